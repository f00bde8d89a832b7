"""The report on accuracy over a grid of targets: what the corrections take off, what scatters, what was measured.

Mean error (bias) and scatter are kept apart throughout: a correction of the joint values removes the first, and
nothing removes the second. Lengths of one table share a unit, that of their largest (µm or mm).
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.numerics import Array, rms
from posture_opt.report.figures.accuracy_map import plot_bias, plot_spread_map
from posture_opt.report.interactive.target_view import target_view
from posture_opt.report.page.csv_table import map_csv
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts.parts import brief_notes, frame_notes, input_facts, note_facts, robot_facts, source_facts
from posture_opt.report.results.target_map_report import (
    grid_words,
    place_columns,
    posture_columns,
    served_sentence,
)
from posture_opt.report.text.blocks import Block, Facts, Report, Summary, Table
from posture_opt.report.text.words import direction_words
from posture_opt.statements.notation import count, length, length_unit, percent, place
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.report.interactive.arm_view import ArmView
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.accuracy_map import AccuracyMap
    from posture_opt.validation.measured_errors import MeasuredErrors

_MIN_ROWS = 20  # rows: fewer say little about a share of 95 %


def accuracy_map_report(found: AccuracyMap) -> Report:
    """Blocks "Problem", "Mean error …", "Spread" and, where measured rows were given, "Measured"."""
    problem = problem_of(found)
    title = problem.name or "Map of accuracy"
    measured = [measured_block(found.measured)] if found.measured is not None else []
    blocks = (problem_block(problem, found), bias_block(found), spread_block(found), *measured)
    return Report(title, lead(found), blocks)


def lead(found: AccuracyMap) -> tuple[str, ...]:
    """What is off without corrections, and what scatters with them.

    Two lines, each with the smallest and the largest value over the grid: the length of the mean error and the 95 %
    radius. A third follows where rows were measured: the share of them in their predicted 95 % regions.
    """
    spread = f"95 % radius about the mean: {_range(found.radius95)}, depending on the target."
    seen = () if found.measured is None else shares_sentences(found.measured)[-1:]
    if not found.corrected:
        return "The file states no corrections of the arm: the mean error is zero.", spread, *seen
    off = _range(found.distance)
    return f"Mean error without the corrections: {off}, depending on the target.", spread, *seen


def _range(values: Array) -> str:
    """Smallest to largest of lengths (N,) [m] over the targets; one length where they agree within 0.5 %."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if high <= low * 1.005:
        return length(high)
    unit, factor = length_unit([high])
    return f"{number(low * factor)} to {number(high * factor)} {unit}"


def problem_block(problem: ProblemData, found: AccuracyMap) -> Block:
    """What was asked, and where: robot, corrections, task, direction (world), grid, sources of error, notes.

    The short form keeps robot, corrections, grid and notes. "Corrections" counts parameters of the geometry and
    effects of the file; "none in the file" means that the mean error of the map is that of the nonlinearity only.
    """
    targets = found.targets
    task = targets.optimisation_problem.task
    known = [f"{count(found.corrections, 'parameter')} of the arm"] * (found.corrections > 0)
    known += [count(found.effects, "effect")] * (found.effects > 0)
    corrected = " and ".join(known) or "none in the file"
    rows = [
        *robot_facts(problem),
        *input_facts(problem),
        ("Corrections", corrected),
        ("Task", f"{task.kind} - {task.summary}"),
        ("Direction", f"{direction_words(targets.target.direction)} in the world"),
        ("Targets", grid_words(found.grid)),
        *source_facts(problem),
        *note_facts((*problem.notes, *frame_notes(problem.robot), *targets.notes)),
    ]
    text = f"At every target the arm takes the best posture for the task. {served_sentence(targets)}"
    notes = brief_notes(problem, (*problem.notes, *targets.notes))
    short = (rows[0], ("Corrections", corrected), ("Targets", grid_words(found.grid)), *notes)
    return Block("Problem", (Facts(tuple(rows)), text), brief=(Facts(short),))


def bias_block(found: AccuracyMap) -> Block:
    """Where the arm lands on average: ``|E[x] − target|`` over the grid.

    Rows of the table:
      without the corrections: the posture of the nominal arm, executed by the calibrated one;
      with its base refitted: the same after the rigid motion of the base that fits the map best. What is left there
        cannot be removed by measuring the workpiece again.

    The row of the refitted base is left out where the map has too few targets for a fit. Without corrections in the
    file one sentence replaces the table.
    """
    if not found.corrected:
        shift = length(float(np.nanmax(found.distance)))
        text = f"Without corrections only the nonlinearity of the kinematics shifts the mean: by at most {shift}."
        return Block("Mean error", (text,))
    rows = [("without the corrections", found.distance)]
    rows += [("with its base refitted", found.settled)] if np.isfinite(found.settled).any() else []
    table = _table(found, rows)
    own = []
    if found.own is not None:
        own = [f"At the position in the problem: {length(float(np.linalg.norm(found.own[0])))}."]
    text = (
        "The posture is computed with the nominal arm and executed by the calibrated arm. In the second row a new base "
        "frame is fitted to the map: what is left can be removed only by correcting the arm."
    )
    return Block("Mean error without the corrections", (text, table, *own), figure="map_bias")


def spread_block(found: AccuracyMap) -> Block:
    """How far the arm scatters about its mean: 95 % radius and longest semi-axis of the 95 % region, over the grid."""
    rows = [("95 % radius", found.radius95), ("longest semi-axis of the 95 % region", _longest(found))]
    own = []
    if found.own is not None:
        own = [f"At the position in the problem: {length(found.own[1])} (95 % probability)."]
    text = "Distance of the tool point from its mean: parameter uncertainty and scatter."
    return Block("Spread", (text, _table(found, rows), *own), figure="map_spread")


def _longest(found: AccuracyMap) -> Array:
    """Longest semi-axis (N,) [m] of the 95 % region at each target."""
    return np.asarray(found.semi_axes95[:, -1])


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
    """Measured rows next to what is predicted for them.

    One row for all measurements and one for those in cells of the map, if there are any: how many they are, RMS with
    and without the corrections, and the length that 95 % of the corrected errors do not exceed.
    """
    near = measured.near
    rows = [("all rows", measured.uncorrected, measured.corrected)]
    if near.any():
        rows.append(("rows on the map", measured.uncorrected[near], measured.corrected[near]))
    unit, factor = length_unit([float(measured.uncorrected.max())])
    cells = [
        (name, str(len(off)), *(number(factor * value) for value in (rms(off), rms(left), _p95(left))))
        for name, off, left in rows
    ]
    headers = ("", "rows", f"RMS, uncorrected [{unit}]", f"RMS, corrected [{unit}]", f"95 % below [{unit}]")
    notes = note_facts(measured.notes)
    facts = [Facts(tuple(notes))] if notes else []
    return Block("Measured", (Table(headers, tuple(cells)), *shares_sentences(measured), *facts))


def _p95(lengths: Array) -> float:
    """The length [m] that 95 % of the lengths (k,) [m] do not exceed."""
    return float(np.quantile(lengths, 0.95))


def shares_sentences(measured: MeasuredErrors) -> tuple[str, ...]:
    """How many rows lie within what is predicted: on the map, and for their own postures.

    Nothing where rows and predictions cannot be compared. The second sentence says whether the spread is understated
    or overstated, as far as the number of rows supports it.
    """
    if not measured.comparable:
        return ()
    near = int(measured.near.sum())
    where = f" (within {length(measured.reach)} of its plane)" if measured.reach else ""
    if near:
        text = f"Of the {count(near, 'row')} in cells of the map{where} {percent(measured.share_near)} lie within"
        first = f"{text} the 95 % radius predicted there, instrument noise included."
        if near < _MIN_ROWS:
            first += " This is a small sample."
    else:
        first = f"No row lies in a cell of the map{where}: move the map to the measured region with --min and --max."
    own = f"The 95 % regions predicted for their own postures contain {percent(measured.share)} of all rows"
    return first, f"{own}{_verdict(measured)}."


def _verdict(measured: MeasuredErrors) -> str:
    """What the share says of the spread, if it is further from 95 % than chance takes it.

    ``|share − 0.95| > 4 sqrt(0.95 · 0.05 / rows)``; empty below the smallest number of rows.
    """
    rows = len(measured.cell)
    if rows < _MIN_ROWS:
        return ""
    # Neighbouring postures err alike: rows count for fewer than they are, so four standard errors.
    chance = 4 * math.sqrt(0.95 * 0.05 / rows)
    if measured.share < 0.95 - chance:
        return ": the spread is understated"
    return ": the spread is overstated" if measured.share > 0.95 + chance else ""


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
            ("Feasible", served_sentence(found.targets)),
            *off,
            ("95 % radius", f"{_range(found.radius95)} about the mean"),
            *seen,
        )
        return Summary(f"Map of accuracy: {found.problem.name}", facts)

    def document(self) -> Report:
        return accuracy_map_report(self.result)

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
