"""Blocks on one posture of an answer and on those along a path: joints, spread, other optima, what would help."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.page.presenter import Columns
from posture_opt.report.parts import parts
from posture_opt.report.parts.parts import joint_cells, joint_heads
from posture_opt.report.parts.task_parts import critical_rows, main_fact
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.selection.answer.improvements import CalibratedArm, HalvedSigma, MovedPart
from posture_opt.selection.answer.solution_statements import ACROSS_PATH, NO_GAIN, part_of
from posture_opt.selection.registered_tasks import part_words
from posture_opt.statements.notation import (
    angle,
    length,
    length_unit,
    percent,
    place,
    quantity,
    shift,
    stated,
)
from posture_opt.uncertainty.regions import deviation
from posture_opt.uncertainty.sources import source_size
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt import Arm, Solution
    from posture_opt.selection.answer.improvements import Improvement
    from posture_opt.selection.program.task_target import TaskTarget
    from posture_opt.selection.terms.term import Term

_MAX_CHANGES, _MAX_PRICES = 6, 4  # that a table of what would help shows


def target_text(target: TaskTarget) -> str:
    """Where the tool point is to go."""
    if target.kind == "point":
        return place(target.lower)
    box = "anywhere in reach" if target.kind == "anywhere" else f"{place(target.lower)} to {place(target.upper)}"
    return f"{box} (the workpiece may be moved)"


def bound_text(term: Term) -> str:
    """A further requirement with its bounds."""
    texts, of = [], f" {part_words(term.part, '')}" if term.part is not None else ""
    for bound in term.stated():
        low, high = stated(bound.low, bound.unit), stated(bound.high, bound.unit)
        sides = [f"at least {low}"] * math.isfinite(bound.low) + [f"at most {high}"] * math.isfinite(bound.high)
        ends = f"at {low}" if bound.low == bound.high else " and ".join(sides)
        texts.append(f"{term.kind.replace('_', ' ')}{of}{f' of {bound.joint}' * bool(bound.joint)} {ends}")
    return ", ".join(texts)


def posture_block(solution: Solution, title: str = "Posture") -> Block:
    """The joints, the tool, and how near the arm comes to anything."""
    facts = parts.tool_facts(solution.spread)
    target, asked, robot = solution.target, solution.optimisation_problem, solution.problem.robot
    if target.tilt and asked.axis_rows:
        leaning = fixed(math.degrees(parts.lean(solution.spread, asked.task.tool_axis, target.axis)))
        facts.append(("Tool axis", f"tilted {leaning} deg, {math.degrees(target.tilt):.6g} deg allowed"))
    facts += parts.distance_facts(solution.problem.scene, solution.clearance)
    brief = Facts((*parts.nearest_limit(robot, solution.q), *facts))
    table = parts.joint_table(solution.problem, robot, solution.q)
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
    rows = [*seen, *parts.ellipse_facts(spread, among), parts.mean_fact(spread, among)]
    rows += [parts.first_order_fact(critical.sigma_max, linear, among), *turned, parts.method_fact(spread)]
    rows += parts.relative_fact(spread)
    brief = Facts((*seen, main_fact(solution.task_spread.budget_groups)))
    return Block("Spread of the tool point", (Facts(tuple(rows)),), figure="cloud", brief=(brief,))


def alternatives_block(solution: Solution) -> Block:
    """The local optima."""
    found = solution.alternatives
    if len(found) < 2:
        return Block("Alternatives", (), figure="joint_map")
    robot = solution.optimisation_problem.robot
    unit, factor = length_unit([found[0].sigma_max])  # that of the answer, in the whole report
    named, free = any(a.configuration for a in found), solution.target.kind != "point"
    headers = ["rank", f"std. dev. [{unit}]", "difference", *["configuration"] * named]
    headers += joint_heads(robot) + [f"{c} [mm]" for c in "xyz"] * free
    rows = []
    for rank, a in enumerate(found, start=1):
        row = [str(rank), number(a.sigma_max * factor), difference(a.sigma_max, found[0].sigma_max)]
        # Of the configuration the names that not all others have too.
        each = zip(a.configuration, *(other.configuration for other in found), strict=True)
        row += [", ".join(name for name, *others in each if len(set(others)) > 1)] * named
        row += joint_cells(robot, [a.posture[name] for name in robot.joint_names])
        rows.append((*row, *([fixed(1e3 * float(v), 1) for v in a.position] if free else [])))
    views = tuple(f"alternative-{rank}" for rank in range(1, len(rows) + 1))
    return Block("Alternatives", (Table(tuple(headers), tuple(rows), views=views),), figure="joint_map")


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
    # A degree or a millimetre must be worth 1e-4 of the standard deviation.
    prices = [price for price in solution.prices if price.gain >= 1e-4 * solution.sigma][:_MAX_PRICES]
    if prices:
        gains = [price.gain for price in prices]
        # A step is a degree or a millimetre.
        steps = [(stated if p.unit in ("rad", "m") else quantity)(p.step, p.unit) for p in prices]
        named = [f"{price.requirement}, {price.side} end" for price in prices]
        loosened = tuple(zip(named, steps, (length(gain, 2, gains) for gain in gains), strict=True))
        items.append(Table(("requirement that holds the answer", "loosened by", "σ falls by"), loosened))
    return Block("What would help", tuple(items))


def _change(change: Improvement, arm: Arm) -> tuple[str, str, str]:
    if isinstance(change, HalvedSigma):
        return "halve σ", change.parameter, source_size(change.parameter, change.sigma / 2, arm)
    if isinstance(change, CalibratedArm):
        instrument = f"instrument σ {length(change.instrument)}{', assumed' * change.assumed}"
        return "calibrate", f"arm at {change.postures} postures", instrument
    assert isinstance(change, MovedPart)
    return "move", "part", f"by {shift(change.shift)}"


def step_text(found: Solution, step: float) -> str:
    """A bound of steps; a slide may move by 1 m where a joint may turn by 1 rad, if it is that long."""
    joints = found.optimisation_problem.robot.joints
    longest = max((joint.upper - joint.lower for joint in joints if joint.type == "prismatic"), default=0.0)
    return f"{angle(step)}, {length(step)} of a slide" if step < longest else angle(step)


def path_facts(found: Solution) -> list[tuple[str, str]]:
    """Size and ends of the path, its workpiece, and the steps that are allowed."""
    added = len(found.path.listed) - len(found.stations)
    start, end = (place(found.path.points[k]) for k in (0, -1))
    size = f"{len(found.stations)} points, {length(found.path.lengths[-1], 4)} long, from {start} to {end}"
    rows = [("Path", f"{size}; {added} points added" if added else size)]
    if found.placement is not None:
        x, y, z, yaw = found.placement.w.tolist()
        rows.append(("Workpiece", f"{place((x, y, z))}, rotated by {fixed(math.degrees(yaw))} deg about z"))
    return [*rows, ("Joint steps", f"at most {step_text(found, found.largest_step)} between listed points")]


def points_block(found: Solution) -> Block:
    """The postures of some points, evenly along the path, and of the listed point with the largest spread."""
    robot, listed = found.optimisation_problem.robot, np.flatnonzero(found.path.listed)
    even = np.linspace(0, len(listed) - 1, min(8, len(listed))).round().astype(int)
    shown = listed[np.union1d(even, np.argmax(found.motion.sigma[listed]))]
    unit, factor = length_unit(found.motion.sigma.tolist())
    heads = ["point", f"std. dev. [{unit}]", *(f"{c} [mm]" for c in "xyz"), *joint_heads(robot)]
    rows = []
    for k in shown:
        q = joint_cells(robot, found.motion.Q[k])
        xyz = [fixed(1e3 * float(v), 1) for v in found.path.points[k]]
        number_of = str(int(np.searchsorted(listed, k)) + 1)
        rows.append((number_of, number(factor * float(found.motion.sigma[k])), *xyz, *q))
    views = tuple(f"point-{row[0]}" for row in rows)
    table = Table(tuple(heads), tuple(rows), 0, views, worst=int(np.argmax(found.motion.sigma[shown])))
    left = len(found.path.points) - len(shown)
    more = (Facts((("More points", f"{left} in postures.csv"),)),) if left else ()
    return Block("Postures along the path", (table, *more), figure="path")


def path_checks(found: Solution) -> Block:
    """What simpler ways give, the lower bound, the steps, and what the search did."""
    sigma, naive, motion = float(found.motion.sigma.max()), found.naive, found.motion
    others = [
        ("each point alone (joints jump)", float(naive.each.sigma.max())),
        ("following the first posture", math.nan if naive.onward is None else float(naive.onward.sigma.max())),
        ("workpiece at the centre of its ranges", found.central),
        ("lower bound (best posture of the worst point)", found.bound if found.bound > 0 else math.nan),
    ]
    onward = f"ends at a limit after {naive.reached} points"
    rows = (
        *([("Following the first", onward)] if naive.onward is None else []),
        ("Smallest step", f"{step_text(found, found.smallest_step)}; {angle(naive.each.largest_step)} each alone"),
        *parts.distance_facts(found.problem.scene, found.clearance),
        ("Off the line", f"up to {length(found.off_line)} with joints interpolated linearly between points"),
        ("Search", f"dynamic programming over {sum(found.candidates)} postures of {len(found.candidates)} points, then "
                   f"one optimisation ({'a local optimum' if motion.optimal else 'not confirmed as an optimum'})"),
        ("Time", f"{found.seconds:.2f} s"),
    )  # fmt: skip
    table = compared_table(sigma, others, length_unit(found.motion.sigma.tolist()))
    return Block("Checks", (*table, Facts(rows)), brief=())


def path_columns(found: Solution) -> Columns:
    """One row a point, listed or added: where it is, the posture, its scatter."""
    return {
        **parts.point_columns(found.path.points),
        "listed": [int(v) for v in found.path.listed],
        f"sigma {ACROSS_PATH} [mm]": (1e3 * found.motion.sigma).tolist(),
        **({} if found.law.times is None else {"time [s]": found.law.times.tolist()}),
        **parts.joint_columns(found.optimisation_problem.robot, found.motion.Q),
    }


def path_figures(found: Solution) -> list[tuple[str, str]]:
    """Size of the path, largest standard deviation and step, first posture."""
    return [
        ("Points", f"{len(found.stations)}, {length(found.path.lengths[-1], 4)} long"),
        ("Standard deviation", f"at most {length(float(found.motion.sigma.max()))} {ACROSS_PATH}"),
        ("First posture", parts.joint_values(found.problem, found.motion.Q[0])),
    ]
