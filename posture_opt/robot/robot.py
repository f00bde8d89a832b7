"""The nominal serial chain in numbers: what every robot format is read into."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from posture_opt.numerics import Array

BASE = "base"  # Capsule.joint of a body at rest: its frame is that of the robot's base
TOOL = "tool"  # Capsule.joint of a body held by the flange: its frame is that of the tool point
Point = tuple[float, float, float]  # (3,) coordinates [m]; the frame is that of the capsule's joint


@dataclass(frozen=True)
class Capsule:
    """All points within ``radius`` of the segment from ``start`` to ``end``: a segment swept by a sphere."""

    joint: str  # the joint whose link it belongs to, base for what is at rest, tool for what is held
    # start, end: (3,) [m], in the frame behind that joint (of the robot's base, of the tool); equal for a sphere
    start: Point
    end: Point
    radius: float  # [m]; zero for a bare line
    # whether the file states it beside those that the arm brings
    added: bool = field(default=False, compare=False)

    @property
    def length(self) -> float:
        """Length of the segment [m]; the capsule is longer by both radii."""
        return math.dist(self.start, self.end)

    @property
    def volume(self) -> float:
        """``π r² l + 4/3 π r³`` [m³]."""
        return math.pi * self.radius**2 * (self.length + 4 / 3 * self.radius)


def moved(capsule: Capsule, T: Array) -> Capsule:
    """The capsule in another frame. capsule: in a frame a; T: (4, 4) T_b_a, lengths in [m]; a rotation and a shift, as
    radii are kept."""
    return replace(capsule, start=_moved_point(T, capsule.start), end=_moved_point(T, capsule.end))


def _moved_point(T: Array, point: Point) -> Point:
    """A point (3,) [m] in the other frame, ``T p``."""
    x, y, z = (T[:3, :3] @ np.array(point) + T[:3, 3]).tolist()
    return x, y, z


Axis = Literal[0, 1, 2]


@dataclass(frozen=True)
class Factor:
    """One elementary transform of the chain: a translation along, or a rotation about, one coordinate axis. ``F =
    Trans(e_axis, v)`` or ``F = Rot(e_axis, v)`` with ``v = nominal + p[parameter] + q[joint]``. Positive rotations are
    right-handed about the axis of the frame that the factor starts from."""

    kind: Literal["translate", "rotate"]  # translate along the axis or rotate about it
    axis: Axis  # 0, 1, 2 for x, y, z of the frame in front of the factor
    nominal: float = 0.0  # value without error and joint variable [rad] or [m]
    # name of the model parameter (an error, zero in the nominal model) that adds to it; empty for a constant
    parameter: str = ""
    joint: int | None = None  # index of the joint variable that adds to it; None for a fixed factor


@dataclass(frozen=True, eq=False)
class Joint:
    """One moving joint and the rigid link behind it. NaN stands for an unknown number; two joints are equal where all
    known values are and the same values are unknown."""

    name: str  # unique in the robot; parameters of the joint are named after it, JOINT.theta
    type: Literal["revolute", "prismatic"]  # revolute (a variable in rad) or prismatic (in m)
    lower: float  # lower, upper: limits of the joint variable [rad] or [m]
    upper: float
    mass: float = math.nan  # of the link behind the joint [kg]; NaN where unknown
    # (3,) centre of mass of that link [m], frame behind the joint; NaN where unknown
    com: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    gear_ratio: float = math.nan  # motor turns per joint turn; NaN where unknown
    velocity: float = math.nan  # largest speed of the joint [rad/s] or [m/s]; NaN where unknown
    effort: float = math.nan  # largest torque or force that its drive bears [N m] or [N]; NaN where unknown

    @property
    def unit(self) -> Literal["rad", "m"]:
        """SI unit of the joint variable."""
        return "rad" if self.type == "revolute" else "m"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Joint) and self._known_values == other._known_values

    def __hash__(self) -> int:
        return hash(self._known_values)

    @property
    def _known_values(self) -> tuple[object, ...]:
        numbers = (self.lower, self.upper, self.mass, self.gear_ratio, self.velocity, self.effort, *self.com)
        return (self.name, self.type, *(None if math.isnan(number) else number for number in numbers))


@dataclass(frozen=True)
class Repeatability:
    """A data sheet's ISO 9283 position repeatability RP [m], with its source. RP is the radius of a sphere, mean
    distance of the repeats from their mean plus three standard deviations of it."""

    value: float
    source: str


@dataclass(frozen=True)
class UrdfDescription:
    """A URDF as it was read: meshes, inertias and further links."""

    data: bytes = field(repr=False)  # the file
    base_link: str  # base_link, tip_link: ends of the chain in it
    tip_link: str


@dataclass(frozen=True)
class Robot:
    """A serial chain: base, one group of factors a joint, tool.

    ``T_world_tool = Π base · Π links[0] · … · Π links[n − 1] · Π tool``; the frame of link i is the one reached behind
    ``links[i]``. Every named parameter occurs in exactly one factor, and every joint variable in exactly one.

    Args:
        name: of the arm, for reports.
        joints: (n,) from the base to the tool.
        links: (n,) the factors of each link, the one with the joint variable among them.
        base: factors of ``T_world_base``; ``tool``: factors of ``T_flange_tool``.
        payload: mass [kg], and ``payload_centre`` (3,) its centre in the axes of the tool, from the tool point [m].
        gravity: (3,) acceleration [m/s²], world axes; it points down.
        repeatability: of the data sheet; None where none is stated.
        base_free, tool_free: whether the frame is to be found from measurements.
        skew, lift: bounds [rad], [m] on how far corrections lean and shift the axes from the nominal arm: what is
            parallel or in one plane there counts as such within them.
        sources: for each group of numbers (``geometry``, ``masses``, …) where it is from; of a URDF the file and its
            links.
        notes: sentences on what was assumed while the robot was read.
        shape: capsules that base, links and tool lie in; empty where the shape is not known.
        shape_notes: which links are not in the shape, and why; ``unshaped`` the names of those links.
        bare_joints: joints that carry links whose shape is not known, which capsules along the links may stand for.
        mounting_below: distance [m] of the surface that the arm is made to stand on below the xy plane of its base.
        tool_radius: of the tool between flange and tool point [m]; None where it is not stated.
        allowed_collisions: pairs of joints (or ``base``) whose links are not checked against each other.
        named_postures: name -> joints with their values [rad or m], of an SRDF.
        description: the URDF that the arm was read from; None of other formats.
        pose_prefix: of columns that hold the last three joints (about z, y', x'') as an orientation; empty of an arm.

    Example:
        >>> import posture_opt as po
        >>> robot = po.load_problem("insert_ur10").robot
        >>> robot.n, robot.joint_names[:3]
        (6, ('shoulder_pan', 'shoulder_lift', 'elbow'))
    """

    name: str
    joints: tuple[Joint, ...]
    links: tuple[tuple[Factor, ...], ...]
    base: tuple[Factor, ...] = ()
    tool: tuple[Factor, ...] = ()
    payload: float = 0.0
    payload_centre: Point = (0.0, 0.0, 0.0)
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    repeatability: Repeatability | None = None
    base_free: bool = False
    tool_free: bool = False
    skew: float = 0.0
    lift: float = 0.0
    sources: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
    shape: tuple[Capsule, ...] = ()
    shape_notes: tuple[str, ...] = ()
    unshaped: tuple[str, ...] = ()
    bare_joints: tuple[str, ...] = ()
    mounting_below: float = 0.0
    tool_radius: float | None = None
    allowed_collisions: frozenset[frozenset[str]] = frozenset()
    named_postures: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    description: UrdfDescription | None = None
    pose_prefix: str = ""

    @property
    def most_payload(self) -> float:
        """The largest payload that can be meant [kg]: three times the mass of the arm, 3 t where that is not known.

        No industrial arm is rated for its own mass, and none for 3 t (FANUC M-2000iA/2300: 2.3 t at 11 t, unverified).
        """
        mass = sum(joint.mass for joint in self.joints)
        return 3.0 * mass if mass > 0 else 3000.0  # of the mass of the arm

    @property
    def n(self) -> int:
        """Number of joints; length of every joint vector q."""
        return len(self.joints)

    @property
    def links_have_shape(self) -> bool:
        """Whether the shape of most moving links is known; a tool or a base alone says nothing of the links."""
        shaped = {capsule.joint for capsule in self.shape} & set(self.joint_names)
        return len(shaped - set(self.bare_joints)) > len(self.bare_joints)

    def with_free(self, frames: Collection[str]) -> Robot:
        """The same robot with some of ``base`` and ``tool`` to be found from data, in addition to those that are
        already.
        """
        return replace(self, base_free=self.base_free or "base" in frames, tool_free=self.tool_free or "tool" in frames)

    @property
    def without_masses(self) -> Robot:
        """The same robot of whose links no mass is known."""
        unknown = (math.nan,) * 3
        return replace(self, joints=tuple(replace(joint, mass=math.nan, com=unknown) for joint in self.joints))

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        """All elementary transforms from the world to the tool point, in the order of their product."""
        return (*self.base, *(f for link in self.links for f in link), *self.tool)

    def link_words(self, joint: str) -> str:
        """The link that moves with a joint, by the joints at both of its ends."""
        names = self.joint_names
        last = names.index(joint) + 1 if joint in names else len(names)
        return f"link from {joint} to {names[last]}" if last < len(names) else f"link behind {joint}"

    @property
    def joint_names(self) -> tuple[str, ...]:
        """(n,) from the base to the tool."""
        return tuple(joint.name for joint in self.joints)

    @property
    def parameters(self) -> dict[str, Factor]:
        """Name of each model parameter -> the one factor that it adds to, from the base to the tool."""
        return {factor.parameter: factor for factor in self.factors if factor.parameter}

    @property
    def lower(self) -> tuple[float, ...]:
        """(n,) lower limits of the joints [rad or m]."""
        return tuple(joint.lower for joint in self.joints)

    @property
    def upper(self) -> tuple[float, ...]:
        """(n,) upper limits of the joints [rad or m]."""
        return tuple(joint.upper for joint in self.joints)

    @property
    def velocities(self) -> tuple[float, ...]:
        """(n,) largest speeds of the joints [rad/s or m/s]; NaN where unknown."""
        return tuple(joint.velocity for joint in self.joints)

    @property
    def length(self) -> float:
        """Sum of all fixed lengths of links and tool [m], without strokes: a bound on the reach of an arm that only
        turns.
        """
        return sum(abs(f.nominal) for link in (*self.links, self.tool) for f in link if f.kind == "translate")

    @cached_property
    def driven(self) -> tuple[int, ...]:
        """(n,) index into ``factors`` of the factor that carries each joint variable."""
        at = {factor.joint: i for i, factor in enumerate(self.factors) if factor.joint is not None}
        return tuple(at[joint] for joint in range(self.n))


def frame_factors(prefix: str, xyz: tuple[float, ...], rpy: tuple[float, ...]) -> tuple[Factor, ...]:
    """The factors of a fixed frame, ``T = Trans(x, y, z) Rz(yaw) Ry(pitch) Rx(roll)`` (URDF's convention). prefix: of
    the parameter names: ``base`` gives ``base.x`` … ``base.yaw``; xyz: (3,) origin [m] in the frame in front; rpy: (3,)
    roll, pitch, yaw [rad], about fixed axes in this order."""
    roll, pitch, yaw = rpy
    return (
        Factor("translate", 0, xyz[0], f"{prefix}.x"),
        Factor("translate", 1, xyz[1], f"{prefix}.y"),
        Factor("translate", 2, xyz[2], f"{prefix}.z"),
        Factor("rotate", 2, yaw, f"{prefix}.yaw"),
        Factor("rotate", 1, pitch, f"{prefix}.pitch"),
        Factor("rotate", 0, roll, f"{prefix}.roll"),
    )


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
