"""Repeated visits about their mean, with the ellipse that the problem's joint scatter and instrument predict."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from posture_opt.measurements.repeat_groups import repeat_groups, rows_of
from posture_opt.numerics import Codes
from posture_opt.report.figures.residual_shape import boundary
from posture_opt.report.style import BLUE, ORANGE, VERMILLION, legend_below, new_figure, styled
from posture_opt.report.words import line_words
from posture_opt.uncertainty.regions import Ellipsoid, coverage_factor
from posture_opt.validation.prediction import ErrorSources
from posture_opt.validation.repeat_scatter import repeat_errors, slides

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem
    from posture_opt.report.figures.residuals import Shown
    from posture_opt.validation.assessment import Assessment

Floats = NDArray[np.float64]

_PANELS = 6
_FEWEST = 5  # visits of a pose that make a cloud
_DOTS = 4000


@styled
def plot_repeats(problem: Problem, shown: Shown, found: Assessment) -> Figure:
    """The postures with most visits one by one; where none has five, all visits about the means of theirs."""
    B = _plane(shown, found)
    groups = sorted(_visits(shown, found), key=len, reverse=True)
    clouds = [rows for rows in groups if len(rows) >= _FEWEST][:_PANELS] or [np.concatenate(groups)]
    alone = len(clouds) == 1 and len(groups) > 1
    columns = min(len(clouds), 3)
    lines = -(-len(clouds) // columns)
    figure = new_figure(3.4 * columns + 0.4, 3.5 * lines + 0.9) if columns > 1 else new_figure(5.6, 6.0)
    predicted = [_predicted(problem, shown, rows, B) for rows in clouds]
    offsets = [_pooled(shown, groups, B) if alone else _about_mean(shown, rows, B) for rows in clouds]
    half = 1.08 * max(float(np.abs(outline).max()) for outline in [*offsets, *_outlines(predicted)])
    for k, (rows, cloud, ellipse) in enumerate(zip(clouds, offsets, predicted, strict=True)):
        axes = figure.add_subplot(lines, columns, k + 1)
        _panel(axes, cloud, ellipse)
        title = (
            f"all visits of {len(groups)} postures, together"
            if alone
            else f"{len(rows)} visits, line {shown.data.line[rows[0]]}"
        )
        axes.set_title(title)
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        axes.set(xlabel=f"{line_words(B[0])} [mm]", ylabel=f"{line_words(B[1])} [mm]")
        axes.locator_params(nbins=5)
    legend_below(figure.axes[0], min(columns, 3))
    return figure


def _outlines(ellipses: list[Ellipsoid | None]) -> list[Floats]:
    return [boundary(ellipse, coverage_factor(0.95, 2)) for ellipse in ellipses if ellipse is not None]


def _panel(axes: Any, cloud: Floats, predicted: Ellipsoid | None) -> None:
    axes.plot(*cloud[:_DOTS].T, ".", color=BLUE, ms=6 if len(cloud) < 100 else 3.5, mew=0, alpha=0.7, zorder=2,
              label="visits about their mean")  # fmt: skip
    known = coverage_factor(0.95, 2)
    if predicted is not None:
        axes.plot(*boundary(predicted, known).T, color=VERMILLION, lw=2.2, zorder=4, label="95 % ellipse, predicted")
    measured = Ellipsoid(np.zeros(2), np.cov(cloud, rowvar=False))
    axes.plot(*boundary(measured, known).T, "--", color=ORANGE, zorder=3, label="covariance of the visits, drawn alike")


def _plane(shown: Shown, found: Assessment) -> Floats:
    """(2, 3) the plane that is drawn: across the task, else the first two axes that were measured."""
    axes, d = shown.axes, found.direction
    if len(axes) == 2 or d is None:
        return np.eye(3)[list(axes[:2])]
    first = np.eye(3)[int(np.argmin(np.abs(d)))]
    first = first - (first @ d) * d
    first /= np.linalg.norm(first)
    second = np.cross(d, first)
    return np.array([first, second if second[np.abs(second).argmax()] > 0 else -second])


def _visits(shown: Shown, found: Assessment) -> list[Codes]:
    """The rows of each posture that was visited more than once, slips left out."""
    odd = found.repeats.outlying if found.repeats is not None else ()
    groups = rows_of(repeat_groups(shown.data, slides(shown.residuals)))
    return [rows for rows in groups if len(rows) > 1 and int(shown.data.line[rows[0]]) not in odd]


def _about_mean(shown: Shown, rows: Codes, B: Floats) -> Floats:
    cloud = shown.places[rows] @ B.T
    return np.asarray(cloud - cloud.mean(axis=0))


def _pooled(shown: Shown, groups: list[Codes], B: Floats) -> Floats:
    """Offsets from the mean of n visits are too small by √(1 − 1/n); set right, they scatter as visits do."""
    return np.concatenate([_about_mean(shown, rows, B) / np.sqrt(1 - 1 / len(rows)) for rows in groups])


def _predicted(problem: Problem, shown: Shown, rows: Codes, B: Floats) -> Ellipsoid | None:
    """The scatter [mm²] of visits by the problem: what it says changes from repeat to repeat, and its instrument."""
    residuals = shown.residuals.take(rows)
    errors = ErrorSources.of(residuals, problem.sources)
    J = residuals.sigma * residuals.sensitivities(errors.names, shown.x)[:, : len(shown.axes)]
    instrument = problem.measurement.position if problem.measurement is not None else 0.0
    C = J @ repeat_errors(errors, residuals)[0] @ np.swapaxes(J, -1, -2)
    C = C.mean(axis=0) + (instrument or 0.0) ** 2 * np.eye(len(shown.axes))
    drawn = B[:, list(shown.axes)]
    return Ellipsoid(np.zeros(2), 1e6 * drawn @ C @ drawn.T) if np.trace(C) > 0 else None
