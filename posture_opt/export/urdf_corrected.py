"""The URDF that an arm was read from, with its corrections: all else of the file comes back as it was.

Corrections are in the origins of the joints: what they add to a joint value turns or shifts along the axis of the
joint, which is the same before and after. Source: ROS, "URDF XML specification", elements joint and limit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from xml.dom import expatbuilder
from xml.dom.minidom import Document, Element

import numpy as np

from posture_opt.export.fixed_pose import fixed_pose
from posture_opt.numerics import Array
from posture_opt.robot.robot import Joint, Robot, UrdfDescription
from posture_opt.robot.urdf_chain import ChainSegment, segments_of, xyz_rpy
from posture_opt.robot.urdf_reader import urdf_tree
from posture_opt.robot.urdf_tree import UrdfTree

WORLD, TOOL = "world", "tool"
_SAME = 1e-12
"""Origins that differ by less [m or 1] are rounding of the product: the file keeps its own text."""


def corrected_document(robot: Robot, description: UrdfDescription, name: str, comment: str) -> str:
    """The file with the corrections of the arm, from link ``world`` to link ``tool``.

    Links and joints in front of the base link are left out, all others are kept, those besides the chain too.

    Args:
        robot: the arm that was read from the file, with its corrections, base and tool.
        name: of the robot in the file.
        comment: at the top.
    """
    document = expatbuilder.parseString(description.data, namespaces=False)
    root = document.documentElement
    assert root is not None
    root.setAttribute("name", name)
    tree = urdf_tree(description.data, name)
    _drop_what_is_in_front(root, tree, description.base_link)
    path = tree.path(description.base_link, description.tip_link)
    elements = {joint.getAttribute("name"): joint for joint in _each(root, "joint")}
    for joint, segment, link in zip(robot.joints, segments_of(path), robot.links, strict=True):
        element = elements[joint.name]
        _correct_origin(document, element, segment.moving.origin, _own_origin(segment, fixed_pose(link)))
        _renew_velocity(document, element, joint, segment)
    _add_frame(document, root, (WORLD, description.base_link), fixed_pose(robot.base), before=True)
    _add_frame(document, root, (description.tip_link, TOOL), fixed_pose(robot.tool), before=False)
    body = root.toxml()
    return f'<?xml version="1.0"?>\n<!--\n{comment}\n-->\n{body}\n'


def _each(root: Element, tag: str) -> Iterator[Element]:
    """The elements ``tag`` right inside the robot."""
    return (node for node in root.childNodes if isinstance(node, Element) and node.tagName == tag)


def _drop_what_is_in_front(root: Element, tree: UrdfTree, base_link: str) -> None:
    """Removes the links that the base link does not carry, with their joints and what refers to these."""
    kept = {base_link}
    open_links = [base_link]
    while open_links:
        below = [joint.child for joint in tree.below(open_links.pop())]
        open_links += below
        kept |= set(below)
    joints = {joint.name for joint in tree.joints if joint.parent in kept}
    known: dict[str, Callable[[Element], bool]] = {
        "link": lambda e: e.getAttribute("name") in kept,
        "joint": lambda e: e.getAttribute("name") in joints,
        "gazebo": lambda e: e.getAttribute("reference") in {"", *kept, *joints},
        "transmission": lambda e: all(j.getAttribute("name") in joints for j in _each(e, "joint")),
    }
    for tag, keeps in known.items():
        for element in [*_each(root, tag)]:
            if not keeps(element):
                root.removeChild(element)


def _own_origin(segment: ChainSegment, T: Array) -> Array:
    """(4, 4) the origin of the joint of a segment whose pose at the joint value zero is ``T`` (4, 4) [m]."""
    before = np.eye(4)
    for origin in segment.before:
        before = before @ origin
    return np.asarray(np.linalg.inv(before) @ T @ np.linalg.inv(segment.T_child_end), dtype=float)


def _correct_origin(document: Document, joint: Element, stated: Array, wanted: Array) -> None:
    """Replaces the origin (4, 4) [m] of a joint where the arm has another one."""
    if np.abs(wanted - stated).max() < _SAME:
        return
    origin = next(_each(joint, "origin"), None) or joint.insertBefore(
        document.createElement("origin"), joint.firstChild
    )
    _write_pose(origin, wanted)


def _write_pose(origin: Element, T: Array) -> None:
    """xyz [m] and rpy [rad] of a pose (4, 4), with all digits."""
    for key, values in zip(("xyz", "rpy"), xyz_rpy(T), strict=True):
        origin.setAttribute(key, " ".join(repr(float(value) + 0.0) for value in values))


def _renew_velocity(document: Document, element: Element, joint: Joint, segment: ChainSegment) -> None:
    """Writes the largest speed of a joint where the problem file states another one than the URDF."""
    if np.isnan(joint.velocity) or joint.velocity == segment.moving.velocity:
        return
    limit = next(_each(element, "limit"), None) or element.appendChild(document.createElement("limit"))
    limit.setAttribute("velocity", repr(float(joint.velocity)))


def _add_frame(document: Document, root: Element, ends: tuple[str, str], T: Array, before: bool) -> None:
    """A link ``world`` in front of the base link, or ``tool`` behind the tip, on a fixed joint with the pose T (4, 4).

    Where the link at that end has this very name and no frame is between, it is the one; else another link of that name
    is called otherwise.
    """
    new = ends[0] if before else ends[1]
    own = ends[1] if before else ends[0]
    if own == new and np.abs(T - np.eye(4)).max() < _SAME:
        return
    renamed = _renamed_link(root, new)
    link = document.createElement("link")
    link.setAttribute("name", new)
    joint = document.createElement("joint")
    names = [element.getAttribute("name") for element in _each(root, "joint")]
    joint.setAttribute("name", _fresh("world_to_base" if before else "flange_to_tool", names))
    joint.setAttribute("type", "fixed")
    for tag, name in zip(("parent", "child"), ends, strict=True):
        end = joint.appendChild(document.createElement(tag))
        end.setAttribute("link", name if name == new and tag == ("parent" if before else "child") else renamed(name))
    _write_pose(joint.appendChild(document.createElement("origin")), T)
    for element in (link, joint):
        root.appendChild(document.createTextNode("  "))
        root.appendChild(element)
        root.appendChild(document.createTextNode("\n"))


def _renamed_link(root: Element, name: str) -> Callable[[str], str]:
    """Calls a link of this name otherwise, wherever the file has it; returns what each link is called then."""
    names = [element.getAttribute("name") for element in _each(root, "link")]
    if name not in names:
        return str
    other = _fresh(name, names)
    for element in _each(root, "link"):
        if element.getAttribute("name") == name:
            element.setAttribute("name", other)
    for joint in _each(root, "joint"):
        for end in (*_each(joint, "parent"), *_each(joint, "child")):
            if end.getAttribute("link") == name:
                end.setAttribute("link", other)
    for element in _each(root, "gazebo"):
        if element.getAttribute("reference") == name:
            element.setAttribute("reference", other)
    return lambda link: other if link == name else link


def relative_meshes(data: bytes) -> list[str]:
    """File names of meshes in a URDF that are neither whole paths nor those of a package."""
    document = expatbuilder.parseString(data, namespaces=False)
    names = (mesh.getAttribute("filename") for mesh in document.getElementsByTagName("mesh"))
    return [name for name in names if name and not name.startswith("/") and "://" not in name]


def _fresh(name: str, taken: Sequence[str]) -> str:
    """The name, with underscores behind it until nothing else is called so."""
    while name in taken:
        name += "_"
    return name
