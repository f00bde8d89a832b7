"""The joints of a URDF chain as segments, and the elementary transforms of each."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.robot import Axis, Factor, frame_factors
from posture_opt.robot.urdf_tree import UrdfJoint


@dataclass(frozen=True)
class ChainSegment:
    """A moving joint with the fixed origins before it and, for the last one, behind it."""

    before: tuple[Array, ...]  # (4, 4) each, the origins of fixed joints since the last moving one, lengths in [m]
    moving: UrdfJoint  # the joint itself, with its own origin
    # (4, 4) each, origins of the fixed joints up to the tip link; empty but for the last segment
    behind: tuple[Array, ...] = ()

    @property
    def T_child_end(self) -> Array:  # noqa: N802
        """(4, 4) the pose of the end of the segment in the child link of its joint, lengths in [m]."""
        return functools.reduce(np.matmul, self.behind, np.eye(4))


def segments_of(path: list[UrdfJoint]) -> list[ChainSegment]:
    """One segment for each moving joint of a path from base to tip, which has at least one."""
    segments: list[ChainSegment] = []
    fixed: tuple[Array, ...] = ()
    for joint in path:
        if joint.type == "fixed":
            fixed = (*fixed, joint.origin)
        else:
            segments.append(ChainSegment(fixed, joint))
            fixed = ()
    segments[-1] = replace(segments[-1], behind=fixed)
    return segments


def link_factors(segment: ChainSegment, index: int) -> tuple[Factor, ...]:
    """Fixed origins (unnamed), the joint's origin (named) and motion, and the fixed origins behind the last joint."""
    joint = segment.moving
    return (
        *(factor for origin in segment.before for factor in _constant_factors(origin)),
        *_origin_factors(joint),
        *_motion_factors(joint, index),
        *(factor for origin in segment.behind for factor in _constant_factors(origin)),
    )


def _origin_factors(joint: UrdfJoint) -> tuple[Factor, ...]:
    """The named factors of a joint's origin, ``Trans(x, y, z) Rz(yaw) Rx(δ) Ry(pitch) Rx(roll)``, δ named ``.roll``."""
    x, y, z = joint.origin[:3, 3].tolist()
    roll, pitch, yaw = joint.rpy
    named = frame_factors(joint.name, (x, y, z), (roll, pitch, yaw))
    if pitch == 0:
        return named
    *before, tilt, turn = named
    return (*before, replace(turn, nominal=0.0), tilt, *([replace(turn, parameter="")] if roll else []))


def _constant_factors(origin: Array) -> tuple[Factor, ...]:
    """An origin (4, 4) as up to six unnamed factors."""
    named = frame_factors("", *xyz_rpy(origin))
    return tuple(replace(factor, parameter="") for factor in named if factor.nominal != 0.0)


def xyz_rpy(T: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Position (3,) [m] and (roll, pitch, yaw) [rad] of a frame (4, 4), ``R = Rz(yaw) Ry(pitch) Rx(roll)``. Roll is
    what yaw and pitch leave over: exact at pitch = ±90° too, where only the sum of yaw and roll is given."""
    R = T[:3, :3]
    cos_pitch = math.hypot(R[0, 0], R[1, 0])
    yaw = math.atan2(R[1, 0], R[0, 0]) if cos_pitch > 1e-13 else math.atan2(-R[0, 1], R[1, 1])
    pitch = math.atan2(-R[2, 0], cos_pitch)
    c, s = math.cos(yaw), math.sin(yaw)
    y_axis = np.array([-s, c, 0.0])
    roll = math.atan2(-float(y_axis @ R[:, 2]), float(y_axis @ R[:, 1]))
    return tuple(T[:3, 3].tolist()), (roll, pitch, yaw)


def _motion_factors(joint: UrdfJoint, index: int) -> tuple[Factor, ...]:
    kind: Literal["translate", "rotate"] = "translate" if joint.type == "prismatic" else "rotate"
    parameter = f"{joint.name}.{'d' if kind == 'translate' else 'theta'}"
    axis = joint.axis / np.max(np.abs(joint.axis))  # whose square no float may hold
    x, y, z = unit = axis / np.linalg.norm(axis)
    axes: tuple[Axis, ...] = (0, 1, 2)
    for axis in axes:
        # Largest component of a unit vector across a coordinate axis that it is taken for: far below what poses show.
        if unit[axis] > 0 and np.abs(np.delete(unit, axis)).max() < 1e-14:
            return (Factor(kind, axis, 0.0, parameter, index),)
    yaw, pitch = math.atan2(y, x), math.atan2(math.hypot(x, y), z)
    return (
        Factor("rotate", 2, yaw),
        Factor("rotate", 1, pitch),
        Factor(kind, 2, 0.0, parameter, index),
        Factor("rotate", 1, -pitch),
        Factor("rotate", 2, -yaw),
    )
