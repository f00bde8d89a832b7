"""A URDF file read into a tree of links and joints: all faults are reported at once, each with its line.

Expat reads the elements with their lines; a document type, and with it every entity, is refused.
Source: ROS, "URDF XML specification", elements link and joint. Colours, sensors and plugins are not read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.files import content
from posture_opt.limits import MAX_URDF_BYTES
from posture_opt.numerics import Array
from posture_opt.robot.urdf_tree import Collision, Inertial, UrdfJoint, UrdfTree
from posture_opt.texts import number_or_nan, one_line, text_fault
from posture_opt.units import NEGLIGIBLE

MAX_ELEMENTS = 100_000  # Elements of a file; a humanoid with hands has some ten thousand
MAX_NESTED = 100  # Elements inside each other; a description of a robot has five, its plug-ins some more


@dataclass(frozen=True)
class Element:
    """One element: its attributes, the elements inside it, and the line that it begins in; texts are left out."""

    tag: str
    attributes: dict[str, str]
    line: int
    inside: list[Element] = field(default_factory=list)

    def first(self, tag: str) -> Element | None:
        """The first element ``tag`` right inside this one."""
        return next((element for element in self.inside if element.tag == tag), None)

    def each(self, tag: str) -> Iterator[Element]:
        """The elements ``tag`` right inside this one."""
        return (element for element in self.inside if element.tag == tag)


def read_elements(data: bytes) -> tuple[Element, ...]:
    """All elements of an XML document in the order of the file, the outermost first."""
    reader = _ElementReader()
    try:
        reader.parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(Issue(f"the file is not XML: {expat.ErrorString(error.code)}", line=error.lineno)) from None
    except (LookupError, ValueError) as error:  # of an encoding that nobody knows
        raise InputError(Issue(f"the file is not XML: {error}", hint="save the file as UTF-8", line=1)) from None
    return tuple(reader.elements)


class _ElementReader:
    """Collects what expat reports: elements in the order in which they begin, nested as in the file."""

    def __init__(self) -> None:
        self.elements: list[Element] = []
        self.around: list[Element] = []
        self.parser = expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if len(self.around) == MAX_NESTED:
            message = f"more than {MAX_NESTED} elements stand inside each other, which no robot description has"
            raise InputError(Issue(message, line=self.parser.CurrentLineNumber))
        if len(self.elements) == MAX_ELEMENTS:
            raise InputError(Issue(f"the file has more than {MAX_ELEMENTS} elements, which no robot description has"))
        element = Element(tag, attributes, self.parser.CurrentLineNumber)
        if self.around:
            self.around[-1].inside.append(element)
        self.around.append(element)
        self.elements.append(element)

    def _end(self, tag: str) -> None:
        self.around.pop()

    def _doctype(self, name: str, *declared: object) -> NoReturn:
        hint = "remove <!DOCTYPE …>, and write numbers and names in place of its &entities;"
        message = "a robot description has no DOCTYPE and no entities"
        raise InputError(Issue(message, hint=hint, line=self.parser.CurrentLineNumber))


MAX_NUMBER = 1e18  # Limits of 1e16 mean that there is none; up to here squares of squares are still numbers
# Geometry -> its attributes, and how many numbers each holds
_GEOMETRY_SIZES = {
    # geometry -> its attributes, and how many numbers each holds
    "box": (("size", 3),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
    "sphere": (("radius", 1),),
    "mesh": (("scale", 3),),
}


def read_urdf(path: Path) -> UrdfTree:
    """The tree of the file at ``path``; lengths in [m], angles in [rad]."""
    try:
        return urdf_tree(content(path, MAX_URDF_BYTES), path.name)
    except InputError as error:
        raise InputError([in_urdf(issue, path) for issue in error.issues]) from None


def urdf_tree(data: bytes, name: str) -> UrdfTree:
    """The tree of a URDF that is called ``name``; lengths in [m], angles in [rad]."""
    robot, reader = _robot_element(data, name), _UrdfReader([])
    links = [(reader.name(element), element) for element in robot.each("link")]
    tree = UrdfTree(
        reader.text(robot, "name", "the <robot>") if robot.attributes.get("name") else one_line(Path(name).stem),
        tuple(link for link, _ in links),
        tuple(reader.joint(element) for element in robot.each("joint")),
        {link: reader.inertial(link, inside) for link, element in links for inside in element.each("inertial")},
        {link: tuple(reader.collisions(link, element)) for link, element in links},
    )
    if issues := reader.issues or [*tree.faults()]:
        raise InputError(issues)
    return tree


def in_urdf(issue: Issue, path: Path) -> Issue:
    """An issue about the key ``file``, with the place of the file and its line."""
    line = f":{issue.line}" if issue.line else ""
    where = "" if path.is_absolute() else f" (in {path.absolute().parent})"
    return replace(issue, message=f"{path}{line}{where}: {issue.message}", key=("file",), value=str(path), line=0)


def _robot_element(data: bytes, name: str) -> Element:
    """The element ``<robot>`` of the file ``name``."""
    elements = read_elements(data)
    for element in elements:
        given = [f' {key}="{value}"' for key, value in element.attributes.items() if "${" in value or "$(" in value]
        macro = element.tag.startswith("xacro:")
        if macro or given:
            stem = name.removesuffix(".xacro").removesuffix(".urdf").removesuffix(".xml")
            there = f"{stem}.urdf" if name != f"{stem}.urdf" else f"{stem}_expanded.urdf"
            message = f"this is a xacro file, not a URDF: it holds <{element.tag}{'' if macro else given[0]}>"
            raise InputError(Issue(message, hint=f"expand it first: xacro {name} > {there}", line=element.line))
    root = elements[0]
    if root.tag != "robot":
        message = f"the file is no URDF: it begins with <{root.tag}>, not <robot>"
        raise InputError(Issue(message, hint="name a URDF file", line=root.line))
    return root


@dataclass(frozen=True)
class _UrdfReader:
    """Elements as links and joints; ``issues`` gathers faults."""

    issues: list[Issue]

    def name(self, element: Element) -> str:
        """The attribute ``name`` of a link or a joint."""
        return self.text(element, "name", f"a <{element.tag}>")

    def joint(self, element: Element) -> UrdfJoint:
        """One ``<joint>``; its axis is x where none is given, its origin the parent's frame."""
        name = self.name(element)
        owner = f"joint '{name}'"
        limit, mimic = element.first("limit"), element.first("mimic")
        axis, safety = element.first("axis"), element.first("safety_controller")
        soft = [self._one_number(safety, f"soft_{end}_limit", owner) for end in ("lower", "upper")]
        multiplier = self._one_number(mimic, "multiplier", owner)
        roll, pitch, yaw = self._three_numbers(element.first("origin"), "rpy", owner).tolist()
        return UrdfJoint(
            name=name,
            type=element.attributes.get("type", ""),
            parent=self._end(element, "parent", owner),
            child=self._end(element, "child", owner),
            origin=_origin_transform(
                self._three_numbers(element.first("origin"), "xyz", owner), np.array([roll, pitch, yaw])
            ),
            rpy=(roll, pitch, yaw),
            axis=self._three_numbers(axis, "xyz", owner)
            if axis and "xyz" in axis.attributes
            else np.array([1.0, 0.0, 0.0]),
            lower=self._one_number(limit, "lower", owner),
            upper=self._one_number(limit, "upper", owner),
            velocity=self._one_number(limit, "velocity", owner),
            effort=self._one_number(limit, "effort", owner),
            mimics=mimic.attributes.get("joint", "another joint") if mimic else "",
            follows=(1.0 if multiplier is None else multiplier, self._one_number(mimic, "offset", owner) or 0.0),
            soft=(-math.inf if soft[0] is None else soft[0], math.inf if soft[1] is None else soft[1]),
            rising=self._one_number(element.first("calibration"), "rising", owner),
            line=element.line,
        )

    def inertial(self, link: str, element: Element) -> Inertial:
        """Mass [kg] and centre of mass (3,) [m] in the frame of the link; a negative mass is an issue."""
        owner = f"link '{link}'"
        mass = self._one_number(element.first("mass"), "value", owner) or 0.0
        if mass < 0:
            self.issues.append(Issue(f"{owner} has a negative mass", line=element.line))
        return Inertial(mass, self._origin_of(element, owner)[:3, 3])

    def collisions(self, link: str, element: Element) -> Iterator[Collision]:
        """Bodies of a link with an extent and a known geometry."""
        owner = f"<collision> of link '{link}'"
        for collision in element.each("collision"):
            for geometry in (inside for part in collision.each("geometry") for inside in part.inside):
                if geometry.tag in _GEOMETRY_SIZES:
                    size = self._geometry_numbers(geometry, owner)
                    file = geometry.attributes.get("filename", "")
                    if min(size) > 0 or geometry.tag == "mesh":
                        yield Collision(geometry.tag, size, self._origin_of(collision, owner), file)  # type: ignore[arg-type]

    def _geometry_numbers(self, geometry: Element, owner: str) -> tuple[float, ...]:
        given = [self._numbers(geometry, key, n, owner) for key, n in _GEOMETRY_SIZES[geometry.tag]]
        size = tuple(number for numbers in given for number in numbers)
        return size if all(given) else (1.0, 1.0, 1.0) if geometry.tag == "mesh" else (0.0,)

    def text(self, element: Element, key: str, owner: str) -> str:
        """An attribute in one line and not empty, or an issue."""
        given = element.attributes.get(key, "")
        if not given:
            message = f"{owner} lacks its {key}"
            self.issues.append(Issue(message, hint=f'write <{element.tag} {key}="…">', line=element.line))
        elif fault := text_fault(given):
            message, hint = f"{owner}: {key}: {fault[0]}", fault[1]
            self.issues.append(Issue(message, value=given, hint=hint, line=element.line))
        return one_line(given)

    def _end(self, joint: Element, tag: str, owner: str) -> str:
        """The link that ``<parent>`` or ``<child>`` of a joint names."""
        if element := joint.first(tag):
            return self.text(element, "link", f"<{tag}> of {owner}")
        self.issues.append(Issue(f"{owner} has no <{tag}>", hint=f'write <{tag} link="…"/>', line=joint.line))
        return ""

    def _origin_of(self, element: Element, owner: str) -> Array:
        """(4, 4) the element's ``<origin>`` in the frame of its owner, lengths in [m]; the identity where there is
        none."""
        origin = element.first("origin")
        return _origin_transform(self._three_numbers(origin, "xyz", owner), self._three_numbers(origin, "rpy", owner))

    def _three_numbers(self, element: Element | None, key: str, owner: str) -> Array:
        """(3,) the numbers of an attribute [m or rad], zeros without it."""
        return np.array(self._numbers(element, key, 3, owner) or [0.0] * 3)

    def _one_number(self, element: Element | None, key: str, owner: str) -> float | None:
        found = self._numbers(element, key, 1, owner)
        return found[0] if found else None

    def _numbers(self, element: Element | None, key: str, count: int, owner: str) -> list[float]:
        """``count`` finite numbers, `NEGLIGIBLE` ones as zeros; zeros and an issue where they are none; [] without."""
        if element is None or key not in element.attributes:
            return []
        numbers = [number_or_nan(word) for word in element.attributes[key].split()]
        finite = len(numbers) == count and all(map(math.isfinite, numbers))
        if finite and all(abs(number) < MAX_NUMBER for number in numbers):
            return [number if abs(number) > NEGLIGIBLE else 0.0 for number in numbers]
        given, wanted = element.attributes[key], "one finite number" if count == 1 else f"{count} finite numbers"
        fault = "is not plausible" if finite else f"does not hold {wanted}"
        message = f'{owner}: <{element.tag} {key}="{given}"> {fault}'
        self.issues.append(Issue(message, value=given, hint="is the exponent right?" * finite, line=element.line))
        return [0.0] * count


def _origin_transform(xyz: Array, rpy: Array) -> Array:
    """(4, 4) ``Trans(x, y, z) Rz(yaw) Ry(pitch) Rx(roll)`` of position (3,) [m] and angles (3,) [rad]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    T = np.eye(4)
    T[:3, 0] = cy * cp, sy * cp, -sp
    T[:3, 1] = cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr
    T[:3, 2] = cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr
    T[:3, 3] = xyz
    return T
