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
    """A joint as it is in the file.

    Args:
        name, type: as written; ``type`` is not checked here.
        parent, child: names of the two links.
        origin: (4, 4) T_parent_joint, lengths in [m]; ``rpy`` (3,) the angles that the file states for it [rad], which
            cannot be recovered from the matrix at a pitch of ±90°.
        axis: (3,) in the joint frame, of any length.
        lower, upper: [rad] or [m]; ``velocity`` [rad/s] or [m/s]; ``effort`` [N m] or [N]; None where the file has
            none.
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
    velocity: float | None
    effort: float | None
    mimics: str
    line: int


@dataclass(frozen=True)
class Inertial:
    """Mass and centre of mass of a link; moments of inertia are not read, as nothing here is dynamic.

    Args:
        mass: [kg].
        com: (3,) [m], frame of the link.
    """

    mass: float
    com: Array


@dataclass(frozen=True)
class Collision:
    """One ``<collision>`` of a link.

    Args:
        kind: ``size`` is the edges of a box (3,), radius and length of a cylinder or a capsule, the radius of a sphere
            [m], or the scale of the mesh in ``file``, along three axes.
        origin: (4, 4) T_link_collision, lengths in [m].
        file: name of the mesh as written in the URDF; empty of other kinds.
    """

    kind: Literal["box", "cylinder", "capsule", "sphere", "mesh"]
    size: tuple[float, ...]
    origin: Array
    file: str = ""


@dataclass(frozen=True)
class UrdfTree:
    """Links and joints of a file; without ``faults`` every link but the roots is the child of one joint.

    Args:
        name: of the robot.
        links: in the order of the file; ``joints``: likewise.
        inertials: link -> its mass; links without one are missing.
        collisions: link -> its bodies.
    """

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
        return self._carried_joints.get(link, [])

    @cached_property
    def _carried_joints(self) -> dict[str, list[UrdfJoint]]:
        """Link -> the joints of which it is the parent."""
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

    def require(self, link: str, key: str) -> None:
        """Refuse a link that the file does not have.

        Raises:
            InputError: with the nearest name, under ``key`` of the robot's section.
        """
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
            yield from self._closed_loops()

    def _closed_loops(self) -> Iterator[Issue]:
        """An issue where links are not connected to a root: then their joints form closed loops.

        Only asked where every link is the child of at most one joint.
        """
        reached, open_links = set(), self.roots()
        while open_links:
            link = open_links.pop()
            reached.add(link)
            open_links += [joint.child for joint in self.below(link) if joint.child not in reached]
        if looped := [joint for joint in self.joints if joint.child not in reached]:
            message = f"the joints form a closed loop, '{looped[0].name}' among them"
            yield Issue(message, hint="cut it: a serial arm has none", line=looped[0].line)


def _doubled_names(names: Iterable[str]) -> list[str]:
    """The names that occur more than once, sorted."""
    return sorted(name for name, count in Counter(names).items() if count > 1)
