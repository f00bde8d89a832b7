"""Reports on maps of targets: the best and the worst place, mean error (bias) and scatter over the grid.

Lengths of one table share the unit of their largest. A target without a posture is "-" in tables and NaN in columns.
A correction of the joint values removes the mean error; nothing removes the scatter.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.numerics import Array, rms
from posture_opt.report.figures.target_map import plot_bias, plot_spread_map, plot_target_map
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.page.save import Files, map_csv
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
from posture_opt.report.scene.posture_views import target_key, target_view
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.report.text.words import CRITERIA, PARTS, direction_words, line_words, part_words
from posture_opt.statements.notation import count, joint_unit, length, length_unit, lengths, percent, place
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.report.scene.arm_view import ArmView
    from posture_opt.selection.maps.map_points import Grid, MapPoint
    from posture_opt.selection.maps.target_map import TargetMap
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.accuracy_map import AccuracyMap
    from posture_opt.validation.measured_errors import MeasuredErrors


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
    """Target, spread and posture of some places."""
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
    return [(label, f"{count(number_of, 'target')}{condition}")] if number_of else []


def _small_table(found: TargetMap) -> tuple[Table, ...]:
    """The numbers of a map that has one layer, at most 11 columns and 17 rows; larger ones are shown as a figure
    only."""
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
        found, problem = self.result, self.problem
        blocks = (problem_block(problem, found), places_block(found), map_block(found))
        return Document(problem.name or "Map of targets", found.statements, blocks)

    def drawings(self) -> Drawings:
        return {"map": partial(plot_target_map, self.result)}

    def view(self) -> ArmView | None:
        return target_view(self.result, [point.sigma_max for point in self.result.map_points], "standard deviation")

    def columns(self) -> Columns:
        found, points, part = self.result, self.result.map_points, PARTS[self.result.within]
        success = {"success": [s.success_probability for s in points]} if not math.isnan(found.target.clearance) else {}
        return {
            **place_columns(found),
            f"sigma {part} [mm]": [1e3 * s.sigma_max for s in points],
            "sigma along the direction [mm]": [1e3 * s.sigma_along for s in points],
            f"95 % radius {part} [mm]": [1e3 * s.radius95 for s in points],
            **success,
            **posture_columns(found),
        }

    def files(self) -> Files:
        return {"map.csv": map_csv(self.columns(), self.result.optimisation_problem.robot.n).encode()}


def _range(values: Array) -> str:
    """Smallest to largest of lengths (N,) [m] over the targets."""
    ends = [float(np.nanmin(values)), float(np.nanmax(values))]
    return lengths(ends, " to ")


def accuracy_problem_block(problem: ProblemData, found: AccuracyMap) -> Block:
    """What was asked, and where: robot, corrections, task, direction (world), grid, sources of error, notes."""
    targets = found.targets
    task = targets.optimisation_problem.task
    corrected = f"{count(found.corrections, 'parameter')} of the arm, {count(found.effects, 'effect')}"
    rows = [
        *robot_facts(problem),
        *input_facts(problem),
        ("Corrections", corrected if found.corrected else "none in the file"),
        ("Task", f"{task.kind} - {task.summary}"),
        ("Direction", f"{direction_words(targets.target.direction)} in the world"),
        ("Targets", f"{grid_words(found.grid)}, in the best posture for the task"),
        *source_facts(problem),
        *note_facts((*problem.notes, *frame_notes(problem.robot), *targets.notes)),
    ]
    notes = brief_notes(problem, (*problem.notes, *targets.notes))
    short = [row for row in rows if row[0] in ("Robot", "Corrections", "Targets")]
    return Block("Problem", (Facts(tuple(rows)),), brief=(Facts((*short, *notes)),))


def bias_block(found: AccuracyMap) -> Block:
    """Where the arm lands on average: ``|E[x] − target|`` over the grid, without the corrections."""
    if not found.corrected:
        return Block("Mean error", ())
    rows = [("without the corrections", found.distance)]
    rows += [("with its base refitted", found.settled)] if np.isfinite(found.settled).any() else []
    own = [] if found.own is None else [_own(length(float(np.linalg.norm(found.own[0]))))]
    text = "The posture is computed with the nominal arm and executed by the calibrated arm."
    title = "Mean error without the corrections"
    return Block(title, (text, _table(found, rows), *own), figure="map_bias")


def spread_block(found: AccuracyMap) -> Block:
    """How far the arm scatters about its mean: 95 % radius and longest semi-axis of the 95 % region, over the grid."""
    longest = np.asarray(found.semi_axes95[:, -1])
    rows = [("95 % radius", found.radius95), ("longest semi-axis of the 95 % region", longest)]
    own = [] if found.own is None else [_own(f"95 % radius {length(found.own[1])}")]
    return Block("Spread", (_table(found, rows), *own), figure="map_spread")


def _own(size: str) -> Facts:
    return Facts((("At the position in the problem", size),))


def _table(found: AccuracyMap, rows: list[tuple[str, Array]]) -> Table:
    """Minimum, median and maximum over the targets, and where the maximum is; ``rows`` (N,) [m]."""
    unit, factor = length_unit([float(np.nanmax(values)) for _, values in rows])
    points = found.grid.points
    cells = []
    for name, values in rows:
        numbers = [number(factor * float(f(values))) for f in (np.nanmin, np.nanmedian, np.nanmax)]
        cells.append((name, *numbers, place(points[int(np.nanargmax(values))]).removesuffix(" mm")))
    headers = (f"[{unit}]", "min", "median", "max", "max at x, y, z [mm]")
    return Table(headers, tuple(cells))


def measured_block(measured: MeasuredErrors) -> Block:
    """Measured rows with and without the corrections: of all, and of those in cells of the map."""
    near = measured.near
    rows = [("all rows", measured.uncorrected, measured.corrected)]
    if near.any():
        rows.append(("rows on the map", measured.uncorrected[near], measured.corrected[near]))
    unit, factor = length_unit([float(measured.uncorrected.max())])
    cells = [
        (name, str(len(off)), *(number(factor * v) for v in (rms(off), rms(left), float(np.quantile(left, 0.95)))))
        for name, off, left in rows
    ]
    headers = ("", "rows", f"RMS, uncorrected [{unit}]", f"RMS, corrected [{unit}]", f"95 % below [{unit}]")
    reach = [Facts((("On the map", f"within {length(measured.reach)} of its plane"),))] if measured.reach else []
    return Block("Measured", (Table(headers, tuple(cells)), *reach))


class AccuracyMapPresenter(Presenter["AccuracyMap"]):
    """Mean error and scatter over a grid of targets: report, two maps, the postures as a view, and ``map.csv``."""

    stem = "map"
    delivers: ClassVar[tuple[str, ...]] = ("map.csv",)

    def summary(self) -> Summary:
        found = self.result
        off = [("Mean error without corrections", _range(found.distance))] if found.corrected else []
        seen = [("Measured rows", str(len(found.measured.cell)))] if found.measured is not None else []
        facts = (
            ("Targets", grid_words(found.grid)),
            ("Feasible", f"{int(found.targets.feasible.sum())} of {len(found.targets.map_points)}"),
            *off,
            ("95 % radius", f"{_range(found.radius95)} about the mean"),
            *seen,
        )
        return Summary(f"Map of accuracy: {found.problem.name}", facts)

    def document(self) -> Document:
        found = self.result
        measured = [measured_block(found.measured)] if found.measured is not None else []
        blocks = (accuracy_problem_block(self.problem, found), bias_block(found), spread_block(found), *measured)
        return Document(self.problem.name or "Map of accuracy", found.statements, blocks)

    def drawings(self) -> Drawings:
        found = self.result
        bias: Drawings = {"map_bias": partial(plot_bias, found)} if found.corrected else {}
        return {**bias, "map_spread": partial(plot_spread_map, found)}

    def view(self) -> ArmView | None:
        found = self.result
        if found.corrected:
            return target_view(found.targets, found.distance.tolist(), "mean error")
        return target_view(found.targets, found.radius95.tolist(), "95 % within")

    def columns(self) -> Columns:
        found, axes = self.result, self.result.semi_axes95[:, ::-1]
        lengths = {
            **{f"bias {c} [mm]": found.bias[:, k] for k, c in enumerate("xyz")},
            "bias [mm]": found.distance,
            **{f"95 % semi-axis {k + 1} [mm]": axes[:, k] for k in range(axes.shape[1])},
            "95 % radius [mm]": found.radius95,
        }
        in_mm = {head: (1e3 * column).tolist() for head, column in lengths.items()}
        return {**place_columns(found.targets), **in_mm, **posture_columns(found.targets)}

    def files(self) -> Files:
        return {"map.csv": map_csv(self.columns(), self.result.targets.optimisation_problem.robot.n).encode()}
