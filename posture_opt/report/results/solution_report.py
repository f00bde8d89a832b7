"""The report on a solution: one posture, one at each feature with their placement, or one at each point of a path."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.page.csv_table import map_csv
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.parts.parts import (
    brief_notes,
    input_facts,
    joint_values,
    note_facts,
    robot_facts,
    source_facts,
    workpiece_facts,
)
from posture_opt.report.parts.path_parts import path_checks, path_columns, path_facts, path_figures, points_block
from posture_opt.report.parts.placement_parts import (
    features_block,
    features_checks,
    features_columns,
    features_facts,
    features_figures,
    order_block,
    placement_of,
    placements_block,
)
from posture_opt.report.parts.posture_parts import (
    alternatives_block,
    bound_text,
    helps_block,
    posture_block,
    spread_block,
    target_text,
)
from posture_opt.report.parts.solution_checks import checks_block, explain_report
from posture_opt.report.parts.task_parts import (
    clearance_facts,
    critical_size,
    minimised_words,
    task_budget_block,
    task_facts,
)
from posture_opt.report.results.drawing_files import figures_of, views_of
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.report.text.text import render
from posture_opt.report.text.words import CRITERIA
from posture_opt.selection.answer.solution_statements import part_of
from posture_opt.statements.notation import joint_unit, length, length_unit, place, probability, stated_length
from posture_opt.uncertainty.spread.joint_digits import joint_digits

if TYPE_CHECKING:
    from posture_opt.report.interactive.arm_view import ArmView
    from posture_opt.report.page.save import Files
    from posture_opt.selection.answer.solution import Solution

_STATUS = {"optimal": "Best posture", "feasible": "Best posture found"}
COMBINED = {
    "worst": "the largest of all features",
    "mean": "the mean of all features",
    "success": "the probability of missing any feature",
}


class SolutionPresenter(Presenter["Solution"]):
    """A solution, or the nearest posture where there is none: what there is of stations, placement and path."""

    stem = "solution"

    def summary(self) -> Summary:
        found = self.result
        asked = found.problem.name or found.optimisation_problem.task.kind
        if found.status == "infeasible":
            said = tuple((one.label or "Why", one.text) for one in found.statements[:2])
            return Summary(f"No answer for: {asked}", said)
        figures = path_figures if found.along_path else features_figures if found.of_features else _figures
        return Summary(f"{_STATUS[found.status]} of: {asked}", tuple(figures(found)))

    def document(self) -> Document:
        found = self.result
        title = self.problem.name or ("Postures along a path" if found.along_path else "Posture selection")
        blocks = self._failed_blocks() if found.status == "infeasible" else self._blocks()
        return Document(title, found.statements, blocks)

    def _blocks(self) -> tuple[Block, ...]:
        """What was asked, the postures, and what they are compared with."""
        found, worst = self.result, self.result.worst
        budget = task_budget_block(self.problem, found.task_spread)
        if found.of_features:
            stations = (features_block(found), placements_block(found), order_block(found))
            return (self.problem_block(), *stations, budget, helps_block(found), features_checks(found))
        if not found.along_path:
            own = (posture_block(found), spread_block(found), budget, helps_block(found), alternatives_block(found))
            return (self.problem_block(), *own, checks_block(found))
        name = f"Posture with the largest standard deviation, {found.path.numbers[found.worst_index]}"
        stations = (points_block(found), posture_block(worst, name), spread_block(worst))
        return (self.problem_block(), *stations, budget, helps_block(found), path_checks(found))

    def _failed_blocks(self) -> tuple[Block, ...]:
        """Which changes would help, what was asked, and what comes nearest."""
        found = self.result
        changes = tuple((change.change,) for change in found.relaxations)
        helps = Block("Changes that each make the task feasible", (Table(("change",), changes),) * (len(changes) > 1))
        nearest = () if found.of_features else (
            points_block(found) if found.along_path else posture_block(found, "Nearest posture"),
        )  # fmt: skip
        return (helps, self.problem_block(), *nearest)

    def problem_block(self) -> Block:
        """What was asked."""
        found, task, problem = self.result, self.result.optimisation_problem.task, self.problem
        stated = tuple(note for note in (*problem.notes, *found.notes) if isinstance(note, str))
        every, requirements = stated, [bound_text(term) for term in task.subject_to]
        asked, sources = self._asked(), (*source_facts(problem), *workpiece_facts(problem))
        rows = (
            *robot_facts(problem), ("Task", f"{task.kind} - {task.summary}"), *asked, ("Minimised", self._aim()),
            *input_facts(problem), *([("Requirements", ", ".join(requirements))] if requirements else []),
            *self._clearance(), *sources,
            *note_facts(every),
        )  # fmt: skip
        briefly = [row for row in asked if row[0] not in ("Direction", "Features", "Workpiece", "Joint steps")]
        short = (rows[0], ("Task", task.kind), *briefly, *input_facts(problem), *sources)
        short = (*short, *brief_notes(problem, every))
        return Block("Problem", (Facts(rows),), brief=(Facts(short),))

    def _asked(self) -> list[tuple[str, str]]:
        """Where the tool point is to go."""
        found = self.result
        if found.along_path:
            return path_facts(found)
        if found.of_features:
            return features_facts(found)
        direction = task_facts(found.optimisation_problem.task, found.target.direction)[1]
        return [direction, ("Target", target_text(found.target))]

    def _aim(self) -> str:
        """What is minimised."""
        task, found = self.result.optimisation_problem.task, self.result
        if not found.points:
            return ", and ".join(minimised_words(task))
        what = CRITERIA[task.criterion].format(part=part_of(found))
        if found.along_path:
            return f"{what}, at the worst point"
        return COMBINED["success"] if found.combine == "success" else f"{what}: {COMBINED[found.combine]}"

    def _clearance(self) -> list[tuple[str, str]]:
        """The clearance and the peg; of features the clearance that is theirs by default."""
        if not self.result.of_features:
            return clearance_facts(self.result.task_spread)
        clearance = self.result.task.clearance
        return [] if clearance is None else [("Clearance", f"{stated_length(clearance)} (radial)")]

    def drawings(self) -> Drawings:
        """The bench or the path, where there is a choice or one; the arm; cloud, budget and map of joints."""
        found, worst = self.result, self.result.worst
        budget = partial(figures_of("solution").plot_task_budget, worst.spread, worst.task_spread)
        if self.result.along_path:
            return {
                "path": partial(figures_of("path").plot_path, found),
                "arm": partial(figures_of("arm").plot_motion, found),
                "budget": budget,
            }
        drawings: Drawings = {"arm": partial(figures_of("arm").plot_solution, found.first)}
        if found.status == "infeasible":
            return drawings
        if self.result.of_features and placement_of(found).free.sum() > 1:
            drawings = {"bench": partial(figures_of("bench").plot_bench, found), **drawings}
        drawings |= {
            "cloud": partial(figures_of("cloud").plot_cross_section, worst.spread, worst.task_spread),
            "budget": budget,
        }
        if not found.points and found.optimisation_problem.robot.n == 2:
            drawings["joint_map"] = partial(figures_of("solution").plot_joint_map, found)
        return drawings

    def view(self) -> ArmView:
        """The answer and its alternatives; a posture for each feature; the listed points, coloured by their scatter."""
        found, scene = self.result, self.problem.scene
        kind, stem = "Posture", "alternative"
        every, names = self._shown_alternatives() if not found.points else (found.stations, found.names)
        if self.result.of_features:
            kind, stem = "Feature", "feature"
        elif self.result.along_path:
            kind, stem, names = "Point of the path", "point", [f"point {k}" for k in range(1, len(every) + 1)]
        postures = views_of("solution_postures").solution_postures(every, names, stem)
        values = ""
        if self.result.along_path:
            unit, factor = length_unit([float(s) for s in found.motion.sigma])
            postures = tuple(
                replace(posture, value=round(factor * station.critical.sigma_max, 5))
                for posture, station in zip(postures, found.stations, strict=True)
            )
            values = f"standard deviation [{unit}]"
        robot, several = found.optimisation_problem.robot, bool(found.points)
        view: ArmView = views_of("arm_view").ArmView(
            robot, postures, kind, scene, points=several, line=self.result.along_path, values=values
        )
        return view

    def _shown_alternatives(self) -> tuple[list[Solution], list[str]]:
        """The answer and its alternatives, with their names."""
        found, joints = self.result, self.result.optimisation_problem.robot.joint_names
        others = found.alternatives[1:] if found.status != "infeasible" else ()
        every = [found, *(replace(found, q=np.array([a.posture[name] for name in joints])) for a in others)]
        names = ["best posture" if found.status != "infeasible" else "nearest posture"]
        return every, [*names, *(f"alternative {rank}" for rank in range(2, len(every) + 1))]

    def columns(self) -> Columns:
        found = self.result
        if self.result.along_path:
            return path_columns(found)
        return features_columns(found) if self.result.of_features else _one_columns(found)

    def delivered(self) -> tuple[str, ...]:
        return ("postures.csv",) if self.result.along_path else ()

    def files(self) -> Files:
        """All points of a path: places to 0.1 µm, joints as finely as rounding asks for, scatter to six digits."""
        if not self.result.along_path:
            return {}
        found, joints = self.result, self.result.optimisation_problem.robot.joints
        digits = joint_digits(found.problem, found.postures)
        decimals = max(6, *(digits.decimals(joint, 1 / joint_unit(joint.type)[1]) for joint in joints))
        return {"postures.csv": map_csv(path_columns(found), len(joints), decimals).encode()}

    def explain(self) -> str:
        """The optimisation problem of the worst station with its values there."""
        return render(explain_report(self.result.worst))


def _figures(found: Solution) -> list[tuple[str, str]]:
    """The posture, its tool point, and what it is worth."""
    critical, p_success = found.critical, found.success_probability
    return [
        ("Posture", joint_values(found.problem, found.q)),
        ("Tool point", place(found.spread.position)),
        ("Standard deviation", f"{critical_size(critical)} {part_of(found)}"),
        ("95 % radius", f"{length(critical.radius95)} from the target"),
        *([] if p_success is None else [("Success probability", probability(p_success))]),
    ]


def _one_columns(solution: Solution) -> dict[str, list[float]]:
    """The distinct postures that are locally best, the best first."""
    found = solution.alternatives
    joints = {joint.name: joint_unit(joint.type) for joint in solution.optimisation_problem.robot.joints}
    postures = {f"{name} [{unit}]": [a.posture[name] * k for a in found] for name, (unit, k) in joints.items()}
    points = {f"{c} [mm]": [1e3 * float(a.position[i]) for a in found] for i, c in enumerate("xyz")}
    return {**postures, **points, "sigma_max [mm]": [1e3 * a.sigma_max for a in found]}
