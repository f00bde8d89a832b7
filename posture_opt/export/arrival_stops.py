"""Stops in front of others, so that joints arrive from the side that their values hold for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.export.tool_moves import Move
from posture_opt.numerics import Array, Mask
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.search.search_outcome import is_clear

_RUN_RAD = math.radians(2.0)
"""Way of a joint to its stop [rad]: many times the play of any gear."""
_TRAVELS = 3.0
"""Times the travel of a hysteresis that a joint comes: all but a twentieth of it is reached then."""
_SHARES = (1.0, 0.5, 0.25)
"""Of that way, where the arm is not clear at its start, or a joint would leave its limits."""


@dataclass(frozen=True, eq=False)
class ArrivalStops:
    """Stops of a program with further ones in front, from which joints arrive as they should.

    Args:
        q: (M, n) the stops [rad or m]; labels, moves: (M,) of each.
        notes: which stops need none, and which could have none.
    """

    q: Array
    labels: tuple[str, ...]
    moves: tuple[Move, ...]
    notes: tuple[str, ...]


def with_arrivals(problem: ProblemData, q: Array, labels: Sequence[str], sides: Array) -> ArrivalStops:
    """Stops q (N, n) [rad or m] that are driven to joint by joint, each arrived at from its sides.

    From where the arm comes to the first stop nobody knows: whatever side is asked for there gets a stop in front.

    Args:
        sides: (N, n) +1 to arrive with increasing values, −1 with decreasing ones, 0 from any side; of joints that err
            the same from both it does not count.
    """
    names = problem.robot.joint_names
    sides = np.where([bool(_runs(problem, name)) for name in names], sides, 0.0)
    moved = np.sign(np.diff(q, axis=0, prepend=np.full((1, q.shape[1]), np.nan)))
    rows: list[tuple[Array, str, Move]] = []
    impossible: list[str] = []
    for k, label in enumerate(labels):
        wrong: Mask = (sides[k] != 0) & (moved[k] != sides[k])
        if wrong.any():
            told = ", ".join(f"{names[j]} {_direction(sides[k, j])}" for j in np.flatnonzero(wrong))
            start = _clear_start(problem, q[k], np.where(wrong, sides[k], 0.0))
            if start is None:
                impossible.append(f"Before {label}: drive so that {told} arrives; no stop in front of it is clear.")
            else:
                rows.append((start, f"before {label}: {told}", Move(waits=False)))
        rows.append((q[k], label, Move()))
    added = len(rows) - len(q)
    stops, texts, moves = zip(*rows, strict=True)
    notes = [_added_note(problem, np.array(stops), moves)] if added else []
    return ArrivalStops(np.array(stops), texts, moves, (*notes, *impossible))


def _added_note(problem: ProblemData, q: Array, moves: Sequence[Move]) -> str:
    """What the stops in front of others are for, and how far beside them the tool is there."""
    at = np.flatnonzero([not move.waits for move in moves])
    tool = np.asarray(problem.arm.position(q), dtype=float)
    away = 1e3 * float(np.linalg.norm(tool[at] - tool[at + 1], axis=1).max())
    return (
        f"Stops in front of some others, up to {away:.0f} mm beside them, bring joints in from the side that their "
        "values hold for: keep them, and see that there is room."
    )


def _direction(side: float) -> str:
    """The side of arrival in words."""
    return "with increasing values" if side > 0 else "with decreasing values"


def _runs(problem: ProblemData, joint: str) -> list[float]:
    """How far a joint should come to its stop [rad], by each effect of it that depends on the side."""
    sided = (effect for effect in problem.arm.effects if effect.target == joint and "approach" in effect.needs)
    return [max(_RUN_RAD, _TRAVELS * getattr(effect, "travel", 0.0)) for effect in sided]


def _clear_start(problem: ProblemData, q: Array, sides: Array) -> Array | None:
    """A posture (n,) from which the joints with a side (n,) arrive at q (n,) from it; None where none is clear."""
    runs = np.array([max(_runs(problem, name), default=0.0) for name in problem.robot.joint_names])
    lower, upper = np.array(problem.robot.lower), np.array(problem.robot.upper)
    for share in _SHARES:
        start = q - share * sides * runs
        if np.all((lower <= start) & (start <= upper)) and bool(is_clear(problem.scene, start[None])[0]):
            return np.asarray(start)
    return None
