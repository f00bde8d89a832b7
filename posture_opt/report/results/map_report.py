"""Reports on maps of targets: the best and the worst place, mean error (bias) and scatter over the grid.

Lengths of one table share the unit of their largest. A target without a posture is "-" in tables and NaN in columns.
A correction of the joint values removes the mean error; nothing removes the scatter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.numerics import Array, rms
from posture_opt.report.figures.target_map import plot_bias, plot_spread_map, plot_target_map
from posture_opt.report.page.presenter import Columns, Drawings, Plots, Presenter
from posture_opt.report.page.save import Files, map_csv
from posture_opt.report.parts import parts
from posture_opt.report.scene.posture_views import target_key, target_view
from posture_opt.report.text.blocks import Block, Facts, Summary, Table
from posture_opt.report.text.words import CRITERIA, PARTS, direction_words, line_words
from posture_opt.selection.registered_tasks import part_words
from posture_opt.statements.notation import count, length, length_unit, lengths, percent, place
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt import AccuracyMap, TargetMap
    from posture_opt.report.scene.arm_view import ArmView
    from posture_opt.selection.maps.grid_layout import Grid
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.accuracy_map import MeasuredErrors


_OWN = "At the position in the problem"


def problem_block(problem: ProblemData, found: TargetMap) -> Block:
    """What was asked, and where: robot, task, direction (world), criterion, grid, collision checks, sources, notes."""
    task = found.optimisation_problem.task
    stated = tuple(note for note in (*problem.notes, *found.notes) if isinstance(note, str))
    sources = (*parts.source_facts(problem), *parts.workpiece_facts(problem))
    rows = (
        *parts.robot_facts(problem),
        *parts.input_facts(problem),
        ("Task", f"{task.kind} - {task.summary}"),
        ("Direction", f"{direction_words(found.target.direction)} in the world"),
        ("Minimised", CRITERIA[task.criterion].format(part=part_words(task.within, task.kind))),
        ("Targets", grid_words(found.grid)),
        *sources,
        *parts.note_facts(stated),
    )
    targets = ("Targets", grid_words(found.grid))
    short = (rows[0], ("Task", task.kind), targets, *sources, *parts.brief_notes(problem, stated))
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
    """Best, worst and own place with spread and posture; the own one where it has a posture."""
    own = found.own if found.own is not None and found.own.feasible else None
    named = {"best target": found.best, "position in the problem": own, "worst target": found.worst}
    points = {name: point for name, point in named.items() if point is not None}
    robot = found.optimisation_problem.robot
    unit, factor = length_unit([point.sigma_max for point in points.values()])
    headers = ("", *(f"{c} [mm]" for c in "xyz"), f"std. dev. [{unit}]", *parts.joint_heads(robot))
    rows = []
    for name, point in points.items():
        at = (fixed(1e3 * value, 1) for value in point.position)
        rows.append((name, *at, number(factor * point.sigma_max), *parts.joint_cells(robot, point.q)))
    return Block("Targets compared", (Table(headers, tuple(rows), views=tuple(map(target_key, points.values()))),))


def map_block(found: TargetMap) -> Block:
    """How much of the map can be served, what neighbours brought, and the figure."""
    statuses, solves = [map_point.status for map_point in found.map_points], found.solves
    unsure = sum(map_point.feasible and not map_point.optimal for map_point in found.map_points)
    oriented = "" if found.optimisation_problem.alignment == "free" else " with the required tool orientation"
    again = f"{solves.again} targets solved again, {solves.better} improved by up to {percent(solves.most)}"

    def counted(n: int, condition: str = "") -> str:
        return f"{count(n, 'target')}{condition}" if n else ""

    rows = (
        ("Feasible", f"{statuses.count('feasible')} of {count(len(statuses), 'target')}"),
        ("Unreachable", counted(statuses.count("not reached"), oriented)),
        ("Requirement not met", counted(statuses.count("requirement not met"))),
        ("Not confirmed", counted(unsure)),
        ("Neighbours' postures", again),
        ("Only from a neighbour", counted(solves.found)),
    )
    return Block("Map", (Facts(tuple(row for row in rows if row[1])), *_small_table(found)), figure="map")


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


def place_columns(found: TargetMap) -> Columns:
    """Where the targets are [mm, world frame], and 1 where there is a posture, else 0."""
    points = parts.point_columns(np.array([s.position for s in found.map_points]) + 0.0)
    return {**points, "feasible": [int(s.feasible) for s in found.map_points]}


def posture_columns(found: TargetMap) -> Columns:
    return parts.joint_columns(found.optimisation_problem.robot, np.array([s.q for s in found.map_points]))


class TargetMapPresenter(Presenter["TargetMap"]):
    """The best posture over a grid of targets; ``map.csv`` has a row a target."""

    stem = "map"
    title = "Map of targets"
    plots: ClassVar[Plots] = {"map": plot_target_map}
    delivers: ClassVar[tuple[str, ...]] = ("map.csv",)

    def summary(self) -> Summary:
        found, best = self.result, self.result.best
        part = part_words(found.within, found.optimisation_problem.task.kind)
        facts = (
            ("Targets", grid_words(found.grid)),
            (
                "Feasible",
                f"{int(found.feasible.sum())} of {count(len(found.feasible), 'target')} have a feasible posture.",
            ),
            ("Best target", f"{place(best.position)}: {length(best.sigma_max)} {part} (1 σ)"),
            ("Its posture", parts.joint_values(found.problem, best.q)),
            ("Worst target", f"{place(found.worst.position)}: {length(found.worst.sigma_max)}"),
        )
        return Summary(f"{self.title}: {found.problem.name or found.optimisation_problem.task.kind}", facts)

    def blocks(self) -> Iterable[Block]:
        return problem_block(self.problem, self.result), places_block(self.result), map_block(self.result)

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


def accuracy_problem_block(problem: ProblemData, found: AccuracyMap) -> Block:
    """What was asked, and where: robot, corrections, task, direction (world), grid, sources of error, notes."""
    targets = found.targets
    task = targets.optimisation_problem.task
    corrected = f"{count(found.corrections, 'parameter')} of the arm, {count(found.effects, 'effect')}"
    rows = [
        *parts.robot_facts(problem),
        *parts.input_facts(problem),
        ("Corrections", corrected if found.corrected else "none in the file"),
        ("Task", f"{task.kind} - {task.summary}"),
        ("Direction", f"{direction_words(targets.target.direction)} in the world"),
        ("Targets", f"{grid_words(found.grid)}, in the best posture for the task"),
        *parts.source_facts(problem),
        *parts.note_facts((*problem.notes, *parts.frame_notes(problem.robot), *targets.notes)),
    ]
    notes = parts.brief_notes(problem, (*problem.notes, *targets.notes))
    short = [row for row in rows if row[0] in ("Robot", "Corrections", "Targets")]
    return Block("Problem", (Facts(tuple(rows)),), brief=(Facts((*short, *notes)),))


def bias_block(found: AccuracyMap) -> Block:
    """Where the arm lands on average: ``|E[x] − target|`` over the grid, without the corrections."""
    if not found.corrected:
        return Block("Mean error", ())
    rows = [("without the corrections", found.distance)]
    rows += [("with its base refitted", found.settled)] if np.isfinite(found.settled).any() else []
    own = [] if found.own is None else [Facts(((_OWN, length(float(np.linalg.norm(found.own[0])))),))]
    text = "The posture is computed with the nominal arm and executed by the calibrated arm."
    title = "Mean error without the corrections"
    return Block(title, (text, _table(found, rows), *own), figure="map_bias")


def accuracy_block(found: AccuracyMap) -> Block:
    """How far the arm scatters about its mean: 95 % radius and longest semi-axis of the 95 % region."""
    longest = np.asarray(found.semi_axes95[:, -1])
    rows = [("95 % radius", found.radius95), ("longest semi-axis of the 95 % region", longest)]
    own = [] if found.own is None else [Facts(((_OWN, f"95 % radius {length(found.own[1])}"),))]
    return Block("Spread", (_table(found, rows), *own), figure="map_spread")


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
    title = "Map of accuracy"
    delivers: ClassVar[tuple[str, ...]] = ("map.csv",)

    def facts(self) -> Iterable[tuple[str, str]]:
        found = self.result
        off, radius = (
            lengths([float(np.nanmin(v)), float(np.nanmax(v))], " to ") for v in (found.distance, found.radius95)
        )
        yield "Targets", grid_words(found.grid)
        yield "Feasible", f"{int(found.targets.feasible.sum())} of {len(found.targets.map_points)}"
        if found.corrected:
            yield "Mean error without corrections", off
        yield "95 % radius", f"{radius} about the mean"
        if found.measured is not None:
            yield "Measured rows", str(len(found.measured.cell))

    def blocks(self) -> Iterable[Block]:
        found = self.result
        yield from (accuracy_problem_block(self.problem, found), bias_block(found), accuracy_block(found))
        if found.measured is not None:
            yield measured_block(found.measured)

    def drawings(self) -> Drawings:
        bias: Drawings = {"map_bias": partial(plot_bias, self.result)} if self.result.corrected else {}
        return {**bias, "map_spread": partial(plot_spread_map, self.result)}

    def view(self) -> ArmView | None:
        found = self.result
        sizes, what = (found.distance, "mean error") if found.corrected else (found.radius95, "95 % within")
        return target_view(found.targets, sizes.tolist(), what)

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
