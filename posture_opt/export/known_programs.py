"""Robot programs of results whose postures are known: compensated targets, postures to measure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.compensation.compensation import Compensation
from posture_opt.experiments.measurement_plan import MeasurementPlan
from posture_opt.export.arrival_stops import with_arrivals
from posture_opt.export.robot_program import RobotProgram, arrival_notes, program_through

_KEPT_ORDER_NOTE = "Keep the order of the stops: from another side the joints arrive elsewhere."


def compensated_program(found: Compensation, speed: float = 10.0, wait: float = 0.0) -> RobotProgram:
    """The program through compensated targets, in their order: from other sides the joints arrive elsewhere.

    Where the targets state a side that the way from the stop before does not have, a stop in front of it sees to it.
    """
    problem, labels = found.problem, [f"line {line}" for line in found.targets.line]
    stops = with_arrivals(problem, found.q, labels, found.targets.side)
    program = program_through(problem, "compensated targets", stops.q, stops.labels, speed=speed, wait=wait)
    order = (_KEPT_ORDER_NOTE,) if problem.arm.effects else ()
    unasked = [name for name, side in zip(problem.robot.joint_names, found.targets.side[0], strict=True) if not side]
    first = arrival_notes(problem.arm, unasked, " at the first stop")
    return replace(program, notes=(*order, *stops.notes, *first, *program.notes), given_moves=stops.moves)


def measuring_program(plan: MeasurementPlan, speed: float = 10.0, wait: float = 2.0) -> RobotProgram:
    """The program that visits the postures to measure and waits at each, round by round.

    A note names the legs on which a straight move of the joints does not keep clear.
    """
    rounds = [f"posture {k}" for k in range(1, len(plan.q) + 1)]
    labels = [f"{label}, round {n}" for n in range(1, plan.repeats + 1) for label in rounds]
    q = np.tile(plan.q, (plan.repeats, 1))
    program = program_through(
        plan.problem, "postures to measure", q, labels if plan.repeats > 1 else rounds, speed=speed, wait=wait
    )
    last = [f"{len(plan.q)} to 1"] if plan.tour.back and plan.repeats > 1 else []
    legs = ", ".join([*(f"{k + 1} to {k + 2}" for k in plan.tour.blocked), *last])
    blocked = (f"A straight move of the joints does not keep clear from posture {legs}: add stops on the way.",)
    return replace(program, notes=(*(blocked if legs else ()), *program.notes))
