"""What a measurement plan asks for, and which parameters its report and its figure list."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

from posture_opt.report.parts.collision_parts import clear_words
from posture_opt.report.parts.parts import note_facts, robot_facts
from posture_opt.report.text.blocks import Block, Facts
from posture_opt.statements.notation import angle_error, count, length, percent, stated_length
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.experiments.measurement_plan import MeasurementPlan
    from posture_opt.selection.problem_data import ProblemData

_EXACT_STD = 1e-7  # m, rad: rounding of a covariance in which parameters are correlated
_MIN_NOTED_RATIO = 1.1  # times the instrument's σ: from there on it is reported


def is_listed(plan: MeasurementPlan, i: int) -> bool:
    """Whether parameter i can be determined, and is not as good as exact already."""
    return bool(plan.settled[i]) and not plan.before.std[i] < _EXACT_STD


def planned_block(problem: ProblemData, plan: MeasurementPlan) -> Block:
    """What is measured, where the arm may go, what was assumed."""
    facts = [
        ("Plan for", _purpose(plan)),
        ("Measured", _measured(plan)),
        *([("Given", _given(plan))] if plan.given is not None else []),
        ("Kept clear", _room(plan)),
    ]
    notes = note_facts((*problem.notes, *plan.notes))
    return Block("What is planned", (Facts((*robot_facts(problem), *facts, *notes)),))


def _purpose(plan: MeasurementPlan) -> str:
    """The criterion of the plan: D-optimal for the parameters and for a recheck, L-optimal for the task."""
    if plan.purpose == "recheck":
        return "a recheck: what may have changed, each by 0.3 mm at the tool, told apart best (D-optimal)"
    if plan.purpose == "parameters":
        return "the parameters of the arm: smallest volume of their confidence ellipsoid (D-optimal)"
    return "the task: smallest variance of the tool point at its posture, in the critical direction (L-optimal)"


def _measured(plan: MeasurementPlan) -> str:
    """Axes with the σ of the instrument, targets, rounds and number of postures.

    Scatter of the arm is named where it adds more than 10 % to the σ of the instrument: ``σ sqrt(spread² − 1)``.
    """
    if plan.instruments:
        return f"a posture is for one instrument: {_by_instrument(plan)}"
    position = f"{', '.join(plan.axes)} to {_stated_sigma(plan)}"
    turned = f", orientation to {angle_error(plan.sigma_rotation)}" if plan.sigma_rotation else ""
    often = "once" if plan.repeats == 1 else f"in {plan.repeats} rounds"
    several = "each of the targets" if len(plan.targets) > 1 else "the target"
    targets = f", of {several} {', '.join(plan.targets)}" if plan.targets else ""
    scatter = ""
    if plan.given is None and plan.spread > _MIN_NOTED_RATIO:
        own = plan.sigma * math.sqrt(plan.spread**2 - 1)
        scatter = f"; the scatter of the arm itself, {length(own, 2)} per coordinate, is included"
    postures = count(len(plan.q), "posture")
    return f"{position}{turned} (one standard deviation){targets}, {often} at each of {postures}{scatter}"


def _stated_sigma(plan: MeasurementPlan) -> str:
    """Standard deviation of one number of a reading."""
    angle = plan.given is not None and plan.given.kind.unit == "rad"
    return angle_error(plan.sigma) if angle else stated_length(plan.sigma)


def _by_instrument(plan: MeasurementPlan) -> str:
    """How many postures are for each instrument, the most first."""
    counts = Counter(plan.instruments).most_common()
    often = "" if plan.repeats == 1 else f", in {plan.repeats} rounds"
    return ", ".join(f"{n} for {name}" for name, n in counts) + often


def _given(plan: MeasurementPlan) -> str:
    """How many rows were measured already, and how much larger than the instrument's σ their residuals are."""
    assert plan.given is not None
    noisy = ""
    if plan.spread > _MIN_NOTED_RATIO:
        noisy = (
            f"; the best fit to them leaves {number(plan.spread, 2)} times the σ of the instrument, which is included"
        )
    return f"{count(len(plan.given), 'row')} measured already{noisy}"


def _room(plan: MeasurementPlan) -> str:
    """What every planned posture keeps clear of, and which share of random postures does."""
    height = plan.workspace.height
    above = f"links and tool point above {stated_length(height)}, " if height > -math.inf else ""
    box = "the tool point in the stated box, " if plan.workspace.bounded else ""
    of = "all" if plan.given is None or plan.given.position is not None else "the tried"
    return (
        f"{above}{box}within the limits of the joints, and {clear_words(plan.workspace.scene)}; "
        f"{percent(plan.share)} of {of} postures qualify. Other collisions are not checked: run slowly the first time"
    )
