"""From which sides joints arrive: how far they come, and where a line begins that brings them in from these."""

from __future__ import annotations

import math

import numpy as np

from posture_opt.errors import NoSolutionError, listed
from posture_opt.numerics import Array, Mask
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.spread.joint_digits import joint_digits

_RUN_RAD = math.radians(2.0)
"""Way of a joint to its stop [rad]: many times the play of any gear."""
_TRAVELS = 3.0
"""Times the travel of a hysteresis that a joint comes: all but a twentieth of it is reached then."""
_LAST_MOVE_RAD = math.radians(0.01)
"""Least move of such a joint on the line to a stop [rad]: it only has to go on as it came to the line's beginning."""
_ROUNDINGS = 2.0
"""Steps of the digits of a program that this is at least."""
_MAX_SLANT = 0.05
"""Sideways shift of an approach point for that, as a share of the line."""


def runs(problem: ProblemData) -> Array:
    """(n,) how far each joint should come to its stop from one side [rad]; zero where no effect depends on it."""
    sided = [effect for effect in problem.arm.effects if "approach" in effect.needs]
    ways = dict.fromkeys(problem.robot.joint_names, 0.0)
    for effect in sided:
        ways[effect.target] = max(ways[effect.target], _RUN_RAD, _TRAVELS * getattr(effect, "travel", 0.0))
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
    """The beginning (n,) of a line of ``length`` [m] to ``q`` (n,), moved until joints go on to their sides on it.

    Raises:
        NoSolutionError: the line would lean by more than a twentieth: it moves a joint against its side.
    """
    least = max(_LAST_MOVE_RAD, _ROUNDINGS * joint_digits(problem, q).turn)
    against = (sides != 0) & (sides * (q - start) < least)
    moved = np.where(against, q - sides * least, start)
    shift = np.asarray(problem.arm.jacobian(start), dtype=float)[:3] @ (moved - start)
    if np.linalg.norm(shift) > _MAX_SLANT * length:
        names = listed(problem.robot.joint_names[j] for j in np.flatnonzero(against))
        raise NoSolutionError(
            f"the way in{name} moves {names} against the side that the answer holds for: state the other side "
            "(task: approach), or come to the stop joint by joint (--approach 0)"
        )
    return np.asarray(moved)
