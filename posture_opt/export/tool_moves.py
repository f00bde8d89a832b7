"""How a robot program comes to each stop: joint by joint, or with the tool on a straight line; and the way in and out.

Lines end at joint values too: the controller turns them into a pose by its own kinematics and tool data, and the arm
stands where it was planned, corrections included. Only the way between two stops is the controller's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.numerics import Array, Codes
from posture_opt.selection.answer.held_joints import held_joints
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.search.search_outcome import is_clear

REDUCED_SPEED = 0.25
"""Speed of the tool point [m/s] at 100 % where the task states none: the reduced speed of ISO 10218-1."""
DEFAULT_APPROACH_M = 0.05
BLENDS_M = (1e-3, 0.3e-3)
"""Radii within which the tool may round a corner: the finest two that ABB predefines (z1, z0), for all languages."""
_MAX_BLEND_SHARE = 0.25
"""Of the distance to the next point, so that two corners never meet."""
_ITERATIONS, _STEPS = 30, 5
_DIFFERENCE = 1e-6
"""Step [rad or m] of the central differences of the pose."""
_REACHED = 1e-7
"""Of the position [m] and of the turn [rad] at an approach point."""


@dataclass(frozen=True)
class Move:
    """How a stop is reached.

    Args:
        line: with the tool point on a straight line, else joint by joint.
        blend: radius [m] within which the corner may be rounded; zero: the arm stops.
        waits: whether the program waits there for its time.
        time: since the first stop on the line [s]; None where it is not known.
        length: of the line from an approach point or to a retract [m]; None of other moves.
    """

    line: bool = False
    blend: float = 0.0
    waits: bool = True
    time: float | None = None
    length: float | None = None


def path_moves(positions: Array, lengths: Array, speed: float) -> list[Move]:
    """The moves along a path: joint by joint to its first point, on lines to the others.

    Args:
        positions: (K, 3) of the tool point [m]; ``lengths`` (K,) the way up to each [m].
        speed: of the tool point [m/s].
    """
    gaps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    room = [0.0, *np.minimum(gaps[:-1], gaps[1:]), 0.0] if len(gaps) else [0.0]
    blends = [next((b for b in BLENDS_M if b <= _MAX_BLEND_SHARE * free), 0.0) for free in room]
    rows = zip(blends, lengths, strict=True)
    return [Move(k > 0, blend, True, float(length) / speed) for k, (blend, length) in enumerate(rows)]


def beside(problem: ProblemData, q: Array, back: Array, distance: float) -> tuple[Array, float] | None:
    """A posture (n,) whose tool is back from its place at ``q`` (n,), and how far [m]; None where there is none.

    Half and a quarter of the distance are tried where the arm cannot go farther, or is not clear of obstacles there.
    Joints that the task holds stay where they are.

    Args:
        back: (3,) the way back, world.
    """
    arm = problem.arm
    held = [] if problem.task is None else list(held_joints(problem.robot, problem.task))
    free = np.setdiff1d(np.arange(problem.robot.n), held)
    for share in (1.0, 0.5, 0.25):
        found = _shifted(arm, q, share * distance * back / np.linalg.norm(back), free)
        if found is not None and bool(is_clear(problem.scene, found[None])[0]):
            return found, share * distance
    return None


def _shifted(arm: Arm, q: Array, shift: Array, free: Codes) -> Array | None:
    """The posture (n,) near ``q`` whose tool is moved by ``shift`` (3,) [m] and turned the same; None without one.

    Only the ``free`` joints move.

    An arm with fewer than six joints keeps the turn as far as it can.
    """
    start = np.asarray(arm.pose(q), dtype=float)
    for k in range(1, _STEPS + 1):
        wanted = start.copy()
        wanted[:3, 3] += shift * k / _STEPS
        for _ in range(_ITERATIONS):
            miss = _twist(np.asarray(arm.pose(q), dtype=float), wanted)
            if np.linalg.norm(miss) < _REACHED:
                break
            step = np.linalg.lstsq(_slopes(arm, q)[:, free], miss, rcond=1e-6)[0]
            q = q + np.bincount(free, step, minlength=len(q))
    miss = _twist(np.asarray(arm.pose(q), dtype=float), wanted)
    inside = np.all((np.array(arm.robot.lower) <= q) & (q <= np.array(arm.robot.upper)))
    wanted_of = miss if len(free) >= 6 else miss[:3]
    return q if inside and np.linalg.norm(wanted_of) < 10 * _REACHED else None


def _twist(T: Array, wanted: Array) -> Array:
    """(6,) shift [m] and turn [rad] from one pose (4, 4) to another near it, world axes."""
    R = wanted[:3, :3] @ T[:3, :3].T
    turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return np.concatenate([wanted[:3, 3] - T[:3, 3], turn])


def _slopes(arm: Arm, q: Array) -> Array:
    """(6, n) change of shift and turn with each joint, by central differences."""
    steps = _DIFFERENCE * np.eye(len(q))
    pairs = [(np.asarray(arm.pose(q - h), dtype=float), np.asarray(arm.pose(q + h), dtype=float)) for h in steps]
    return np.column_stack([_twist(low, high) for low, high in pairs]) / (2 * _DIFFERENCE)


def with_way(
    problem: ProblemData, q: Array, labels: Sequence[str], moves: Sequence[Move], backs: Array, distance: float,
    together: bool,
) -> tuple[Array, list[str], list[Move], list[str]]:  # fmt: skip
    """Stops with an approach point in front and a retract behind: of all together, as along a path, or of each.

    Args:
        backs: (N, 3) the way back from each stop, world.

    Returns:
        stops (M, n), their labels and moves, and notes on those that could not be had as asked.
    """
    rows: list[tuple[Array, str, Move]] = []
    notes: list[str] = []
    groups = [range(len(q))] if together else [range(k, k + 1) for k in range(len(q))]
    for group in groups:
        name = f" of {labels[group[0]]}" if labels[group[0]] and not together else ""
        ways = [beside(problem, q[k], backs[k], distance) for k in (group[0], group[-1])]
        for word, way in zip(("approach", "retract"), ways, strict=True):
            if way is None:
                notes.append(f"There is no {word} point{name}: the arm cannot stand clear {distance * 1e3:g} mm back.")
            elif way[1] < distance:
                notes.append(f"The {word} point{name} is {way[1] * 1e3:g} mm back, not {distance * 1e3:g} mm.")
        if ways[0] is not None:
            rows.append((ways[0][0], f"approach{name}", Move(waits=False)))
        for k in group:
            move = moves[k]
            if k == group[0] and ways[0] is not None:
                move = replace(move, line=True, length=ways[0][1])
            rows.append((q[k], labels[k], move))
        if ways[1] is not None:
            rows.append((ways[1][0], f"retract{name}", Move(True, waits=False, length=ways[1][1])))
    return np.array([row[0] for row in rows]), [row[1] for row in rows], [row[2] for row in rows], notes
