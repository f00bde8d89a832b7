"""What reports say of one posture of an answer: target, joints, spread of the tool point, other local optima."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.errors import enumerated
from posture_opt.report.parts.budget_parts import main_fact
from posture_opt.report.parts.collision_parts import distance_facts
from posture_opt.report.parts.parts import (
    ellipse_facts,
    first_order_fact,
    joint_table,
    lean,
    mean_fact,
    method_fact,
    nearest_limit,
    relative_fact,
    sentence,
    tool_facts,
    validity_sentence,
)
from posture_opt.report.parts.solution_checks import gain_facts, ranking_sentence
from posture_opt.report.parts.task_parts import critical_rows, orientation_rows
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.report.text.words import part_words
from posture_opt.robot.posture import joints_at_limits
from posture_opt.statements.notation import count, joint_unit, length_unit, percent, place, stated
from posture_opt.uncertainty.regions.regions import deviation
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt.numerics import Array
    from posture_opt.robot.robot import Robot
    from posture_opt.selection.answer.solution import Alternative, Solution
    from posture_opt.selection.program.task_target import TaskTarget
    from posture_opt.selection.terms.term import Stated, Term

_PLANAR_JOINTS = 2  # of arms that are drawn on paper


def limit_lead(robot: Robot, Q: Array) -> tuple[str, ...]:
    """That joints stand at their limits, and how to keep away from these; nothing of arms that move in a plane.

    Args:
        Q: (N, n) the postures of the answer [rad or m].
    """
    at = joints_at_limits(robot, Q) if robot.n > _PLANAR_JOINTS else []
    if not at:
        return ()
    verb, whose = ("stands", "its limit") if len(at) == 1 else ("stand", "their limits")
    return (
        f"{enumerated(at)} {verb} at {whose}, where controllers seldom let a joint go: to keep away add subject_to: "
        "[{kind: limit_margin, at_least: 2 deg}] to the task.",
    )


def target_words(target: TaskTarget) -> str:
    """Where the tool point is to go."""
    if target.kind == "point":
        return f"the point {place(target.lower)}"
    if target.kind == "anywhere":
        return "anywhere in reach (the workpiece may be moved)"
    return f"anywhere in the box from {place(target.lower)} to {place(target.upper)} (the workpiece may be moved)"


def bound_words(term: Term) -> str:
    """A further requirement with its bounds."""
    of = f" {part_words(term.part, '')}" if term.part is not None else ""
    name = f"{term.kind.replace('_', ' ')}{of}"
    return ", ".join(f"{name}{f' of {bound.joint}' * bool(bound.joint)} {_sides(bound)}" for bound in term.stated())


def _sides(bound: Stated) -> str:
    """The ends of a bound in words."""
    if bound.low == bound.high:
        return f"at {stated(bound.low, bound.unit)}"
    sides = [f"at least {stated(bound.low, bound.unit)}"] * math.isfinite(bound.low)
    sides += [f"at most {stated(bound.high, bound.unit)}"] * math.isfinite(bound.high)
    return " and ".join(sides)


def posture_block(solution: Solution) -> Block:
    """The joints, the tool, and where the workpiece goes."""
    facts = tool_facts(solution.spread)
    target, optimisation_problem = solution.target, solution.optimisation_problem
    if target.tilt and optimisation_problem.axis_rows:
        leaning = math.degrees(lean(solution.spread, optimisation_problem.task.tool_axis, target.axis))
        allowed = f"{math.degrees(target.tilt):.6g} deg allowed"
        facts.append(("Tool axis", f"tilted {fixed(leaning)} deg from the task direction ({allowed})"))
    facts += distance_facts(solution.problem.scene, solution.clearance)
    robot = solution.optimisation_problem.robot
    brief = Facts((*nearest_limit(robot, solution.q), *facts))
    return Block(
        "Posture", (joint_table(solution.problem, robot, solution.q), Facts(tuple(facts))), figure="arm", brief=(brief,)
    )


def nearest_block(solution: Solution) -> Block:
    """The posture that violates the requirements least."""
    table = joint_table(solution.problem, solution.optimisation_problem.robot, solution.q)
    facts = (*tool_facts(solution.spread), *distance_facts(solution.problem.scene, solution.clearance))
    return Block("Nearest posture", (table, Facts(facts)), figure="arm")


def spread_block(solution: Solution) -> Block:
    """The uncertainty of the tool point, the part that counts first."""
    spread, critical = solution.spread, solution.critical
    first = solution.basis.T @ spread.covariance_first_order @ solution.basis
    among = [float(s) for s in spread.ellipse.semi_axes]  # the whole block in one unit
    rows = critical_rows(solution.task_spread, among, "target")
    short = len(rows)
    rows += ellipse_facts(spread, among)
    rows.append(mean_fact(spread, among))
    linear = deviation(float(np.linalg.eigvalsh(first)[-1]), spread.covariance)
    rows.append(first_order_fact(critical.sigma_max, linear, among))
    rows += orientation_rows(solution)
    rows += [method_fact(spread), *relative_fact(spread)]
    items = (Facts(tuple(rows)), validity_sentence(spread))
    contributions = main_fact(solution.problem.arm, solution.task_spread.budget_groups)
    brief = Facts((*rows[:short], contributions, *gain_facts(solution)[:1]))
    return Block("Spread of the tool point", items, figure="cloud", brief=(brief,))


def alternatives_block(solution: Solution) -> Block:
    """The other local optima."""
    alternatives = solution.alternatives
    if len(alternatives) < 2:
        only = _same_configuration(solution) or ("No other local optimum was found.",)
        return Block("Alternatives", only, figure="joint_map", brief=())
    joints = solution.optimisation_problem.robot.joints
    unit, factor = length_unit([alternatives[0].sigma_max])  # that of the answer, in the whole report
    headers = ["rank", f"std. dev. [{unit}]", "difference"]
    named = any(a.configuration for a in alternatives)
    headers += ["configuration"] if named else []
    headers += [f"{j.name} [{joint_unit(j.type)[0]}]" for j in joints]
    free = solution.target.kind != "point"
    headers += [f"{c} [mm]" for c in "xyz"] if free else []
    rows = []
    for rank, a in enumerate(alternatives, start=1):
        row = [str(rank), number(a.sigma_max * factor), _more(a.sigma_max, alternatives[0].sigma_max)]
        row += [_without_common(a, alternatives)] if named else []
        row += [fixed(a.posture[j.name] * joint_unit(j.type)[1], 1) for j in joints]
        row += [fixed(1e3 * float(v), 1) for v in a.position] if free else []
        rows.append(tuple(row))
    views = tuple(f"alternative-{rank}" for rank in range(1, len(rows) + 1))
    table = Table(tuple(headers), tuple(rows), views=views)
    return Block(
        "Alternatives", (*ranking_sentence(solution), table, *_same_configuration(solution)), figure="joint_map"
    )


def _without_common(one: Alternative, every: Sequence[Alternative]) -> str:
    """The names of a configuration that are not those of all others too."""
    each = zip(one.configuration, *(other.configuration for other in every), strict=True)
    return ", ".join(name for name, *others in each if len(set(others)) > 1)


def _same_configuration(solution: Solution) -> tuple[str, ...]:
    """How many optima are not listed, as they differ from one that is by spin or redundancy alone."""
    more = len(solution.optima) - len(solution.alternatives)
    differ = f"{count(more, 'further optimum', 'further optima')} {'differs' if more == 1 else 'differ'} from these"
    return (f"{differ} by the spin of the tool or the redundancy of the arm alone.",) if more else ()


def _more(sigma: float, best: float) -> str:
    """How much larger a standard deviation is than the best."""
    more = sigma / best - 1 if best > 0 else 0.0
    if abs(more) < 5e-5:
        return "-" if sigma == best else "same"
    return f"+{percent(more)}" if more > 0 else percent(more)


def changes_block(solution: Solution) -> tuple[Block, ...]:
    """Changes of which any one makes the task possible, where there is a choice."""
    changes = tuple(f"- {sentence(relaxation.change)}" for relaxation in solution.relaxations)
    return (Block("Each of these changes makes the task feasible", changes),) if len(changes) > 1 else ()
