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
from posture_opt.report.parts.parts import (
    brief_notes,
    input_facts,
    joint_values,
    note_facts,
    robot_facts,
    source_facts,
    workpiece_facts,
)
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.report.text.words import CRITERIA, PARTS, direction_words, line_words, part_words
from posture_opt.statements.notation import count, joint_unit, length, length_unit, percent, place
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.report.interactive.arm_view import ArmView
    from posture_opt.selection.maps.map_points import Grid, MapPoint
    from posture_opt.selection.maps.target_map import TargetMap
    from posture_opt.selection.problem_data import ProblemData


def problem_block(problem: ProblemData, found: TargetMap) -> Block:
    """What was asked, and where: robot, task, direction (world), criterion, grid, collision checks, sources, notes."""
    task = found.optimisation_problem.task
    stated = tuple(note for note in (*problem.notes, *found.notes) if isinstance(note, str))
    sources = (*source_facts(problem), *workpiece_facts(problem))
    rows = (
        *robot_facts(problem),
        *input_facts(problem),
        ("Task", f"{task.kind} - {task.summary}"),
        ("Direction", f"{direction_words(found.target.direction)} in the world"),
        ("Minimised", CRITERIA[task.criterion].format(part=part_words(task.within, task.kind))),
        ("Targets", grid_words(found.grid)),
        *sources,
        *note_facts(stated),
    )
    targets = ("Targets", grid_words(found.grid))
    short = (rows[0], ("Task", task.kind), targets, *sources, *brief_notes(problem, stated))
    return Block("Problem", (Facts(rows),), brief=(Facts(short),))


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
    """How much of the map can be served, what neighbours brought, and the figure."""
    statuses, solves = [map_point.status for map_point in found.map_points], found.solves
    unsure = sum(map_point.feasible and not map_point.optimal for map_point in found.map_points)
    oriented = "" if found.optimisation_problem.alignment == "free" else " with the required tool orientation"
    again = f"{solves.again} targets solved again, {solves.better} improved by up to {percent(solves.most)}"
    rows = (
        ("Feasible", f"{statuses.count('feasible')} of {count(len(statuses), 'target')}"),
        *_counted("Unreachable", statuses.count("not reached"), oriented),
        *_counted("Requirement not met", statuses.count("requirement not met")),
        *_counted("Not confirmed", unsure),
        ("Neighbours' postures", again),
        *_counted("Only from a neighbour", solves.found),
    )
    return Block("Map", (Facts(rows), *_small_table(found)), figure="map")


def served_sentence(found: TargetMap) -> str:
    """How many targets have a posture."""
    return f"{int(found.feasible.sum())} of {count(len(found.feasible), 'target')} have a feasible posture."


def _counted(label: str, number_of: int, condition: str = "") -> list[tuple[str, str]]:
    """So many targets; nothing of none."""
    return [(label, f"{count(number_of, 'target')}{condition}")] if number_of else []


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

    def document(self) -> Document:
        """Problem, places, the map itself."""
        found, problem = self.result, self.problem
        blocks = (problem_block(problem, found), places_block(found), map_block(found))
        return Document(problem.name or "Map of targets", found.statements, blocks)

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
