"""The chain of a URDF between two links in numbers: its joints as segments, their transforms, and an SRDF's states."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product
from pathlib import Path
from typing import Literal

import numpy as np

from posture_opt.errors import BadValueError, InputError, Issue, listed
from posture_opt.files import content, located
from posture_opt.limits import MAX_URDF_BYTES, MOST_JOINTS
from posture_opt.numerics import TURN, Array
from posture_opt.robot.corrections import with_velocities
from posture_opt.robot.format import FULL_TURN, RobotFormat, check_joint_name
from posture_opt.robot.robot import BASE, Axis, Factor, Joint, Robot, UrdfDescription, frame_factors, xyz_rpy
from posture_opt.robot.shape_section import replaces_shape, shaped
from posture_opt.robot.urdf_reader import MAX_NUMBER, Element, in_urdf, read_elements, read_urdf
from posture_opt.robot.urdf_shape import Carried, UrdfShape, urdf_shape
from posture_opt.robot.urdf_tree import ChosenTip, UrdfJoint, UrdfTree, chosen_tip
from posture_opt.texts import number_or_nan, text_fault

# Types of URDF joints with one variable; continuous is a revolute joint without limits
_MOVING_TYPES = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class UrdfChain:
    """The chain that a section of a problem file names: the URDF, its ends and the SRDF where they are given."""

    folder: Path  # from which the files are named
    file: str
    base_link: str | None
    tip_link: str | None
    srdf: str | None

    def robot(self, section: RobotFormat) -> Robot:
        """The chain in numbers, with the shape and the velocities that a section states."""
        file, tree = self._path, self.tree.with_held(self._joints())
        path = tree.path(self.base, self.tip.link)
        if issues := [*_chain_faults(path)]:
            raise InputError([in_urdf(issue, file) for issue in issues])
        segments = segments_of(path)
        links = tuple(link_factors(segment, index) for index, segment in enumerate(segments))
        joints = tuple(_joint_of(tree, segment) for segment in segments)
        robot = section.bare(tree.name, joints, links)
        notes = (*self.tip.notes(), *_notes(path, robot.length))
        # Stated in the child link of the last joint, counted from the tip.
        end = np.linalg.inv(segments[-1].T_child_end).astype(np.float64)
        if not replaces_shape(section.shape):
            own = _own_shape(tree, path[0].parent, segments, end, file)
            robot = replace(robot, **own._asdict())
        robot = with_velocities(shaped(robot, section.shape, end), section.velocity)
        ends = path[0].parent, path[-1].child
        sources = (("file", self.file), ("base_link", ends[0]), ("tip_link", ends[1]))
        description = UrdfDescription(content(file, MAX_URDF_BYTES), *ends)
        robot = replace(robot, sources=sources, notes=notes, description=description)
        if self.srdf is None:
            return robot
        found = read_srdf(self.folder, self.srdf, tree)
        bodies = {BASE: ends[0], **{segment.moving.name: segment.moving.child for segment in segments}}
        carried = {j: [name for name, _ in tree.rigid(link) if tree.collisions.get(name)] for j, link in bodies.items()}
        allowed, postures = found.allowed_pairs(carried), found.postures(robot.joint_names)
        return replace(robot, allowed_collisions=allowed, named_postures=postures)

    @cached_property
    def _path(self) -> Path:
        try:
            return located(self.folder, self.file)
        except InputError as error:
            raise InputError([issue.at("file") for issue in error.issues]) from None

    @cached_property
    def tree(self) -> UrdfTree:
        return read_urdf(self._path)

    @cached_property
    def base(self) -> str:
        roots = self.tree.roots()
        if not self.base_link and len(roots) != 1:
            message = f"the URDF has {len(roots)} root links, the file falls apart"
            raise InputError(Issue(message, ("base_link",), None, f"name one: base_link: {listed(roots)}"))
        base = self.base_link or roots[0]
        self.tree.require(base, "base_link")
        return base

    @cached_property
    def tip(self) -> ChosenTip:
        """The last link; where it is not named, with what was assumed."""
        tip = ChosenTip(self.tip_link) if self.tip_link else chosen_tip(self.tree, self.base)
        self.tree.require(tip.link, "tip_link")
        return tip

    def _joints(self) -> list[UrdfJoint]:
        tip, base = self.tip.link, self.base
        path = self.tree.path(base, tip)
        if not path and tip == base:
            raise InputError(Issue(f"no joint is attached to '{base}'", ("file",), None, "choose another base_link"))
        if not path:
            below = listed(self.tree.leaves(base))
            message = f"there is no chain from '{base}' to '{tip}'"
            raise InputError(Issue(message, ("tip_link",), tip, f"behind '{base}' are: {below}"))
        return path


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


def _own_shape(tree: UrdfTree, base_link: str, segments: Sequence[ChainSegment], end: Array, file: Path) -> UrdfShape:
    """The shape of the file's ``<collision>`` elements, capsules in the frame behind each joint.

    Behind the last joint that is the flange: ``end`` (4, 4) is the child link of that joint in it, lengths in [m].
    """
    frames = [np.eye(4)] * (len(segments) - 1) + [end]
    links = [Carried(s.moving.name, s.moving.child, T) for s, T in zip(segments, frames, strict=True)]
    return urdf_shape(tree, (Carried(BASE, base_link, np.eye(4)), *links), file)


def _chain_faults(path: list[UrdfJoint]) -> Iterator[Issue]:
    moving = [joint for joint in path if joint.type != "fixed"]
    for joint in moving:
        try:
            _check_joint(joint)
        except BadValueError as error:
            yield replace(error.issue(()), line=joint.line)
    if not moving:
        message = f"no joint moves between '{path[0].parent}' and '{path[-1].child}'"
        yield Issue(message, hint="choose another tip_link or base_link")
    if len(moving) > MOST_JOINTS.most:
        yield Issue(MOST_JOINTS.message(len(moving)), hint="choose a tip_link nearer to the base_link")


def _check_joint(joint: UrdfJoint) -> None:
    name, chain = f"joint '{joint.name}'", f"only {', '.join(_MOVING_TYPES)} and fixed joints can be in the chain"
    if joint.mimics:
        ratio, offset = joint.follows
        unit = "m" if joint.type == "prismatic" else "rad"
        pair = f"joint: {joint.name}, follows: {joint.mimics}"
        coupling = f"effects: [{{kind: joint_coupling, {pair}, estimate: {{ratio: {ratio:g}}}}}]"
        lines = f"{coupling} and subject_to: [{{kind: fixed_joints, values: {{{joint.name}: {offset:g} {unit}}}}}]"
        message = f"{name} mimics '{joint.mimics}': coupled joints cannot be in the chain"
        raise BadValueError(message, f"choose another tip_link, or delete its <mimic> and write {lines}")
    if joint.type not in _MOVING_TYPES:
        raise BadValueError(f"{name} {f'is {joint.type}' if joint.type else 'has no type'}", chain)
    check_joint_name(joint.name)
    if not np.any(joint.axis):
        raise BadValueError(f"{name} has an axis of length zero", 'write for example <axis xyz="0 0 1"/>')
    if joint.type == "prismatic" and (joint.lower is None or joint.upper is None):
        raise BadValueError(f"{name} is prismatic and has no limits", 'write <limit lower="0" upper="0.2" …/>')
    lower, upper = _joint_limits(joint)
    if not lower < upper:
        message = f"{name} has crossed limits or no range: {lower:g} to {upper:g}"
        raise BadValueError(message, "write lower < upper")


def _joint_limits(joint: UrdfJoint) -> tuple[float, float]:
    """(lower, upper) [rad or m] that the controller allows; a whole turn either way where the file has no limit for a
    joint that turns."""
    lower, upper = joint.lower, joint.upper
    if lower is None or upper is None or (joint.type == "continuous" and not lower < upper):
        return FULL_TURN  # many files write lower="0" upper="0" for a continuous joint
    soft = max(lower, joint.soft[0]), min(upper, joint.soft[1])
    return soft if soft[0] < soft[1] else (lower, upper)


def _notes(path: list[UrdfJoint], length: float) -> Iterator[str]:
    """What was assumed of a chain, and what no arm has: numbers in another unit than URDF's m and rad."""
    soft = []
    for joint in path:
        limits = _joint_limits(joint)
        if joint.type == "fixed" and joint.mimics:
            yield f"joint {joint.name} mimics {joint.mimics}, which is not in the chain: held at {joint.follows[1]:g}"
        if any(abs(angle) > TURN for angle in joint.rpy):
            yield f"joint {joint.name} is turned by rpy {' '.join(f'{v:g}' for v in joint.rpy)} rad: are these degrees?"
        if joint.type == "revolute" and joint.lower is None:
            yield f"joint {joint.name} has no <limit>: a turn either way is taken"
        elif joint.type == "revolute" and max(map(abs, limits)) > 4 * TURN:
            yield f"joint {joint.name} turns from {limits[0]:g} to {limits[1]:g} rad: are these degrees?"
        elif joint.type != "fixed" and limits != FULL_TURN and limits != (joint.lower, joint.upper):
            soft.append(joint.name)
        if joint.type != "fixed" and joint.rising:
            yield f"<calibration> of joint {joint.name} is not used; write an offset as corrections: {joint.name}.theta"
    if soft:
        yield f"limits in <safety_controller> hold for {listed(soft)}"
    if length > 20:  # m; the largest arms have 5
        yield f"the links are {length:.0f} m long: is the file in mm?"


def _joint_of(tree: UrdfTree, segment: ChainSegment) -> Joint:
    """The joint with the mass [kg] of all that is fixed to its child link and their common centre (3,) [m]. ``com = Σ
    m_i c_i / Σ m_i``, in the frame behind the segment."""
    moving = segment.moving
    T_child_end = segment.T_child_end
    bodies = [(tree.inertials[link], T) for link, T in tree.rigid(moving.child) if link in tree.inertials]
    mass, com = math.nan, (math.nan, math.nan, math.nan)
    if bodies:
        mass = sum(body.mass for body, _ in bodies)
        moment = sum((body.mass * (T[:3, :3] @ body.com + T[:3, 3]) for body, T in bodies), np.zeros(3))
        centre = moment / (mass or 1.0)
        x, y, z = (T_child_end[:3, :3].T @ (centre - T_child_end[:3, 3])).tolist()
        com = (x, y, z)
    kind: Literal["revolute", "prismatic"] = "prismatic" if moving.type == "prismatic" else "revolute"
    # Zero stands for unknown in many files.
    velocity, effort = (limit if limit and limit > 0 else math.nan for limit in (moving.velocity, moving.effort))
    return Joint(moving.name, kind, *_joint_limits(moving), mass, com, velocity=velocity, effort=effort)


_FREE_JOINTS = ("floating", "planar")  # Types of joints with several values, as of a base that drives: never in a chain


@dataclass(frozen=True)
class Srdf:
    """Pairs of links and named postures of an SRDF (MoveIt, "URDF and SRDF": disable_collisions, group_state)."""

    disabled: frozenset[frozenset[str]]  # pairs of links whose collisions are not checked
    states: dict[str, dict[str, float]]  # name -> joint -> value [rad or m]

    def allowed_pairs(self, carried: dict[str, list[str]]) -> frozenset[frozenset[str]]:
        """Pairs of joints of which no links are checked against each other, by the links with a shape that each
        carries."""
        shaped = {joint: links for joint, links in carried.items() if links}
        return frozenset(
            frozenset(pair)
            for pair in combinations(shaped, 2)
            if all(frozenset(links) in self.disabled for links in product(*(shaped[joint] for joint in pair)))
        )

    def postures(self, joints: tuple[str, ...]) -> tuple[tuple[str, tuple[tuple[str, float], ...]], ...]:
        """The named postures of some joints; states of other joints alone, of a gripper say, are left out."""
        found = (
            (name, tuple((joint, values[joint]) for joint in joints if joint in values))
            for name, values in self.states.items()
        )
        return tuple((name, values) for name, values in found if values)


def read_srdf(folder: Path, file: str, tree: UrdfTree) -> Srdf:
    """The SRDF in ``file``, named from ``folder``, of the robot of a URDF."""
    try:
        path = located(folder, file)
        root = read_elements(content(path, MAX_URDF_BYTES))[0]
        if root.tag != "robot":
            raise InputError(Issue(f"the file is no SRDF: it begins with <{root.tag}>, not <robot>", line=root.line))
        pairs = (frozenset(_text(e, key) for key in ("link1", "link2")) for e in root.each("disable_collisions"))
        disabled = frozenset(pair for pair in pairs if len(pair) == 2)
        named = {link for pair in disabled for link in pair}
        if named and not named & {*tree.links}:
            raise InputError(Issue("none of its links is in the URDF", hint="is it that of another robot?"))
        return Srdf(disabled, _states(root, {joint.name for joint in tree.joints if joint.type not in _FREE_JOINTS}))
    except InputError as error:
        lines = [f"line {issue.line}: " if issue.line else "" for issue in error.issues]
        raise InputError([
            Issue(f"{line}{issue.message}", ("srdf",), file, issue.hint)
            for line, issue in zip(lines, error.issues, strict=True)
        ]) from None  # fmt: skip


def _states(root: Element, single: set[str]) -> dict[str, dict[str, float]]:
    """The named states; of several of one name, in several groups, the one with most joints. Values of joints with
    several degrees of freedom, which are none of the ``single`` ones, are left out."""
    found: dict[str, dict[str, float]] = {}
    stated: set[tuple[str, str]] = set()
    for state in root.each("group_state"):
        name, group = _text(state, "name"), _text(state, "group")
        if (name, group) in stated:
            raise InputError(Issue(f"the state '{name}' of the group '{group}' is stated twice", line=state.line))
        stated.add((name, group))
        values: dict[str, float] = {}
        for joint in state.each("joint"):
            moved = _text(joint, "name")
            if moved in values:
                raise InputError(Issue(f"the state '{name}' states the joint '{moved}' twice", line=joint.line))
            if moved in single or len(_text(joint, "value").split()) < 2:
                values[moved] = _value(joint)
        if len(values) > len(found.get(name, {})):
            found[name] = values
    return found


def _value(joint: Element) -> float:
    """The value [rad or m] of a joint in a state."""
    text = _text(joint, "value")
    value = number_or_nan(text)
    if not math.isfinite(value):
        raise InputError(Issue(f"the value '{text}' of a joint is no number", line=joint.line))
    if abs(value) > MAX_NUMBER:
        raise InputError(Issue(f"the value '{text}' of a joint is not plausible", line=joint.line))
    return value


def _text(element: Element, key: str) -> str:
    given = element.attributes.get(key, "")
    fault = text_fault(given)
    if fault is not None:
        raise InputError(Issue(f"<{element.tag} {key}=…>: {fault[0]}", hint=fault[1], line=element.line))
    return given
