"""Position errors of models in a report: how they were held out, their table, and the instrument that measured them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.measurements.repeats import repeat_groups
from posture_opt.numerics import rms
from posture_opt.report.text.blocks import Table
from posture_opt.statements.notation import angle_error, count, decimals_of, stated_length
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.calibration.estimation.error_statistics import Statistics
    from posture_opt.calibration.second_file import OtherFile
    from posture_opt.measurements.measurements import Measurements
    from posture_opt.robot.robot import Robot
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
    """RMS errors [mm] inside and outside the joint ranges that the models were fitted in; nothing where all are inside.

    Args:
        models: name of each model -> its words.
    """
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
    """How many rows there are, in how many postures, and how many of these were measured more than once.

    Postures are one where they have a name in common or their joint values agree, whatever their rows are called.
    """
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
