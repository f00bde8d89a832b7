"""What a URDF describes: links with their masses, joints between them, and which link carries the tool."""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from posture_opt.errors import InputError, Issue, listed, one_of
from posture_opt.numerics import Array


@dataclass(frozen=True)
class UrdfJoint:
    name: str  # name, type: as written; type is not checked here
    type: str
    parent: str  # parent, child: names of the two links
    child: str
    # (4, 4) T_parent_joint, lengths in [m]; rpy (3,) the angles that the file states for it [rad], which cannot be
    # recovered from the matrix at a pitch of ±90°
    origin: Array
    rpy: tuple[float, float, float]
    axis: Array  # (3,) in the joint frame, of any length
    # lower, upper: [rad] or [m]; velocity [rad/s] or [m/s]; effort [N m] or [N]; None where the file has none
    lower: float | None
    upper: float | None
    velocity: float | None
    effort: float | None
    mimics: str  # the joint that this one follows, or an empty text
    follows: tuple[float, float]  # multiplier and offset [rad or m] of what it follows
    soft: tuple[float, float]  # what its controller allows of these limits; infinite where the file has nothing
    rising: float | None  # where its reference switch is, which some calibrations write their offset into
    line: int  # where in the file it begins

    def fixed_at_zero(self) -> UrdfJoint:
        """A fixed joint at the offset of its ``<mimic>``: ``origin · Trans(u v)`` or ``origin · Rot(u, v)``."""
        from scipy.spatial.transform import Rotation

        T, by = np.eye(4), self.follows[1] * self.axis / (np.linalg.norm(self.axis) or 1.0)
        if self.type == "prismatic":
            T[:3, 3] = by
        else:
            T[:3, :3] = Rotation.from_rotvec(by).as_matrix()
        return replace(self, type="fixed", origin=self.origin @ T)


@dataclass(frozen=True)
class Inertial:
    """Mass and centre of mass of a link; moments of inertia are not read, as nothing here is dynamic."""

    mass: float  # [kg]
    com: Array  # (3,) [m], frame of the link


@dataclass(frozen=True)
class Collision:
    """One ``<collision>`` of a link."""

    # size is the edges of a box (3,), radius and length of a cylinder or a capsule, the radius of a sphere [m], or the
    # scale of the mesh in file, along three axes
    kind: Literal["box", "cylinder", "capsule", "sphere", "mesh"]
    size: tuple[float, ...]
    origin: Array  # (4, 4) T_link_collision, lengths in [m]
    file: str = ""  # name of the mesh as written in the URDF; empty of other kinds


@dataclass(frozen=True)
class UrdfTree:
    """Links and joints of a file; without ``faults`` every link but the roots is the child of one joint."""

    name: str  # of the robot
    links: tuple[str, ...]  # in the order of the file; joints: likewise
    joints: tuple[UrdfJoint, ...]
    inertials: dict[str, Inertial]  # link -> its mass; links without one are missing
    collisions: dict[str, tuple[Collision, ...]]  # link -> its bodies

    def roots(self) -> list[str]:
        """The links that no joint carries."""
        children = {joint.child for joint in self.joints}
        return [link for link in self.links if link not in children]

    def leaves(self, base: str, without: Container[str] = ()) -> list[str]:
        """The links behind ``base`` that carry no joint but those named in ``without``."""
        found, open_links = [], [base]
        while open_links:
            link = open_links.pop()
            below = [joint.child for joint in self.below(link) if joint.name not in without]
            open_links += below
            found += [] if below else [link]
        return sorted(found)

    def below(self, link: str) -> list[UrdfJoint]:
        """The joints that ``link`` carries."""
        return self._carried_joints.get(link, [])

    def behind(self, link: str) -> Iterator[UrdfJoint]:
        """All joints behind ``link``."""
        open_links = [link]
        while open_links:
            below = self.below(open_links.pop())
            yield from below
            open_links += [joint.child for joint in below]

    @cached_property
    def _carried_joints(self) -> dict[str, list[UrdfJoint]]:
        carried: dict[str, list[UrdfJoint]] = defaultdict(list)
        for joint in self.joints:
            carried[joint.parent].append(joint)
        return dict(carried)

    def rigid(self, link: str) -> list[tuple[str, Array]]:
        """``link`` and every link fixed to it behind, each with its (4, 4) T_link_other."""
        found: list[tuple[str, Array]] = []
        open_links = [(link, np.eye(4))]
        while open_links:
            name, T = open_links.pop()
            found.append((name, T))
            open_links += [(joint.child, T @ joint.origin) for joint in self.below(name) if joint.type == "fixed"]
        return found

    def path(self, base: str, tip: str) -> list[UrdfJoint]:
        """The joints from ``base`` to ``tip``; empty where the tip is not behind the base."""
        above = {joint.child: joint for joint in self.joints}
        joints: list[UrdfJoint] = []
        link = tip
        while link != base and link in above and len(joints) < len(self.joints):
            joints.insert(0, above[link])
            link = above[link].parent
        return joints if link == base else []

    def moving(self, base: str, tip: str) -> list[UrdfJoint]:
        """The joints of `path` that move."""
        return [joint for joint in self.path(base, tip) if joint.type != "fixed"]

    def with_held(self, path: list[UrdfJoint]) -> UrdfTree:
        """Joints of a path that mimic one outside of it are fixed where they are while that one is at zero."""
        driven = {joint.name for joint in path}
        held = {joint.name for joint in path if joint.mimics and joint.mimics not in driven}
        return replace(self, joints=tuple(j.fixed_at_zero() if j.name in held else j for j in self.joints))

    def require(self, link: str, key: str) -> None:
        """Refuse a link that the file does not have."""
        if link not in self.links:
            raise InputError(Issue("the URDF has no such link", (key,), link, one_of(link, self.links, "links")))

    def faults(self) -> Iterator[Issue]:
        """What keeps links and joints from being trees, each with its line where one joint is to blame."""
        if not self.links:
            yield Issue("the file has no <link>", hint="name a URDF file")
        known = set(self.links)
        for joint in self.joints:
            for end in (joint.parent, joint.child):
                if end not in known:
                    message = f"joint '{joint.name}' names a link '{end}' that the file does not have"
                    yield Issue(message, hint=one_of(end, self.links, "links"), line=joint.line)
        for name in _doubled_names(self.links):
            yield Issue(f"two links are named '{name}'", hint="rename one, and the joints that mean it")
        for name in _doubled_names(joint.name for joint in self.joints):
            yield Issue(f"two joints are named '{name}'", hint="rename one")
        carrying = {joint.child: joint for joint in self.joints}
        for name in _doubled_names(joint.child for joint in self.joints):
            message = f"link '{name}' is the child of two joints, one of them '{carrying[name].name}'"
            yield Issue(message, hint="cut the closed loop: a serial arm has none", line=carrying[name].line)
        if len(carrying) == len(self.joints):
            reached = {joint.name for root in self.roots() for joint in self.behind(root)}
            if looped := [joint for joint in self.joints if joint.name not in reached]:
                message = f"the joints form a closed loop, '{looped[0].name}' among them"
                yield Issue(message, hint="cut it: a serial arm has none", line=looped[0].line)


def _doubled_names(names: Iterable[str]) -> list[str]:
    return sorted(name for name, count in Counter(names).items() if count > 1)


_FINGER_NAME = re.compile(r"finger|grip|jaw|knuckle|claw|thumb", re.IGNORECASE)
_WRIST_NAME = re.compile(r"roll|rotat|wrist|pitch|yaw|tilt", re.IGNORECASE)  # it may be named after what it turns
_TOOL_NAME = re.compile(r"(^|_)(tool|tcp|eef?|end_effector|flange)(_link|_frame)?$", re.IGNORECASE)


@dataclass(frozen=True)
class ChosenTip:
    """The end of a chain that the file leaves open."""

    link: str
    fingers: tuple[tuple[str, str], ...] = ()  # joints of a gripper behind it that are no part of the chain, and why
    others: tuple[str, ...] = ()  # further links that the chain could end at

    def notes(self) -> tuple[str, ...]:
        if not self.fingers:
            return ()
        joints = listed([f"{joint} ({why})" for joint, why in self.fingers])
        moved = "is taken for a finger" if len(self.fingers) == 1 else "are taken for fingers"
        return (f"the chain ends at {self.link}: {joints} {moved} of a gripper; tip_link names another end",)


def chosen_tip(tree: UrdfTree, base: str) -> ChosenTip:
    """The last link behind ``base`` that carries no finger: the only one, else ``tool0``, ROS-Industrial's name of the
    tool flange, else the only one that is named after a tool."""
    fingers = _Fingers(tree, base)
    reasons = fingers.reasons()
    carried = {joint.child for joint in tree.joints if joint.name in reasons}
    first = [j for j in fingers.moving if j.name in reasons and not fingers.links_before(j) & carried]
    leaves = tree.leaves(base, reasons)
    moved = [leaf for leaf in leaves if tree.moving(base, leaf)] or leaves
    tools = [leaf for leaf in moved if _TOOL_NAME.search(leaf)]
    for options in (leaves, [leaf for leaf in leaves if leaf == "tool0"], moved, tools):
        if len(options) == 1:
            link = options[0]
            ends = dict.fromkeys((*moved, *tree.leaves(base)))
            others = tuple(leaf for leaf in ends if leaf != link and tree.moving(base, leaf))
            return ChosenTip(link, tuple((joint.name, reasons[joint.name]) for joint in first), others)
    message = f"the URDF has {len(moved)} last links behind '{base}'"
    options_text = listed(_tip_options(tree, base), 12)  # hands have more leaves than a reader compares
    raise InputError(Issue(message, ("tip_link",), None, f"name one: tip_link: {options_text}"))


def _tip_options(tree: UrdfTree, base: str) -> list[str]:
    """The links that may be meant, each with its chain in words: tool frames, then what carries fingers, then these."""
    paths = {leaf: tree.path(base, leaf) for leaf in tree.leaves(base)}
    fixed = [leaf for leaf, path in paths.items() if path and path[-1].type == "fixed"]
    moving = [leaf for leaf in paths if leaf not in fixed]
    carriers = {leaf: [base, *(joint.parent for joint in tree.moving(base, leaf))][-1] for leaf in moving}
    between = [link for link in dict.fromkeys(carriers.values()) if link != base and link not in paths]
    words: dict[str, str] = {}
    for link in (*paths, *between):
        joints = tree.moving(base, link)
        words[link] = f"{len(joints)} {'joint' if len(joints) == 1 else 'joints'}"
        if mimics := [joint.name for joint in joints if joint.mimics]:
            words[link] += f", not possible: {mimics[0]} mimics another"
        if link in between:
            words[link] += f", carries {', '.join(leaf for leaf in moving if carriers[leaf] == link)}"
    return [f"{link} ({words[link]})" for link in (*fixed, *between, *moving)]


@dataclass(frozen=True)
class _Fingers:
    """The joints behind ``base`` that move fingers, or fix one.

    A joint is one where all that moves behind it are fingers too, and

    - its name is that of a finger, ``left_jaw``, and that of the first joint is not, or
    - the link that carries it carries another of the same type, range and number of joints behind, fewer than the arm
      has in front, or
    - it mimics a finger, or a finger mimics it, or
    - it is the last of at least four moving joints, and slides by at most 80 mm.
    """

    tree: UrdfTree
    base: str

    def reasons(self) -> dict[str, str]:
        """Joint name -> reason."""
        found: dict[str, str] = {}
        while added := {name: why for name, why in self._next(found) if name not in found}:
            found |= added
        return found

    def links_before(self, joint: UrdfJoint) -> set[str]:
        return {self.base, *(before.child for before in self.tree.path(self.base, joint.parent))}

    def _before(self, joint: UrdfJoint) -> list[UrdfJoint]:
        return self.tree.moving(self.base, joint.parent)

    @cached_property
    def moving(self) -> tuple[UrdfJoint, ...]:
        return tuple(joint for joint in self.tree.behind(self.base) if joint.type != "fixed")

    @cached_property
    def _behind(self) -> dict[str, list[UrdfJoint]]:
        behind: dict[str, list[UrdfJoint]] = {joint.name: [] for joint in self.moving}
        for joint in self.moving:
            for before in self._before(joint):
                behind[before.name].append(joint)
        return behind

    @cached_property
    def _alike(self) -> frozenset[str]:
        """Joints of which another like them is on the same rigid body of the arm."""
        groups: dict[tuple[str, str, int], list[UrdfJoint]] = defaultdict(list)
        for joint in self.moving:
            body = [self.base, *(before.child for before in self._before(joint))][-1]
            groups[(body, joint.type, len(self._behind[joint.name]))].append(joint)
        return frozenset(
            joint.name
            for (_, _, behind), group in groups.items()
            for joint in group
            if sum(_same_range(joint, other) for other in group) > 1 and behind + 1 < len(self._before(joint))
        )

    def _named(self, joint: UrdfJoint) -> bool:
        before = self._before(joint)
        return bool(before) and _finger_named(joint.name) and not _finger_named(before[0].name)

    def _next(self, found: Mapping[str, str]) -> Iterator[tuple[str, str]]:
        """Joints that are fingers given those ``found``, each with the reason."""
        masters = {joint.mimics for joint in self.moving if joint.name in found and joint.mimics}
        for joint in self.moving:
            behind, before = self._behind[joint.name], len(self._before(joint))
            if joint.name in self._alike:
                yield from ((one.name, "beside another like it on the same link") for one in (joint, *behind))
            if any(other.name not in found for other in behind) or not before:
                continue
            # Franka hand 40 mm, WSG 50 55 mm; quills of SCARA robots and linear axes have 100 mm or more.
            short = joint.type == "prismatic" and _range(joint) <= 0.08
            if self._named(joint):
                yield joint.name, "by its name"
            elif joint.mimics in found or joint.name in masters:
                yield joint.name, "coupled with a finger by <mimic>"
            elif not behind and short and before >= 3:  # so many give the arm its position
                yield joint.name, "a slide with a short stroke at the end"
        for joint in self.tree.joints:  # of grippers that are drawn closed
            if joint.type == "fixed" and "finger" in joint.name.lower() and self._named(joint):
                yield joint.name, "by its name"


def _finger_named(name: str) -> bool:
    return bool(_FINGER_NAME.search(name)) and not _WRIST_NAME.search(name)


def _range(joint: UrdfJoint) -> float:
    """How far the joint moves [rad or m]; infinite where it has no limits."""
    return math.inf if joint.lower is None or joint.upper is None else abs(joint.upper - joint.lower)


def _same_range(one: UrdfJoint, other: UrdfJoint) -> bool:
    a, b = _range(one), _range(other)
    return a == b or abs(a - b) <= 0.01 * min(a, b)
