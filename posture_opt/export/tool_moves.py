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

from posture_opt.errors import NoSolutionError, listed
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import held_joints
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.uncertainty.joint_digits import joint_digits

# Speed of the tool point [m/s] at 100 % where the task states none: the reduced speed of ISO 10218-1.
REDUCED_SPEED = 0.25
# Radii within which the tool may round a corner: the finest two that ABB predefines (z1, z0), for all languages.
BLENDS_M = (1e-3, 0.3e-3)
_REACHED = 1e-9  # of the position [m] and of the turn [rad] at an approach point


@dataclass(frozen=True)
class Move:
    """How a stop is reached.

    Args:
        blend: radius [m] within which the corner may be rounded; zero: the arm stops.
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
    # At most a quarter of the way to the next point, so that two corners never meet.
    blends = [next((b for b in BLENDS_M if b <= 0.25 * free), 0.0) for free in room]
    rows = zip(blends, lengths, strict=True)
    return [Move(k > 0, blend, True, float(length) / speed) for k, (blend, length) in enumerate(rows)]


def beside(problem: ProblemData, q: Array, back: Array, distance: float) -> tuple[Array, float] | None:
    """A posture (n,) whose tool is back from its place at ``q`` (n,), and how far [m]; None where there is none.

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
    """Postures (K, n) from ``q`` on, the tool moved by up to ``shift`` (3,) [m] and turned the same."""
    start = np.asarray(arm.pose(q), dtype=float)
    lower, upper, found = np.array(arm.robot.lower), np.array(arm.robot.upper), []
    for share in np.linspace(0, 1, max(math.ceil(float(np.linalg.norm(shift)) / 0.01), 2) + 1)[1:]:  # each 10 mm
        wanted = start.copy()
        wanted[:3, 3] += share * shift
        for _ in range(30):
            # Gauss-Newton with the Jacobian of the chain: effects change it by little.
            miss = _twist(np.asarray(arm.pose(q), dtype=float), wanted)
            if np.linalg.norm(miss) < _REACHED:
                break
            step = np.linalg.lstsq(np.asarray(arm.jacobian(q), dtype=float)[:, free], miss, rcond=1e-6)[0]
            q = q + np.bincount(free, step, minlength=len(q))
        miss = _twist(np.asarray(arm.pose(q), dtype=float), wanted)
        counted = miss if len(free) >= 6 else miss[:3]
        if np.any((q < lower) | (q > upper)) or np.linalg.norm(counted) >= 1e-6:
            return None
        found.append(q)
    return np.array(found)


def _twist(T: Array, wanted: Array) -> Array:
    """(6,) shift [m] and turn [rad] from one pose (4, 4) to another near it, world axes."""
    R = wanted[:3, :3] @ T[:3, :3].T
    turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return np.concatenate([wanted[:3, 3] - T[:3, 3], turn])


def with_way(
    problem: ProblemData, group: Sequence[Stop], backs: Sequence[Array], distance: float
) -> tuple[list[Stop], list[str]]:
    """A stop, or the stops of a path, with an approach point in front and a retract behind.

    Args:
        backs: (3,) each, the way back from the first stop and from the last one, world.
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
        count = math.ceil(float(np.abs(b.q - a.q).max()) / math.radians(3.0))  # of the joint that moves most, or m
        shares = np.linspace(0, 1, count + 1)[1:-1, None]
        if len(shares) and not is_clear(problem.scene, (1 - shares) * a.q + shares * b.q).all():
            found.append(f"{a.label or 'the stop'} to {b.label or 'the stop'}")
    return found


def runs(problem: ProblemData) -> Array:
    """(n,) how far each joint should come to its stop from one side [rad]; zero where no effect depends on it."""
    ways = dict.fromkeys(problem.robot.joint_names, 0.0)
    for effect in problem.arm.effects:
        if "approach" in effect.needs:
            # Many times the play of any gear; of a hysteresis all but a twentieth is reached after three travels.
            way = max(math.radians(2.0), 3.0 * getattr(effect, "travel", 0.0))
            ways[effect.target] = max(ways[effect.target], way)
    return np.array(list(ways.values()))


def task_sides(problem: ProblemData) -> Array:
    """(n,) the sides that the task states, of joints that an effect of theirs depends on them; else 0."""
    inputs, names = problem.arm.inputs, problem.robot.joint_names
    sides = [float(inputs.side(j)) if name in inputs.stated else 0.0 for j, name in enumerate(names)]
    return np.where(runs(problem) > 0, sides, 0.0)


def side_words(problem: ProblemData, sides: Array, which: Mask) -> str:
    """Joints (n,) with the sides that they are to arrive from."""
    names = problem.robot.joint_names
    ways = ["increasing" if side > 0 else "decreasing" for side in sides.tolist()]
    return ", ".join(f"{names[j]} with {ways[j]} values" for j in np.flatnonzero(which))


def from_sides(problem: ProblemData, start: Array, q: Array, sides: Array, length: float, name: str) -> Array:
    """The beginning (n,) of a line of ``length`` [m] to ``q`` (n,), moved until joints go on to their sides on it."""
    # A joint only has to go on as it came to the line's beginning, by more than its digits can say.
    least = max(math.radians(0.01), 2.0 * joint_digits(problem, q).turn)
    against = (sides != 0) & (sides * (q - start) < least)
    moved = np.where(against, q - sides * least, start)
    shift = np.asarray(problem.arm.jacobian(start), dtype=float)[:3] @ (moved - start)
    if np.linalg.norm(shift) > 0.05 * length:
        names = listed(problem.robot.joint_names[j] for j in np.flatnonzero(against))
        raise NoSolutionError(
            f"the way in{name} moves {names} against the side that the answer holds for: state the other side "
            "(task: approach), or come to the stop joint by joint (--approach 0)"
        )
    return np.asarray(moved)


def with_arrivals(problem: ProblemData, stops: Sequence[Stop]) -> tuple[list[Stop], list[str]]:
    """Stops with further ones in front of those that are driven to joint by joint, each arrived at from its sides."""
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
            sides_text, side = side_words(problem, stop.sides, wrong), np.where(wrong, stop.sides, 0.0)
            start = _clear_start(problem, stop.q, side * run)
            came = np.where(wrong, stop.sides, came)
            if start is None:
                notes.append(
                    f"Before {stop.label}: drive so that {sides_text} arrives; no stop in front of it is clear."
                )
            else:
                rows.append(Stop(start, f"before {stop.label}: {sides_text}".strip(), Move(waits=False), 0.0 * side))
        rows.append(stop)
    if on_lines:
        notes.append(f"Joints come to {listed(on_lines)} from another side than the answer holds for.")
    if len(rows) > len(stops):
        tool = np.asarray(problem.arm.position(np.array([stop.q for stop in rows])), dtype=float)
        pairs = zip(pairwise(rows), np.linalg.norm(np.diff(tool, axis=0), axis=1), strict=True)
        away = 1e3 * max(gap for (a, _), gap in pairs if a.label.startswith("before"))
        text = f"Stops in front of some others, up to {away:.0f} mm beside them, bring joints in from the side that "
        notes.insert(0, f"{text}their values hold for: keep them, and see that there is room.")
    return rows, notes


def _clear_start(problem: ProblemData, q: Array, way: Array) -> Array | None:
    """A posture (n,) from which joints come to q (n,) along a ``way`` (n,) [rad]; None where none is clear."""
    lower, upper = np.array(problem.robot.lower), np.array(problem.robot.upper)
    for share in (1.0, 0.5, 0.25):
        start = q - share * way
        if np.all((lower <= start) & (start <= upper)) and bool(is_clear(problem.scene, start[None])[0]):
            return np.asarray(start)
    return None
