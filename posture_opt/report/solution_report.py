"""The report on a solution: problem, posture, spread, budget, alternatives, checks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.blocks import Block, Facts, Report, Summary, Table
from posture_opt.report.collision_parts import collision_facts, distance_facts
from posture_opt.report.improvement_parts import improvements_block
from posture_opt.report.parts import (
    ellipse_facts,
    first_order_fact,
    frame_notes,
    input_facts,
    joint_table,
    joint_values,
    lean,
    mean_fact,
    method_fact,
    note_facts,
    robot_facts,
    sentence,
    source_facts,
    tool_facts,
    validity_sentence,
)
from posture_opt.report.presenter import Columns, Presenter
from posture_opt.report.solution_checks import checks_block, explain_report, ranking_sentence
from posture_opt.report.task_parts import (
    clearance_facts,
    critical_rows,
    critical_size,
    minimised_words,
    orientation_rows,
    point_words,
    task_budget_block,
    task_facts,
)
from posture_opt.report.text import render
from posture_opt.report.units_text import (
    joint_unit,
    joint_value,
    length,
    length_unit,
    percent,
    place,
    probability,
    stated,
)
from posture_opt.report.words import PARTS
from posture_opt.uncertainty.regions import deviation
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem
    from posture_opt.selection.solution import Solution
    from posture_opt.selection.task_target import TaskTarget
    from posture_opt.selection.terms.term import Stated, Term

_WIDE = 110  # characters of headers, which break at spaces: the text has lines of 100
_STATUS = {"optimal": "Best posture", "feasible": "Best posture found", "infeasible": "No posture"}


def solution_report(solution: Solution) -> Report:
    """The blocks of a solution, or those of a failure: why, and what comes nearest."""
    problem = solution.problem
    title = problem.name or "Posture selection"
    if solution.status == "infeasible":
        least = [f"The least change that helps: {r.change}." for r in solution.relaxations[:1]]
        return Report(title, ("There is no posture for this task.", *least), (
            Block("Why", tuple(sentence(reason.message) for reason in solution.reasons)),
            *changes_block(solution),
            problem_block(problem, solution),
            nearest_block(solution),
        ))  # fmt: skip
    blocks = [
        problem_block(problem, solution),
        posture_block(solution),
        spread_block(solution),
        task_budget_block(problem, solution.task_spread),
        improvements_block(problem, solution.improvements, PARTS[solution.critical.within]),
        alternatives_block(solution),
        checks_block(solution),
    ]
    return Report(title, lead(solution), tuple(block for block in blocks if block.items))


def changes_block(solution: Solution) -> tuple[Block, ...]:
    """Changes of which any one makes the task possible, where there is a choice."""
    changes = tuple(f"- {sentence(relaxation.change)}" for relaxation in solution.relaxations)
    return (Block("Any one of these changes makes it possible", changes),) if len(changes) > 1 else ()


def lead(solution: Solution) -> tuple[str, ...]:
    """The answer in two sentences."""
    robot = solution.optimisation_problem.robot
    values = ", ".join(joint_value(v, j.type) for v, j in zip(solution.q, robot.joints, strict=True))
    answer = f"Best posture: {values}."
    if solution.status != "optimal":
        answer += " The solver did not confirm that it is an optimum; it is the best of all that were compared."
    part, size = PARTS[solution.critical.within], critical_size(solution.critical)
    return answer, f"{part[0].upper()}{part[1:]} {point_words(solution.task_spread)} then scatters by {size}."


def problem_block(problem: Problem, solution: Solution) -> Block:
    """What was asked."""
    optimisation_problem, target = solution.optimisation_problem, solution.target
    task = optimisation_problem.task
    rows = [
        *robot_facts(problem),
        *task_facts(task, target.direction),
        ("Target", target_words(target)),
        ("Minimised", ", and ".join(minimised_words(task))),
        *input_facts(problem),
    ]
    if task.subject_to:
        rows.append(("Required", ", ".join(_bound_words(term) for term in task.subject_to)))
    rows += clearance_facts(solution.task_spread)
    rows += collision_facts(problem.scene)
    rows += source_facts(problem)
    rows += note_facts((*problem.notes, *frame_notes(problem.robot), *solution.notes))
    return Block("Problem", (Facts(tuple(rows)),))


def target_words(target: TaskTarget) -> str:
    """Where the tool point is to go."""
    if target.kind == "point":
        return f"the point {place(target.lower)}"
    if target.kind == "anywhere":
        return "anywhere in reach: the workpiece may be placed"
    return f"anywhere in the box from {place(target.lower)} to {place(target.upper)}: the workpiece may be placed"


def _bound_words(term: Term) -> str:
    of = f" {PARTS[term.part]}" if term.part is not None else ""
    name = f"{term.kind.replace('_', ' ')}{of}"
    return ", ".join(f"{name}{f' of {bound.joint}' * bool(bound.joint)} {_sides(bound)}" for bound in term.stated())


def _sides(bound: Stated) -> str:
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
        allowed = f"{math.degrees(target.tilt):.6g} deg is allowed"
        facts.append(("Tool leans", f"{fixed(leaning)} deg off the direction; {allowed}"))
    facts += distance_facts(solution.problem.scene, solution.clearance)
    if solution.target.kind != "point":
        facts = [("Workpiece", f"place it so that the target is at {place(solution.spread.position)}"), *facts]
    return Block(
        "Posture", (joint_table(solution.optimisation_problem.robot, solution.q), Facts(tuple(facts))), figure="arm"
    )


def nearest_block(solution: Solution) -> Block:
    """The posture that violates the requirements least."""
    table = joint_table(solution.optimisation_problem.robot, solution.q)
    facts = (*tool_facts(solution.spread), *distance_facts(solution.problem.scene, solution.clearance))
    return Block("The posture that comes nearest", (table, Facts(facts)), figure="arm")


def spread_block(solution: Solution) -> Block:
    """How far the tool point scatters, in the part that counts first."""
    spread, critical = solution.spread, solution.critical
    first = solution.basis.T @ spread.covariance_first_order @ solution.basis
    among = [float(s) for s in spread.ellipse.semi_axes]  # the whole block in one unit
    rows = critical_rows(solution.task_spread, among, "target")
    rows += ellipse_facts(spread, among)
    rows.append(mean_fact(spread, among))
    linear = deviation(float(np.linalg.eigvalsh(first)[-1]), spread.covariance)
    rows.append(first_order_fact(critical.sigma_max, linear, among))
    rows += orientation_rows(solution)
    rows.append(method_fact(spread))
    return Block("Spread of the tool point", (Facts(tuple(rows)), validity_sentence(spread)), figure="cloud")


def alternatives_block(solution: Solution) -> Block:
    """The other postures that are locally best."""
    alternatives = solution.alternatives
    if len(alternatives) < 2:
        return Block("Alternatives", ("No other distinct posture was found to be locally best.",), figure="joint_map")
    joints = solution.optimisation_problem.robot.joints
    unit, factor = length_unit([a.sigma_max for a in alternatives])
    headers = ["rank", f"scatter [{unit}]", "more by"]
    headers += [f"{j.name} [{joint_unit(j.type)[0]}]" for j in joints]
    free = solution.target.kind != "point"
    headers += [f"{c} [mm]" for c in "xyz"] if free else []
    rows = []
    for rank, a in enumerate(alternatives, start=1):
        row = [str(rank), number(a.sigma_max * factor, 4), _more(a.sigma_max, alternatives[0].sigma_max)]
        row += [fixed(a.posture[j.name] * joint_unit(j.type)[1], 1) for j in joints]
        row += [fixed(1e3 * float(v), 1) for v in a.position] if free else []
        rows.append(tuple(row))
    views = tuple(f"alternative-{rank}" for rank in range(1, len(rows) + 1))
    table = (
        _turned(headers, rows)
        if sum(len(h) + 2 for h in headers) > _WIDE
        else Table(tuple(headers), tuple(rows), views=views)
    )
    return Block("Alternatives", (*ranking_sentence(solution), table), figure="joint_map")


def _turned(headers: Sequence[str], rows: Sequence[tuple[str, ...]]) -> Table:
    """The table with a line for each column: joints may have long names, and there are few alternatives."""
    lines = [(header, *(row[k] for row in rows)) for k, header in enumerate(headers)]
    return Table(lines[0], tuple(lines[1:]))


def _more(sigma: float, best: float) -> str:
    more = sigma / best - 1 if best > 0 else 0.0
    if abs(more) < 5e-5:
        return "-" if sigma == best else "the same"
    return percent(more)


def _summary(solution: Solution) -> Summary:
    critical = solution.critical
    place_words = "Tool point" if solution.status != "infeasible" else "Nearest point"
    facts = [
        ("Posture", joint_values(solution.optimisation_problem.robot, solution.q)),
        (place_words, place(solution.spread.position)),
        ("Scatter", f"{length(critical.sigma_max)} {PARTS[critical.within]} (one standard deviation)"),
        ("95 % within", f"{length(critical.radius95)} of the target"),
    ]
    if solution.success_probability is not None:
        facts.append(("Success", probability(solution.success_probability)))
    if solution.status == "infeasible":
        facts = [*facts[:2], ("Why", sentence(solution.reasons[0].message) if solution.reasons else "no posture fits")]
    asked = solution.problem.name or solution.optimisation_problem.task.kind
    return Summary(f"{_STATUS[solution.status]} of: {asked}", tuple(facts))


def _columns(solution: Solution) -> dict[str, list[float]]:
    """The distinct postures that are locally best, the best first."""
    found = solution.alternatives
    joints = {joint.name: joint_unit(joint.type) for joint in solution.optimisation_problem.robot.joints}
    postures = {f"{name} [{unit}]": [a.posture[name] * k for a in found] for name, (unit, k) in joints.items()}
    points = {f"{c} [mm]": [1e3 * float(a.position[i]) for a in found] for i, c in enumerate("xyz")}
    return {**postures, **points, "sigma_max [mm]": [1e3 * a.sigma_max for a in found]}


class SolutionPresenter(Presenter["Solution"]):
    """A solution, or the nearest posture where there is none."""

    document = "solution"

    def summary(self) -> Summary:
        return _summary(self.result)

    def report(self) -> Report:
        return solution_report(self.result)

    def columns(self) -> Columns:
        return _columns(self.result)

    def explain(self) -> str:
        """The optimisation problem with its values at the solution."""
        return render(explain_report(self.result))
