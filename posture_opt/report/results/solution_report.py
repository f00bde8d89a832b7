"""The report on a solution: one posture, one at each feature with their placement, or one at each point of a path."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.page.save import map_csv
from posture_opt.report.parts import parts, placement_parts, posture_parts, task_parts
from posture_opt.report.parts.solution_checks import checks_block, explain_report
from posture_opt.report.results import figures_of, scene_of
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.report.text.text import render
from posture_opt.report.text.words import CRITERIA
from posture_opt.selection.answer.solution_statements import part_of
from posture_opt.statements.notation import joint_unit, length, length_unit, place, probability, stated_length
from posture_opt.uncertainty.joint_digits import joint_digits

if TYPE_CHECKING:
    from posture_opt.report.page.save import Files
    from posture_opt.report.scene.arm_view import ArmView
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
        return Summary(f"{_STATUS[found.status]} of: {asked}", tuple(self.facts()))

    def facts(self) -> Iterable[tuple[str, str]]:
        found = self.result
        if found.along_path:
            return posture_parts.path_figures(found)
        if found.of_features:
            return placement_parts.features_figures(found)
        success = found.success_probability
        return (
            ("Posture", parts.joint_values(found.problem, found.q)),
            ("Tool point", place(found.spread.position)),
            ("Standard deviation", f"{task_parts.critical_size(found.critical)} {part_of(found)}"),
            ("95 % radius", f"{length(found.critical.radius95)} from the target"),
            *([] if success is None else [("Success probability", probability(success))]),
        )

    def document(self) -> Document:
        title = "Postures along a path" if self.result.along_path else "Posture selection"
        return Document(self.problem.name or title, self.result.statements, tuple(self.blocks()))

    def blocks(self) -> Iterable[Block]:
        found, worst = self.result, self.result.worst
        if found.status == "infeasible":
            # Which changes would help, what was asked, and what comes nearest.
            changes = tuple((change.change,) for change in found.relaxations)
            helps = (Table(("change",), changes),) * (len(changes) > 1)
            yield from (Block("Changes that each make the task feasible", helps), self.problem_block())
            if found.along_path:
                yield posture_parts.points_block(found)
            elif not found.of_features:
                yield posture_parts.posture_block(found, "Nearest posture")
            return
        yield self.problem_block()
        shared = (task_parts.task_budget_block(self.problem, found.task_spread), posture_parts.helps_block(found))
        if found.of_features:
            yield from (placement_parts.features_block(found), placement_parts.placements_block(found))
            yield from (placement_parts.order_block(found), *shared, placement_parts.features_checks(found))
        elif found.along_path:
            name = f"Posture with the largest standard deviation, {found.path.numbers[found.worst_index]}"
            yield from (posture_parts.points_block(found), posture_parts.posture_block(worst, name))
            yield from (posture_parts.spread_block(worst), *shared, posture_parts.path_checks(found))
        else:
            yield from (posture_parts.posture_block(found), posture_parts.spread_block(found), *shared)
            yield from (posture_parts.alternatives_block(found), checks_block(found))

    def problem_block(self) -> Block:
        """What was asked."""
        found, task, problem = self.result, self.result.optimisation_problem.task, self.problem
        stated = tuple(note for note in (*problem.notes, *found.notes) if isinstance(note, str))
        requirements = [posture_parts.bound_text(term) for term in task.subject_to]
        asked, sources = self._asked(), (*parts.source_facts(problem), *parts.workpiece_facts(problem))
        robot, inputs = parts.robot_facts(problem), parts.input_facts(problem)
        clearances = task_parts.clearance_facts(found.task_spread)
        if found.of_features:  # only the clearance that is theirs by default
            clearance = found.task.clearance
            clearances = [] if clearance is None else [("Clearance", f"{stated_length(clearance)} (radial)")]
        rows = [*robot, ("Task", f"{task.kind} - {task.summary}"), *asked, ("Minimised", self._aim()), *inputs]
        rows += [("Requirements", ", ".join(requirements))] if requirements else []
        rows += [*clearances, *sources, *parts.note_facts(stated)]
        briefly = [row for row in asked if row[0] not in ("Direction", "Features", "Workpiece", "Joint steps")]
        short = (robot[0], ("Task", task.kind), *briefly, *inputs, *sources, *parts.brief_notes(problem, stated))
        return Block("Problem", (Facts(tuple(rows)),), brief=(Facts(short),))

    def _asked(self) -> list[tuple[str, str]]:
        found = self.result
        if found.along_path:
            return posture_parts.path_facts(found)
        if found.of_features:
            return placement_parts.features_facts(found)
        direction = task_parts.task_facts(found.optimisation_problem.task, found.target.direction)[1]
        return [direction, ("Target", posture_parts.target_text(found.target))]

    def _aim(self) -> str:
        task, found = self.result.optimisation_problem.task, self.result
        if not found.points:
            return ", and ".join(task_parts.minimised_words(task))
        what = CRITERIA[task.criterion].format(part=part_of(found))
        if found.along_path:
            return f"{what}, at the worst point"
        return COMBINED["success"] if found.combine == "success" else f"{what}: {COMBINED[found.combine]}"

    def drawings(self) -> Drawings:
        found, worst = self.result, self.result.worst
        budget = partial(figures_of("solution").plot_task_budget, worst.spread, worst.task_spread)
        if self.result.along_path:
            return {
                "path": partial(figures_of("solution").plot_path, found),
                "arm": partial(scene_of("arm_figure").plot_motion, found),
                "budget": budget,
            }
        drawings: Drawings = {"arm": partial(scene_of("arm_figure").plot_solution, found.first)}
        if found.status == "infeasible":
            return drawings
        if self.result.of_features and placement_parts.placement_of(found).free.sum() > 1:
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
        found, path, values = self.result, self.result.along_path, ""
        kind, stem, names = "Feature", "feature", found.names
        every: Sequence[Solution] = found.stations
        if path:
            kind, stem, names = "Point of the path", "point", tuple(f"point {k}" for k in range(1, len(every) + 1))
        elif not found.points:
            kind, stem = "Posture", "alternative"
            failed, joints = found.status == "infeasible", found.optimisation_problem.robot.joint_names
            others = () if failed else found.alternatives[1:]
            every = [found, *(replace(found, q=np.array([a.posture[name] for name in joints])) for a in others)]
            first = ("best posture",) if found.best_of_all is None else ("ordinary posture", "best posture of all")
            ranked = (f"alternative {rank}" for rank in range(len(first) + 1, len(every) + 1))
            names = ("nearest posture",) if failed else (*first, *ranked)
        postures = scene_of("posture_views").solution_postures(every, names, stem)
        if path:
            unit, factor = length_unit([float(s) for s in found.motion.sigma])
            postures = tuple(
                replace(posture, value=round(factor * station.critical.sigma_max, 5))
                for posture, station in zip(postures, found.stations, strict=True)
            )
            values = f"standard deviation [{unit}]"
        robot, points = found.optimisation_problem.robot, bool(found.points)
        view: ArmView = scene_of("arm_view").ArmView(
            robot, postures, kind, self.problem.scene, points=points, line=path, values=values
        )
        return view

    def columns(self) -> Columns:
        found = self.result
        if found.along_path:
            return posture_parts.path_columns(found)
        if found.of_features:
            return placement_parts.features_columns(found)
        # The distinct postures that are locally best, the best first.
        best, robot = found.alternatives, found.optimisation_problem.robot
        return {
            **parts.joint_columns(robot, np.array([[a.posture[name] for name in robot.joint_names] for a in best])),
            **parts.point_columns(np.array([a.position for a in best])),
            "sigma_max [mm]": [1e3 * a.sigma_max for a in best],
        }

    def delivered(self) -> tuple[str, ...]:
        return ("postures.csv",) if self.result.along_path else ()

    def files(self) -> Files:
        if not self.result.along_path:
            return {}
        found, joints = self.result, self.result.optimisation_problem.robot.joints
        digits = joint_digits(found.problem, found.postures)
        decimals = max(6, *(digits.decimals(joint, 1 / joint_unit(joint.type)[1]) for joint in joints))
        return {"postures.csv": map_csv(posture_parts.path_columns(found), len(joints), decimals).encode()}

    def explain(self) -> str:
        return render(explain_report(self.result.worst))
