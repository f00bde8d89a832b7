"""A URDF file as a tree of links and joints, checked; the XML itself is read by yourdfpy."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.nearest import nearest_file, one_of
from posture_opt.numerics import Array

MAX_BYTES = 50_000_000  # a robot of some hundred links takes a few hundred kB


@dataclass(frozen=True)
class UrdfJoint:
    """A joint as it stands in the file.

    Args:
        origin: (4, 4) T_parent_joint, lengths in [m].
        axis: (3,) in the joint frame.
        lower, upper: [rad] or [m]; None where the file has none.
        mimics: the joint that this one follows, or an empty text.
    """

    name: str
    type: str
    parent: str
    child: str
    origin: Array
    axis: Array
    lower: float | None
    upper: float | None
    mimics: str


@dataclass(frozen=True)
class Inertial:
    """Mass [kg] and centre of mass (3,) [m] of a link, in the link's frame."""

    mass: float
    com: Array


@dataclass(frozen=True)
class UrdfTree:
    """Links and joints of a file in which every link has at most one parent."""

    name: str
    links: tuple[str, ...]
    joints: tuple[UrdfJoint, ...]
    inertials: dict[str, Inertial]

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
        return [joint for joint in self.joints if joint.parent == link]

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


def read_urdf(path: Path) -> UrdfTree:
    """The tree of the file at ``path``; meshes, colours, sensors and plugins are left out before it is parsed.

    Raises:
        InputError: no such file, not XML, not a URDF, a part missing, or no tree.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise _refused("the file is larger than any robot description; is it a mesh?", path)
        data = path.read_bytes()
    except FileNotFoundError:
        near = Path(nearest_file(path)).name
        mend = f"did you mean {near} in the same folder?" if near else ""
        raise InputError(replace(_issue("no such file", path), mend=mend)) from None
    except OSError as error:
        raise _refused(f"the file cannot be read ({error.strerror or error})", path) from None
    robot = _parse(_bare(data, path), path)
    tree = UrdfTree(
        robot.name or path.stem,
        tuple(link.name for link in robot.links),
        tuple(_joint(joint) for joint in robot.joints),
        {link.name: _inertial(link.inertial) for link in robot.links if link.inertial is not None},
    )
    if faults := _faults(tree):
        raise InputError([_issue(fault, path) for fault in faults])
    return tree


def _issue(message: str, path: Path) -> Issue:
    """``message`` about the file, with the place where it was looked for."""
    where = "" if path.is_absolute() else f" (in {path.absolute().parent})"
    return Issue(f"{path}{where}: {message}", ("file",), str(path))


def _refused(message: str, path: Path) -> InputError:
    return InputError(_issue(message, path))


def _bare(data: bytes, path: Path) -> bytes:
    """The kinematic part of the file only: what yourdfpy need not see cannot disturb it."""
    from lxml import etree  # type: ignore[import-untyped]  # what yourdfpy itself reads XML with

    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True)
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise _refused(f"the file is not XML: {error.msg}", path) from None
    if root.tag != "robot":
        raise _refused(f"the file is no URDF: it begins with <{etree.QName(root).localname}>, not <robot>", path)
    if any("xacro" in (etree.QName(item).namespace or "") for item in root.iter(etree.Element)):
        raise _refused("this is a xacro file, not a URDF; expand it first: xacro FILE > robot.urdf", path)
    kept = {"link": {"inertial"}, "joint": {"origin", "parent", "child", "axis", "limit", "mimic"}}
    for item in list(root):
        if item.tag not in kept:
            root.remove(item)
            continue
        for part in [part for part in item if part.tag not in kept[item.tag]]:
            item.remove(part)
    root.set("name", root.get("name", ""))
    return bytes(etree.tostring(root))


def _parse(data: bytes, path: Path) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the mesh libraries that yourdfpy imports
        from yourdfpy import URDF

        try:
            urdf = URDF.load(BytesIO(data), build_scene_graph=False, load_meshes=False)
        except (AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
            fault = f"a <link> or <joint> lacks a part or holds no numbers ({error})"
            raise _refused(f"the file is no complete URDF: {fault}", path) from None
    return urdf.robot


def _joint(joint: Any) -> UrdfJoint:
    limit = joint.limit
    return UrdfJoint(
        name=joint.name,
        type=joint.type or "",
        parent=joint.parent or "",
        child=joint.child or "",
        origin=np.eye(4) if joint.origin is None else np.asarray(joint.origin, dtype=float),
        axis=np.asarray(joint.axis, dtype=float),
        lower=None if limit is None else limit.lower,
        upper=None if limit is None else limit.upper,
        mimics="" if joint.mimic is None else str(joint.mimic.joint),
    )


def _inertial(inertial: Any) -> Inertial:
    com = np.zeros(3) if inertial.origin is None else np.asarray(inertial.origin, dtype=float)[:3, 3]
    return Inertial(float(inertial.mass or 0.0), com)


def _faults(tree: UrdfTree) -> list[str]:
    """What keeps the file from being a tree of finite numbers."""
    faults = [] if tree.links else ["the file has no <link>"]
    if tree.links and not tree.roots():
        faults.append("every link hangs on a joint: the joints form a closed loop")
    faults += [f"two links are named '{name}'" for name in _twice(tree.links)]
    faults += [f"two joints are named '{name}'" for name in _twice(joint.name for joint in tree.joints)]
    faults += [f"link '{name}' hangs on two joints: a closed loop is no serial arm"
               for name in _twice(joint.child for joint in tree.joints)]  # fmt: skip
    for joint in tree.joints:
        for end in (joint.parent, joint.child):
            if end not in tree.links:
                faults.append(f"joint '{joint.name}' names a link '{end}' that the file does not have")
        numbers = [*joint.origin.flat, *joint.axis.flat, joint.lower or 0.0, joint.upper or 0.0]
        if joint.axis.shape != (3,) or not np.isfinite(numbers).all():
            faults.append(f"joint '{joint.name}' holds numbers that are not finite, or not three of them")
    for link, inertial in tree.inertials.items():
        if not np.isfinite([inertial.mass, *inertial.com]).all() or inertial.mass < 0:
            faults.append(f"link '{link}' has a mass or centre of mass that is negative or not finite")
    return faults


def _twice(names: Iterable[str]) -> list[str]:
    every = list(names)
    return sorted({name for name in every if every.count(name) > 1})
