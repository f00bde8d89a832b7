"""Errors over the joints: one line of panels a joint, as it stands and calibrated."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from posture_opt.measurements.measurements import group_means
from posture_opt.report.figures.residuals import COLOURS, TITLES, chosen_rows
from posture_opt.report.style import GREY, legend_below, new_figure, styled

if TYPE_CHECKING:
    from posture_opt.report.figures.residuals import Shown

Floats = NDArray[np.float64]

_DOTS = 800  # more make a fog
_IN_BIN = 20  # poses, on average
_FEWEST = 4  # poses of a bin that is drawn
_STEPS = 12  # different values, as of a payload: no more need to be put together
_LEAST, _MOST = 6, 72  # bins: many, as errors of gears have tens of periods a turn
_GAP = 0.08  # of the bins, all of them empty: no line is drawn over it
_LEVER = 0.05  # of the longest: nearer to its axis, a joint moves the tool point in no direction to speak of


@dataclass(frozen=True, eq=False)
class Binned:
    """Means of values in bins along x, each with half its 95 % interval; NaN where a bin is empty."""

    x: Floats
    mean: Floats
    band: Floats

    @classmethod
    def of(cls, x: Floats, values: Floats, most: int = _MOST) -> Binned:
        """Of values (n,) at x (n,), in ``most`` bins or fewer; a few different x are bins of their own."""
        from scipy.special import stdtrit

        steps, at = np.unique(x, return_inverse=True)
        bins = len(steps)
        if bins > _STEPS:
            bins = max(min(len(x) // _IN_BIN, most), _LEAST)
            at = np.clip(((x - steps[0]) / (steps[-1] - steps[0]) * bins).astype(int), 0, bins - 1)
        count = np.bincount(at, minlength=bins)
        some = np.where(count >= _FEWEST, count, np.nan)
        mean, middle = np.bincount(at, values, bins) / some, np.bincount(at, x, bins) / some
        variance = np.bincount(at, (values - mean[at]) ** 2, bins) / (some - 1)
        return cls(middle, mean, stdtrit(some - 1, 0.975) * np.sqrt(variance / some))

    def draw(self, axes: Any, colour: str, label: str = "") -> None:
        """The line with its band; it passes over a few empty bins, not over a wide gap."""
        known = np.isfinite(self.mean)
        wide = np.flatnonzero(np.diff(np.flatnonzero(known)) > max(_GAP * len(known), 3)) + 1
        x, mean, band = (np.insert(values[known], wide, np.nan) for values in (self.x, self.mean, self.band))
        marker = "o" if len(x) <= _STEPS else ""
        axes.fill_between(x, mean - band, mean + band, color=colour, alpha=0.3, lw=0, zorder=3)
        axes.plot(x, mean, color=colour, lw=1.5, marker=marker, ms=4, zorder=4, label=label)


@styled
def plot_residuals_over_joints(shown: Shown) -> Figure:
    """Errors along the motion of each joint over its value: dots are poses, the line is their mean in bins."""
    robot = shown.robot
    figure = new_figure(9.6, 1.2 + 1.55 * robot.n)
    grid = figure.subplots(robot.n, 2, squeeze=False)
    for name, column in zip(shown.errors, grid.T, strict=True):
        sizes = []
        for axes, joint, x, along in zip(column, robot.joints, *_along(shown, shown.errors[name]), strict=True):
            _panel(axes, x, along, COLOURS[name])
            sizes.append(float(np.quantile(np.abs(along), 0.995)))
            axes.set_xlabel(f"{joint.name} [{'deg' if joint.type == 'revolute' else 'mm'}]", labelpad=1)
        limit = 1.1 * max(sizes, default=1.0)
        for axes in column:
            axes.set_ylim(-limit, limit)
            axes.locator_params(axis="y", nbins=4)
        column[0].set_title(TITLES[name])
    figure.supylabel("error along the joint's own motion [mm]", fontsize=10)
    legend_below(grid[0][1], 2)
    return figure


def _panel(axes: Any, x: Floats, along: Floats, colour: str) -> None:
    dots = chosen_rows(len(x), _DOTS)
    look: dict[str, Any] = {"color": colour, "ms": 3 if len(x) > 200 else 6, "alpha": 0.5, "mew": 0}
    some = f"{len(dots)} of {len(x)}" if len(dots) < len(x) else str(len(x))
    axes.plot(x[dots], along[dots], ".", zorder=2, rasterized=True, label=f"{some} poses", **look)
    axes.axhline(0, color=GREY, lw=0.8, zorder=1)
    if len(x) >= _FEWEST:
        Binned.of(x, along).draw(axes, "black", "mean of neighbours with its 95 % band")


def _along(shown: Shown, errors: Floats) -> tuple[list[Floats], list[Floats]]:
    """By joint, its value [deg or mm] and the error along its motion [mm], pose by pose."""
    values, along = [], []
    for k, (joint, column) in enumerate(zip(shown.robot.joints, shown.columns, strict=True)):
        lever = np.linalg.norm(column, axis=1)
        far = lever > _LEVER * lever.max()
        part = np.sum(errors[far] * column[far], axis=1) / lever[far]
        factor = math.degrees(1.0) if joint.type == "revolute" else 1e3
        means = group_means(np.column_stack([factor * shown.data.q[far, k], part]), shown.data.pose[far])
        values.append(means[:, 0])
        along.append(means[:, 1])
    return values, along
