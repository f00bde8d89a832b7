"""Stops in front of others, so that joints arrive from the side that their values hold for."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from posture_opt.errors import listed
from posture_opt.export.arrivals import runs, side_words
from posture_opt.export.tool_moves import Move, Stop
from posture_opt.numerics import Array, Mask
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.search.search_outcome import is_clear

_SHARES = (1.0, 0.5, 0.25)
"""Of a run, where the arm is not clear at its start, or a joint would leave its limits."""


def with_arrivals(problem: ProblemData, stops: Sequence[Stop]) -> tuple[list[Stop], list[str]]:
    """Stops with further ones in front of those that are driven to joint by joint, each arrived at from its sides.

    From where the arm comes to the first stop nobody knows: whatever side is asked for there gets a stop in front.
    Notes say what the further stops are for, and where joints arrive from another side.
    """
    run, came = runs(problem), np.full(problem.robot.n, np.nan)
    rows: list[Stop] = []
    notes: list[str] = []
    on_lines: list[str] = []
    for k, stop in enumerate(stops):
        if k:
            move = np.sign(stop.q - stops[k - 1].q)
            came = np.where(move != 0, move, came)
        wrong: Mask = (run > 0) & (stop.sides != 0) & (came != stop.sides)
        if wrong.any() and stop.move.line:
            on_lines.append(stop.label)
        elif wrong.any():
            told, side = side_words(problem, stop.sides, wrong), np.where(wrong, stop.sides, 0.0)
            start = _clear_start(problem, stop.q, side * run)
            came = np.where(wrong, stop.sides, came)
            if start is None:
                notes.append(f"Before {stop.label}: drive so that {told} arrives; no stop in front of it is clear.")
            else:
                rows.append(Stop(start, f"before {stop.label}: {told}".strip(), Move(waits=False), 0.0 * side))
        rows.append(stop)
    if on_lines:
        notes.append(f"Joints come to {listed(on_lines)} from another side than the answer holds for.")
    added = len(rows) - len(stops)
    return rows, [*([_added_note(problem, rows)] if added else []), *notes]


def _added_note(problem: ProblemData, stops: Sequence[Stop]) -> str:
    """What the stops in front of others are for, and how far beside them the tool is there."""
    tool = np.asarray(problem.arm.position(np.array([stop.q for stop in stops])), dtype=float)
    pairs = zip(pairwise(stops), np.linalg.norm(np.diff(tool, axis=0), axis=1), strict=True)
    away = 1e3 * max(gap for (a, _), gap in pairs if a.label.startswith("before"))
    return (
        f"Stops in front of some others, up to {away:.0f} mm beside them, bring joints in from the side that their "
        "values hold for: keep them, and see that there is room."
    )


def _clear_start(problem: ProblemData, q: Array, way: Array) -> Array | None:
    """A posture (n,) from which joints come to q (n,) along a ``way`` (n,) [rad]; None where none is clear."""
    lower, upper = np.array(problem.robot.lower), np.array(problem.robot.upper)
    for share in _SHARES:
        start = q - share * way
        if np.all((lower <= start) & (start <= upper)) and bool(is_clear(problem.scene, start[None])[0]):
            return np.asarray(start)
    return None
