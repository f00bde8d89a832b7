"""How sure one may be of a solution: what it is compared with, the search, and its nonlinear program with values."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.parts.posture_parts import compared_table
from posture_opt.report.text.blocks import Block, Document, Facts, Table
from posture_opt.selection.program.nlp import Values
from posture_opt.selection.program.task_target import FREE, SIZES, TaskTarget
from posture_opt.statements.notation import length, length_unit, percent, quantity
from posture_opt.units import UNKNOWN

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution
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


def checks_block(solution: Solution) -> Block:
    """What the answer is compared with, what the search did lest a better posture be missed, time."""
    e, other, sigma = solution.statistics, solution.most_manipulable, solution.critical.sigma_max
    others = [
        ("typical feasible posture", e.typical),
        ("worst feasible posture found", e.worst),
        ("posture of greatest manipulability", math.nan if other is None else other.sigma_max),
        *([] if e.sweep is None else [(f"best of a sweep, {e.sweep.over}", e.sweep_sigma)]),
    ]
    bound = solution.lower_bound
    # A bound 100 times below the answer says nothing about it.
    if bound is not None and sigma <= 100.0 * bound.sigma:
        lever = f", lever {length(bound.radius, 4)}" if math.isfinite(bound.radius) and bound.radius > 0 else ""
        others.append((f"lower bound ({bound.source} {percent(bound.share)}{lever})", bound.sigma))
    proof = "a local optimum" if solution.status == "optimal" else "not confirmed as a local optimum"
    starts = f"{e.tried:,} random starts, {e.starts:,} reached the target, {e.feasible:,} meet all requirements"
    rows = (
        ("Search", starts),
        ("Best found", f"by {e.hits} of {e.polished} local searches with {e.distinct} distinct optima; {proof}"),
        *([("", f"in {e.recurred} of {e.batches} independent batches")] if e.batches > 1 else []),
        ("Time", f"{e.seconds:.2f} s"),
    )
    return Block("Checks", (*compared_table(sigma, others, length_unit([sigma])), Facts(rows)), brief=())


def explain_report(solution: Solution) -> Document:
    """The nonlinear program as it was solved: objective, variables, rows and target with their values."""
    nlp = (solution.engine or solution).optimisation_problem.nlp
    values = Values.of(nlp, solution.q, solution.target.parameters)
    terms = [(name, _plain(float(value))) for (name, _), value in zip(nlp.terms, values.terms, strict=True)]
    bounded = "at least", "value", "at most", ""
    variables, rows = [], []
    for v, x in zip(nlp.variables, solution.q, strict=True):
        ends = (quantity(float(y), v.unit) for y in (v.lower, x, v.upper))
        variables.append((v.name, *ends, _binding(v.lower, x, v.upper)))
    for row, low, value, high in zip(nlp.rows, values.row_lower, values.rows, values.row_upper, strict=True):
        # Sizes have no sign; a miss is shown as the probability of success.
        first, last = row.shown(float(low)), row.shown(float(high))
        first = -math.inf if first == last and low < high else first
        shown = (quantity(y, row.unit) for y in (min(first, last), row.shown(float(value)), max(first, last)))
        rows.append((row.name, *shown, _binding(low, value, high)))
    of_rows = Table(("row", *bounded), tuple(rows)) if rows else "None: the tool point is free."
    target = _parameters(solution.target, not solution.problem.workpiece_sources.empty)
    blocks = (
        Block("Objective", (Table(("term", "value"), (*terms, ("objective", _plain(values.objective)))),)),
        Block("Variables", (Table(("variable", *bounded), tuple(variables)),)),
        Block("Rows", (of_rows,)),
        Block("Parameters of the target", (target,)),
    )
    return Document(f"Nonlinear program of: {solution.problem.name}", (), blocks)


def _binding(low: float, value: float, high: float) -> str:
    tolerance = 1e-6
    if value < low - tolerance or value > high + tolerance:
        return "violated"
    if low == high:
        return "met"
    return "at its bound" if min(value - low, high - value) < tolerance else ""


def _parameters(target: TaskTarget, levered: bool) -> Table:
    """Parameters of the target with their meaning, but for those that say nothing here."""
    rows, at, hidden = [], 0, set[str]()
    hidden |= {"axis", "a1", "a2"} if np.array_equal(target.axis, target.direction) else set()
    hidden |= (set() if target.spun else {"spin"}) | (set() if levered else {"lever"})
    for name, size in SIZES.items():
        entries = [float(v) for v in target.parameters[at : at + size]]
        at += size
        text = ", ".join(f"{v + 0.0:.4g}" for v in entries)
        if name in ("lower", "upper", "clearance", "lever"):
            text = ", ".join("free" if abs(v) >= FREE else quantity(v, "m") for v in entries)
        elif name == "scale":
            text = f"{_plain(entries[0] * 1e6)} mm^2"
        if name not in hidden:
            rows.append((name, _PARAMETER_MEANINGS[name], text))
    return Table(("parameter", "is", "value"), tuple(rows), text_columns=2)


def _plain(value: float) -> str:
    return f"{value:.6g}" if math.isfinite(value) else UNKNOWN
