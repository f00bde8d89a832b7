"""How joints arrive at commands, and how far the tool is then expected to be from its targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.compensation.nearest_postures import Poses, pose_misses
from posture_opt.compensation.targets import Targets
from posture_opt.model.arm import Arm
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE, Inputs
from posture_opt.numerics import Array, Mask
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.sources.sources import Sources

_MOVE_TOLERANCE = 1e-12  # rad or m: a smaller step is rounding
_LONG_MOVE = 1e6  # rad or m: the move to the first row, of which nothing is known but that it was long


@dataclass(frozen=True, eq=False)
class Arrivals:
    """How the joints arrive at N rows."""

    # (N, n) direction of the last move of each joint: +1 when its value grew, −1 when it fell, 0 where unknown
    side: Array
    way: Array  # (N, n) length of that move [rad or m]

    @property
    def known(self) -> Mask:
        """(N, n) whether the side is known."""
        return np.asarray(self.side != 0)

    def inputs(self, arm: Arm, rows: Targets, stated: Sequence[str] = ()) -> Inputs:
        """Inputs of effects in every row, its own columns first; sides not ``stated`` are sources of error."""
        given, n = arm.inputs, len(rows)
        warmth = None if rows.temperature is None else rows.temperature - REFERENCE_TEMPERATURE
        return Inputs(
            payload=np.full(n, given.payload) if rows.payload is None else rows.payload,
            approach=list(self.side.T),
            approach_length=list(self.way.T),
            temperature=np.full(n, given.temperature) if warmth is None else warmth,
            time=np.full(n, given.time) if rows.time is None else rows.time,
            stated=tuple(stated),
        )


def arrivals_of(arm: Arm, rows: Targets, q: Array) -> Arrivals:
    """``side_k = sign(q_k − q_{k−1})`` of commands (N, n) or the last move before; the first comes from far."""
    step = np.diff(q, axis=0, prepend=q[:1])
    last = np.where(np.abs(step) > _MOVE_TOLERANCE, np.arange(len(q))[:, None], 0)
    move = np.take_along_axis(step, np.maximum.accumulate(last, axis=0), axis=0)
    task = [arm.inputs.side(j) if joint.name in arm.inputs.stated else 0.0 for j, joint in enumerate(arm.robot.joints)]
    side = np.where(move != 0, np.sign(move), np.array(task, dtype=float))
    return Arrivals(np.where(rows.side != 0, rows.side, side), np.where(move != 0, np.abs(move), _LONG_MOVE))


def sided_joints(arm: Arm) -> Mask:
    """Joints (n,) that have an effect which depends on the side of arrival."""
    asked = {effect.target for effect in arm.effects if "approach" in effect.needs}
    return np.array([joint.name in asked for joint in arm.robot.joints])


@dataclass(frozen=True, eq=False)
class ExpectedMiss:
    """Of N commands against their targets."""

    off: Array  # (N,) distance of the expected tool point [m]; turned: (N,) angle of the expected orientation [rad]
    turned: Array
    # (N,) root mean square distance of the tool point, uncertainty and scatter included [m]; rms_turned: (N,) of the
    # angle [rad]
    rms: Array
    rms_turned: Array


def expected_miss(arm: Arm, sources: Sources, rows: Targets, wanted: Poses, q: Array, came: Arrivals) -> ExpectedMiss:
    """``rms² = |E f(q) − x|² + tr Cov f(q)`` at commands q (N, n) [rad or m], f with effects and errors."""
    q = np.asarray(q, dtype=float)
    inputs = came.inputs(arm, rows)
    left = pose_misses(np.asarray(arm.under(inputs).pose(q), dtype=float), wanted)
    off, turned = np.linalg.norm(left.position, axis=1), np.linalg.norm(left.rotation, axis=1)
    squared, squared_turned = off**2, turned**2
    patterns, group = np.unique(came.known, axis=0, return_inverse=True)
    for k, known in enumerate(patterns):
        at = np.flatnonzero(group.ravel() == k)
        stated = [joint.name for joint, is_known in zip(arm.robot.joints, known, strict=True) if is_known]
        tool_point = ToolPoint.of(arm.under(replace(inputs.take(at), stated=tuple(stated))), sources)
        more, more_turned = _mean_square_spread(
            tool_point, [np.ascontiguousarray(column) for column in q[at].T], left.position[at]
        )
        squared[at] += more
        squared_turned[at] += more_turned
    return ExpectedMiss(off, turned, np.sqrt(squared), np.sqrt(squared_turned))


def _mean_square_spread(tool_point: ToolPoint, q: Sequence[Array], left: Array) -> tuple[Array, Array]:
    """(N,) mean squares that uncertainty adds [m²], [rad²]; ``left`` (N, 3) target minus nominal tool point [m]."""
    moments = tool_point.moments(q)
    count = len(left)
    bias = np.broadcast_to(np.asarray(moments.mean - moments.position, dtype=float), (count, 3))
    total = np.broadcast_to(np.trace(np.asarray(moments.covariance, dtype=float), axis1=-2, axis2=-1), count)
    turns = np.asarray(tool_point.pose_first_order(q, moments.walk), dtype=float)[..., 3:, 3:]
    # |x̄ + b − target|² − |x̄ − target|², where left = target − x̄
    shifted = (bias**2).sum(axis=1) - 2 * (bias * left).sum(axis=1)
    return total + shifted, np.broadcast_to(np.trace(turns, axis1=-2, axis2=-1), count)
