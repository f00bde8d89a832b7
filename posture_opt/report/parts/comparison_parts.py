"""Comparison of plans in a report: the postures of several models of one arm, and the errors in them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from posture_opt.report.text.blocks import Block, Later, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.selection.comparison.comparison_statements import FIRST
from posture_opt.statements.notation import joint_value, length, probability

if TYPE_CHECKING:
    from posture_opt.selection.comparison.comparison import ComparedAnswer, Comparison

TITLE = "Comparison of plans"
_ROUNDING_M = 1e-7  # m: a miss that the plan corrected for is rounding


def comparison_blocks(comparison: Comparison | None, names: Mapping[str, str] = MODEL_NAMES) -> tuple[Block, ...]:
    """The posture of each model with its predicted errors; nothing without a task, or a posture of the reference.

    Args:
        comparison: of named models; ``names`` are their column headers.
    """
    if comparison is None or not comparison.answers_task(comparison.reference):
        return ()
    figure = "predicted_error" if comparison.answers_task(FIRST) else ""
    return (Block(TITLE, Later(partial(_table, comparison, names)), figure),)


def _table(comparison: Comparison, names: Mapping[str, str]) -> tuple[Table, ...]:
    """The postures and errors of all models."""
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
    return length(metres if metres > _ROUNDING_M else 0.0, among=among) if math.isfinite(metres) else ""
