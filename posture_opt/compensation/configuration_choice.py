"""Postures at rows of targets in as few configurations of the arm as can be."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from posture_opt.compensation.task_postures import Found, TaskPostures
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.answer.configurations import configurations

Branches = dict[tuple[str, ...], Array]
"""Name of a configuration -> a posture (n,) in it."""
_CHANGE_COST = 1e3  # rad: more than all joints together move


def changes_of(robot: Robot, Q: Array) -> list[int]:
    """The rows k of postures (N, n) that the arm leaves for row k + 1 in another configuration."""
    return [k for k, (a, b) in enumerate(pairwise(configurations(robot, Q))) if a != b]


def in_fewest_configurations(
    search: TaskPostures, found: Sequence[Found], p: Array, R: Array | None
) -> list[Found]:  # fmt: skip
    """The postures that were found, or others with fewer changes of the configuration; refused ones as they are.

    Args:
        search: of the targets p (N, 3) [m], with orientations R (N, 3, 3) where these are wanted.
    """
    robot = search.problem.robot
    rows = [k for k, one in enumerate(found) if not one.reason]
    named = configurations(robot, np.reshape([found[k].q for k in rows], (-1, robot.n)))
    if len(set(named)) < 2:
        return [*found]
    options = [
        {**search.branches(p[k], None if R is None else R[k]), name: found[k].q}
        for k, name in zip(rows, named, strict=True)
    ]
    best = dict(zip(rows, _way(options), strict=True))
    return [Found(best[k]) if k in best else one for k, one in enumerate(found)]


def _way(options: Sequence[Branches]) -> list[Array]:
    """One posture of each row: of fewest changes of the configuration, and then of least motion of the joints."""
    ways = [(0.0, [(name, q)]) for name, q in options[0].items()]
    for branches in options[1:]:
        ways = [
            min(
                ((cost + _step(way[-1], (name, q)), [*way, (name, q)]) for cost, way in ways),
                key=lambda found: found[0],
            )
            for name, q in branches.items()
        ]
    return [q for _, q in min(ways, key=lambda found: found[0])[1]]


def _step(a: tuple[tuple[str, ...], Array], b: tuple[tuple[str, ...], Array]) -> float:
    """What it costs to go from one posture to the next [rad]."""
    return _CHANGE_COST * (a[0] != b[0]) + float(np.abs(a[1] - b[1]).max())
