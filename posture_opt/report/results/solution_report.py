"""The report on a solution: problem, posture, spread, budget, alternatives, checks."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.parts.budget_parts import main_fact
from posture_opt.report.parts.collision_parts import collision_facts, distance_facts
from posture_opt.report.parts.improvement_parts import improvements_block
from posture_opt.report.parts.parts import (
    ellipse_facts,
    first_order_fact,
    frame_notes,
    input_facts,
    joint_table,
    joint_values,
    lean,
    mean_fact,
    method_fact,
    nearest_limit,
    note_facts,
    robot_facts,
    sentence,
    source_facts,
    tool_facts,
    validity_sentence,
)
from posture_opt.report.parts.solution_checks import checks_block, explain_report, gain_facts, ranking_sentence
from posture_opt.report.parts.task_parts import (
    clearance_facts,
    critical_rows,
    critical_size,
    minimised_words,
    orientation_rows,
    spread_lead,
    task_budget_block,
    task_facts,
)
from posture_opt.report.results.drawing_files import figures_of, views_of
from posture_opt.report.text.blocks import Block, Facts, Report, Summary, Table
from posture_opt.report.text.text import render
from posture_opt.report.text.units_text import (
    joint_unit,
    length,
    length_unit,
    percent,
    place,
    probability,
    stated,
)
from posture_opt.report.text.words import part_words
from posture_opt.uncertainty.regions.regions import deviation
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.report.interactive.arm_view import ArmView
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.selection.program.task_target import TaskTarget
    from posture_opt.selection.terms.term import Stated, Term

_STATUS = {"optimal": "Best posture", "feasible": "Best posture found", "infeasible": "No posture"}


def solution_report(solution: Solution) -> Report:
    """The blocks of a solution, or those of a failure: why, and what comes nearest."""
    problem = solution.problem
    title = problem.name or "Posture selection"
    if solution.status == "infeasible":
        least = [f"Smallest change that makes it feasible: {r.change}." for r in solution.relaxations[:1]]
        return Report(title, ("No posture meets the requirements of this task.", *least), (
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
        improvements_block(
            problem, solution.improvements, part_words(solution.critical.within, solution.task_spread.kind)
        ),
        alternatives_block(solution),
        checks_block(solution),
    ]
    return Report(title, lead(solution), tuple(block for block in blocks if block.items))


def changes_block(solution: Solution) -> tuple[Block, ...]:
    """Changes of which any one makes the task possible, where there is a choice."""
    changes = tuple(f"- {sentence(relaxation.change)}" for relaxation in solution.relaxations)
    return (Block("Each of these changes makes the task feasible", changes),) if len(changes) > 1 else ()


def lead(solution: Solution) -> tuple[str, ...]:
    """The spread that the task cares about, the posture, where the workpiece goes, and doubts about the optimum."""
    size, *p_success = spread_lead(solution.task_spread)
    posture = f"Best posture: {joint_values(solution.problem, solution.q)}."
    placed = [f"Place the workpiece so that the target is at {place(solution.spread.position)}."]
    doubt = ["The solver did not confirm an optimum; this is the best posture found."]
    free, sure = solution.target.kind != "point", solution.status == "optimal"
    return (size, posture, *p_success, *(placed if free else []), *([] if sure else doubt))


def problem_block(problem: ProblemData, solution: Solution) -> Block:
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
        rows.append(("Requirements", ", ".join(_bound_words(term) for term in task.subject_to)))
    rows += clearance_facts(solution.task_spread)
    rows += collision_facts(problem.scene)
    rows += source_facts(problem)
    notes = note_facts((*problem.notes, *frame_notes(problem.robot), *solution.notes))
    told = (*input_facts(problem), *source_facts(problem), *notes)
    short = (rows[0], ("Task", task.kind), ("Target", target_words(target)), *told)
    return Block("Problem", (Facts((*rows, *notes)),), brief=(Facts(short),))


def target_words(target: TaskTarget) -> str:
    """Where the tool point is to go."""
    if target.kind == "point":
        return f"the point {place(target.lower)}"
    if target.kind == "anywhere":
        return "anywhere in reach (the workpiece may be moved)"
    return f"anywhere in the box from {place(target.lower)} to {place(target.upper)} (the workpiece may be moved)"


def _bound_words(term: Term) -> str:
    of = f" {part_words(term.part, '')}" if term.part is not None else ""
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
    rows.append(method_fact(spread))
    items = (Facts(tuple(rows)), validity_sentence(spread))
    contributions = main_fact(solution.problem.arm, solution.task_spread.budget_groups)
    brief = Facts((*rows[:short], contributions, *gain_facts(solution)[:1]))
    return Block("Spread of the tool point", items, figure="cloud", brief=(brief,))


def alternatives_block(solution: Solution) -> Block:
    """The other local optima."""
    alternatives = solution.alternatives
    if len(alternatives) < 2:
        return Block("Alternatives", ("No other local optimum was found.",), figure="joint_map", brief=())
    joints = solution.optimisation_problem.robot.joints
    unit, factor = length_unit([a.sigma_max for a in alternatives])
    headers = ["rank", f"std. dev. [{unit}]", "difference"]
    headers += [f"{j.name} [{joint_unit(j.type)[0]}]" for j in joints]
    free = solution.target.kind != "point"
    headers += [f"{c} [mm]" for c in "xyz"] if free else []
    rows = []
    for rank, a in enumerate(alternatives, start=1):
        row = [str(rank), number(a.sigma_max * factor), _more(a.sigma_max, alternatives[0].sigma_max)]
        row += [fixed(a.posture[j.name] * joint_unit(j.type)[1], 1) for j in joints]
        row += [fixed(1e3 * float(v), 1) for v in a.position] if free else []
        rows.append(tuple(row))
    views = tuple(f"alternative-{rank}" for rank in range(1, len(rows) + 1))
    table = Table(tuple(headers), tuple(rows), views=views)
    return Block("Alternatives", (*ranking_sentence(solution), table), figure="joint_map")


def _more(sigma: float, best: float) -> str:
    more = sigma / best - 1 if best > 0 else 0.0
    if abs(more) < 5e-5:
        return "-" if sigma == best else "same"
    return f"+{percent(more)}" if more > 0 else percent(more)


def _summary(solution: Solution) -> Summary:
    critical = solution.critical
    place_words = "Tool point" if solution.status != "infeasible" else "Nearest point"
    facts = [
        ("Posture", joint_values(solution.problem, solution.q)),
        (place_words, place(solution.spread.position)),
        ("Standard deviation", f"{critical_size(critical)} {part_words(critical.within, solution.task_spread.kind)}"),
        ("95 % radius", f"{length(critical.radius95)} from the target"),
    ]
    if solution.success_probability is not None:
        facts.append(("Success probability", probability(solution.success_probability)))
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

    def drawings(self) -> Drawings:
        """The arm; where there is a posture, its cloud across the direction, its budget, and a map of two joints."""
        found = self.result
        drawings: Drawings = {"arm": partial(figures_of("arm").plot_solution, found)}
        if found.status == "infeasible":
            return drawings
        drawings["cloud"] = partial(figures_of("cloud").plot_cross_section, found.spread, found.task_spread)
        drawings["budget"] = partial(figures_of("solution").plot_task_budget, found.spread, found.task_spread)
        if found.optimisation_problem.robot.n == 2:
            drawings["joint_map"] = partial(figures_of("solution").plot_joint_map, found)
        return drawings

    def view(self) -> ArmView:
        """The answer and its alternatives."""
        found = self.result
        joints = found.optimisation_problem.robot.joint_names
        others = found.alternatives[1:] if found.status != "infeasible" else ()
        every = [found, *(replace(found, q=np.array([a.posture[name] for name in joints])) for a in others)]
        names = ["best posture" if found.status != "infeasible" else "nearest posture"]
        names += [f"alternative {rank}" for rank in range(2, len(every) + 1)]
        postures = views_of("solution_postures").solution_postures(every, names, "alternative")
        view: ArmView = views_of("arm_view").ArmView(
            found.optimisation_problem.robot, postures, "Posture", found.problem.scene
        )
        return view

    def columns(self) -> Columns:
        return _columns(self.result)

    def explain(self) -> str:
        """The optimisation problem with its values at the solution."""
        return render(explain_report(self.result))
