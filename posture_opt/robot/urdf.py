"""Robots read from a URDF file: the chain between two links, everything fixed folded in."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from posture_opt.errors import BadValueError, InputError, Issue, listed
from posture_opt.files import located
from posture_opt.numerics import Array
from posture_opt.robot.format import FULL_TURN, MAX_JOINTS, RobotFormat, check_joint_name
from posture_opt.robot.robot import Axis, Factor, Joint, Robot, frame_factors
from posture_opt.robot.urdf_reader import in_urdf, read_urdf
from posture_opt.robot.urdf_tree import UrdfJoint, UrdfTree

FLANGE = "tool0"
MOVING = ("revolute", "continuous", "prismatic")
_ON_AXIS = 1e-14  # how far beside a coordinate axis a unit vector may lie: far below what a pose can show


class UrdfRobot(RobotFormat):
    """The chain from ``base_link`` to ``tip_link`` of a URDF file.

    Where they are not given, the base is the root and the tip the only leaf or, among several, ``tool0``, which is
    ROS-Industrial's name of the tool flange.

    A joint is ``Trans(x, y, z) Rz(yaw) Ry(pitch) Rx(roll)`` of its origin, then the motion about or along its axis;
    where the axis points against a coordinate axis, ``JOINT.theta`` still counts along the coordinate axis. Errors
    ``JOINT.x|y|z|yaw|pitch`` are those of the origin's numbers. ``JOINT.roll`` is a turn about x in front of the pitch;
    without pitch it is the error of the number roll. So the three turn about perpendicular axes at every pitch, ±90°
    included. Fixed joints are constant, their masses count to the moving link that carries them. Meshes are never
    opened.
    Source: ROS, "URDF XML specification", elements link and joint.
    """

    kind: Literal["urdf"] = "urdf"
    file: str
    base_link: str | None = None
    tip_link: str | None = None

    def nominal(self, folder: Path) -> Robot:
        """The chain in numbers.

        Raises:
            InputError: no such file, no URDF, no such link, no chain between the links, or a joint in it that a
                serial arm with one variable a joint cannot have (mimic, floating, planar).
        """
        file = self._located(folder)
        tree = read_urdf(file)
        path = self._path(tree)
        if issues := [*_faults(path)]:
            raise InputError([in_urdf(issue, file) for issue in issues])
        segments = _segments(path)
        links = tuple(_link_factors(segment, index) for index, segment in enumerate(segments))
        joints = tuple(_joint(tree, segment) for segment in segments)
        free = [s.moving.name for s in segments if s.moving.type == "revolute" and s.moving.lower is None]
        return replace(
            self.assemble(tree.name, joints, links),
            sources=(("file", self.file), ("base_link", path[0].parent), ("tip_link", path[-1].child)),
            notes=tuple(f"joint {name} has no <limit>: a turn either way is taken" for name in free),
        )

    def _located(self, folder: Path) -> Path:
        try:
            return located(folder, self.file)
        except InputError as error:
            raise InputError([issue.at("file") for issue in error.issues]) from None

    def _path(self, tree: UrdfTree) -> list[UrdfJoint]:
        base = self.base_link or _only(tree.roots(), "base_link", "root links, the file falls apart")
        tree.require(base, "base_link")
        tip = self.tip_link or _only(tree.leaves(base), "tip_link", f"last links behind '{base}'")
        tree.require(tip, "tip_link")
        path = tree.path(base, tip)
        if not path and tip == base:
            raise InputError(Issue(f"no joint hangs on '{base}'", ("file",), None, "choose another base_link"))
        if not path:
            below = listed(tree.leaves(base))
            message = f"there is no chain from '{base}' to '{tip}'"
            raise InputError(Issue(message, ("tip_link",), tip, f"behind '{base}' hang: {below}"))
        return path


def _only(links: list[str], key: str, what: str) -> str:
    if len(links) == 1 or (key == "tip_link" and FLANGE in links):
        return links[0] if len(links) == 1 else FLANGE
    raise InputError(Issue(f"the URDF has {len(links)} {what}", (key,), None, f"name one: {key}: {listed(links)}"))


def _faults(path: list[UrdfJoint]) -> Iterator[Issue]:
    """Every joint of the chain that cannot be used, and a chain that nothing can be chosen of."""
    moving = [joint for joint in path if joint.type != "fixed"]
    for joint in moving:
        try:
            _check(joint)
        except BadValueError as error:
            yield replace(error.issue(()), line=joint.line)
    if not moving:
        message = f"no joint moves between '{path[0].parent}' and '{path[-1].child}'"
        yield Issue(message, mend="choose another tip_link or base_link")
    if len(moving) > MAX_JOINTS:
        message = f"{len(moving)} moving joints are more than the {MAX_JOINTS} that a serial arm may have here"
        yield Issue(message, mend="choose a tip_link nearer to the base_link")


def _check(joint: UrdfJoint) -> None:
    """Refuse a moving joint that cannot stand in the chain."""
    name, chain = f"joint '{joint.name}'", f"only {', '.join(MOVING)} and fixed joints can stand in the chain"
    if joint.mimics:
        message = f"{name} mimics '{joint.mimics}': coupled joints cannot stand in the chain"
        raise BadValueError(message, "choose another tip_link")
    if joint.type not in MOVING:
        raise BadValueError(f"{name} {f'is {joint.type}' if joint.type else 'has no type'}", chain)
    check_joint_name(joint.name)
    if not np.linalg.norm(joint.axis) > 0:
        raise BadValueError(f"{name} has an axis of length zero", 'write for example <axis xyz="0 0 1"/>')
    if joint.type == "prismatic" and (joint.lower is None or joint.upper is None):
        raise BadValueError(f"{name} is prismatic and has no limits", 'write <limit lower="0" upper="0.2" …/>')
    lower, upper = _limits(joint)
    if not lower < upper:
        message = f"{name} has crossed limits or no range: {lower:g} to {upper:g}"
        raise BadValueError(message, "write lower < upper")


def _limits(joint: UrdfJoint) -> tuple[float, float]:
    lower, upper = joint.lower, joint.upper
    if lower is None or upper is None or (joint.type == "continuous" and not lower < upper):
        return FULL_TURN  # many files write lower="0" upper="0" for a continuous joint
    return lower, upper


@dataclass(frozen=True)
class _Segment:
    """A moving joint with the fixed origins before it and, for the last one, behind it: (4, 4) each."""

    before: tuple[Array, ...]
    moving: UrdfJoint
    behind: tuple[Array, ...] = ()


def _segments(path: list[UrdfJoint]) -> list[_Segment]:
    segments: list[_Segment] = []
    fixed: tuple[Array, ...] = ()
    for joint in path:
        if joint.type == "fixed":
            fixed = (*fixed, joint.origin)
        else:
            segments.append(_Segment(fixed, joint))
            fixed = ()
    segments[-1] = replace(segments[-1], behind=fixed)
    return segments


def _link_factors(segment: _Segment, index: int) -> tuple[Factor, ...]:
    """Fixed origins (unnamed), the joint's own origin (named), its motion, and what is fixed behind the last joint."""
    joint = segment.moving
    return (
        *(factor for origin in segment.before for factor in _constant(origin)),
        *_origin_factors(joint),
        *_motion(joint, index),
        *(factor for origin in segment.behind for factor in _constant(origin)),
    )


def _origin_factors(joint: UrdfJoint) -> tuple[Factor, ...]:
    """The named factors of a joint's origin, ``Trans(x, y, z) Rz(yaw) Rx(δ) Ry(pitch) Rx(roll)``, δ named ``.roll``.

    The three turn about perpendicular axes at every pitch. An error of the angle roll itself would turn about the axis
    of yaw at a pitch of ±90°, and then no three errors make a small turn about the third axis; without pitch it is δ.
    """
    x, y, z = joint.origin[:3, 3].tolist()
    roll, pitch, yaw = joint.rpy
    named = frame_factors(joint.name, (x, y, z), (roll, pitch, yaw))
    if pitch == 0:
        return named
    *before, tilt, turn = named
    return (*before, replace(turn, nominal=0.0), tilt, *([replace(turn, parameter="")] if roll else []))


def pitched_rolls(robot: Robot) -> tuple[str, ...]:
    """Names of the errors of roll that stand in front of a pitch, see `UrdfRobot`."""
    pairs = [pair for link in robot.links for pair in itertools.pairwise(link)]
    return tuple(a.parameter for a, b in pairs if a.parameter.endswith(".roll") and b.parameter.endswith(".pitch"))


def _constant(origin: Array) -> tuple[Factor, ...]:
    named = frame_factors("", *_xyz_rpy(origin))
    return tuple(replace(factor, parameter="") for factor in named if factor.nominal != 0.0)


def _xyz_rpy(T: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Position (3,) [m] and (roll, pitch, yaw) [rad] with ``R = Rz(yaw) Ry(pitch) Rx(roll)``.

    Roll is taken from what yaw and pitch leave over, so the product is exact at pitch = ±90° too, where yaw and
    roll turn about one axis and only their sum is given.
    """
    R = T[:3, :3]
    cos_pitch = math.hypot(R[0, 0], R[1, 0])
    yaw = math.atan2(R[1, 0], R[0, 0]) if cos_pitch > 1e-13 else math.atan2(-R[0, 1], R[1, 1])
    pitch = math.atan2(-R[2, 0], cos_pitch)
    c, s = math.cos(yaw), math.sin(yaw)
    y_axis = np.array([-s, c, 0.0])
    roll = math.atan2(-float(y_axis @ R[:, 2]), float(y_axis @ R[:, 1]))
    return tuple(T[:3, 3].tolist()), (roll, pitch, yaw)


def _motion(joint: UrdfJoint, index: int) -> tuple[Factor, ...]:
    """The joint variable about or along its axis; any but +x, +y, +z is turned onto z by constants and back."""
    kind: Literal["translate", "rotate"] = "translate" if joint.type == "prismatic" else "rotate"
    parameter = f"{joint.name}.{'d' if kind == 'translate' else 'theta'}"
    x, y, z = unit = joint.axis / np.linalg.norm(joint.axis)
    axes: tuple[Axis, ...] = (0, 1, 2)
    for axis in axes:
        if unit[axis] > 0 and np.abs(np.delete(unit, axis)).max() < _ON_AXIS:
            return (Factor(kind, axis, 0.0, parameter, index),)
    yaw, pitch = math.atan2(y, x), math.atan2(math.hypot(x, y), z)
    return (
        Factor("rotate", 2, yaw),
        Factor("rotate", 1, pitch),
        Factor(kind, 2, 0.0, parameter, index),
        Factor("rotate", 1, -pitch),
        Factor("rotate", 2, -yaw),
    )


def _joint(tree: UrdfTree, segment: _Segment) -> Joint:
    """The joint with the mass of all that is fixed to its child link, its centre in the frame behind the segment."""
    moving = segment.moving
    T_child_end = _product(segment.behind)
    bodies = _rigid(tree, moving.child)
    mass, com = math.nan, (math.nan, math.nan, math.nan)
    if bodies:
        mass = sum(weight for weight, _ in bodies)
        centre = sum((weight * point for weight, point in bodies), np.zeros(3)) / (mass or 1.0)
        x, y, z = (T_child_end[:3, :3].T @ (centre - T_child_end[:3, 3])).tolist()
        com = (x, y, z)
    kind: Literal["revolute", "prismatic"] = "prismatic" if moving.type == "prismatic" else "revolute"
    return Joint(moving.name, kind, *_limits(moving), mass, com)


def _rigid(tree: UrdfTree, link: str) -> list[tuple[float, Array]]:
    """Mass and centre (3,) in the frame of ``link`` of every body fixed to it, itself among them."""
    bodies: list[tuple[float, Array]] = []
    open_links = [(link, np.eye(4))]
    while open_links:
        name, T = open_links.pop()
        if name in tree.inertials:
            body = tree.inertials[name]
            bodies.append((body.mass, T[:3, :3] @ body.com + T[:3, 3]))
        open_links += [(joint.child, T @ joint.origin) for joint in tree.below(name) if joint.type == "fixed"]
    return bodies


def _product(frames: tuple[Array, ...]) -> Array:
    T = np.eye(4)
    for frame in frames:
        T = T @ frame
    return T
