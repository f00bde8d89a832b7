"""Blocks on one posture of an answer: joints and tool, spread of the tool point, other optima, what would help."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

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
    tool_facts,
)
from posture_opt.report.parts.task_parts import critical_rows
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.report.text.words import part_words, source_size
from posture_opt.selection.answer.improvements import CalibratedArm, HalvedSigma, MovedPart
from posture_opt.selection.answer.solution_statements import NO_GAIN, part_of
from posture_opt.statements.notation import (
    angle,
    joint_unit,
    length,
    length_unit,
    percent,
    place,
    quantity,
    shift,
    stated,
)
from posture_opt.uncertainty.regions.regions import deviation
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt.model.arm import Arm
    from posture_opt.selection.answer.improvements import Improvement
    from posture_opt.selection.answer.prices import Price
    from posture_opt.selection.answer.solution import Alternative, Solution
    from posture_opt.selection.program.task_target import TaskTarget
    from posture_opt.selection.terms.term import Stated, Term

_MAX_CHANGES, _MAX_PRICES = 6, 4  # that a table of what would help shows
_MIN_PRICE = 1e-4  # of the standard deviation: what a degree or a millimetre is worth, to be worth a row


def target_text(target: TaskTarget) -> str:
    """Where the tool point is to go."""
    if target.kind == "point":
        return place(target.lower)
    box = "anywhere in reach" if target.kind == "anywhere" else f"{place(target.lower)} to {place(target.upper)}"
    return f"{box} (the workpiece may be moved)"


def bound_text(term: Term) -> str:
    """A further requirement with its bounds."""
    of = f" {part_words(term.part, '')}" if term.part is not None else ""
    name = f"{term.kind.replace('_', ' ')}{of}"
    return ", ".join(f"{name}{f' of {bound.joint}' * bool(bound.joint)} {_sides(bound)}" for bound in term.stated())


def _sides(bound: Stated) -> str:
    """The ends of a bound."""
    if bound.low == bound.high:
        return f"at {stated(bound.low, bound.unit)}"
    sides = [f"at least {stated(bound.low, bound.unit)}"] * math.isfinite(bound.low)
    sides += [f"at most {stated(bound.high, bound.unit)}"] * math.isfinite(bound.high)
    return " and ".join(sides)


def posture_block(solution: Solution, title: str = "Posture") -> Block:
    """The joints, the tool, and how near the arm comes to anything."""
    facts = tool_facts(solution.spread)
    target, asked, robot = solution.target, solution.optimisation_problem, solution.problem.robot
    if target.tilt and asked.axis_rows:
        leaning = fixed(math.degrees(lean(solution.spread, asked.task.tool_axis, target.axis)))
        facts.append(("Tool axis", f"tilted {leaning} deg, {math.degrees(target.tilt):.6g} deg allowed"))
    facts += distance_facts(solution.problem.scene, solution.clearance)
    brief = Facts((*nearest_limit(robot, solution.q), *facts))
    table = joint_table(solution.problem, robot, solution.q)
    return Block(title, (table, Facts(tuple(facts))), figure="arm", brief=(brief,))


def spread_block(solution: Solution) -> Block:
    """The uncertainty of the tool point, the part that counts first."""
    spread, critical = solution.spread, solution.critical
    first = solution.basis.T @ spread.covariance_first_order @ solution.basis
    among = [float(s) for s in spread.ellipse.semi_axes]  # the whole block in one unit
    seen = critical_rows(solution.task_spread, among, "target")
    linear = deviation(float(np.linalg.eigvalsh(first)[-1]), spread.covariance)
    task, turned = solution.optimisation_problem.task, []
    if any(term.uses_orientation for term in (*task.minimize, *task.subject_to)):
        of = solution.orientation
        turned = [("Orientation", f"tilt {angle(of.tilt)} (worst axis), spin {angle(of.spin)} (standard deviations)")]
    rows = (
        *seen, *ellipse_facts(spread, among), mean_fact(spread, among),
        first_order_fact(critical.sigma_max, linear, among), *turned, method_fact(spread), *relative_fact(spread),
    )  # fmt: skip
    contributions = main_fact(solution.task_spread.budget_groups)
    brief = Facts((*seen, contributions))
    return Block("Spread of the tool point", (Facts(rows),), figure="cloud", brief=(brief,))


def alternatives_block(solution: Solution) -> Block:
    """The local optima."""
    found = solution.alternatives
    if len(found) < 2:
        return Block("Alternatives", (), figure="joint_map")
    joints = solution.optimisation_problem.robot.joints
    unit, factor = length_unit([found[0].sigma_max])  # that of the answer, in the whole report
    named, free = any(a.configuration for a in found), solution.target.kind != "point"
    headers = ["rank", f"std. dev. [{unit}]", "difference", *["configuration"] * named]
    headers += [f"{j.name} [{joint_unit(j.type)[0]}]" for j in joints] + [f"{c} [mm]" for c in "xyz"] * free
    rows = []
    for rank, a in enumerate(found, start=1):
        row = [str(rank), number(a.sigma_max * factor), difference(a.sigma_max, found[0].sigma_max)]
        row += [_without_common(a, found)] * named
        row += [fixed(a.posture[j.name] * joint_unit(j.type)[1], 1) for j in joints]
        rows.append((*row, *([fixed(1e3 * float(v), 1) for v in a.position] if free else [])))
    views = tuple(f"alternative-{rank}" for rank in range(1, len(rows) + 1))
    return Block("Alternatives", (Table(tuple(headers), tuple(rows), views=views),), figure="joint_map")


def _without_common(one: Alternative, every: Sequence[Alternative]) -> str:
    """The names of a configuration that are not those of all others too."""
    each = zip(one.configuration, *(other.configuration for other in every), strict=True)
    return ", ".join(name for name, *others in each if len(set(others)) > 1)


def difference(sigma: float, reference: float) -> str:
    """How much larger or smaller a standard deviation is than the one of the answer."""
    more = sigma / reference - 1 if reference > 0 else 0.0
    if abs(more) < NO_GAIN / 10:
        return "-" if sigma == reference else "same"
    return f"+{percent(more)}" if more > 0 else percent(more)


def compared_table(sigma: float, others: Sequence[tuple[str, float]], unit: tuple[str, float]) -> tuple[Table, ...]:
    """Standard deviations [m] beside the one of the answer, those that are known; nothing where none is."""
    name, factor = unit
    rows = [(who, number(other * factor), difference(other, sigma)) for who, other in others if math.isfinite(other)]
    return (Table(("compared with", f"std. dev. [{name}]", "difference"), tuple(rows)),) if rows else ()


def helps_block(solution: Solution) -> Block:
    """What would lower the standard deviation, most gain first, and what loosening a requirement is worth."""
    unit, factor = length_unit([solution.sigma])  # that of the answer, in the whole report
    changes, items = solution.helpful[:_MAX_CHANGES], []
    if changes:
        arm = solution.problem.arm
        rows = [(*_change(c, arm), number(c.sigma_max * factor, 3), percent(c.gain)) for c in changes]
        headers = ("change", "of", "to", f"σ {part_of(solution)} [{unit}]", "reduction")
        items.append(Table(headers, tuple(rows), text_columns=3))
    prices = [price for price in solution.prices if price.gain >= _MIN_PRICE * solution.sigma][:_MAX_PRICES]
    if prices:
        gains = [price.gain for price in prices]
        loosened = tuple((*_requirement(price), length(price.gain, 2, gains)) for price in prices)
        items.append(Table(("requirement that holds the answer", "loosened by", "σ falls by"), loosened))
    return Block("What would help", tuple(items))


def _change(change: Improvement, arm: Arm) -> tuple[str, str, str]:
    """What changes, of what, to which size."""
    if isinstance(change, HalvedSigma):
        return "halve σ", change.parameter, source_size(change.parameter, change.sigma / 2, arm)
    if isinstance(change, CalibratedArm):
        instrument = f"instrument σ {length(change.instrument)}{', assumed' * change.assumed}"
        return "calibrate", f"arm at {change.postures} postures", instrument
    assert isinstance(change, MovedPart)
    return "move", "part", f"by {shift(change.shift)}"


def _requirement(price: Price) -> tuple[str, str]:
    """A requirement with the end that holds, and a step of it: a degree, a millimetre."""
    write = stated if price.unit in ("rad", "m") else quantity
    return f"{price.requirement}, {price.side} end", write(price.step, price.unit)
