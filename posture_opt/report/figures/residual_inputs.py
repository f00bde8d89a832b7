"""Errors over time, temperature and payload, and by the side from which a joint arrived."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from posture_opt.report.figures.residual_joints import Binned
from posture_opt.report.figures.residuals import TITLES
from posture_opt.report.style import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILLION, new_figure, styled

if TYPE_CHECKING:
    from posture_opt.report.figures.residuals import Shown

Floats = NDArray[np.float64]

_SIDES = ((-1, "from below", ORANGE, -0.12), (1, "from above", PURPLE, 0.12))
_XYZ = (BLUE, VERMILLION, GREEN)
_FEWEST = 10  # arrivals from a side
_VALUES = 3  # different ones that make a line
_BINS = 30


@styled
def plot_residuals_over_inputs(shown: Shown) -> Figure:
    """Mean errors by axis over the inputs that the data have, and along each joint's motion by its approach."""
    inputs, sided = _inputs(shown), _both_sides(shown)
    lines = len(inputs) + bool(sided)
    figure = new_figure(9.6, 0.9 + 2.1 * lines)
    grid = figure.subplots(lines, 2, squeeze=False)
    for name, column in zip(shown.errors, grid.T, strict=True):
        column[0].set_title(TITLES[name])
        for axes, (label, x) in zip(column, inputs, strict=False):
            _over(axes, shown, shown.errors[name], x)
            axes.set_xlabel(label)
        if sided:
            _approach(column[-1], shown, shown.errors[name], sided)
    for axes in grid[: len(inputs), 0]:
        axes.set_ylabel("mean error [mm]")
    if sided:
        grid[-1][0].set_ylabel("mean error along\nthe joint's motion [mm]")
    entries = {
        label: handle for axes in grid[:, 0] for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=len(entries))
    return figure


def _inputs(shown: Shown) -> list[tuple[str, Floats]]:
    """What the errors are drawn over: time or, without it, the order of the rows; temperature, payload."""
    data = shown.data
    order = ("line of the file", data.line.astype(float))
    found = [order if data.time is None else _clock(data.time)]
    others = (("temperature [degC]", data.temperature), ("payload [kg]", data.payload))
    return found + [(label, x) for label, x in others if x is not None and len(np.unique(x)) >= _VALUES]


def _clock(seconds: Floats) -> tuple[str, Floats]:
    length = float(np.ptp(seconds))
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if length > 3 * size:
            return f"time [{unit}]", seconds / size
    return "time [s]", seconds


def _over(axes: Any, shown: Shown, errors: Floats, x: Floats) -> None:
    axes.axhline(0, color=GREY, lw=0.8, zorder=1)
    for axis in shown.axes:
        Binned.of(x, errors[:, axis], _BINS).draw(axes, _XYZ[axis], "xyz"[axis])


def _both_sides(shown: Shown) -> list[int]:
    """The joints that arrived often from both sides."""
    approach = shown.data.approach
    return [
        k for k in range(approach.shape[1])
        if min(np.count_nonzero(approach[:, k] < 0), np.count_nonzero(approach[:, k] > 0)) >= _FEWEST
    ]  # fmt: skip


def _approach(axes: Any, shown: Shown, errors: Floats, joints: list[int]) -> None:
    """Mean and its 95 % interval of the error along the motion of each joint, by the side that it came from."""
    axes.axhline(0, color=GREY, lw=0.8, zorder=1)
    for side, label, colour, shift in _SIDES:
        means, bars = [], []
        for k in joints:
            column = shown.columns[k]
            lever = np.maximum(np.linalg.norm(column, axis=1), 1e-12)
            part = (np.sum(errors * column, axis=1) / lever)[shown.data.approach[:, k] == side]
            means.append(part.mean())
            bars.append(2 * part.std(ddof=1) / np.sqrt(len(part)))
        places = np.arange(len(joints)) + shift
        axes.errorbar(places, means, bars, fmt="o", color=colour, ms=5, capsize=3, label=f"joint arrives {label}")
    axes.set_xticks(range(len(joints)), [shown.robot.joint_names[k].replace("_", "\n") for k in joints])
    axes.grid(axis="x", visible=False)
