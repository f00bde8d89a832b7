"""Postures for targets that come without one: those of the nominal arm, each near the one before it."""

from __future__ import annotations

import numpy as np

from posture_opt.compensation.nearest_postures import NearestPostures, Poses
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.joint_ranges import drawn_between
from posture_opt.robot.robot import Robot
from posture_opt.selection.program.pose_request import PoseRequest
from posture_opt.selection.program.task_target import spin_axis
from posture_opt.selection.search.inverse_kinematics import InverseKinematics

_TOOL_AXIS = (0.0, 0.0, 1.0)
_RANDOM_STARTS = 200  # random postures that are led to a target which the posture before it does not lead to
_KEPT_STARTS = 24  # of them, those that come nearest
_SAME_ORIENTATION_RAD = 1e-3  # rad: orientations that are as near as each other


def start_postures(drawn: Robot, chain: NearestPostures, wanted: Poses) -> Array:
    """Postures (N, n) [rad or m] of the nominal arm at poses that the ``chain`` with corrections reaches.

    Each row starts from the one before it, so that the arm moves little. The first row, and one that cannot be reached
    so, takes of `_RANDOM_STARTS` random starts the posture nearest to the one before, or to the middle of the joints'
    ranges. Draws are seeded: the same targets give the same postures.

    Args:
        drawn: the robot without corrections; chain: the solver of the robot with them.
        wanted: N poses, world.
    """
    low, high = drawn_between(chain.robot)
    before = (low + high) / 2
    search = InverseKinematics(Arm(chain.robot), _TOOL_AXIS, chain.directions, None, spun=chain.turns >= 3)
    rng, found = np.random.default_rng(0), []
    for row in range(len(wanted.position)):
        one = wanted.take(np.arange(len(wanted.position)) == row)
        q = chain.solve(one, before[None]) if row else before[None]
        if not chain.reached(q, one)[0] and not chain.beyond(one)[0]:
            q = _searched_posture(search, chain, one, before, rng)
        found.append(q[0])
        before = q[0]
    return NearestPostures(drawn).solve(wanted, np.array(found))


def _searched_posture(
    search: InverseKinematics, chain: NearestPostures, one: Poses, before: Array, rng: np.random.Generator
) -> Array:
    """A posture (1, n) that random starts lead to, the nearest to ``before`` (n,); else what comes nearest."""
    oriented = one.rotation is not None and chain.turns >= 3
    R = np.eye(3) if one.rotation is None else one.rotation[0]
    request = PoseRequest(one.position[0], R[:, 2], R @ spin_axis(_TOOL_AXIS), np.array([1.0, *[float(oriented)] * 2]))
    led, errors = search.solve(search.random_postures(_RANDOM_STARTS, rng), request)
    led = led[np.argsort(errors, kind="stable")[:_KEPT_STARTS]]
    every = one.repeated(len(led))
    led = chain.followed(every, np.broadcast_to(before, led.shape), led)
    left = chain.misses(led, every)
    off = np.linalg.norm(left.position @ chain.directions, axis=1) + np.linalg.norm(left.rotation, axis=1)
    good = off <= off.min() + (_SAME_ORIENTATION_RAD if chain.turns < 3 else 1e-6)
    distance = np.where(good, np.abs(led - before).max(axis=1), np.inf)
    return chain.solve(one, before[None], led[[int(np.argmin(distance))]])
