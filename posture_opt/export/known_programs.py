"""Robot programs of results whose postures are known: compensated targets, postures to measure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.compensation.compensation import Compensation
from posture_opt.experiments.measurement_plan import MeasurementPlan
from posture_opt.export.arrivals import runs
from posture_opt.export.robot_program import MotionRequest, RobotProgram, posture_program, program_through

_KEPT_ORDER_NOTE = "Keep the order of the stops: from another side the joints arrive elsewhere."


def compensated_program(
    found: Compensation, speed: float = 10.0, wait: float = 0.0, approach: float | None = None
) -> RobotProgram:
    """The program through compensated targets, in their order, each arrived at from the side that it was found for."""
    problem, labels = found.problem, [f"line {line}" for line in found.targets.line]
    asked = MotionRequest(speed, wait, approach)
    sides = np.where(runs(problem) > 0, found.side, 0.0)
    program = posture_program(problem, "compensated targets", found.q, labels, asked, sides)
    order = (_KEPT_ORDER_NOTE,) if problem.arm.effects else ()
    return replace(program, notes=(*order, *program.notes))


def measuring_program(plan: MeasurementPlan, speed: float = 10.0, wait: float = 2.0) -> RobotProgram:
    """The program that visits the postures to measure and waits at each, round by round."""
    rounds = [f"posture {k}" for k in range(1, len(plan.q) + 1)]
    labels = [f"{label}, round {n}" for n in range(1, plan.repeats + 1) for label in rounds]
    q = np.tile(plan.q, (plan.repeats, 1))
    return program_through(
        plan.problem, "postures to measure", q, labels if plan.repeats > 1 else rounds, speed=speed, wait=wait
    )
