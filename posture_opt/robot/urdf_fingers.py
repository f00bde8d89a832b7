"""Which joints of a URDF move the fingers of a gripper: they end the chain of the arm."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from posture_opt.robot.urdf_tree import UrdfJoint, UrdfTree

_FINGER_NAME = re.compile(r"finger|grip|jaw|knuckle|claw|thumb", re.IGNORECASE)
_WRIST_NAME = re.compile(r"roll|rotat|wrist|pitch|yaw|tilt", re.IGNORECASE)
"""A wrist joint may be named after the gripper that it turns."""
_MAX_FINGER_STROKE_M = 0.08
"""Stroke of a finger: Franka hand 40 mm, WSG 50 55 mm; quills of SCARA robots and linear axes have 100 mm or more."""
_MIN_ARM_JOINTS = 3
"""Moving joints in front of a finger that is known by nothing but its stroke: so many give the arm its position."""
_SAME_RANGE_RATIO = 0.01
"""Ranges of two fingers that are built alike differ by less."""

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
    reasons: Mapping[str, str] = field(init=False)
    """Name of each of these joints -> why it is one."""

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
        """All joints behind the base that move."""
        found, open_links = [], [self.base]
        while open_links:
            below = self.tree.below(open_links.pop())
            found += [joint for joint in below if joint.type != "fixed"]
            open_links += [joint.child for joint in below]
        return tuple(found)

    def _links_before(self, joint: UrdfJoint) -> set[str]:
        """The links from the base to the one that carries the joint."""
        return {self.base, *(before.child for before in self.tree.path(self.base, joint.parent))}

    def _arm_joints(self, joint: UrdfJoint) -> int:
        """Number of moving joints in front of a joint."""
        return sum(before.type != "fixed" for before in self.tree.path(self.base, joint.parent))

    @cached_property
    def _behind(self) -> dict[str, tuple[UrdfJoint, ...]]:
        """Name of each moving joint -> the moving joints behind it."""
        behind: dict[str, list[UrdfJoint]] = {joint.name: [] for joint in self._moving}
        for joint in self._moving:
            for before in self.tree.path(self.base, joint.parent):
                if before.type != "fixed":
                    behind[before.name].append(joint)
        return {name: tuple(joints) for name, joints in behind.items()}

    @cached_property
    def _alike(self) -> frozenset[str]:
        """Names of the joints of which another like them is on the same rigid body of the arm."""
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
        """Whether a joint is named after a finger, and the first one of the arm is not."""
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
    """Whether a name is that of a finger or a gripper, and not that of a wrist which turns one."""
    return bool(_FINGER_NAME.search(name)) and not _WRIST_NAME.search(name)


def _short_slide(joint: UrdfJoint) -> bool:
    """Whether the joint slides, and not far."""
    return joint.type == "prismatic" and _range(joint) <= _MAX_FINGER_STROKE_M


def _range(joint: UrdfJoint) -> float:
    """How far the joint moves [rad or m]; infinite where it has no limits."""
    return math.inf if joint.lower is None or joint.upper is None else abs(joint.upper - joint.lower)


def _same_range(one: UrdfJoint, other: UrdfJoint) -> bool:
    """Whether two joints move equally far."""
    a, b = _range(one), _range(other)
    return a == b or abs(a - b) <= _SAME_RANGE_RATIO * min(a, b)
