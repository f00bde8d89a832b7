"""Residuals over the joints, over time and other inputs, and by the side that a joint came from.

Lines are means of neighbouring rows with their 95 % band: a line that leaves zero beyond its band is systematic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.measurements.measurements import group_means
from posture_opt.numerics import Array
from posture_opt.report.figures.residuals import TITLES, chosen_rows, dots_look
from posture_opt.report.page.colours import BLUE, GREEN, GREY, MODEL_COLOURS, ORANGE, PURPLE, VERMILLION
from posture_opt.report.page.style import Look, legend, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.report.figures.residuals import Shown


_MAX_DOTS = 800  # more make a fog
MEAN = "black", "mean of neighbours with its 95 % band"
"""Colour and label of a mean in bins."""
_MIN_BIN_POSES = 4  # poses of a bin that is drawn
_MAX_DISTINCT_VALUES = 12  # different values, as of a payload: no more need to be put together
_MIN_BINS, _MAX_BINS = 6, 72  # bins: many, as errors of gears have tens of periods a turn

_SIDE_LOOKS = ((-1, "decreasing", ORANGE, -0.12), (1, "increasing", PURPLE, 0.12))
_AXIS_LOOKS: tuple[Look, ...] = (
    {"color": BLUE, "marker": "o"},
    {"color": VERMILLION, "marker": "s", "ls": "--"},
    {"color": GREEN, "marker": "^", "ls": ":"},
)


@dataclass(frozen=True, eq=False)
class Binned:
    """Means of values in bins along x, each with half its 95 % interval by Student's t; NaN where a bin has too few.
    ``t(0.975, n − 1) s / sqrt(n)`` of the n values of a bin with standard deviation s; ``x`` (b,), ``mean`` (b,),
    ``band`` (b,)."""

    x: Array
    mean: Array
    band: Array

    @classmethod
    def of(cls, x: Array, values: Array, most: int = _MAX_BINS) -> Binned:
        """Of values (n,) at x (n,), in ``most`` bins or fewer; a few different x are bins of their own."""
        from scipy.special import stdtrit

        steps, at = np.unique(x, return_inverse=True)
        bins = len(steps)
        if bins > _MAX_DISTINCT_VALUES:
            bins = max(min(len(x) // 20, most), _MIN_BINS)
            at = np.clip(((x - steps[0]) / (steps[-1] - steps[0]) * bins).astype(int), 0, bins - 1)
        count = np.bincount(at, minlength=bins)
        some = np.where(count >= _MIN_BIN_POSES, count, np.nan)
        mean, middle = np.bincount(at, values, bins) / some, np.bincount(at, x, bins) / some
        variance = np.bincount(at, (values - mean[at]) ** 2, bins) / (some - 1)
        return cls(middle, mean, stdtrit(some - 1, 0.975) * np.sqrt(variance / some))

    def draw(self, axes: Axes, color: str = "black", label: str = "", **look: Any) -> None:
        """The line with its band; it passes over a few empty bins, not over a wide gap."""
        known = np.isfinite(self.mean)
        # No line is drawn over a gap of 8 % of the bins.
        wide = np.flatnonzero(np.diff(np.flatnonzero(known)) > max(0.08 * len(known), 3)) + 1
        x, mean, band = (np.insert(values[known], wide, np.nan) for values in (self.x, self.mean, self.band))
        axes.fill_between(x, mean - band, mean + band, color=color, alpha=0.25, lw=0, zorder=3)
        marker = "o" if len(x) <= _MAX_DISTINCT_VALUES else ""
        axes.plot(x, mean, **{"color": color, "lw": 1.5, "marker": marker, "ms": 4, **look}, zorder=4, label=label)


@styled
def plot_residuals_over_joints(shown: Shown) -> Figure:
    """Errors along the motion of each joint [mm] over its value [deg or mm]: dots are poses, the line is their mean in
    bins. Left before, right after calibration, each side with one scale for all joints. A wave is a gear, a slope a
    compliance or scale, two levels a backlash."""
    seen = _seen_joints(shown)
    joints = [shown.robot.joints[k] for k in seen]
    figure = new_figure(1.0 + 1.35 * len(joints))
    grid = figure.subplots(len(joints), 2, squeeze=False)
    poses = len(np.unique(shown.data.pose))
    some = f"{_MAX_DOTS} of {poses} poses" if poses > _MAX_DOTS else f"{poses} poses"
    for name, column in zip(shown.errors, grid.T, strict=True):
        sizes = []
        for axes, joint, x, along in zip(column, joints, *_along(shown, shown.errors[name], seen), strict=True):
            draw_trend(axes, x, along, (".", MODEL_COLOURS[name], some))
            sizes.append(float(np.quantile(np.abs(along), 0.995)))
            axes.set_xlabel(f"{joint.name} [{'deg' if joint.type == 'revolute' else 'mm'}]", labelpad=1)
        limit = 1.1 * max(sizes, default=1.0)
        for axes in column:
            axes.set_ylim(-limit, limit)
            axes.locator_params(axis="y", nbins=4)
        column[0].set_title(TITLES[name])
    figure.supylabel("error along the joint's own motion [mm]")
    legend(figure)
    return figure


def draw_trend(
    axes: Axes, x: Array, y: Array, dots: tuple[str, str, str], mean: tuple[str, str] = MEAN, bins: int = _MAX_BINS
) -> None:
    """Values (n,) over x (n,) as dots, of many some drawn by lot, with the mean of neighbours and a line at zero."""
    rows = chosen_rows(len(x), _MAX_DOTS)
    mark, colour, label = dots
    look: Look = {"mew": 0, "ls": "none", "rasterized": True, **dots_look(len(rows))}
    look["ms"] *= 1.0 if mark == "." else 0.6  # a dot is drawn at half its size
    axes.plot(x[rows], y[rows], mark, color=colour, zorder=2, label=label, **look)
    axes.axhline(0, color=GREY, lw=0.8, zorder=1)
    if len(x) >= _MIN_BIN_POSES:
        Binned.of(x, y, bins).draw(axes, *mean)


def _seen_joints(shown: Shown) -> list[int]:
    """The joints that change what is measured in some posture, rounding apart: less than 1e-9 of the longest lever."""
    levers = [float(np.max(np.linalg.norm(column, axis=1), initial=0.0)) for column in shown.columns]
    return [k for k, lever in enumerate(levers) if lever > 1e-9 * max(levers)]


def _along(shown: Shown, errors: Array, joints: list[int]) -> tuple[list[Array], list[Array]]:
    """By joint, its value [deg or mm] and the error along its motion [mm], pose by pose. ``e · c / |c|`` with the
    column c of the joint; poses in which ``|c|`` is below 5 % of its largest are left out; ``errors`` (N, 3) [mm]."""
    values, along = [], []
    for k in joints:
        joint, column = shown.robot.joints[k], shown.columns[k]
        lever = np.linalg.norm(column, axis=1)
        # Nearer to its axis, a joint moves the tool point in no direction to speak of.
        far = lever > 0.05 * lever.max()
        part = np.sum(errors[far] * column[far], axis=1) / lever[far]
        factor = math.degrees(1.0) if joint.type == "revolute" else 1e3
        means = group_means(np.column_stack([factor * shown.data.q[far, k], part]), shown.data.pose[far])
        values.append(means[:, 0])
        along.append(means[:, 1])
    return values, along


@styled
def plot_residuals_over_inputs(shown: Shown) -> Figure:
    """Mean errors by axis [mm] over the inputs that the data have, and along each joint's motion by its approach. Left
    before, right after calibration. The last line of panels is left out where no joint arrived often from both sides; a
    gap between both marks of a joint that exceeds their bars is backlash."""
    data = shown.data
    inputs = [("line of the file", data.line.astype(float))]
    if data.time is not None:
        length = float(np.ptp(data.time))
        unit, size = next(((u, s) for u, s in (("h", 3600.0), ("min", 60.0)) if length > 3 * s), ("s", 1.0))
        inputs = [(f"time [{unit}]", data.time / size)]
    others = (("temperature [degC]", data.temperature), ("payload [kg]", data.payload))
    # Three different values make a line.
    inputs += [(label, x) for label, x in others if x is not None and len(np.unique(x)) >= 3]
    arrived = [(data.approach < 0).sum(axis=0), (data.approach > 0).sum(axis=0)]
    sided = [k for k in _seen_joints(shown) if min(side[k] for side in arrived) >= 10]
    lines = len(inputs) + bool(sided)
    figure = new_figure(0.7 + 1.9 * lines)
    grid = figure.subplots(lines, 2, squeeze=False)
    for name, column in zip(shown.errors, grid.T, strict=True):
        column[0].set_title(TITLES[name])
        for axes, (label, x) in zip(column, inputs, strict=False):
            axes.axhline(0, color=GREY, lw=0.8, zorder=1)
            for axis in shown.axes:
                trend = Binned.of(x, shown.errors[name][:, axis], 30)
                trend.draw(axes, label=data.kind.axis_names[axis], **_AXIS_LOOKS[axis])
            axes.set_xlabel(label)
        if sided:
            _approach(column[-1], shown, shown.errors[name], sided)
    for axes in grid[: len(inputs), 0]:
        axes.set_ylabel("mean error [mm]")
    if sided:
        grid[-1][0].set_ylabel("mean error along\nthe joint's motion [mm]")
    legend(figure)
    return figure


def _approach(axes: Axes, shown: Shown, errors: Array, joints: list[int]) -> None:
    """Mean and its 95 % interval of the error along the motion of each joint, by the side that it came from; ``errors``
    (N, 3) [mm]."""
    axes.axhline(0, color=GREY, lw=0.8, zorder=1)
    for side, label, colour, shift in _SIDE_LOOKS:
        means, bars = [], []
        for k in joints:
            column = shown.columns[k]
            lever = np.maximum(np.linalg.norm(column, axis=1), 1e-12)
            part = (np.sum(errors * column, axis=1) / lever)[shown.data.approach[:, k] == side]
            means.append(part.mean())
            bars.append(2 * part.std(ddof=1) / np.sqrt(len(part)))
        look: Look = {"fmt": "<" if side < 0 else ">", "color": colour, "ms": 6, "capsize": 3}
        axes.errorbar(np.arange(len(joints)) + shift, means, bars, label=f"joint arrives {label}", **look)
    names = [shown.robot.joint_names[k] for k in joints]
    longest = max(len(part) for name in names for part in name.split("_"))
    # So many letters fit upright side by side.
    if longest * len(names) > 36:
        axes.set_xticks(range(len(joints)), names, rotation=30, ha="right", rotation_mode="anchor")
    else:
        axes.set_xticks(range(len(joints)), [name.replace("_", "\n") for name in names])
    axes.grid(axis="x", visible=False)
