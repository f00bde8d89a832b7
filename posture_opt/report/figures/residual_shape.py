"""What remains after calibration: its distribution by axis, and the region that holds 95 % of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from posture_opt.report.figures.residuals import chosen_rows
from posture_opt.report.style import BLUE, GREEN, GREY, VERMILLION, legend_below, new_figure, styled
from posture_opt.uncertainty.regions import Ellipsoid, coverage_factor, hotelling_factor

if TYPE_CHECKING:
    from posture_opt.report.figures.residuals import Shown
    from posture_opt.validation.assessment import Assessment

Floats = NDArray[np.float64]

_DOTS = 2000
_QUANTILES = 300  # of many rows; the outer ones, which tell most, are all drawn
_BINS = (8, 60)


@styled
def plot_shape(shown: Shown) -> Figure:
    """Histograms with the normal curve and, below, quantiles beside normal ones, axis by axis."""
    axes_of = shown.axes
    figure = new_figure(3.2 * len(axes_of), 5.6)
    grid = figure.subplots(2, len(axes_of), squeeze=False)
    for column, axis in zip(grid.T, axes_of, strict=True):
        values = shown.errors["calibrated"][:, axis]
        _histogram(column[0], values)
        _quantiles(column[1], values)
        column[0].set_xlabel(f"error in {'xyz'[axis]} [mm]")
        column[1].set_xlabel("normal quantile [standard deviations]")
    grid[0][0].set_ylabel("rows")
    grid[1][0].set_ylabel("measured [standard deviations]")
    legend_below(grid[1][0], 3)
    return figure


def _histogram(axes: Any, values: Floats) -> None:
    mean, sd = values.mean(), values.std(ddof=1)
    bins = int(np.clip(np.sqrt(len(values)), *_BINS))
    _, edges, _ = axes.hist(values, bins, color=BLUE, alpha=0.6, zorder=2)
    x = np.linspace(mean - 4 * sd, mean + 4 * sd, 200)
    curve = np.exp(-(((x - mean) / sd) ** 2) / 2) / (sd * np.sqrt(2 * np.pi))
    axes.locator_params(axis="x", nbins=5)
    axes.plot(x, curve * len(values) * (edges[1] - edges[0]), color=VERMILLION, zorder=3)


def _quantiles(axes: Any, values: Floats) -> None:
    """Ordered values over those of as many normal ones, and where 95 % of normal ones lie, each by itself."""
    from scipy.special import betaincinv, ndtri

    n = len(values)
    ordered = (np.sort(values) - values.mean()) / values.std(ddof=1)
    rank = np.unique(np.concatenate([np.linspace(1, n, min(n, _QUANTILES)).round(), *_outer(n)])).astype(int)
    ordered = ordered[rank - 1]
    normal = ndtri((rank - 0.5) / n)
    low, high = (ndtri(betaincinv(rank, n + 1 - rank, p)) for p in (0.025, 0.975))
    axes.fill_between(normal, low, high, color=GREY, alpha=0.3, lw=0, zorder=1, label="95 % of normal ones")
    axes.plot(normal[[0, -1]], normal[[0, -1]], color=VERMILLION, lw=1.2, zorder=2, label="normal distribution")
    axes.plot(normal, ordered, ".", color=BLUE, ms=4, mew=0, zorder=3, label="errors")


def _outer(n: int) -> tuple[Floats, Floats]:
    tail = np.arange(1.0, min(n, 50) + 1)
    return tail, n + 1 - tail


@styled
def plot_region(shown: Shown, found: Assessment) -> Figure:
    """Errors of the calibrated model with the 95 % ellipse for so many samples, and what the instrument adds."""
    left = found.residual_scatter
    assert left is not None
    pairs = [(a, b) for k, a in enumerate(shown.axes) for b in shown.axes[k + 1 :]]
    figure = new_figure(6.0, 6.2) if len(pairs) == 1 else new_figure(10.5, 4.4)
    rows = chosen_rows(len(shown.data), _DOTS)
    errors = shown.errors["calibrated"]
    half = 1.05 * float(np.abs(errors[rows]).max())
    factor = hotelling_factor(0.95, 2, left.dof)
    rows_or_poses = "samples" if left.dof == left.samples else "poses"
    for k, pair in enumerate(pairs):
        axes = figure.add_subplot(1, len(pairs), k + 1)
        points = errors[:, list(pair)]
        region = Ellipsoid(np.zeros(2), points.T @ points / len(points))
        few = f"{len(rows)} of " if len(rows) < len(points) else ""
        dots: dict[str, Any] = {"color": BLUE, "ms": 3.5, "alpha": 0.5, "mew": 0, "rasterized": True}
        axes.plot(*points[rows].T, ".", zorder=2, label=f"{few}{len(points)} errors", **dots)
        label = f"95 % ellipse for {left.dof} {rows_or_poses} ({factor:.3f} std. dev.)"
        axes.plot(*boundary(region, factor).T, color=VERMILLION, lw=2.2, zorder=4, label=label)
        if found.instrument:
            circle = Ellipsoid(np.zeros(2), (1e3 * found.instrument) ** 2 * np.eye(2))
            label = "95 % circle of the instrument"
            axes.plot(*boundary(circle, coverage_factor(0.95, 2)).T, "--", color=GREEN, zorder=5, label=label)
        axes.set(xlabel=f"error in {'xyz'[pair[0]]} [mm]", ylabel=f"error in {'xyz'[pair[1]]} [mm]")
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        axes.locator_params(nbins=5 if len(pairs) > 1 else 9)
    legend_below(figure.axes[0], 3 if len(pairs) > 1 else 2)
    return figure


def boundary(ellipse: Ellipsoid, factor: float) -> Floats:
    """(121, 2) the curve at ``factor`` standard deviations."""
    angle = np.linspace(0, 2 * np.pi, 121)
    circle = np.array([np.cos(angle), np.sin(angle)])
    return np.asarray(ellipse.center + (factor * ellipse.axes * ellipse.semi_axes @ circle).T)
