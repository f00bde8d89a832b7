"""Where an arm is expected to come at commands, and how far that is from its targets on the average."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.compensation.arrival_sides import Arrivals
from posture_opt.compensation.nearest_postures import Poses, pose_misses
from posture_opt.compensation.targets import Targets
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.sources.sources import Sources


@dataclass(frozen=True, eq=False)
class ExpectedMiss:
    """Of N commands against their targets.

    Args:
        off: (N,) distance of the expected tool point [m]; turned: (N,) angle of the expected orientation [rad].
        rms: (N,) root mean square distance of the tool point, uncertainty and scatter included [m]; rms_turned: (N,)
            of the angle [rad].
    """

    off: Array
    turned: Array
    rms: Array
    rms_turned: Array


def expected_miss(arm: Arm, sources: Sources, rows: Targets, wanted: Poses, q: Array, came: Arrivals) -> ExpectedMiss:
    """The expected miss of commands: ``rms² = |E f(q) − x|² + tr Cov f(q)``.

    f is the arm with corrections and effects under the inputs of each row, x the wanted point. The covariance is that
    of everything uncertain: geometry, effects, scatter, and the sides that are unknown. Rows with the same known sides
    are evaluated together.

    Args:
        arm: with its effects; sources: the errors of its parameters.
        rows: for their columns; wanted: (N,) poses, world.
        q: (N, n) commands [rad or m]; came: how the joints arrive at them.
    """
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
    """What uncertainty adds (N,) to the mean square of the distance [m²] and of the angle [rad²].

    Args:
        q: (n,) of joint values (N,); left: (N, 3) target minus nominal tool point [m], which the bias of the mean
            changes.
    """
    moments = tool_point.moments(q)
    count = len(left)
    bias = np.broadcast_to(np.asarray(moments.mean - moments.position, dtype=float), (count, 3))
    total = np.broadcast_to(np.trace(np.asarray(moments.covariance, dtype=float), axis1=-2, axis2=-1), count)
    turns = np.asarray(tool_point.pose_first_order(q, moments.walk), dtype=float)[..., 3:, 3:]
    # |x̄ + b − target|² − |x̄ − target|², where left = target − x̄
    shifted = (bias**2).sum(axis=1) - 2 * (bias * left).sum(axis=1)
    return total + shifted, np.broadcast_to(np.trace(turns, axis1=-2, axis2=-1), count)
