"""How the tool point scatters: its simulated cloud as a whole, and as the task sees it.

Ellipses of a plane hold 95 % at 2.448 standard deviations, intervals of a line at 1.960: drawn regions state their
factor.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.figures.axis_names import axis_name, levelled
from posture_opt.report.page.colours import BLUE, CLEARANCE_COLOUR, GREY, ORANGE, PURPLE, VERMILLION
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import legend_below, legend_beside, styled
from posture_opt.statements.notation import length, length_unit, stated_length
from posture_opt.uncertainty.regions.regions import Ellipsoid, coverage_factor
from posture_opt.uncertainty.simulation.cloud import cloud_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.uncertainty.simulation.cloud import Cloud
    from posture_opt.uncertainty.spread.spread import Spread
    from posture_opt.uncertainty.spread.task_spread import TaskSpread

_MAX_DRAWN_POINTS = 5000
_CLOUD_SAMPLES = 2000


@styled
def plot_cloud(cloud: Cloud) -> Figure:
    """The simulated tool points with the 95 % ellipses of the closed form and of the sample.

    A planar arm is drawn in its plane, others in three views: across the direction of the task and from both sides, or
    along the axes of the world where nothing is to be done along a direction. Where both ellipses cover each other,
    the closed form is true; where the cloud is bent, no ellipse is.
    """
    spread, seen = cloud.spread, cloud.spread.for_task
    views = _views(spread, seen)
    unit, scale = length_unit([float(spread.ellipse.semi_axes[-1])])
    offsets = cloud.points[:_MAX_DRAWN_POINTS] - spread.position
    half = 1.1 * scale * float(np.abs(offsets).max()) or 1.0
    figure = new_figure(5.0 if len(views) == 1 else 3.6)
    for k, B in enumerate(views, start=1):
        axes = figure.add_subplot(1, len(views), k)
        if k == 1 and len(views) > 1 and seen is not None and seen.critical.within != "all":
            axes.set_title("seen along the direction of the task")
        _view(axes, cloud, B, offsets @ B.T, scale)
        _task_marks(axes, seen, B, scale, half)
        direction = None if seen is None else seen.direction
        axes.set(xlabel=f"{axis_name(B[0], direction)} [{unit}]", ylabel=f"{axis_name(B[1], direction)} [{unit}]")
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        axes.locator_params(nbins=5 if len(views) > 1 else 9)
    (legend_beside if len(views) == 1 else legend_below)(figure)
    return figure


def plot_simulated(spread: Spread) -> Figure:
    """The cloud of a small simulation next to the closed form."""
    return plot_cloud(cloud_of(spread, _CLOUD_SAMPLES, 0))


def _views(spread: Spread, seen: TaskSpread | None) -> list[Array]:
    """The planes that are looked at, (2, 3) each, rows orthonormal in the world frame.

    One for a planar arm, else three: of the axes across and along the direction of the task, or of the world's axes.
    """
    if len(spread.basis) == 2:
        return [spread.basis]
    frame = np.eye(3)
    if seen is not None and seen.critical.within != "all":
        frame = np.vstack([levelled(seen.axes[:2]), seen.direction])
    return [frame[list(pair)] for pair in combinations(range(3), 2)]


def _task_marks(axes: Axes, seen: TaskSpread | None, B: Array, scale: float, half: float) -> None:
    """The direction that counts and the clearance, in a view that shows all that counts.

    Args:
        B: (2, 3) axes of the view, world.
        scale: from m to the unit of the figure; ``half`` half the side of the picture in that unit.
    """
    if seen is None or not np.allclose(seen.critical.basis @ B.T @ B, seen.critical.basis, atol=1e-9):
        return
    if len(seen.critical.covariance) == 1:
        _band(axes, seen, B, scale, half)
    clearance_lines(axes, seen, B, scale, half)


def _view(axes: Axes, cloud: Cloud, B: Array, points: Array, scale: float) -> None:
    """One view: points (n, 2) [m] and both ellipses about the nominal tool point.

    Args:
        B: (2, 3) the axes of the view, world.
        scale: from m to the unit of the figure.
    """
    spread = cloud.spread
    shown = f"{len(points)} of " if len(points) < cloud.n else ""
    drawn = f"{shown}{cloud.n} simulated tool points"
    axes.plot(*(scale * points).T, ".", color=BLUE, ms=4, alpha=0.45, mew=0, rasterized=True, zorder=2, label=drawn)
    closed = Ellipsoid(B @ spread.bias, B @ spread.covariance @ B.T)
    sampled = Ellipsoid(B @ (cloud.mean - spread.position), B @ cloud.covariance @ B.T)
    label = f"95 % ellipse, closed form ({closed.factor(0.95):.3f} std. dev.)"
    axes.plot(*(scale * closed.points(0.95)).T, color=VERMILLION, lw=2.6, zorder=4, label=label)
    axes.plot(*(scale * sampled.points(0.95)).T, "--", color=ORANGE, zorder=5, label="95 % ellipse, simulated")
    mark_origin(axes, "nominal tool point")


@styled
def plot_cross_section(
    spread: Spread, seen: TaskSpread, n: int = _CLOUD_SAMPLES, seed: int = 0, origin: str = "target"
) -> Figure:
    """n simulated tool points about the ``origin``, seen along the direction (a planar arm: in its plane).

    With the clearance of the hole, the direction that counts where it is one alone, and the other end of a peg. The
    share of dots inside the green line is the probability of success; the diamond is the mean, whose offset no
    repetition averages out.

    Args:
        n: number of samples, drawn with ``seed``.
        origin: what the origin of the axes is, in words.
    """
    spread = spread.seen
    B = view_basis(spread, seen)
    points = (cloud_of(spread, n, seed).points - spread.position) @ B.T
    ellipse = Ellipsoid(B @ spread.bias, B @ spread.covariance @ B.T)
    unit, scale = length_unit([float(ellipse.semi_axes[-1])])
    figure = new_figure(5.0)
    axes = figure.add_subplot()
    label = f"{n} simulated tool points"
    axes.plot(*(scale * points).T, ".", color=BLUE, ms=4, alpha=0.45, mew=0, rasterized=True, zorder=2, label=label)
    boundary = scale * ellipse.points(0.95)
    axes.plot(*boundary.T, color=VERMILLION, zorder=4, label=f"95 % ellipse ({ellipse.factor(0.95):.3f} std. dev.)")
    boundary = np.vstack([boundary, _top_end(axes, seen, B, scale)])
    mark_origin(axes, origin)
    axes.plot(*(scale * ellipse.center), "D", color=VERMILLION, mec="white", ms=7, zorder=7, ls="none", label="mean")
    half = 1.12 * float(np.abs(np.vstack([scale * points, boundary])).max())
    if len(seen.critical.covariance) == 1:
        _band(axes, seen, B, scale, half)
    clearance_lines(axes, seen, B, scale, half)
    frame_target(axes, seen, B, half, unit, origin)
    legend_beside(figure)
    return figure


def _top_end(axes: Axes, seen: TaskSpread, B: Array, scale: float) -> Array:
    """(k, 2) the 95 % ellipse of the other end of a peg, drawn dashed where the view is across the direction."""
    if seen.peg is None or len(seen.peg.top.basis) != 2:
        return np.zeros((0, 2))
    top, turn = seen.peg.top, B @ seen.peg.top.basis.T
    if abs(abs(np.linalg.det(turn)) - 1) > 1e-9:  # another plane
        return np.zeros((0, 2))
    boundary = scale * Ellipsoid(turn @ top.bias, turn @ top.covariance @ turn.T).points(0.95)
    axes.plot(*boundary.T, "--", color=PURPLE, zorder=4, label="95 % ellipse of the top end of the peg")
    return np.asarray(boundary)


def mark_origin(axes: Axes, label: str) -> None:
    """A cross whose arms reach beyond every mark that may lie on it."""
    axes.plot(0, 0, "+", color="black", ms=22, mew=1.4, zorder=6)
    axes.plot([], [], "+", color="black", ms=9, mew=1.4, ls="none", label=label)  # in the legend no line is that high


def frame_target(axes: Axes, seen: TaskSpread, B: Array, half: float, unit: str, origin: str = "target") -> None:
    """The square about the target that is shown, with its axes named: one unit about a point without any spread."""
    half = half or 1.0
    names = [f"{axis_name(b, seen.direction)}, off the {origin} [{unit}]" for b in B]
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal", xlabel=names[0], ylabel=names[1])


def view_basis(spread: Spread, seen: TaskSpread) -> Array:
    """What is looked at, (2, 3), rows orthonormal in the world frame.

    Across the direction where that is a plane; a line and the direction where one axis counts; the plane of both
    longest axes where all count; the plane of a planar arm.
    """
    critical = seen.critical
    basis: Array
    if len(spread.basis) == 2:
        basis = spread.basis
    elif len(critical.basis) == 2:
        basis = levelled(critical.basis)
    elif len(critical.basis) == 1:
        basis = np.array([levelled(seen.axes[:2])[0], seen.direction])
    else:
        basis = levelled(spread.axes[::-1][:2])
    return basis


def _band(axes: Axes, seen: TaskSpread, B: Array, scale: float, half: float) -> None:
    """The 95 % interval of the one direction that counts, as a band through the plane.

    Its half width is ``1.960 σ`` about the bias along that direction; an arrow near the edge shows the direction.
    """
    along = B @ seen.critical.basis[0]
    centre = float(seen.critical.bias[0]) * scale
    width = coverage_factor(0.95, 1) * seen.critical.sigma_max * scale
    strip = _strip(along, centre - width, centre + width, 3 * half)
    name = {"across": "across the direction", "along": "along the direction"}.get(seen.critical.within, "")
    label = f"95 % interval {name}: \N{PLUS-MINUS SIGN}{length(width / scale)}"
    axes.fill(*strip.T, facecolor=ORANGE, alpha=0.18, edgecolor=ORANGE, lw=1, zorder=1, label=label)
    aside = -0.88 * half * np.array([-along[1], along[0]])  # near the edge, where it hides no point
    ends = (aside + along * 0.45 * half, aside - along * 0.45 * half)
    axes.annotate("", *ends, zorder=7, arrowprops={"arrowstyle": "<|-|>", "color": "black", "lw": 2.0})
    axes.plot([], [], color="black", lw=2.0, label="the direction that counts")


def _strip(along: Array, low: float, high: float, reach: float) -> Array:
    """(4, 2) corners of the band ``low ≤ along · y ≤ high``, as long as ``reach`` both ways."""
    side = np.array([-along[1], along[0]])
    return np.array([low * along - reach * side, high * along - reach * side, high * along + reach * side,
                     low * along + reach * side])  # fmt: skip


def clearance_lines(axes: Axes, seen: TaskSpread, B: Array, scale: float, half: float) -> None:
    """The clearance of the hole about the target: a circle, or two lines where one direction counts.

    Nothing without a clearance, or where all directions count. A clearance larger than the picture is named in the
    legend only.
    """
    clearance = seen.clearance
    if math.isnan(clearance) or seen.critical.within == "all":
        return
    r = clearance * scale
    label = f"clearance {stated_length(clearance)}"
    if len(seen.critical.covariance) == 1:
        along = B @ seen.critical.basis[0]
        side = np.array([-along[1], along[0]])
        inside = r < half * (abs(along).sum())
        for sign in (1, -1):
            line = np.array([sign * r * along - 3 * half * side, sign * r * along + 3 * half * side])
            axes.plot(
                *line.T, "--", color=CLEARANCE_COLOUR, zorder=3, label=_seen(label, inside) if sign == 1 else None
            )
        return
    angle = np.linspace(0, 2 * math.pi, 181)
    axes.plot(
        r * np.cos(angle),
        r * np.sin(angle),
        "--",
        color=CLEARANCE_COLOUR,
        zorder=3,
        label=_seen(label, r < 1.41 * half),
    )
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)
    axes.axvline(0, color=GREY, lw=0.6, zorder=0)


def _seen(label: str, inside: bool) -> str:
    """A label, with a word where what it names lies outside of the picture."""
    return label if inside else f"{label} (outside the picture)"
