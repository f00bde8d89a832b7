"""The Monte Carlo cloud beside the closed form."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from posture_opt.numerics import Array
from posture_opt.report.style import BLUE, ORANGE, VERMILLION, legend_below, new_figure, styled
from posture_opt.report.units_text import length_unit
from posture_opt.report.words import line_words
from posture_opt.uncertainty.regions import Ellipsoid

if TYPE_CHECKING:
    from posture_opt.uncertainty.cloud import Cloud

_DRAWN = 5000


@styled
def plot_cloud(cloud: Cloud) -> Figure:
    """The simulated tool points with the 95 % ellipses of the closed form and of the sample.

    A planar arm is drawn in its plane, others in the three views along the axes of the world.
    """
    spread = cloud.spread
    views = [spread.basis] if len(spread.basis) == 2 else [np.eye(3)[list(pair)] for pair in combinations(range(3), 2)]
    unit, scale = length_unit([float(spread.ellipse.semi_axes[-1])])
    offsets = cloud.points[:_DRAWN] - spread.position
    half = 1.1 * scale * float(np.abs(offsets).max())
    figure = new_figure(6.2, 6.4) if len(views) == 1 else new_figure(10.5, 4.4)
    for k, B in enumerate(views, start=1):
        axes = figure.add_subplot(1, len(views), k)
        _view(axes, cloud, B, offsets @ B.T, scale)
        axes.set(xlabel=f"{line_words(B[0])}, off the nominal point [{unit}]")
        axes.set(ylabel=f"{line_words(B[1])}, off the nominal point [{unit}]")
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        axes.locator_params(nbins=5 if len(views) > 1 else 9)
    legend_below(axes, 2)
    return figure


def _view(axes: Any, cloud: Cloud, B: Array, points: Array, scale: float) -> None:
    spread = cloud.spread
    shown = f"{len(points)} of " if len(points) < cloud.n else ""
    drawn = f"{shown}{cloud.n} simulated tool points"
    axes.plot(*(scale * points).T, ".", color=BLUE, ms=3.5, alpha=0.5, mew=0, zorder=2, label=drawn)
    closed = Ellipsoid(B @ spread.bias, B @ spread.covariance @ B.T)
    sampled = Ellipsoid(B @ (cloud.mean - spread.position), B @ cloud.covariance @ B.T)
    label = f"95 % ellipse, closed form ({closed.factor(0.95):.3f} std. dev.)"
    axes.plot(*(scale * closed.points(0.95)).T, color=VERMILLION, lw=2.6, zorder=4, label=label)
    axes.plot(*(scale * sampled.points(0.95)).T, "--", color=ORANGE, zorder=5, label="95 % ellipse, simulated")
    axes.plot(0, 0, "x", color="black", ms=8, mew=2, zorder=6, label="nominal tool point")
