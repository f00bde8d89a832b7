"""The nonlinear program, printed: variables, objective, rows with their bounds, and their values at the solution."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from posture_opt.numerics import Array
from posture_opt.report.blocks import Block, Report, Table
from posture_opt.report.units_text import UNKNOWN, quantity
from posture_opt.selection.nlp import Values
from posture_opt.selection.task_target import FREE, SIZES

if TYPE_CHECKING:
    from posture_opt.selection.nlp import Nlp
    from posture_opt.selection.solution import Solution

_LENGTHS = ("lower", "upper", "clearance")
_MEANING = {
    "lower": "box of the target, lower corner",
    "upper": "box of the target, upper corner",
    "direction": "direction of the task",
    "b1": "first axis across it",
    "b2": "second axis across it",
    "clearance": "clearance of the hole",
    "sin_tilt": "sine of the tilt that is allowed",
    "scale": "variance that the objective is divided by",
}


def explain_report(solution: Solution) -> Report:
    """The nonlinear program as it was solved."""
    nlp = solution.optimisation_problem.nlp
    parameters = solution.target.parameters()
    values = Values.of(nlp, solution.q, parameters)
    lead = (
        f"Minimise the objective over {len(nlp.variables)} joint values, subject to the bounds of the joints and to "
        f"{len(nlp.rows)} rows; values at the {'nearest' if solution.status == 'infeasible' else 'best'} posture.",
    )
    blocks = (
        Block("Objective", (_objective(nlp, values),)),
        Block("Variables", (_variables(nlp, solution.q),)),
        Block("Rows", (_rows(nlp, values) if nlp.rows else "None: the tool point is free.",)),
        Block("Parameters of the target", (_parameters(parameters),)),
    )
    return Report(f"Nonlinear program of: {solution.problem.name}", lead, blocks)


def _objective(nlp: Nlp, values: Values) -> Table:
    rows = [(name, _plain(float(value))) for (name, _), value in zip(nlp.terms, values.terms, strict=True)]
    return Table(("term", "value"), (*rows, ("objective", _plain(values.objective))))


def _variables(nlp: Nlp, q: Array) -> Table:
    rows = tuple(
        (v.name, *(quantity(float(x), v.unit) for x in (v.lower, value, v.upper)), _binding(v.lower, value, v.upper))
        for v, value in zip(nlp.variables, q, strict=True)
    )
    return Table(("variable", "at least", "value", "at most", ""), rows)


def _rows(nlp: Nlp, values: Values) -> Table:
    rows = tuple(
        (row.name, *(quantity(float(x), row.unit) for x in (low, value, high)), _binding(low, value, high))
        for row, low, value, high in zip(nlp.rows, values.row_lower, values.rows, values.row_upper, strict=True)
    )
    return Table(("row", "at least", "value", "at most", ""), rows)


def _binding(low: float, value: float, high: float) -> str:
    tolerance = 1e-6
    if value < low - tolerance or value > high + tolerance:
        return "violated"
    if low == high:
        return "met"
    return "at its bound" if min(value - low, high - value) < tolerance else ""


def _parameters(parameters: Array) -> Table:
    rows, at = [], 0
    for name, size in SIZES.items():
        entries = [float(v) for v in parameters[at : at + size]]
        at += size
        rows.append((name, _MEANING[name], _entries(name, entries)))
    return Table(("parameter", "is", "value"), tuple(rows), text_columns=2)


def _entries(name: str, entries: list[float]) -> str:
    if name in _LENGTHS:
        return ", ".join("free" if abs(v) >= FREE else quantity(v, "m") for v in entries)
    if name == "scale":
        return f"{_plain(entries[0] * 1e6)} mm^2"
    return ", ".join(f"{v + 0.0:.4g}" for v in entries)


def _plain(value: float) -> str:
    return f"{value:.6g}" if math.isfinite(value) else UNKNOWN
