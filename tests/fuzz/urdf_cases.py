"""URDF files: loops, several roots, mimics, missing limits, odd numbers, entities, and text that is no XML."""

from __future__ import annotations

import copy
import random
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable

from tests.fuzz.bases import problem_file
from tests.fuzz.case import Case
from tests.fuzz.text_faults import spoil
from tests.fuzz.values import NUMBERS, WORDS, word

FILE = "r.urdf"
_TRIPLES = (
    "0 0 0", "1 0 0", "0 -1 0", "0 0 0.3", "0.1 0.2 0.3", "1e308 0 0", "nan 0 0", "0 inf 0", "", " ", "1 2",
    "1 2 3 4", "a b c", "0,0,1", "1e-200 0 0", "1e155 1e155 1e155", "1e6 0 0", "١ 0 0", "0 0 1e-9", "5e-324 0 0",
    "1_0 0 0", "3.14159 1.5707963 0",
)  # fmt: skip
_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "", "Revolute", "ball", "screw")
_ENTITIES = '<!DOCTYPE robot [<!ENTITY a "aaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;">'
_PROLOGUES = (
    '<!DOCTYPE robot [<!ENTITY a "500">]>', '<!DOCTYPE robot SYSTEM "file:///etc/passwd">', "<!DOCTYPE robot>",
    f'{_ENTITIES}<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;">]>', "<?php ?>", "<!-- -- -->", "<robot/>", "text", "<![CDATA[x]]>",
    '<?xml version="1.1"?>', '<?xml version="1.0" encoding="utf-16"?>', '<?xml version="1.0" encoding="nonsense"?>',
    '<?xml version="1.0" encoding="ascii"?>',
)  # fmt: skip


def urdf_case(rng: random.Random, number: int) -> Case:
    """One call with a random URDF file."""
    robot = ET.fromstring(problem_file("bench_arm.urdf").read_text("utf-8")) if rng.random() < 0.5 else _tree(rng)
    for _ in range(rng.choice((0, 1, 1, 2, 3))):
        rng.choice(_CHANGES)(rng, robot)
    text = ET.tostring(robot, encoding="unicode")
    if rng.random() < 0.08:
        text = rng.choice(_PROLOGUES) + text
    if rng.random() < 0.05:
        text = re.sub(r'"0\.\d*"', '"&a;"', text, count=1)
    if rng.random() < 0.01:
        text = text.replace("<link", f"{'<a>' * 5000}{'</a>' * 5000}<link", 1)
    content = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.12:
        content = spoil(rng, content)
    words, out = _words(rng, robot)
    return Case("urdf", number, words, {FILE: content}, out)


def _words(rng: random.Random, robot: ET.Element) -> tuple[tuple[str, ...], tuple[str, ...]]:
    names = [link.get("name", "") for link in robot.iter("link")]
    links: tuple[str, ...] = ()
    if rng.random() < 0.3 and names:
        links = ("--base-link", rng.choice([*names, "x"]), "--tip-link", rng.choice([*names, "y"]))
    moving = [j for j in robot.iter("joint") if j.get("type") in ("revolute", "continuous", "prismatic")]
    posture = ", ".join("0.05 m" if j.get("type") == "prismatic" else f"{rng.uniform(-60, 60):.1f} deg" for j in moving)
    sliding = any(j.get("type") == "prismatic" for j in moving)
    sigma = ("--sigma", "0.02 deg, 0.01 mm" if sliding and rng.random() < 0.8 else "0.02 deg")
    manner = rng.choice(((), ("--json",), ("--full",)))
    choice = rng.random()
    if choice < 0.6:
        return ("uncertainty", "--robot", FILE, *links, *sigma, "--posture", posture or "0", *manner), ()
    if choice < 0.64:
        return ("new", FILE, *links), ()
    if choice < 0.9:
        to = rng.choice(("urdf", "dh", "urdf", "dh", "urdf", "dh", "python", "c"))
        return ("export", "--to", to, "--robot", FILE, *links, *sigma, "--out", "o"), ("o",)
    if choice < 0.93:
        target = ("--task", "probe", "--position", "0.3 m, 0 m, 0.3 m")
        return (*target, "--robot", FILE, *links, *sigma, *manner), ()
    if choice < 0.96:
        return ("plan-measurements", "--robot", FILE, *links, "--count", "2", "--candidates", "10", *manner), ()
    return ("simulate", "--robot", FILE, *links, *sigma, "-n", "20", "--posture", posture or "0", *manner), ()


def _tree(rng: random.Random) -> ET.Element:
    """A chain of up to eight joints, with branches at times."""
    robot = ET.Element("robot", name="r")
    ET.SubElement(robot, "link", name="l0")
    for k in range(1, rng.choice((1, 2, 3, 4, 5, 7, 8, 9))):
        ET.SubElement(robot, "link", name=f"l{k}")
        joint = ET.SubElement(robot, "joint", name=f"j{k}", type=rng.choice((*_TYPES[:4], "revolute", "revolute")))
        rpy = f"{rng.choice((0, 0, 1.5707963, -1.5707963, 0.3))} 0 {rng.choice((0, 0, 1.5707963, 0.7))}"
        ET.SubElement(joint, "origin", xyz=f"{rng.choice((0, 0.1))} 0 {rng.choice((0, 0.3))}", rpy=rpy)
        ET.SubElement(joint, "parent", link=f"l{k - 1 if rng.random() < 0.9 else rng.randrange(k)}")
        ET.SubElement(joint, "child", link=f"l{k}")
        ET.SubElement(joint, "axis", xyz=rng.choice(("0 0 1", "0 1 0", "1 0 0", "0 0 -1", "0 0.6 0.8")))
        ET.SubElement(joint, "limit", lower="-2.5", upper="2.5", effort="1", velocity="1")
    return robot


def _elements(robot: ET.Element) -> list[ET.Element]:
    return [element for element in robot.iter() if element is not robot] or [robot]


def _attribute(rng: random.Random, robot: ET.Element) -> None:
    element = rng.choice(_elements(robot))
    names = list(element.keys())
    if not names:
        return
    name = rng.choice(names)
    value = rng.choice((str(rng.choice(NUMBERS)), rng.choice(_TRIPLES), _xml_text(word(rng))))
    element.set(name, rng.choice(_TYPES) if name == "type" and rng.random() < 0.8 else value)


def _triple(rng: random.Random, robot: ET.Element) -> None:
    found = [
        (e, k)
        for e in _elements(robot)
        for k in ("xyz", "rpy", "size", "lower", "upper", "value")
        if e.get(k) is not None
    ]
    if found:
        element, key = rng.choice(found)
        element.set(key, rng.choice(_TRIPLES) if key in ("xyz", "rpy", "size") else str(rng.choice(NUMBERS)))


def _drop_attribute(rng: random.Random, robot: ET.Element) -> None:
    element = rng.choice(_elements(robot))
    if element.attrib:
        del element.attrib[rng.choice(list(element.keys()))]


def _drop(rng: random.Random, robot: ET.Element) -> None:
    parents = [parent for parent in robot.iter() if len(parent)]
    if parents:
        parent = rng.choice(parents)
        parent.remove(rng.choice(list(parent)))


def _double(rng: random.Random, robot: ET.Element) -> None:
    parents = [parent for parent in robot.iter() if len(parent)]
    if parents:
        parent = rng.choice(parents)
        parent.append(copy.deepcopy(rng.choice(list(parent))))


def _reconnect(rng: random.Random, robot: ET.Element) -> None:
    """Loops, several roots, links that do not exist."""
    ends = [end for joint in robot.iter("joint") for end in joint if end.tag in ("parent", "child")]
    names = [link.get("name", "") for link in robot.iter("link")]
    if ends and names:
        rng.choice(ends).set("link", rng.choice([*names, "nowhere", ""]))


def _mimic(rng: random.Random, robot: ET.Element) -> None:
    joints = list(robot.iter("joint"))
    if joints:
        other = rng.choice(joints).get("name", "")
        number = {"multiplier": str(rng.choice(NUMBERS)), "offset": "0.1"} if rng.random() < 0.5 else {}
        ET.SubElement(rng.choice(joints), "mimic", joint=rng.choice((other, "x", "")), **number)


def _foreign(rng: random.Random, robot: ET.Element) -> None:
    """Elements that other programs write, and deep ones."""
    at = rng.choice(list(robot.iter()))
    tag = rng.choice(
        (
            "gazebo", "transmission", "xacro:macro", "collision", "visual", "safety_controller", "dynamics", "link",
            "joint",
        )
    )  # fmt: skip
    element = ET.SubElement(at, tag.replace(":", "_"))
    if tag == "collision":
        shape = rng.choice(("box", "cylinder", "sphere", "mesh", "cone"))
        keys = {
            "box": {"size": rng.choice(_TRIPLES)},
            "mesh": {"filename": rng.choice(("x.stl", "package://a/b.dae", ""))},
        }
        values = keys.get(shape, {"radius": str(rng.choice(NUMBERS)), "length": str(rng.choice(NUMBERS))})
        ET.SubElement(ET.SubElement(element, "geometry"), shape, **values)
    if rng.random() < 0.1:
        for _ in range(rng.choice((50, 300))):
            element = ET.SubElement(element, "a")


def _name(rng: random.Random, robot: ET.Element) -> None:
    """The same odd name everywhere it is referred to."""
    named = [e for e in robot.iter() if e.tag in ("link", "joint") and e.get("name")]
    if not named:
        return
    former, new = rng.choice(named).get("name", ""), _xml_text(rng.choice(WORDS))
    for element in robot.iter():
        for key, value in element.items():
            if value == former and key in ("name", "link", "joint"):
                element.set(key, new)


def _xml_text(text: str) -> str:
    return re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f]", "?", text)


_CHANGES: tuple[Callable[[random.Random, ET.Element], None], ...] = (
    _attribute, _attribute, _triple, _triple, _drop_attribute, _drop, _double, _reconnect, _mimic, _foreign, _name,
)  # fmt: skip
