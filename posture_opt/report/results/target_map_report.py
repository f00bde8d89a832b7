"""The report on a map of targets: the best place, the worst, and what the file's own position gives away.

Compared are standard deviations of the part that the task counts, in one unit per table. A target without a posture is
"-" in tables and NaN in columns.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, ClassVar

from posture_opt.report.figures.target_map import plot_target_map
from posture_opt.report.interactive.target_view import target_key, target_view
from posture_opt.report.page.csv_table import map_csv
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.page.save import Files
from posture_opt.report.parts.collision_parts import collision_facts, mounting_lead
from posture_opt.report.parts.measured_range_parts import beyond_lead
from posture_opt.report.parts.parts import (
    brief_notes,
    frame_notes,
    input_facts,
    joint_values,
    note_facts,
    robot_facts,
    source_facts,
    workpiece_facts,
)
from posture_opt.report.parts.solution_checks import confirmation_words
from posture_opt.report.text.blocks import Block, Facts, Report, Summary, Table
from posture_opt.report.text.words import CRITERIA, PARTS, direction_words, line_words, part_words
from posture_opt.statements.notation import count, joint_unit, length, length_unit, percent, place
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.report.interactive.arm_view import ArmView
    from posture_opt.selection.maps.map_points import Grid, MapPoint
    from posture_opt.selection.maps.target_map import TargetMap
    from posture_opt.selection.problem_data import ProblemData

_GAIN_TOLERANCE = 5e-4  # of the spread: what a map cannot promise to win
_MAX_PERCENT_RATIO = 1.5  # times: below, a gain is written in percent


def target_map_report(found: TargetMap) -> Report:
    """Problem, places, the map itself."""
    problem: ProblemData = found.problem
    title = problem.name or "Map of targets"
    first, last = mounting_lead(found.problem.scene, found.postures[found.feasible])
    first = (*first, *beyond_lead(problem.arm, found.postures[found.feasible]))
    return Report(
        title, (*first, *lead(found), *last), (problem_block(problem, found), places_block(found), map_block(found))
    )


def lead(found: TargetMap) -> tuple[str, ...]:
    """The best place, and what it is better than: the position in the problem, where there is one, and the worst
    target.
    """
    best, worst = found.best, found.worst
    part = part_words(found.within, found.optimisation_problem.task.kind)
    answer = f"Best target: {place(best.position)}, standard deviation {part} {length(best.sigma_max)}."
    others = [f"Worst target of the map: {length(worst.sigma_max)}."]
    if found.own is not None:
        others.insert(0, _own_sentence(best, found.own))
    return answer, " ".join(others)


def _own_sentence(best: MapPoint, own: MapPoint) -> str:
    """What moving the workpiece from the position in the problem to the best target gains.

    In percent below a ratio of 1.5, else as a factor; no gain below 0.05 %, which the map cannot resolve.
    """
    if not own.feasible:
        return "The position in the problem has no feasible posture."
    scatter = f"Position in the problem: {length(own.sigma_max)}"
    ratio = own.sigma_max / best.sigma_max if best.sigma_max > 0 else 1.0
    if ratio < 1 + _GAIN_TOLERANCE:
        return f"{scatter}; no target of the map is better."
    gain = f"{percent(1 - 1 / ratio)} lower" if ratio < _MAX_PERCENT_RATIO else f"{number(ratio)} times lower"
    return f"{scatter}; the best target is {gain}."


def problem_block(problem: ProblemData, found: TargetMap) -> Block:
    """What was asked, and where: robot, task, direction (world), criterion, grid, collision checks, sources, notes."""
    task = found.optimisation_problem.task
    rows = [
        *robot_facts(problem),
        *input_facts(problem),
        ("Task", f"{task.kind} - {task.summary}"),
        ("Direction", f"{direction_words(found.target.direction)} in the world"),
        ("Minimised", CRITERIA[task.criterion].format(part=part_words(task.within, task.kind))),
        ("Targets", grid_words(found.grid)),
        *collision_facts(problem.scene),
        *source_facts(problem),
        *workpiece_facts(problem),
        *note_facts((*problem.notes, *frame_notes(problem.robot), *found.notes)),
    ]
    notes = brief_notes(problem, (*problem.notes, *found.notes))
    short = (
        rows[0],
        ("Task", task.kind),
        ("Targets", grid_words(found.grid)),
        *source_facts(problem),
        *workpiece_facts(problem),
        *notes,
    )
    return Block("Problem", (Facts(tuple(rows)),), brief=(Facts(short),))


def grid_words(grid: Grid) -> str:
    """How many targets, and what they cover: size, the range along each axis [mm], and the origin of a turned grid."""
    u, v, w = map(len, grid.values)
    texts = []
    for axis, values in zip(grid.axes, grid.values, strict=True):
        name = line_words(axis)
        low, high = (fixed(1e3 * value, 1) for value in (values[0], values[-1]))
        texts.append(f"{name} = {low} mm" if len(values) == 1 else f"{name} from {low} to {high} mm")
    size = " x ".join(str(n) for n in (u, v, w) if n > 1)
    off = "" if grid.aligned else f", off {place(grid.origin)}"
    return f"{size}: {', '.join(texts)}{off}"


def places_block(found: TargetMap) -> Block:
    """Best, worst and own place with their postures; the own one where it has a posture."""
    map_points = {"best target": found.best, "worst target": found.worst}
    if found.own is not None and found.own.feasible:
        map_points = {"best target": found.best, "position in the problem": found.own, "worst target": found.worst}
    table = places_table(found, map_points)
    return Block("Targets compared", (table,))


def places_table(found: TargetMap, map_points: dict[str, MapPoint]) -> Table:
    """Target, spread and posture of some places.

    Columns: x, y, z [mm] in the world frame, standard deviation in the unit of the largest, joints [deg or mm].
    """
    joints = found.optimisation_problem.robot.joints
    unit, factor = length_unit([map_point.sigma_max for map_point in map_points.values()])
    headers = ["", *(f"{c} [mm]" for c in "xyz"), f"std. dev. [{unit}]"]
    headers += [f"{joint.name} [{joint_unit(joint.type)[0]}]" for joint in joints]
    rows = []
    for name, map_point in map_points.items():
        cells = [
            name,
            *(fixed(1e3 * value, 1) for value in map_point.position),
            number(factor * map_point.sigma_max),
        ]
        cells += [fixed(q * joint_unit(joint.type)[1], 1) for q, joint in zip(map_point.q, joints, strict=True)]
        rows.append(tuple(cells))
    return Table(tuple(headers), tuple(rows), views=tuple(target_key(map_point) for map_point in map_points.values()))


def map_block(found: TargetMap) -> Block:
    """How much of the map can be served, and the figure."""
    return Block("Map", (served_sentence(found), neighbours_sentence(found), *_small_table(found)), figure="map")


def served_sentence(found: TargetMap) -> str:
    """How many targets have a posture, and what keeps the others from one.

    Either no posture reaches the target with the required orientation, or each that does violates a requirement.
    """
    statuses = [map_point.status for map_point in found.map_points]
    text = f"{statuses.count('feasible')} of {count(len(statuses), 'target')} have a feasible posture"
    if statuses.count("feasible") == 1:
        text = f"1 of {count(len(statuses), 'target')} has a feasible posture"
    away, kept = statuses.count("not reached"), statuses.count("requirement not met")
    how = "" if found.optimisation_problem.alignment == "free" else " with the required tool orientation"
    why = [f"{away} unreachable{how}"] * (away > 0)
    why += [f"{kept} reachable, but not with all requirements met"] * (kept > 0)
    unsure = sum(map_point.feasible and not map_point.optimal for map_point in found.map_points)
    note = f" At {count(unsure, 'target')} the solver did not confirm an optimum." if unsure else ""
    return f"{text}; {', '.join(why)}.{note}" if why else f"{text}.{note}"


def neighbours_sentence(found: TargetMap) -> str:
    """How many targets were solved again from postures of their neighbours, and by how much that improved them."""
    solves = found.solves
    text = f"Neighbouring postures were tried at every target, and {count(solves.again, 'target')} solved again: "
    gain = f"by up to {percent(solves.most)}" if solves.most >= _GAIN_TOLERANCE else "by less than 0.05 %"
    text += f"{solves.better} improved, {gain}." if solves.better else "none improved."
    text += f" {count(solves.found, 'target')} found a posture only from a neighbour." if solves.found else ""
    if found.confirmation is None:
        return text
    return f"{text} Best, worst and own target: {confirmation_words(found.confirmation)}."


def _small_table(found: TargetMap) -> tuple[Table, ...]:
    """The numbers of a map that has one layer, at most 11 columns and 17 rows; larger ones are shown as a figure only.

    Rows run from the largest coordinate of the second axis to the smallest, as in the figure.
    """
    layers, rows, columns = found.grid.shape
    if layers > 1 or columns > 11 or rows > 17:
        return ()
    unit, factor = length_unit([found.worst.sigma_max])
    u, v = (line_words(axis) for axis in found.grid.axes[:2])
    headers = (f"{v} \\ {u} [mm]", *(fixed(1e3 * value, 0) for value in found.grid.values[0]))
    values = found.sigma.reshape(rows, columns)
    cells = [
        (fixed(1e3 * at, 0), *("-" if s != s else number(factor * s) for s in row))
        for at, row in zip(found.grid.values[1][::-1], values[::-1], strict=True)
    ]
    return (Table((f"{unit}: {headers[0]}", *headers[1:]), tuple(cells), text_columns=0),)


def columns(found: TargetMap) -> dict[str, list[float]]:
    """One row a target: place, whether there is a posture, its spread, and the posture; NaN where there is none.

    Lengths are in mm, joints in deg or mm; "success" is there where the task has a clearance.
    """
    part, points = PARTS[found.within], found.map_points
    success = {"success": [s.success_probability for s in points]} if not math.isnan(found.target.clearance) else {}
    return {
        **place_columns(found),
        f"sigma {part} [mm]": [1e3 * s.sigma_max for s in points],
        "sigma along the direction [mm]": [1e3 * s.sigma_along for s in points],
        f"95 % radius {part} [mm]": [1e3 * s.radius95 for s in points],
        **success,
        **posture_columns(found),
    }


def place_columns(found: TargetMap) -> dict[str, list[float]]:
    """Where the targets are [mm, world frame], and 1 where there is a posture, else 0."""
    points = {f"{c} [mm]": [1e3 * s.position[k] + 0.0 for s in found.map_points] for k, c in enumerate("xyz")}
    return {**points, "feasible": [int(s.feasible) for s in found.map_points]}


def posture_columns(found: TargetMap) -> dict[str, list[float]]:
    """The posture at every target, a column a joint [deg or mm]."""
    joints = [(joint.name, *joint_unit(joint.type)) for joint in found.optimisation_problem.robot.joints]
    return {f"{name} [{u}]": [s.q[k] * factor for s in found.map_points] for k, (name, u, factor) in enumerate(joints)}


class TargetMapPresenter(Presenter["TargetMap"]):
    """The best posture over a grid of targets; ``map.csv`` has a row a target."""

    stem = "map"
    delivers: ClassVar[tuple[str, ...]] = ("map.csv",)

    def summary(self) -> Summary:
        """Grid, feasible targets, the best target with its posture, the worst."""
        found, best = self.result, self.result.best
        part = part_words(found.within, found.optimisation_problem.task.kind)
        facts = (
            ("Targets", grid_words(found.grid)),
            ("Feasible", served_sentence(found)),
            ("Best target", f"{place(best.position)}: {length(best.sigma_max)} {part} (1 σ)"),
            ("Its posture", joint_values(found.problem, best.q)),
            ("Worst target", f"{place(found.worst.position)}: {length(found.worst.sigma_max)}"),
        )
        return Summary(f"Map of targets: {found.problem.name or found.optimisation_problem.task.kind}", facts)

    def document(self) -> Report:
        """The whole report."""
        return target_map_report(self.result)

    def drawings(self) -> Drawings:
        """The map: standard deviation by colour, hatched where there is no posture."""
        return {"map": partial(plot_target_map, self.result)}

    def view(self) -> ArmView | None:
        """The best posture at every target that has one; None where none has."""
        return target_view(self.result, [point.sigma_max for point in self.result.map_points], "standard deviation")

    def columns(self) -> Columns:
        """The columns of ``map.csv``, see ``columns``."""
        return columns(self.result)

    def files(self) -> Files:
        """``map.csv``: one row a target, places to 0.1 µm, joints to six decimals."""
        return {"map.csv": map_csv(self.columns(), self.result.optimisation_problem.robot.n).encode()}
