"""What a URDF file describes: links, the joints between them, and the masses of the links."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from posture_opt.errors import InputError, Issue, one_of
from posture_opt.numerics import Array


@dataclass(frozen=True)
class UrdfJoint:
    """A joint as it stands in the file.

    Args:
        origin: (4, 4) T_parent_joint, lengths in [m]; ``rpy`` (3,) the angles that the file states for it [rad], which
            the matrix does not tell at a pitch of ±90°.
        axis: (3,) in the joint frame.
        lower, upper: [rad] or [m]; None where the file has none.
        mimics: the joint that this one follows, or an empty text.
        line: where in the file it begins.
    """

    name: str
    type: str
    parent: str
    child: str
    origin: Array
    rpy: tuple[float, float, float]
    axis: Array
    lower: float | None
    upper: float | None
    mimics: str
    line: int


@dataclass(frozen=True)
class Inertial:
    """Mass [kg] and centre of mass (3,) [m] of a link, in the link's frame."""

    mass: float
    com: Array


@dataclass(frozen=True)
class Collision:
    """One ``<collision>`` of a link.

    Args:
        kind: ``size`` is the edges of a box (3,), radius and length of a cylinder or a capsule, the radius of a sphere
            [m], or the scale of the mesh in ``file``, along three axes.
        origin: (4, 4) T_link_collision.
    """

    kind: Literal["box", "cylinder", "capsule", "sphere", "mesh"]
    size: tuple[float, ...]
    origin: Array
    file: str = ""


@dataclass(frozen=True)
class UrdfTree:
    """Links and joints of a file; without ``faults`` every link but the roots hangs on one joint."""

    name: str
    links: tuple[str, ...]
    joints: tuple[UrdfJoint, ...]
    inertials: dict[str, Inertial]
    collisions: dict[str, tuple[Collision, ...]]

    def roots(self) -> list[str]:
        """The links that no joint carries."""
        children = {joint.child for joint in self.joints}
        return [link for link in self.links if link not in children]

    def leaves(self, base: str) -> list[str]:
        """The links behind ``base`` that carry no joint."""
        found, open_links = [], [base]
        while open_links:
            link = open_links.pop()
            below = self.below(link)
            open_links += [joint.child for joint in below]
            found += [] if below else [link]
        return sorted(found)

    def below(self, link: str) -> list[UrdfJoint]:
        """The joints that ``link`` carries."""
        return self._carried.get(link, [])

    @cached_property
    def _carried(self) -> dict[str, list[UrdfJoint]]:
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
        """The joints from ``base`` to ``tip``; empty where the tip does not hang on the base."""
        above = {joint.child: joint for joint in self.joints}
        joints: list[UrdfJoint] = []
        link = tip
        while link != base and link in above and len(joints) < len(self.joints):
            joints.insert(0, above[link])
            link = above[link].parent
        return joints if link == base else []

    def require(self, link: str, key: str) -> None:
        """InputError with the nearest name where the file has no such link."""
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
        for name in _twice(self.links):
            yield Issue(f"two links are named '{name}'", hint="rename one, and the joints that mean it")
        for name in _twice(joint.name for joint in self.joints):
            yield Issue(f"two joints are named '{name}'", hint="rename one")
        carrying = {joint.child: joint for joint in self.joints}
        for name in _twice(joint.child for joint in self.joints):
            message = f"link '{name}' hangs on two joints, one of them '{carrying[name].name}'"
            yield Issue(message, hint="cut the closed loop: a serial arm has none", line=carrying[name].line)
        if len(carrying) == len(self.joints):
            yield from self._loops()

    def _loops(self) -> Iterator[Issue]:
        """Where no link hangs on two joints, what no root carries goes round in closed loops."""
        reached, open_links = set(), self.roots()
        while open_links:
            link = open_links.pop()
            reached.add(link)
            open_links += [joint.child for joint in self.below(link) if joint.child not in reached]
        if looped := [joint for joint in self.joints if joint.child not in reached]:
            message = f"the joints form a closed loop, '{looped[0].name}' among them"
            yield Issue(message, hint="cut it: a serial arm has none", line=looped[0].line)


def _twice(names: Iterable[str]) -> list[str]:
    return sorted(name for name, count in Counter(names).items() if count > 1)
