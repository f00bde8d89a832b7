"""How sure one may be of a solution: what it is compared with, the search, and its nonlinear program with values."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.parts.posture_parts import compared_table
from posture_opt.report.text.blocks import Block, Document, Facts, Table
from posture_opt.selection.program.nlp import Values
from posture_opt.selection.program.task_target import FREE, SIZES, TaskTarget
from posture_opt.statements.notation import length, length_unit, percent, quantity
from posture_opt.units import UNKNOWN

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.program.nlp import Nlp, Row

_MAX_BOUND_RATIO = 100.0  # times: a bound that is farther below the answer says nothing about it
_LENGTH_PARAMETERS = ("lower", "upper", "clearance", "lever")
_PARAMETER_MEANINGS = {
    "lower": "box of the target, lower corner",
    "upper": "box of the target, upper corner",
    "direction": "direction of the task",
    "b1": "first axis across it",
    "b2": "second axis across it",
    "clearance": "clearance of the hole",
    "sin_tilt": "sine of the tilt that is allowed",
    "scale": "variance that the objective is divided by",
    "axis": "where the tool axis is to point",
    "a1": "first axis across that",
    "a2": "second axis across that",
    "spin": "where the y axis of the tool is to point",
    "lever": "from the origin of the workpiece to the target",
}
_AXIS_PARAMETERS = ("axis", "a1", "a2")


def checks_block(solution: Solution) -> Block:
    """What the answer is compared with, what the search did lest a better posture be missed, time."""
    e, other, sigma = solution.statistics, solution.most_manipulable, solution.critical.sigma_max
    others = [
        ("typical feasible posture", e.typical),
        ("worst feasible posture found", e.worst),
        ("posture of greatest manipulability", math.nan if other is None else other.sigma_max),
        *([] if e.sweep is None else [(f"best of a sweep, {e.sweep.over}", e.sweep_sigma)]),
        *_lower_bound(solution),
    ]
    found = f"{e.tried:,} random starts, {e.starts:,} reached the target, {e.feasible:,} meet all requirements"
    proof = "a local optimum" if solution.status == "optimal" else "not confirmed as a local optimum"
    hits = f"by {e.hits} of {e.polished} local searches with {e.distinct} distinct optima; {proof}"
    again = f"in {e.recurred} of {e.batches} independent batches"
    rows = (("Search", found), ("Best found", hits), *([("", again)] if e.batches > 1 else []),
            ("Time", f"{e.seconds:.2f} s"))  # fmt: skip
    unit = length_unit([solution.critical.sigma_max])
    return Block("Checks", (*compared_table(sigma, others, unit), Facts(rows)), brief=())


def _lower_bound(solution: Solution) -> list[tuple[str, float]]:
    """The bound that no posture beats, with the source that sets it."""
    bound = solution.lower_bound
    if bound is None or solution.critical.sigma_max > _MAX_BOUND_RATIO * bound.sigma:
        return []
    lever = f", lever {length(bound.radius, 4)}" if math.isfinite(bound.radius) and bound.radius > 0 else ""
    return [(f"lower bound ({bound.source} {percent(bound.share)}{lever})", bound.sigma)]


def explain_report(solution: Solution) -> Document:
    """The nonlinear program as it was solved."""
    nlp = solution.optimisation_problem.nlp
    values = Values.of(nlp, solution.q, solution.target.parameters)
    blocks = (
        Block("Objective", (_objective(nlp, values),)),
        Block("Variables", (_variables(nlp, solution.q),)),
        Block("Rows", (_rows(nlp, values) if nlp.rows else "None: the tool point is free.",)),
        Block(
            "Parameters of the target", (_parameters(solution.target, not solution.problem.workpiece_sources.empty),)
        ),
    )
    return Document(f"Nonlinear program of: {solution.problem.name}", (), blocks)


def _objective(nlp: Nlp, values: Values) -> Table:
    """Terms of the objective with their values."""
    rows = [(name, _plain(float(value))) for (name, _), value in zip(nlp.terms, values.terms, strict=True)]
    return Table(("term", "value"), (*rows, ("objective", _plain(values.objective))))


def _variables(nlp: Nlp, q: Array) -> Table:
    """Joint values between their limits."""
    rows = tuple(
        (v.name, *(quantity(float(x), v.unit) for x in (v.lower, value, v.upper)), _binding(v.lower, value, v.upper))
        for v, value in zip(nlp.variables, q, strict=True)
    )
    return Table(("variable", "at least", "value", "at most", ""), rows)


def _rows(nlp: Nlp, values: Values) -> Table:
    """Rows between their ends."""
    rows = tuple(
        (row.name, *_end_texts(row, float(low), float(value), float(high)), _binding(low, value, high))
        for row, low, value, high in zip(nlp.rows, values.row_lower, values.rows, values.row_upper, strict=True)
    )
    return Table(("row", "at least", "value", "at most", ""), rows)


def _end_texts(row: Row, low: float, value: float, high: float) -> list[str]:
    """Lower end, value and upper end in words: sizes without a sign, the probability of success for a miss."""
    ends = [row.shown(low), row.shown(high)]
    if ends[0] == ends[1] and low < high:
        ends[0] = -math.inf
    return [quantity(text, row.unit) for text in (min(ends), row.shown(value), max(ends))]


def _binding(low: float, value: float, high: float) -> str:
    """Whether a value is at an end, or beyond."""
    tolerance = 1e-6
    if value < low - tolerance or value > high + tolerance:
        return "violated"
    if low == high:
        return "met"
    return "at its bound" if min(value - low, high - value) < tolerance else ""


def _parameters(target: TaskTarget, levered: bool) -> Table:
    """Parameters of the target with their meaning, but for those that say nothing here.

    Args:
        levered: whether the workpiece errs, so that the lever counts.
    """
    rows, at = [], 0
    along = np.array_equal(target.axis, target.direction)  # then the tool axis is stated above
    hidden = (
        *(_AXIS_PARAMETERS if along else ()),
        *(() if target.spun else ("spin",)),
        *(() if levered else ("lever",)),
    )
    for name, size in SIZES.items():
        entries = [float(v) for v in target.parameters[at : at + size]]
        at += size
        if name in hidden:
            continue
        rows.append((name, _PARAMETER_MEANINGS[name], _entries(name, entries)))
    return Table(("parameter", "is", "value"), tuple(rows), text_columns=2)


def _entries(name: str, entries: list[float]) -> str:
    """Numbers of a parameter in its unit."""
    if name in _LENGTH_PARAMETERS:
        return ", ".join("free" if abs(v) >= FREE else quantity(v, "m") for v in entries)
    if name == "scale":
        return f"{_plain(entries[0] * 1e6)} mm^2"
    return ", ".join(f"{v + 0.0:.4g}" for v in entries)


def _plain(value: float) -> str:
    """A number without a unit."""
    return f"{value:.6g}" if math.isfinite(value) else UNKNOWN
