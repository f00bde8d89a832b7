"""The arm as URDF: its corrections in the origins of the joints, base and tool as fixed joints.

Source: ROS, "URDF XML specification": ``origin`` is ``Trans(x, y, z) Rz(yaw) Ry(pitch) Rx(roll)`` from the parent link
to the joint, whose axis is given in the joint frame; the child link's frame is the joint frame after the motion.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import ClassVar, Literal
from xml.dom import expatbuilder
from xml.dom.minidom import Document, Element
from xml.sax.saxutils import quoteattr

import numpy as np

from posture_opt import __version__
from posture_opt.export.export_format import Exported, ExportFormat, ExportSource
from posture_opt.model.chain import fixed_pose
from posture_opt.numerics import Array
from posture_opt.robot.robot import BASE, TOOL, Capsule, Factor, Joint, Robot, UrdfDescription, xyz_rpy
from posture_opt.robot.urdf_chain import ChainSegment, segments_of
from posture_opt.robot.urdf_reader import urdf_tree
from posture_opt.robot.urdf_tree import UrdfTree
from posture_opt.texts import one_line


class UrdfArm(ExportFormat):
    """A URDF file whose forward kinematics is that of the corrected arm, from ``world`` to ``tool``."""

    summary: ClassVar[str] = "the corrected arm as URDF, from link 'world' to link 'tool'"
    default: ClassVar[str] = "arm"

    kind: Literal["urdf"] = "urdf"

    def write(self, source: ExportSource) -> Exported:
        problem = source.problem
        effects = ", ".join(effect.name for effect in problem.arm.effects)
        left_out = (f"a URDF cannot hold effects: left out are {effects}",) if effects else ()
        free = [frame for frame in ("base", "tool") if getattr(problem.robot, f"{frame}_free")]
        found = tuple(f"the {frame} is free, to be found from data: here it is at its start value" for frame in free)
        robot, notes = problem.robot, [*left_out, *found]
        if robot.description is not None:
            if files := relative_meshes(robot.description.data):
                notes.append(f"meshes are named from the folder of the URDF, {files[0]} say: put this file beside it")
            text = corrected_document(robot, robot.description, self.stem, _comment(notes))
        else:
            limits = {"effort": [joint.effort for joint in robot.joints], "velocity": robot.velocities}
            unknown = " and ".join(word for word, values in limits.items() if any(map(math.isnan, values)))
            if unknown:
                notes.append(f"{unknown} limits of joints are placeholders where the problem file has none")
            notes.append(
                "masses are left out: a URDF wants tensors of inertia with them, and the problem file has none"
            )
            text = urdf_text(robot, self.stem, notes)
        return Exported({f"{self.stem}.urdf": text}, tuple(notes))


def _comment(notes: Sequence[str]) -> str:
    lines = (f"Written by posture_opt {__version__}.", *notes)
    return "\n".join("  " + re.sub("-(?=-)", "- ", one_line(line)) for line in lines)


def urdf_text(robot: Robot, name: str, notes: Sequence[str] = ()) -> str:
    """The URDF of a chain; joint names, zeros, directions and limits are those of its joints."""
    before, behind = _parts(robot)
    links = _unique(("world", "base", *(f"{joint.name}_link" for joint in robot.joints), "flange", "tool"))
    fixed = _unique((*robot.joint_names, "world_to_base", "to_flange", "flange_to_tool"))[robot.n :]
    origins = [before[0], *((*rest, *ahead) for rest, ahead in zip(behind[:-1], before[1:], strict=True))]
    joints = [_fixed(fixed[0], links[0], links[1], robot.base)]
    for k, (joint, origin) in enumerate(zip(robot.joints, origins, strict=True)):
        joints.append(_moving(joint, links[k + 1], links[k + 2], origin, robot.factors[robot.driven[k]].axis))
    joints.append(_fixed(fixed[1], links[-3], links[-2], behind[-1]))
    joints.append(_fixed(fixed[2], links[-2], links[-1], robot.tool))
    body = [*_links(robot, links, behind), *joints]
    head = f'<?xml version="1.0"?>\n<!--\n{_comment(notes)}\n-->\n<robot name={quoteattr(name)}>'
    return "\n".join([head, *body, "</robot>", ""])


def _links(robot: Robot, names: Sequence[str], behind: Sequence[Sequence[Factor]]) -> list[str]:
    """The links with the shape of the arm, whose capsules are given in the frames behind the joints."""
    carried = [BASE, *robot.joint_names, TOOL]
    frames = [np.eye(4), *map(fixed_pose, behind), np.eye(4)]
    link_of = dict(zip(carried, [*names[1:-2], names[-1]], strict=True))
    shown = {
        link_of[owner]: [line for c in robot.shape if c.joint == owner for line in _capsule(c, T)]
        for owner, T in zip(carried, frames, strict=True)
    }
    found = []
    for name in names:
        tag, inside = f"  <link name={quoteattr(name)}", shown.get(name)
        found += [f"{tag}>", *inside, "  </link>"] if inside else [f"{tag}/>"]
    return found


def _parts(robot: Robot) -> tuple[list[tuple[Factor, ...]], list[tuple[Factor, ...]]]:
    """Of each link the factors up to its joint variable, whose nominal value is among them, and those behind it."""
    # A turn by the nominal value and one by the joint variable are about one axis: the order of the two is free.
    before, behind = [], []
    for link in robot.links:
        at = next(i for i, factor in enumerate(link) if factor.joint is not None)
        before.append(link[: at + 1])
        behind.append(link[at + 1 :])
    return before, behind


def _origin(factors: Iterable[Factor]) -> str:
    """The element ``origin`` of a product of factors: xyz [m] and rpy [rad]."""
    xyz, rpy = xyz_rpy(fixed_pose(factors))
    places, turns = (" ".join(repr(float(value) + 0.0) for value in part) for part in (xyz, rpy))
    return f'    <origin xyz="{places}" rpy="{turns}"/>'


def _fixed(name: str, parent: str, child: str, factors: Iterable[Factor]) -> str:
    head = f'  <joint name={quoteattr(name)} type="fixed">'
    return "\n".join([head, *_ends(parent, child), _origin(factors), "  </joint>"])


def _moving(joint: Joint, parent: str, child: str, factors: Iterable[Factor], axis: int) -> str:
    along = " ".join("1" if k == axis else "0" for k in range(3))
    head = f'  <joint name={quoteattr(joint.name)} type="{joint.type}">'
    bounds = f'lower="{float(joint.lower)!r}" upper="{float(joint.upper)!r}"'
    # The format requires limits, where nobody states one.
    effort = 1000.0 if math.isnan(joint.effort) else float(joint.effort)
    velocity = 1.0 if math.isnan(joint.velocity) else float(joint.velocity)
    limit = f'    <limit {bounds} effort="{effort!r}" velocity="{velocity!r}"/>'
    motion = f'    <axis xyz="{along}"/>'
    return "\n".join([head, *_ends(parent, child), _origin(factors), motion, limit, "  </joint>"])


def _ends(parent: str, child: str) -> tuple[str, str]:
    return f"    <parent link={quoteattr(parent)}/>", f"    <child link={quoteattr(child)}/>"


def _unique(names: Sequence[str]) -> list[str]:
    found: list[str] = []
    for name in names:
        found.append(_fresh(name, found))
    return found


def _capsule(capsule: Capsule, T: Array) -> list[str]:
    """A cylinder with a ball at both ends; T (4, 4) maps the frame that the capsule is given in to the link's."""
    start, end = (T[:3, :3] @ np.array(point) + T[:3, 3] for point in (capsule.start, capsule.end))
    length = float(np.linalg.norm(end - start))
    ball = f'<sphere radius="{capsule.radius!r}"/>'
    if length < 1e-9:
        return _both((start + end) / 2, (0.0, 0.0), ball)
    x, y, z = (end - start) / length
    turned = math.atan2(math.hypot(x, y), z), math.atan2(y, x)
    cylinder = f'<cylinder radius="{capsule.radius!r}" length="{length!r}"/>'
    middle = _both((start + end) / 2, turned, cylinder)
    return [*middle, *_both(start, (0.0, 0.0), ball), *_both(end, (0.0, 0.0), ball)]


def _both(at: Array, turned: tuple[float, float], geometry: str) -> list[str]:
    """The same body as ``visual`` and ``collision``: its axis z is turned by pitch and yaw [rad]."""
    place = " ".join(repr(float(v)) for v in at)
    origin = f'<origin xyz="{place}" rpy="0.0 {turned[0]!r} {turned[1]!r}"/>'
    return [f"    <{kind}>{origin}<geometry>{geometry}</geometry></{kind}>" for kind in ("visual", "collision")]


_SAME = 1e-12  # Origins that differ by less [m or 1] are rounding of the product: the file keeps its own text


def corrected_document(robot: Robot, description: UrdfDescription, name: str, comment: str) -> str:
    """The file with the corrections of the arm, from link ``world`` to link ``tool``."""
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
    _add_frame(document, root, ("world", description.base_link), fixed_pose(robot.base), before=True)
    _add_frame(document, root, (description.tip_link, "tool"), fixed_pose(robot.tool), before=False)
    body = root.toxml()
    return f'<?xml version="1.0"?>\n<!--\n{comment}\n-->\n{body}\n'


def _each(root: Element, tag: str) -> Iterator[Element]:
    return (node for node in root.childNodes if isinstance(node, Element) and node.tagName == tag)


def _drop_what_is_in_front(root: Element, tree: UrdfTree, base_link: str) -> None:
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
    if np.isnan(joint.velocity) or joint.velocity == segment.moving.velocity:
        return
    limit = next(_each(element, "limit"), None) or element.appendChild(document.createElement("limit"))
    limit.setAttribute("velocity", repr(float(joint.velocity)))


def _add_frame(document: Document, root: Element, ends: tuple[str, str], T: Array, before: bool) -> None:
    """A link ``world`` before the base link, or ``tool`` behind the tip, on a fixed joint with the pose T (4, 4)."""
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
    while name in taken:
        name += "_"
    return name
