"""Models of one arm compared in a report: position errors of measured rows, and planned postures with their errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.measurements.repeats import repeat_groups
from posture_opt.numerics import rms
from posture_opt.report.text.blocks import Block, Later, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.selection.comparison.comparison import FIRST
from posture_opt.statements.notation import (
    angle_error,
    count,
    decimals_of,
    joint_value,
    length,
    probability,
    stated_length,
)
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt import Comparison, Measurements, Robot
    from posture_opt.calibration.estimation.error_statistics import Statistics
    from posture_opt.calibration.second_file import OtherFile
    from posture_opt.selection.comparison.comparison import ComparedAnswer
    from posture_opt.selection.problem_data import ProblemData

_ERROR_HEADERS = ("RMS", "interval of RMS", "mean", "95 % below", "max")


def error_cells(s: Statistics) -> tuple[str, ...]:
    """Lengths of position errors in mm, without the name of the model.

    RMS, its 95 % interval, mean, the length that 95 % do not exceed, and maximum, as `error_headers` names them.
    """
    low, high = (value * 1e3 for value in s.interval)
    decimals = decimals_of(high, 3)
    return (mm(s.rms), f"{fixed(low, decimals)} to {fixed(high, decimals)}", mm(s.mean), mm(s.p95), mm(s.max))


def error_headers(data: Measurements | None = None) -> tuple[str, ...]:
    """The headers of a table of errors; what errors are called depends on what was measured."""
    words = "position error" if data is None else data.kind.error_words
    return (f"{words} [mm]", *_ERROR_HEADERS)


def error_table(rows: Mapping[str, Statistics], data: Measurements | None = None) -> Table:
    """Lengths of errors in mm, a row a model; ``data`` that were predicted, positions by default."""
    return Table(error_headers(data), tuple((name, *error_cells(statistics)) for name, statistics in rows.items()))


def range_table(file: OtherFile, models: Mapping[str, str]) -> tuple[Table, ...]:
    """RMS errors [mm] inside and outside the joint ranges that the models were fitted in; nothing where all are
    inside."""
    out = int(file.outside.sum())
    if not out:
        return ()
    headers = ("RMS [mm]", f"inside ({len(file.data) - out})", f"outside ({out}, by {', '.join(file.joints)})")
    rows = (
        (words, *(mm(file.rms(name, rows)) for rows in (~file.outside, file.outside))) for name, words in models.items()
    )
    return (Table(headers, tuple(rows)),)


def mm(metres: float) -> str:
    """A length in mm, without its unit."""
    return number(metres * 1e3)


def reading_size(data: Measurements, sigma: float) -> str:
    """The σ of a reading with its unit: a length, an angle in mrad, or pixels with what they are at the marker."""
    if data.lever is not None:
        return f"{number(sigma / rms(data.lever), 2)} {data.kind.unit}, {stated_length(sigma)} at the marker"
    return stated_length(sigma) if data.kind.unit == "m" else angle_error(sigma)


def rows_words(data: Measurements, robot: Robot) -> str:
    """How many rows there are, in how many postures, and how many of these were measured more than once."""
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    whole = replace(data, target=np.zeros_like(data.target), robot=np.zeros_like(data.robot))
    postures = len(np.unique(repeat_groups(whole, slides)))
    counts = np.bincount(repeat_groups(data, slides))
    again = 0 if data.second is not None else int(np.count_nonzero(counts > 1))  # rows of a picture are no repeats
    targets = len(data.target_names)
    of = f", {targets} targets" if targets > 1 else ""
    repeated = f"; {again:,} of them measured more than once" if again else ""
    return f"{count(len(data), 'row')} in {count(postures, 'posture')}{of}{repeated}"


def instrument_words(problem: ProblemData, data: Measurements) -> str:
    """How well the instrument measures a coordinate, where there is an instrument and its accuracy is stated."""
    if data.touches:
        return f"none: the arm touches {count(len(data.point_names), 'fixed point')}"
    sigma, of_one = position_sigma(problem, data), "" if data.position is None else " of a coordinate"
    return f"{reading_size(data, sigma)} (one standard deviation{of_one})" if sigma else "no accuracy is stated"


TITLE = "Comparison of plans"


def comparison_blocks(comparison: Comparison | None, names: Mapping[str, str] = MODEL_NAMES) -> tuple[Block, ...]:
    """The posture of each model with its predicted errors; nothing without a task, or a posture of the reference."""
    if comparison is None or not comparison.answers_task(comparison.reference):
        return ()
    figure = "predicted_error" if comparison.answers_task(FIRST) else ""
    return (Block(TITLE, Later(partial(_table, comparison, names)), figure),)


def _table(comparison: Comparison, names: Mapping[str, str]) -> tuple[Table, ...]:
    return (comparison_table(distinct_columns(comparison), comparison.reference, names),)


def distinct_columns(comparison: Comparison) -> dict[str, ComparedAnswer]:
    """The answers by the name of the model; one that repeats the one before it in the table is left out."""
    columns: dict[str, ComparedAnswer] = {}
    reference = comparison.reference
    for name, column in comparison.answered.items():
        former = next(reversed(columns.values()), None)
        sizes = [] if former is None else [former.judged[reference].critical_error]
        if former is None or _cells(former, reference, sizes) != _cells(column, reference, sizes):
            columns[name] = column
    return columns


def comparison_table(
    columns: Mapping[str, ComparedAnswer], reference: str, names: Mapping[str, str] = MODEL_NAMES
) -> Table:
    """A column a model: joints, σ as itself and as the reference predicts it, errors, probability of success."""
    sizes = [column.judged[reference].critical_error for column in columns.values()]
    cells = [_cells(column, reference, sizes) for column in columns.values()]
    labels = [joint.name for joint in next(iter(columns.values())).problem.robot.joints]
    labels += ["largest σ, as planned", "largest σ, as judged", "mean error", "95 % error radius"]
    labels += ["scatter alone", "systematic (constant) part", "success probability"]
    rows = [row for row in zip(labels, *cells, strict=True) if any(row[1:])]
    return Table(("planned with the model", *(names.get(name, name) for name in columns)), tuple(rows))


def _cells(column: ComparedAnswer, reference: str, sizes: list[float]) -> tuple[str, ...]:
    (station,), judged = column.stations, column.judged[reference]
    joints = [joint_value(q, joint.type) for q, joint in zip(station.q, column.problem.robot.joints, strict=True)]
    errors = (column.sigma_max, judged.sigma_max, judged.distance, judged.critical_error)
    parts = judged.worst.parts
    scatter, constant = "", ""
    if parts is not None:
        scatter = _length(parts.scatter_radius, sizes) if parts.scatter_sigma > 0 else "none stated"
        constant = _length(parts.systematic_radius, sizes)
    shown = (*(_length(value, sizes) for value in errors), scatter, constant)
    return (*joints, *shown, success_text(judged.success_probability))


def success_text(p: float | None) -> str:
    """A probability of success for a table; empty without one."""
    return "" if p is None else probability(p)


def _length(metres: float, among: list[float]) -> str:
    # A miss that the plan corrected for is rounding.
    return length(metres if metres > 1e-7 else 0.0, among=among) if math.isfinite(metres) else ""
