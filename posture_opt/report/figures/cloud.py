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
from posture_opt.report.page.colours import BLUE, CLEARANCE_COLOUR, GREY, ORANGE, PURPLE, VERMILLION
from posture_opt.report.page.style import Look, legend, new_axes, new_figure, square, styled
from posture_opt.report.text.words import PARTS, line_words
from posture_opt.statements.notation import length, length_unit, stated_length
from posture_opt.uncertainty.cloud import cloud_of
from posture_opt.uncertainty.regions import Ellipsoid, coverage_factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

    from posture_opt import Cloud, Spread
    from posture_opt.uncertainty.clearance import Critical
    from posture_opt.uncertainty.task_spread import TaskSpread

_PARALLEL_SINE = 1e-6  # sine of the angle below which two lines are one


def axis_name(axis: Array, direction: Array | None = None) -> str:
    """What the axis of a figure is called; ``axis`` (3,), ``direction`` (3,)."""
    letter = line_words(axis)
    if len(letter) == 1:
        return letter
    if direction is not None and np.linalg.norm(np.cross(axis, direction)) < _PARALLEL_SINE:
        return "along the direction of the task"
    across = direction is not None and abs(float(axis @ direction)) < _PARALLEL_SINE
    where = "horizontally" if abs(float(axis[2])) < _PARALLEL_SINE else "upwards"
    return f"across the direction, {where}" if across else f"{where} in the plane drawn"


def levelled(plane: Array) -> Array:
    """Another orthonormal basis (2, 3) of a plane (2, 3): along coordinate axes, else with the first horizontal."""
    if all(len(line_words(axis)) == 1 for axis in plane):
        return plane
    normal = np.cross(plane[0], plane[1])
    letters = [e for e in np.eye(3) if abs(float(e @ normal)) < _PARALLEL_SINE]
    if len(letters) == 2:
        return np.array(letters)
    first = np.cross([0.0, 0.0, 1.0], normal)
    first = first / np.linalg.norm(first)
    first = first * np.sign(first[np.argmax(np.abs(first))])
    second = np.cross(normal, first)
    return np.array([first, second * (1.0 if second[2] >= 0 else -1.0)])


def critical_axis(critical: Critical) -> str:
    """Where the part that counts scatters most: "along the worst axis across the direction (x)"."""
    part = PARTS[critical.within]
    return with_letter(part if len(critical.covariance) == 1 else f"along the worst axis {part}", critical.worst_axis)


def with_letter(words: str, axis: Array) -> str:
    """Words for an axis, and its letter where it is one of the world's."""
    letter = line_words(axis)
    return f"{words} ({letter})" if len(letter) == 1 else words


def decimals(axis: Axis) -> None:
    """Ticks of a logarithmic axis (x or y of some axes) as plain decimals; between decades where there are few."""
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    # More than 2.5 decades need no ticks between.
    few = high / low < 10**2.5
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if few else (1,), numticks=20))
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_minor_formatter(NullFormatter())


_CLOUD_SAMPLES = 2000


@styled
def plot_cloud(cloud: Cloud) -> Figure:
    """The simulated tool points with the 95 % ellipses of the closed form and of the sample. A planar arm is drawn in
    its plane, others in three views: across the direction of the task and from both sides, or along the axes of the
    world where nothing is to be done along a direction. Where both ellipses cover each other, the closed form is true;
    where the cloud is bent, no ellipse is."""
    spread, seen = cloud.spread, cloud.spread.for_task
    views = [spread.basis]
    if len(spread.basis) == 3:
        # The axes across and along the direction of the task, or those of the world.
        sided = seen is not None and seen.critical.within != "all"
        frame = np.vstack([levelled(seen.axes[:2]), seen.direction]) if seen is not None and sided else np.eye(3)
        views = [frame[list(pair)] for pair in combinations(range(3), 2)]
    unit, scale = length_unit([float(spread.ellipse.semi_axes[-1])])
    offsets = cloud.points[:5000] - spread.position
    half = 1.1 * scale * float(np.abs(offsets).max()) or 1.0
    figure = new_figure(5.0 if len(views) == 1 else 3.6)
    for k, B in enumerate(views, start=1):
        axes = figure.add_subplot(1, len(views), k)
        if k == 1 and len(views) > 1 and seen is not None and seen.critical.within != "all":
            axes.set_title("seen along the direction of the task")
        _view(axes, cloud, B, offsets @ B.T, scale)
        # What the task counts is drawn in a view that shows all of it.
        if seen is not None and np.allclose(seen.critical.basis @ B.T @ B, seen.critical.basis, atol=1e-9):
            if len(seen.critical.covariance) == 1:
                _band(axes, seen, B, scale, half)
            clearance_lines(axes, seen, B, scale, half)
        direction = None if seen is None else seen.direction
        square(axes, half, *(f"{axis_name(b, direction)} [{unit}]" for b in B))
        axes.locator_params(nbins=5 if len(views) > 1 else 9)
    legend(figure, beside=len(views) == 1)
    return figure


def plot_simulated(spread: Spread) -> Figure:
    """The cloud of a small simulation next to the closed form."""
    return plot_cloud(cloud_of(spread, _CLOUD_SAMPLES, 0))


def _view(axes: Axes, cloud: Cloud, B: Array, points: Array, scale: float) -> None:
    """One view: points (n, 2) [m] and both ellipses about the nominal tool point; ``B`` (2, 3)."""
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
    """n simulated tool points about the ``origin``, seen along the direction (a planar arm: in its plane). With the
    clearance of the hole, the direction that counts where it is one alone, and the other end of a peg. The share of
    dots inside the green line is the probability of success; the diamond is the mean, whose offset no repetition
    averages out."""
    spread = spread.seen
    B = view_basis(spread, seen)
    points = (cloud_of(spread, n, seed).points - spread.position) @ B.T
    ellipse = Ellipsoid(B @ spread.bias, B @ spread.covariance @ B.T)
    unit, scale = length_unit([float(ellipse.semi_axes[-1])])
    figure, axes = new_axes(5.0)
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
    legend(figure, beside=True)
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
    square(axes, half or 1.0, *(f"{axis_name(b, seen.direction)}, off the {origin} [{unit}]" for b in B))


def view_basis(spread: Spread, seen: TaskSpread) -> Array:
    """What is looked at, (2, 3), rows orthonormal in the world frame: a plane across the direction, a line and the
    direction where one axis counts, the plane of both longest axes, the plane of a planar arm."""
    basis = seen.critical.basis
    if len(spread.basis) == 2:
        return np.asarray(spread.basis)
    if len(basis) == 1:
        return np.array([levelled(seen.axes[:2])[0], seen.direction])
    return levelled(basis if len(basis) == 2 else spread.axes[::-1][:2])


def _band(axes: Axes, seen: TaskSpread, B: Array, scale: float, half: float) -> None:
    """The 95 % interval of the one direction that counts, as a band through the plane. Its half width is ``1.960 σ``
    about the bias along that direction; an arrow near the edge shows the direction."""
    along = B @ seen.critical.basis[0]
    side = np.array([-along[1], along[0]])
    centre = float(seen.critical.bias[0]) * scale
    width = coverage_factor(0.95, 1) * seen.critical.sigma_max * scale
    ends, reach = (centre - width, centre + width), 3 * half * side
    strip = np.array(
        [ends[0] * along - reach, ends[1] * along - reach, ends[1] * along + reach, ends[0] * along + reach]
    )
    name = {"across": "across the direction", "along": "along the direction"}.get(seen.critical.within, "")
    label = f"95 % interval {name}: \N{PLUS-MINUS SIGN}{length(width / scale)}"
    axes.fill(*strip.T, facecolor=ORANGE, alpha=0.18, edgecolor=ORANGE, lw=1, zorder=1, label=label)
    aside = -0.88 * half * side  # near the edge, where it hides no point
    arrow = {"arrowstyle": "<|-|>", "color": "black", "lw": 2.0}
    axes.annotate("", aside + along * 0.45 * half, aside - along * 0.45 * half, zorder=7, arrowprops=arrow)
    axes.plot([], [], color="black", lw=2.0, label="the direction that counts")


def clearance_lines(axes: Axes, seen: TaskSpread, B: Array, scale: float, half: float) -> None:
    """The clearance of the hole about the target: a circle, or two lines where one direction counts; nothing without a
    clearance, or where all directions count. The legend alone names one that is larger than the picture."""
    if math.isnan(seen.clearance) or seen.critical.within == "all":
        return
    r, one = seen.clearance * scale, len(seen.critical.covariance) == 1
    along = B @ seen.critical.basis[0]
    inside = r < half * abs(along).sum() if one else r < 1.41 * half
    label = f"clearance {stated_length(seen.clearance)}" + " (outside the picture)" * (not inside)
    look: Look = {"ls": "--", "color": CLEARANCE_COLOUR, "zorder": 3}
    if one:
        reach = 3 * half * np.array([-along[1], along[0]])
        for sign, name in ((1, label), (-1, None)):
            axes.plot(*np.array([sign * r * along - reach, sign * r * along + reach]).T, **look, label=name)
        return
    angle = np.linspace(0, 2 * math.pi, 181)
    axes.plot(r * np.cos(angle), r * np.sin(angle), **look, label=label)
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)
    axes.axvline(0, color=GREY, lw=0.6, zorder=0)
