"""Which link of a URDF carries the tool, where the file leaves it open."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from posture_opt.errors import InputError, Issue, listed
from posture_opt.robot.urdf_tree import UrdfJoint, UrdfTree

_FINGER_NAME = re.compile(r"finger|grip|jaw|knuckle|claw|thumb", re.IGNORECASE)
# A wrist joint may be named after the gripper that it turns
_WRIST_NAME = re.compile(r"roll|rotat|wrist|pitch|yaw|tilt", re.IGNORECASE)
# Moving joints in front of a finger that is known by nothing but its stroke: so many give the arm its position
_MIN_ARM_JOINTS = 3

NAMED = "by its name"
ALIKE = "beside another like it on the same link"
COUPLED = "coupled with a finger by <mimic>"
SHORT = "a slide with a short stroke at the end"


@dataclass(frozen=True)
class Fingers:
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
    reasons: Mapping[str, str] = field(init=False)  # Name of each of these joints -> why it is one

    def __post_init__(self) -> None:
        found: dict[str, str] = {}
        while added := {name: why for name, why in self._next(found) if name not in found}:
            found |= added
        object.__setattr__(self, "reasons", found)

    def first(self) -> tuple[UrdfJoint, ...]:
        """The joints that move fingers and are carried by the arm, not by another finger."""
        carried = {joint.child for joint in self.tree.joints if joint.name in self.reasons}
        return tuple(j for j in self._moving if j.name in self.reasons and not self._links_before(j) & carried)

    def leaves(self) -> list[str]:
        """The last links behind the base without the fingers."""
        found, open_links = [], [self.base]
        while open_links:
            link = open_links.pop()
            below = [joint for joint in self.tree.below(link) if joint.name not in self.reasons]
            open_links += [joint.child for joint in below]
            found += [] if below else [link]
        return sorted(found)

    @cached_property
    def _moving(self) -> tuple[UrdfJoint, ...]:
        found, open_links = [], [self.base]
        while open_links:
            below = self.tree.below(open_links.pop())
            found += [joint for joint in below if joint.type != "fixed"]
            open_links += [joint.child for joint in below]
        return tuple(found)

    def _links_before(self, joint: UrdfJoint) -> set[str]:
        return {self.base, *(before.child for before in self.tree.path(self.base, joint.parent))}

    def _arm_joints(self, joint: UrdfJoint) -> int:
        return sum(before.type != "fixed" for before in self.tree.path(self.base, joint.parent))

    @cached_property
    def _behind(self) -> dict[str, tuple[UrdfJoint, ...]]:
        behind: dict[str, list[UrdfJoint]] = {joint.name: [] for joint in self._moving}
        for joint in self._moving:
            for before in self.tree.path(self.base, joint.parent):
                if before.type != "fixed":
                    behind[before.name].append(joint)
        return {name: tuple(joints) for name, joints in behind.items()}

    @cached_property
    def _alike(self) -> frozenset[str]:
        groups: dict[tuple[object, ...], list[UrdfJoint]] = defaultdict(list)
        for joint in self._moving:
            before = [link.child for link in self.tree.path(self.base, joint.parent) if link.type != "fixed"]
            body = before[-1] if before else self.base
            groups[(body, joint.type, len(self._behind[joint.name]))].append(joint)
        found = set()
        for group in groups.values():
            for joint in group:
                same = [other for other in group if _same_range(joint, other)]
                if len(same) > 1 and len(self._behind[joint.name]) + 1 < self._arm_joints(joint):
                    found.add(joint.name)
        return frozenset(found)

    def _named(self, joint: UrdfJoint) -> bool:
        moving = [before.name for before in self.tree.path(self.base, joint.parent) if before.type != "fixed"]
        return bool(moving) and _finger_named(joint.name) and not _finger_named(moving[0])

    def _next(self, found: Mapping[str, str]) -> Iterator[tuple[str, str]]:
        """Joints that are fingers, given those that are ``found`` to be; each with the reason."""
        masters = {joint.mimics for joint in self._moving if joint.name in found and joint.mimics}
        for joint in self._moving:
            behind = self._behind[joint.name]
            if joint.name in self._alike:
                yield joint.name, ALIKE
                yield from ((other.name, ALIKE) for other in behind)
            if any(other.name not in found for other in behind) or not self._arm_joints(joint):
                continue
            if self._named(joint):
                yield joint.name, NAMED
            elif joint.mimics in found or joint.name in masters:
                yield joint.name, COUPLED
            elif not behind and _short_slide(joint) and self._arm_joints(joint) >= _MIN_ARM_JOINTS:
                yield joint.name, SHORT
        for joint in self.tree.joints:  # of grippers that are drawn closed
            if joint.type == "fixed" and "finger" in joint.name.lower() and self._named(joint):
                yield joint.name, NAMED


def _finger_named(name: str) -> bool:
    return bool(_FINGER_NAME.search(name)) and not _WRIST_NAME.search(name)


def _short_slide(joint: UrdfJoint) -> bool:
    # Stroke of a finger: Franka hand 40 mm, WSG 50 55 mm; quills of SCARA robots and linear axes have 100 mm or more.
    return joint.type == "prismatic" and _range(joint) <= 0.08


def _range(joint: UrdfJoint) -> float:
    """How far the joint moves [rad or m]; infinite where it has no limits."""
    return math.inf if joint.lower is None or joint.upper is None else abs(joint.upper - joint.lower)


def _same_range(one: UrdfJoint, other: UrdfJoint) -> bool:
    a, b = _range(one), _range(other)
    return a == b or abs(a - b) <= 0.01 * min(a, b)  # ranges of two fingers that are built alike differ by less


FLANGE = "tool0"  # ROS-Industrial's name of the tool flange
_TOOL_NAME = re.compile(r"(^|_)(tool|tcp|eef?|end_effector|flange)(_link|_frame)?$", re.IGNORECASE)


@dataclass(frozen=True)
class ChosenTip:
    """The end of a chain that the file leaves open."""

    link: str  # the last link of the chain
    # joints that move fingers of a gripper behind it and are no part of the chain, each with the reason
    fingers: tuple[tuple[str, str], ...] = ()
    others: tuple[str, ...] = ()  # further links that the chain could end at

    def notes(self) -> tuple[str, ...]:
        if not self.fingers:
            return ()
        joints = listed([f"{joint} ({why})" for joint, why in self.fingers])
        moved = "is taken for a finger" if len(self.fingers) == 1 else "are taken for fingers"
        return (f"the chain ends at {self.link}: {joints} {moved} of a gripper; tip_link names another end",)


def chosen_tip(tree: UrdfTree, base: str) -> ChosenTip:
    """The last link behind ``base`` that carries no finger: the only one, else ``tool0``, else the only one that is
    named after a tool."""
    fingers = Fingers(tree, base)
    named = tuple((joint.name, fingers.reasons[joint.name]) for joint in fingers.first())
    leaves = fingers.leaves()
    moved = [leaf for leaf in leaves if _moves(tree, base, leaf)] or leaves
    tools = [leaf for leaf in moved if _TOOL_NAME.search(leaf)]
    for options in (leaves, [leaf for leaf in leaves if leaf == FLANGE], moved, tools):
        if len(options) == 1:
            link = options[0]
            ends = dict.fromkeys((*moved, *tree.leaves(base)))
            return ChosenTip(link, named, tuple(leaf for leaf in ends if leaf != link and _moves(tree, base, leaf)))
    message = f"the URDF has {len(moved)} last links behind '{base}'"
    # Links that a message lists; hands have more leaves than a reader compares.
    named_links = listed(_tip_options(tree, base), 12)
    raise InputError(Issue(message, ("tip_link",), None, f"name one: tip_link: {named_links}"))


def _moves(tree: UrdfTree, base: str, link: str) -> bool:
    """Whether a joint moves between ``base`` and ``link``."""
    return any(joint.type != "fixed" for joint in tree.path(base, link))


def _tip_options(tree: UrdfTree, base: str) -> list[str]:
    """The links that may be meant, each with its chain in words: tool frames, then what carries fingers, then these."""
    paths = {leaf: tree.path(base, leaf) for leaf in tree.leaves(base)}
    fixed = [leaf for leaf, path in paths.items() if path and path[-1].type == "fixed"]
    moving = [leaf for leaf in paths if leaf not in fixed]
    carriers = dict.fromkeys(_carrier_link(paths[leaf], base) for leaf in moving)
    between = [link for link in carriers if link != base and link not in paths]
    words = {leaf: _chain_words(path) for leaf, path in paths.items()}
    words |= {
        link: f"{_chain_words(tree.path(base, link))}, carries {_finger_links(paths, link, moving, base)}"
        for link in between
    }
    return [f"{link} ({words[link]})" for link in (*fixed, *between, *moving)]


def _carrier_link(path: list[UrdfJoint], base: str) -> str:
    """The parent link of the last moving joint of a path; ``base`` where none moves."""
    return next((joint.parent for joint in reversed(path) if joint.type != "fixed"), base)


def _finger_links(paths: dict[str, list[UrdfJoint]], link: str, moving: list[str], base: str) -> str:
    return ", ".join(leaf for leaf in moving if _carrier_link(paths[leaf], base) == link)


def _chain_words(path: list[UrdfJoint]) -> str:
    turning = [joint for joint in path if joint.type != "fixed"]
    mimics = [joint.name for joint in turning if joint.mimics]
    count = f"{len(turning)} {'joint' if len(turning) == 1 else 'joints'}"
    return f"{count}, not possible: {mimics[0]} mimics another" if mimics else count
