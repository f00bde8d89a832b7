"""Scatter of the residuals compared with the normal distribution, and of repeated visits about their mean.

Lengths are in mm; ellipses state how many standard deviations they are drawn at.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.measurements.measurements import rows_of
from posture_opt.measurements.repeats import repeats_of_one_kind
from posture_opt.numerics import Array, Codes
from posture_opt.report.figures.residuals import chosen_rows, dots_look
from posture_opt.report.page.colours import BLUE, GREEN, GREY, ORANGE, VERMILLION
from posture_opt.report.page.style import Look, legend, new_figure, square, styled
from posture_opt.report.text.words import line_words
from posture_opt.uncertainty.regions import Ellipsoid, coverage_factor, hotelling_factor
from posture_opt.validation.prediction import ErrorSources, prismatic_joints
from posture_opt.validation.repeat_scatter import repeat_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.report.figures.residuals import Shown
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.assessment import Assessment


_BIN_RANGE = (8, 60)


@styled
def plot_shape(shown: Shown) -> Figure:
    """Histograms [mm] with the normal curve and, below, quantiles over normal ones, axis by axis. Quantiles on the
    line: the errors are normal. Ends that bend away from it are heavy tails; a point outside of the grey band happens
    in 5 % of normal samples at that rank."""
    axes_of = shown.axes
    figure = new_figure(5.4)
    grid = figure.subplots(2, len(axes_of), squeeze=False)
    for column, axis in zip(grid.T, axes_of, strict=True):
        values = shown.errors["calibrated"][:, axis]
        _histogram(column[0], values)
        _quantiles(column[1], values)
        column[0].set_xlabel(shown.error_label(axis))
        column[1].set_xlabel("normal quantile [std. dev.]")
    grid[0][0].set_ylabel("rows")
    grid[1][0].set_ylabel("measured [std. dev.]")
    legend(figure)
    return figure


def _histogram(axes: Axes, values: Array) -> None:
    """Counts in about as many bins as the root of their number, and the normal curve of equal mean and deviation;
    ``values`` (n,) [mm]."""
    mean, sd = values.mean(), values.std(ddof=1)
    bins = int(np.clip(np.sqrt(len(values)), *_BIN_RANGE))
    _, edges, _ = axes.hist(values, bins, color=BLUE, alpha=0.6, zorder=2)
    x = np.linspace(mean - 4 * sd, mean + 4 * sd, 200)
    curve = np.exp(-(((x - mean) / sd) ** 2) / 2) / (sd * np.sqrt(2 * np.pi))
    axes.locator_params(axis="x", nbins=5)
    axes.plot(x, curve * len(values) * (edges[1] - edges[0]), color=VERMILLION, zorder=3)


def _quantiles(axes: Axes, values: Array) -> None:
    """Ordered values over those of as many normal ones, and where 95 % of normal ones are, each by itself. The k-th of
    n uniform numbers has a beta distribution with parameters k and n + 1 − k; the k-th value is drawn over the normal
    quantile of ``(k − 1/2) / n``; ``values`` (n,) [mm]."""
    from scipy.special import betaincinv, ndtri

    n = len(values)
    ordered = (np.sort(values) - values.mean()) / values.std(ddof=1)
    # Of many rows 300; the outer ones, which show the tails, are all drawn.
    tail = np.arange(1.0, min(n, 50) + 1)
    rank = np.unique(np.concatenate([np.linspace(1, n, min(n, 300)).round(), tail, n + 1 - tail])).astype(int)
    ordered = ordered[rank - 1]
    normal = ndtri((rank - 0.5) / n)
    low, high = (ndtri(betaincinv(rank, n + 1 - rank, p)) for p in (0.025, 0.975))
    axes.fill_between(normal, low, high, color=GREY, alpha=0.3, lw=0, zorder=1, label="95 % of normal ones")
    axes.plot(normal[[0, -1]], normal[[0, -1]], color=VERMILLION, lw=1.2, zorder=2, label="normal distribution")
    axes.plot(normal, ordered, ".", color=BLUE, ms=7, mew=0, zorder=3, label="errors")


@styled
def plot_region(shown: Shown, found: Assessment) -> Figure:
    """Errors of the calibrated model [mm] with the 95 % ellipse for so many samples, and what the instrument adds. The
    factor is Hotelling's for an estimated covariance, ``sqrt(2 ν/(ν − 1) F₀.₉₅(2, ν − 1))`` with ν degrees of freedom:
    larger than 2.448. An ellipse much larger than the circle of the instrument is scatter of the arm or an error that
    the model does not explain."""
    left = found.residual_scatter
    assert left is not None
    pairs = [(a, b) for k, a in enumerate(shown.axes) for b in shown.axes[k + 1 :]]
    figure = new_figure(5.0 if len(pairs) == 1 else 3.5)
    rows = chosen_rows(len(shown.data), 2000)
    errors = shown.errors["calibrated"]
    half = 1.05 * float(np.abs(errors[rows]).max())
    factor = hotelling_factor(0.95, 2, left.dof)
    rows_or_poses = "samples" if left.dof == left.samples else "poses"
    for k, pair in enumerate(pairs):
        axes = figure.add_subplot(1, len(pairs), k + 1)
        points = errors[:, list(pair)]
        region = Ellipsoid(np.zeros(2), points.T @ points / len(points))
        few = f"{len(rows)} of " if len(rows) < len(points) else ""
        dots: Look = {"color": BLUE, "mew": 0, "rasterized": True, **dots_look(len(rows))}
        axes.plot(*points[rows].T, ".", zorder=2, label=f"{few}{len(points)} errors", **dots)
        label = f"95 % ellipse for {left.dof} {rows_or_poses} ({factor:.3f} std. dev.)"
        axes.plot(*boundary(region, factor).T, color=VERMILLION, lw=2.2, zorder=4, label=label)
        if found.instrument:
            circle = Ellipsoid(np.zeros(2), (1e3 * found.instrument) ** 2 * np.eye(2))
            label = "95 % circle of the instrument"
            axes.plot(*boundary(circle, coverage_factor(0.95, 2)).T, "--", color=GREEN, zorder=5, label=label)
        square(axes, half, *map(shown.error_label, pair))
        axes.locator_params(nbins=5 if len(pairs) > 1 else 9)
    legend(figure, beside=len(pairs) == 1)
    return figure


def boundary(ellipse: Ellipsoid, factor: float) -> Array:
    """The curve (121, 2) at ``factor`` standard deviations of an ellipse, in the unit of the ellipse. ``center + factor
    · A diag(s) (cos φ, sin φ)`` with the axes A and the semi-axes s."""
    angle = np.linspace(0, 2 * np.pi, 121)
    circle = np.array([np.cos(angle), np.sin(angle)])
    return np.asarray(ellipse.center + (factor * ellipse.axes * ellipse.semi_axes @ circle).T)


@styled
def plot_repeats(problem: ProblemData, shown: Shown, found: Assessment) -> Figure:
    """The postures with most visits one by one; where none has five, all visits about the means of theirs. Visits [mm]
    about their mean, their covariance (dashed) and the scatter that the problem predicts for them. Dots well outside of
    the red ellipse: the arm scatters more than the file states."""
    B = _plane(shown, found)
    odd = found.repeats.outlying if found.repeats is not None else ()
    visits = rows_of(repeats_of_one_kind(shown.data, prismatic_joints(shown.residuals)))
    known = [rows for rows in visits if len(rows) > 1 and int(shown.data.line[rows[0]]) not in odd]
    groups = sorted(known, key=len, reverse=True)
    # Five visits of a pose make a cloud.
    clouds = [rows for rows in groups if len(rows) >= 5][:6] or [np.concatenate(groups)]
    alone = len(clouds) == 1 and len(groups) > 1
    columns = min(len(clouds), 3)
    lines = -(-len(clouds) // columns)
    figure = new_figure((8.0 / columns - 0.1) * lines + 0.7 if columns > 1 else 5.0)
    predicted = [_predicted(problem, shown, rows, B) for rows in clouds]
    offsets = [_about_mean(shown, rows, B) for rows in clouds]
    if alone:
        # Offsets from the mean of n visits are too small by √(1 − 1/n); divided by that, they scatter as visits do.
        offsets = [np.concatenate([_about_mean(shown, g, B) / np.sqrt(1 - 1 / len(g)) for g in groups])]
    outlines = [boundary(one, coverage_factor(0.95, 2)) for one in predicted if one is not None]
    half = 1.08 * max(float(np.abs(outline).max()) for outline in [*offsets, *outlines])
    for k, (rows, cloud, ellipse) in enumerate(zip(clouds, offsets, predicted, strict=True)):
        axes = figure.add_subplot(lines, columns, k + 1)
        _panel(axes, cloud, ellipse)
        title = (
            f"all visits of {len(groups)} postures, together"
            if alone
            else f"{len(rows)} visits, line {shown.data.line[rows[0]]}"
        )
        axes.set_title(title)
        square(axes, half, *(f"{line_words(b)} [mm]" for b in B))
        axes.locator_params(nbins=5)
    legend(figure, beside=columns == 1)
    return figure


def _panel(axes: Axes, cloud: Array, predicted: Ellipsoid | None) -> None:
    """One cloud of visits (k, 2) [mm] with the ellipse that was predicted."""
    axes.plot(*cloud[:4000].T, ".", color=BLUE, ms=6 if len(cloud) < 100 else 3.5, mew=0, alpha=0.7, zorder=2,
              label="visits about their mean")  # fmt: skip
    known = coverage_factor(0.95, 2)
    if predicted is not None:
        axes.plot(*boundary(predicted, known).T, color=VERMILLION, lw=2.2, zorder=4, label="95 % ellipse, predicted")
    measured = Ellipsoid(np.zeros(2), np.cov(cloud, rowvar=False))
    axes.plot(*boundary(measured, known).T, "--", color=ORANGE, zorder=3, label="covariance of the visits, drawn alike")


def _plane(shown: Shown, found: Assessment) -> Array:
    """(2, 3) the plane that is drawn: across the task, else the first two axes that were measured."""
    axes, d = shown.axes, found.direction
    if len(axes) == 2 or d is None:
        return np.eye(3)[list(axes[:2])]
    first = np.eye(3)[int(np.argmin(np.abs(d)))]
    first = first - (first @ d) * d
    first /= np.linalg.norm(first)
    second = np.cross(d, first)
    return np.array([first, second if second[np.abs(second).argmax()] > 0 else -second])


def _about_mean(shown: Shown, rows: Codes, B: Array) -> Array:
    """(k, 2) visits about their mean [mm], in the plane of B (2, 3)."""
    cloud = shown.places[rows] @ B.T
    return np.asarray(cloud - cloud.mean(axis=0))


def _predicted(problem: ProblemData, shown: Shown, rows: Codes, B: Array) -> Ellipsoid | None:
    """The scatter [mm²] of visits by the problem: what it says changes from repeat to repeat, and its instrument. ``C =
    mean_k J_k Σ J_kᵀ + σ² I`` over the rows, projected on the plane of B (2, 3); None where it is zero."""
    residuals = shown.residuals.take(rows)
    errors = ErrorSources.of(residuals, problem.sources)
    J = residuals.sigma * residuals.sensitivities(errors.names, shown.x)[:, : len(shown.axes)]
    instrument = problem.measurement.position if problem.measurement is not None else 0.0
    C = J @ repeat_errors(errors, residuals)[0] @ np.swapaxes(J, -1, -2)
    C = C.mean(axis=0) + (instrument or 0.0) ** 2 * np.eye(len(shown.axes))
    drawn = B[:, list(shown.axes)]
    return Ellipsoid(np.zeros(2), 1e6 * drawn @ C @ drawn.T) if np.trace(C) > 0 else None
