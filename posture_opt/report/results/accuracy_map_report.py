"""The report on accuracy over a grid of targets: what the corrections take off, what scatters, what was measured.

Mean error (bias) and scatter are kept apart throughout: a correction of the joint values removes the first, and
nothing removes the second. Lengths of one table share a unit, that of their largest (µm or mm).
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.numerics import Array, rms
from posture_opt.report.figures.accuracy_map import plot_bias, plot_spread_map
from posture_opt.report.interactive.target_view import target_view
from posture_opt.report.page.csv_table import map_csv
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.page.save import Files
from posture_opt.report.parts.parts import brief_notes, frame_notes, input_facts, note_facts, robot_facts, source_facts
from posture_opt.report.results.target_map_report import (
    grid_words,
    place_columns,
    posture_columns,
)
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.report.text.words import direction_words
from posture_opt.statements.notation import count, length, length_unit, lengths, place
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.report.interactive.arm_view import ArmView
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.accuracy_map import AccuracyMap
    from posture_opt.validation.measured_errors import MeasuredErrors


def _range(values: Array) -> str:
    """Smallest to largest of lengths (N,) [m] over the targets."""
    ends = [float(np.nanmin(values)), float(np.nanmax(values))]
    return lengths(ends, " to ")


def problem_block(problem: ProblemData, found: AccuracyMap) -> Block:
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
    """Where the arm lands on average: ``|E[x] − target|`` over the grid, without the corrections.

    The second row is after the rigid motion of the base that fits the map best: only correcting the arm removes what
    is left there. It is left out where the map has too few targets for a fit.
    """
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
    """A fact on the position that the problem states."""
    return Facts((("At the position in the problem", size),))


def _table(found: AccuracyMap, rows: list[tuple[str, Array]]) -> Table:
    """Minimum, median and maximum over the targets, and where the maximum is.

    Args:
        rows: names with lengths (N,) [m] at the N targets of the grid, NaN where there is no posture.
    """
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


def columns(found: AccuracyMap) -> dict[str, list[float]]:
    """One row a target: place, mean error, 95 % region and radius, and the posture; NaN where there is none.

    Lengths are in mm, semi-axes from the longest to the shortest, joints in deg or mm.
    """
    axes = found.semi_axes95[:, ::-1]
    values = {
        **{f"bias {c} [mm]": found.bias[:, k] for k, c in enumerate("xyz")},
        "bias [mm]": found.distance,
        **{f"95 % semi-axis {k + 1} [mm]": axes[:, k] for k in range(axes.shape[1])},
        "95 % radius [mm]": found.radius95,
    }
    lengths = {head: (1e3 * column).tolist() for head, column in values.items()}
    return {**place_columns(found.targets), **lengths, **posture_columns(found.targets)}


class AccuracyMapPresenter(Presenter["AccuracyMap"]):
    """Mean error and scatter over a grid of targets: report, two maps, the postures as a view, and ``map.csv``."""

    stem = "map"
    delivers: ClassVar[tuple[str, ...]] = ("map.csv",)

    def summary(self) -> Summary:
        """Grid, feasible targets, range of the mean error and of the 95 % radius, number of measured rows."""
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
        """What was asked, mean error, spread and, where measured rows were given, these."""
        found = self.result
        measured = [measured_block(found.measured)] if found.measured is not None else []
        blocks = (problem_block(self.problem, found), bias_block(found), spread_block(found), *measured)
        return Document(self.problem.name or "Map of accuracy", found.statements, blocks)

    def drawings(self) -> Drawings:
        """The mean error, where there are corrections, and the spread."""
        found = self.result
        bias: Drawings = {"map_bias": partial(plot_bias, found)} if found.corrected else {}
        return {**bias, "map_spread": partial(plot_spread_map, found)}

    def view(self) -> ArmView | None:
        """The posture at every target that has one, coloured by its error; None where none has."""
        found = self.result
        if found.corrected:
            return target_view(found.targets, found.distance.tolist(), "mean error")
        return target_view(found.targets, found.radius95.tolist(), "95 % within")

    def columns(self) -> Columns:
        """The columns of ``map.csv``, see ``columns``."""
        return columns(self.result)

    def files(self) -> Files:
        """``map.csv``: one row a target, joint values to six decimals of deg or mm."""
        return {"map.csv": map_csv(self.columns(), self.result.targets.optimisation_problem.robot.n).encode()}
