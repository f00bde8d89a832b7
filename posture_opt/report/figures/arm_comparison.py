"""Where the postures of several arms land about the target, as each of the arms predicts it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.figures.cloud import clearance_lines, frame_target, mark_origin, view_basis
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import BLUE, GREEN, ORANGE, PURPLE, legend_below, styled
from posture_opt.report.text.units_text import length, length_unit
from posture_opt.uncertainty.regions.regions import Ellipsoid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.selection.comparison.arm_comparison import ArmComparison
    from posture_opt.selection.comparison.plan_comparison import PredictedError

Look = tuple[str, str, str]
_FAR = 30.0  # times the largest ellipse of an arm in its own posture: farther off, only the legend says so
_LOOKS = ((BLUE, "-", "o"), (ORANGE, "--", "s"), (GREEN, "-.", "D"), (PURPLE, ":", "^"))


@styled
def plot_arm_comparison(found: ArmComparison) -> Figure:
    """The 95 % ellipses of all answers about the target, a panel for every arm that predicts them.

    In the panel of arm A the answer planned with A is the smallest; how much larger the others are there is what
    planning with the wrong arm costs.
    """
    judges = [name for name in found.arms if any(name in arm.judged for arm in found.answered.values())]
    station = next(iter(found.answered.values())).stations[0]
    B = view_basis(station.spread, station.task_spread)
    own = max(_extent(_worst(arm.judged[name].predicted_errors), B) for name, arm in found.answered.items())
    near = {
        (judge, name): _worst(arm.judged[judge].predicted_errors)
        for judge in judges
        for name, arm in found.answered.items()
        if judge in arm.judged
    }
    half = 1.12 * max(size for predicted_error in near.values() if (size := _extent(predicted_error, B)) <= _FAR * own)
    unit, scale = length_unit([half])
    looks = {name: _LOOKS[k % len(_LOOKS)] for k, name in enumerate(found.arms)}
    figure = new_figure(4.9)
    for axes, judge in zip(figure.subplots(1, len(judges), squeeze=False)[0], judges, strict=True):
        for name in found.answered:
            if (judge, name) in near:
                _draw(axes, near[judge, name], B, (scale, half), f"planned with {name}", looks[name])
        mark_origin(axes, "target")
        clearance_lines(axes, station.task_spread, B, scale, half * scale)
        frame_target(axes, station.task_spread, B, half * scale, unit)
        axes.set_title(f"predicted by {judge}")
    legend_below(figure)
    return figure


def _worst(predicted_errors: tuple[PredictedError, ...]) -> PredictedError:
    """The station with the largest predicted error."""
    return max(predicted_errors, key=lambda predicted_error: predicted_error.critical_error)


def _region(predicted_error: PredictedError, B: Array) -> Ellipsoid:
    """The predicted error as an ellipse in the plane of the basis B (2, 3) [m]."""
    return Ellipsoid(B @ predicted_error.miss, B @ predicted_error.covariance @ B.T)


def _extent(predicted_error: PredictedError, B: Array) -> float:
    """How far a 95 % ellipse reaches from the target [m], along either axis of the plane."""
    return float(np.abs(_region(predicted_error, B).points(0.95)).max())


def _draw(
    axes: Axes, predicted_error: PredictedError, B: Array, frame: tuple[float, float], label: str, look: Look
) -> None:
    (scale, half), (colour, dashes, mark) = frame, look
    region = _region(predicted_error, B)
    if _extent(predicted_error, B) > 1.12 * half:
        axes.plot([], [], mark, color=colour, label=f"{label}: {length(predicted_error.distance)} off, outside")
        return
    boundary = (scale * region.points(0.95)).T
    axes.fill(*boundary, facecolor=colour, alpha=0.12, lw=0)
    axes.plot(*boundary, color=colour, ls=dashes, label=f"{label}: 95 % ellipse")
    axes.plot(*(scale * region.center), mark, color=colour, ms=7, mec="white", zorder=7)
