"""How a robot program comes to each stop: joint by joint, or with the tool on a straight line; and the way in and out.

Lines end at joint values too: the controller turns them into a pose by its own kinematics and tool data, and the arm
stands where it was planned, corrections included. Only the way between two stops is the controller's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from posture_opt.export.arrivals import from_sides
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
_ITERATIONS = 30
_LINE_STEP_M = 0.01
"""Between two postures of a line that are looked at."""
_LEG_STEP_RAD = math.radians(3.0)
"""Of the joint that moves most, or m, between two postures of a move that are looked at."""
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


class Stop(NamedTuple):
    """A posture that a program drives to.

    Args:
        q: (n,) [rad or m]; ``label`` a text, empty for none; ``move`` how it is reached.
        sides: (n,) +1 where a joint is to arrive with increasing values, −1 with decreasing ones, 0 either way.
    """

    q: Array
    label: str
    move: Move
    sides: Array


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

    The arm is clear all along the line between the two. Half and a quarter of the distance are tried where it cannot go
    farther. Joints that the task holds stay where they are.

    Args:
        back: (3,) the way back, world.
    """
    held = [] if problem.task is None else list(held_joints(problem.robot, problem.task))
    free = np.setdiff1d(np.arange(problem.robot.n), held)
    for share in (1.0, 0.5, 0.25):
        line = _line(problem.arm, q, share * distance * back / np.linalg.norm(back), free)
        if line is not None and bool(is_clear(problem.scene, line).all()):
            return line[-1], share * distance
    return None


def _line(arm: Arm, q: Array, shift: Array, free: Codes) -> Array | None:
    """Postures (K, n) from ``q`` on, the tool moved by up to ``shift`` (3,) [m] and turned the same; None without any.

    Only the ``free`` joints move. An arm with fewer than six joints keeps the turn as far as it can.
    """
    start = np.asarray(arm.pose(q), dtype=float)
    lower, upper, found = np.array(arm.robot.lower), np.array(arm.robot.upper), []
    for share in np.linspace(0, 1, max(math.ceil(float(np.linalg.norm(shift)) / _LINE_STEP_M), 2) + 1)[1:]:
        wanted = start.copy()
        wanted[:3, 3] += share * shift
        for _ in range(_ITERATIONS):
            miss = _twist(np.asarray(arm.pose(q), dtype=float), wanted)
            if np.linalg.norm(miss) < _REACHED:
                break
            step = np.linalg.lstsq(_slopes(arm, q)[:, free], miss, rcond=1e-6)[0]
            q = q + np.bincount(free, step, minlength=len(q))
        miss = _twist(np.asarray(arm.pose(q), dtype=float), wanted)
        counted = miss if len(free) >= 6 else miss[:3]
        if np.any((q < lower) | (q > upper)) or np.linalg.norm(counted) >= 10 * _REACHED:
            return None
        found.append(q)
    return np.array(found)


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
    problem: ProblemData, group: Sequence[Stop], backs: Sequence[Array], distance: float
) -> tuple[list[Stop], list[str]]:
    """A stop, or the stops of a path, with an approach point in front and a retract behind.

    The approach point lies so far beside the line that joints which are to arrive from a side do.

    Args:
        backs: (3,) each, the way back from the first stop and from the last one, world.

    Returns:
        the stops, and notes on points that could not be had as asked.

    Raises:
        NoSolutionError: the way in moves a joint against its side.
    """
    first, last = group[0], group[-1]
    name = f" of {first.label}" if first.label and len(group) == 1 else ""
    ways = [beside(problem, stop.q, back, distance) for stop, back in zip((first, last), backs, strict=True)]
    notes, rows, inner = [], [], list(group)
    for word, way in zip(("approach", "retract"), ways, strict=True):
        if way is None:
            notes.append(f"There is no {word} point{name}: the arm cannot stand clear {distance * 1e3:g} mm back.")
        elif way[1] < distance:
            notes.append(f"The {word} point{name} is {way[1] * 1e3:g} mm back, not {distance * 1e3:g} mm.")
    if ways[0] is not None:
        start = from_sides(problem, ways[0][0], first.q, first.sides, ways[0][1], name)
        rows = [Stop(start, f"approach{name}", Move(waits=False), first.sides)]
        inner[0] = first._replace(move=replace(first.move, line=True, length=ways[0][1]))
    if ways[1] is not None:
        move = Move(True, waits=False, length=ways[1][1])
        inner.append(Stop(ways[1][0], f"retract{name}", move, np.zeros(len(last.q))))
    return [*rows, *inner], notes


def blocked_legs(problem: ProblemData, stops: Sequence[Stop]) -> list[str]:
    """From which stop to which one an even move of the joints does not keep clear, in words."""
    found = []
    for a, b in pairwise(stops):
        count = math.ceil(float(np.abs(b.q - a.q).max()) / _LEG_STEP_RAD)
        shares = np.linspace(0, 1, count + 1)[1:-1, None]
        if len(shares) and not is_clear(problem.scene, (1 - shares) * a.q + shares * b.q).all():
            found.append(f"{a.label or 'the stop'} to {b.label or 'the stop'}")
    return found
