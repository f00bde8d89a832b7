"""The report on a solution: one posture, one at each feature with their placement, or one at each point of a path."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.page.csv_table import map_csv
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.parts.collision_parts import (
    collision_facts,
    mounting_lead,
    pierced_lead,
    unchecked_facts,
    workpiece_lead,
)
from posture_opt.report.parts.improvement_parts import improvements_block, most_helpful
from posture_opt.report.parts.measured_range_parts import beyond_lead
from posture_opt.report.parts.parts import (
    brief_notes,
    frame_notes,
    input_facts,
    joint_values,
    note_facts,
    robot_facts,
    sentence,
    source_facts,
    workpiece_facts,
)
from posture_opt.report.parts.path_parts import (
    ACROSS,
    path_checks,
    path_columns,
    path_facts,
    path_lead,
    path_summary,
    path_workpiece,
    point_words,
    points_block,
    step_words,
)
from posture_opt.report.parts.placement_parts import (
    COMBINED,
    features_block,
    features_checks,
    features_columns,
    features_facts,
    features_lead,
    features_summary,
    no_placement_lead,
    order_block,
    placement_of,
    placements_block,
)
from posture_opt.report.parts.posture_parts import (
    alternatives_block,
    bound_words,
    changes_block,
    limit_lead,
    nearest_block,
    posture_block,
    spread_block,
    target_words,
)
from posture_opt.report.parts.solution_checks import NO_GAIN, SMALL_GAIN, checks_block, explain_report
from posture_opt.report.parts.task_parts import (
    clearance_facts,
    critical_size,
    minimised_words,
    spread_lead,
    task_budget_block,
    task_facts,
)
from posture_opt.report.results.drawing_files import figures_of, views_of
from posture_opt.report.text.blocks import Block, Facts, Report, Summary
from posture_opt.report.text.text import render
from posture_opt.report.text.words import CRITERIA, part_words
from posture_opt.statements.notation import (
    joint_unit,
    length,
    length_unit,
    percent,
    place,
    probability,
    stated_length,
)
from posture_opt.uncertainty.spread.joint_digits import joint_digits

if TYPE_CHECKING:
    from posture_opt.report.interactive.arm_view import ArmView
    from posture_opt.report.page.save import Files
    from posture_opt.selection.answer.solution import Solution

_STATUS = {"optimal": "Best posture", "feasible": "Best posture found", "infeasible": "No posture"}


class SolutionPresenter(Presenter["Solution"]):
    """A solution, or the nearest posture where there is none: what there is of stations, placement and path."""

    stem = "solution"

    @property
    def along_path(self) -> bool:
        """Whether the stations are the points of a path."""
        return self.result.followed is not None

    @property
    def of_features(self) -> bool:
        """Whether the stations are features that share a placement."""
        return bool(self.result.points) and not self.along_path

    @property
    def part(self) -> str:
        """The part of the spread that counts, in words."""
        critical = self.result.critical
        return ACROSS if self.along_path else part_words(critical.within, self.result.task_spread.kind)

    def summary(self) -> Summary:
        found = self.result
        return path_summary(found) if self.along_path else features_summary(found) if self.of_features else _one(found)

    def document(self) -> Report:
        found = self.result
        title = self.problem.name or ("Postures along a path" if self.along_path else "Posture selection")
        if found.status == "infeasible":
            return Report(title, self._failed_lead(), tuple(self._failed_blocks()))
        blocks = (
            self.problem_block(),
            *self._station_blocks(),
            task_budget_block(self.problem, found.task_spread),
            improvements_block(self.problem, found.improvements, found.prices, found.sigma, self.part),
            *(() if found.points else (alternatives_block(found),)),
            path_checks(found) if self.along_path else features_checks(found) if found.points else checks_block(found),
        )
        lead = path_lead if self.along_path else features_lead if self.of_features else _one_lead
        first, last = mounting_lead(self.problem.scene, found.postures)
        first = (*first, *pierced_lead(self.problem.scene, found.postures))
        first = (*first, *beyond_lead(self.problem.arm, found.postures))
        last = (*workpiece_lead(found), *limit_lead(self.problem.robot, found.postures), *last)
        return Report(title, (*first, *lead(found), *last), tuple(block for block in blocks if block.items))

    def _station_blocks(self) -> tuple[Block, ...]:
        """The postures, and what the stations share."""
        found, worst = self.result, self.result.worst
        if self.of_features:
            return features_block(found), placements_block(found), order_block(found)
        if not self.along_path:
            return posture_block(found), spread_block(found)
        name = f"Posture {point_words(found, found.worst_index)}, where the standard deviation is largest"
        return points_block(found), Block(name, posture_block(worst).items, figure="arm"), spread_block(worst)

    def _failed_lead(self) -> tuple[str, ...]:
        found = self.result
        if self.along_path:
            return ("No motion along this path meets the requirements.",)
        if self.of_features:
            return no_placement_lead(found)
        least = [f"Smallest change that makes it feasible: {change.change}." for change in found.relaxations[:1]]
        return ("No posture meets the requirements of this task.", *least)

    def _failed_blocks(self) -> list[Block]:
        """Why, what would help, what was asked, and what comes nearest."""
        found = self.result
        why = Block("Why", tuple(sentence(reason.message) for reason in found.reasons))
        if self.along_path:
            return [why, self.problem_block(), points_block(found)]
        if self.of_features:
            helps = Block("What would help", tuple(sentence(change.change) for change in found.relaxations))
            return [why, helps, self.problem_block()]
        return [why, *changes_block(found), self.problem_block(), nearest_block(found)]

    def problem_block(self) -> Block:
        """What was asked."""
        found, problem = self.result, self.problem
        task, asked = found.optimisation_problem.task, self._asked()
        every = (*problem.notes, *frame_notes(problem.robot), *found.notes)
        rows = [*robot_facts(problem), ("Task", f"{task.kind} - {task.summary}"), *asked, ("Minimised", self._aim())]
        if self.along_path:
            rows.append(("Joint steps", f"between listed points: at most {step_words(found, found.largest_step)}"))
        rows += input_facts(problem)
        if task.subject_to:
            rows.append(("Requirements", ", ".join(bound_words(term) for term in task.subject_to)))
        rows += self._clearance()
        sources = (*source_facts(problem), *workpiece_facts(problem))
        rows += [*collision_facts(problem.scene), *unchecked_facts(problem.scene), *sources, *note_facts(every)]
        briefly = [row for row in asked if row[0] not in ("Direction", "Features", "Workpiece")]
        short = (rows[0], ("Task", task.kind), *briefly, *input_facts(problem), *sources)
        short = (*short, *unchecked_facts(problem.scene), *brief_notes(problem, every))
        return Block("Problem", (Facts(tuple(rows)),), brief=(Facts(short),))

    def _asked(self) -> list[tuple[str, str]]:
        """Where the tool point is to go."""
        found = self.result
        if self.along_path:
            return [*path_facts(found), *path_workpiece(found)]
        if self.of_features:
            return features_facts(found)
        direction = task_facts(found.optimisation_problem.task, found.target.direction)[1]
        return [direction, ("Target", target_words(found.target))]

    def _aim(self) -> str:
        """What is minimised."""
        task, found = self.result.optimisation_problem.task, self.result
        if self.along_path:
            return f"at the worst point, {CRITERIA[task.criterion].format(part=ACROSS)}"
        if not self.of_features:
            return ", and ".join(minimised_words(task))
        what = CRITERIA[found.task.criterion].format(part=self.part)
        return COMBINED["success"] if found.combine == "success" else f"{what}: {COMBINED[found.combine]}"

    def _clearance(self) -> list[tuple[str, str]]:
        """The clearance and the peg; of features the clearance that is theirs by default."""
        if not self.of_features:
            return clearance_facts(self.result.task_spread)
        clearance = self.result.task.clearance
        return [] if clearance is None else [("Clearance", f"{stated_length(clearance)} (radial)")]

    def drawings(self) -> Drawings:
        """The bench or the path, where there is a choice or one; the arm; cloud, budget and map of joints."""
        found, worst = self.result, self.result.worst
        budget = partial(figures_of("solution").plot_task_budget, worst.spread, worst.task_spread)
        if self.along_path:
            return {
                "path": partial(figures_of("path").plot_path, found),
                "arm": partial(figures_of("arm").plot_motion, found),
                "budget": budget,
            }
        drawings: Drawings = {"arm": partial(figures_of("arm").plot_solution, found.first)}
        if found.status == "infeasible":
            return drawings
        if self.of_features and placement_of(found).free.sum() > 1:
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
        if self.of_features:
            kind, stem = "Feature", "feature"
        elif self.along_path:
            kind, stem, names = "Point of the path", "point", [f"point {k}" for k in range(1, len(every) + 1)]
        postures = views_of("solution_postures").solution_postures(every, names, stem)
        values = ""
        if self.along_path:
            unit, factor = length_unit([float(s) for s in found.motion.sigma])
            postures = tuple(
                replace(posture, value=round(factor * station.critical.sigma_max, 5))
                for posture, station in zip(postures, found.stations, strict=True)
            )
            values = f"standard deviation [{unit}]"
        robot, several = found.optimisation_problem.robot, bool(found.points)
        view: ArmView = views_of("arm_view").ArmView(
            robot, postures, kind, scene, points=several, line=self.along_path, values=values
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
        if self.along_path:
            return path_columns(found)
        return features_columns(found) if self.of_features else _one_columns(found)

    def delivered(self) -> tuple[str, ...]:
        return ("postures.csv",) if self.along_path else ()

    def files(self) -> Files:
        """All points of a path: places to 0.1 µm, joints as finely as rounding asks for, scatter to six digits."""
        if not self.along_path:
            return {}
        found, joints = self.result, self.result.optimisation_problem.robot.joints
        digits = joint_digits(found.problem, found.postures)
        decimals = max(6, *(digits.decimals(joint, 1 / joint_unit(joint.type)[1]) for joint in joints))
        return {"postures.csv": map_csv(path_columns(found), len(joints), decimals).encode()}

    def explain(self) -> str:
        """The optimisation problem of the worst station with its values there."""
        return render(explain_report(self.result.worst))


def _one_lead(solution: Solution) -> tuple[str, ...]:
    """The spread that the task cares about, the posture, where the workpiece goes, and doubts about the optimum."""
    size, *p_success = spread_lead(solution.task_spread)
    posture = f"Best posture: {joint_values(solution.problem, solution.q)}."
    placed = [f"Place the workpiece so that the target is at {place(solution.spread.position)}."]
    doubt = ["The solver did not confirm an optimum; this is the best posture found."]
    free, sure = solution.target.kind != "point", solution.status == "optimal"
    return (size, posture, *p_success, *(placed if free else []), *_helps(solution), *([] if sure else doubt))


def _helps(solution: Solution) -> tuple[str, ...]:
    """What helps the most, where the choice of the posture gains little."""
    typical, helps = (
        solution.statistics.typical,
        most_helpful(solution.problem, solution.improvements, solution.sigma_max),
    )
    gain = solution.gain_over(typical)
    if not helps or not math.isfinite(typical) or abs(gain) >= SMALL_GAIN:
        return ()
    little = "nothing" if gain < NO_GAIN else f"only {percent(gain)}"
    return (f"The choice of the posture gains {little}. What would help most: {helps}.",)


def _one(solution: Solution) -> Summary:
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


def _one_columns(solution: Solution) -> dict[str, list[float]]:
    """The distinct postures that are locally best, the best first."""
    found = solution.alternatives
    joints = {joint.name: joint_unit(joint.type) for joint in solution.optimisation_problem.robot.joints}
    postures = {f"{name} [{unit}]": [a.posture[name] * k for a in found] for name, (unit, k) in joints.items()}
    points = {f"{c} [mm]": [1e3 * float(a.position[i]) for a in found] for i, c in enumerate("xyz")}
    return {**postures, **points, "sigma_max [mm]": [1e3 * a.sigma_max for a in found]}
