"""An SRDF: pairs that are not checked, and named postures, of a published arm and of one written here."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

import posture_opt as po
from posture_opt.robot.urdf import UrdfRobot
from tests.helpers.pin import robots_folder

BALL = "<collision><geometry><sphere radius='0.05'/></geometry></collision>"


def arm(folder: Path, count: int = 5) -> None:
    """A chain of balls 0.3 m apart, ``a0 … a5``, and a plate fixed to ``a2``."""
    names = [f"a{k}" for k in range(count + 1)]
    links = "".join(f"<link name='{name}'>{BALL}</link>" for name in (*names, "plate"))
    joints = "".join(
        f"<joint name='j{k}' type='revolute'><parent link='a{k - 1}'/><child link='a{k}'/><origin xyz='0 0 0.3'/>"
        "<axis xyz='0 1 0'/><limit lower='-2.5' upper='2.5'/></joint>"
        for k in range(1, count + 1)
    )
    fixed = "<joint name='f' type='fixed'><parent link='a2'/><child link='plate'/><origin xyz='0.1 0 0'/></joint>"
    (folder / "arm.urdf").write_text(f"<robot name='chain'>{links}{joints}{fixed}</robot>")


SRDF = """<?xml version="1.0"?>
<robot name="chain">
  <group_state name="home" group="arm">
    <joint name="j1" value="0.1"/><joint name="j3" value="-0.2"/><joint name="finger" value="0.01"/>
  </group_state>
  <group_state name="open" group="hand"><joint name="finger" value="0.04"/></group_state>
  <disable_collisions link1="a0" link2="a3" reason="Never"/>
  <disable_collisions link1="a1" link2="a4" reason="Never"/>
  <disable_collisions link1="a2" link2="a5" reason="Never"/>
</robot>
"""


def problem(folder: Path, **keys: Any) -> po.Problem:
    (folder / "arm.srdf").write_text(keys.pop("srdf", SRDF))
    robot = {"kind": "urdf", "file": "arm.urdf", "tip_link": "a5", "srdf": "arm.srdf"}
    return po.problem_from_dict({"robot": robot, **keys}, folder)


def test_pairs_are_left_out_where_no_link_of_both_is_checked(tmp_path: Path) -> None:
    arm(tmp_path)
    found = problem(tmp_path)
    off = {frozenset(("base", "j3")), frozenset(("j1", "j4"))}
    assert found.robot.allowed_collisions == off
    plain = po.problem_from_dict({"robot": {"kind": "urdf", "file": "arm.urdf", "tip_link": "a5"}}, tmp_path)
    every, pairs = ({frozenset(pair) for pair in p.scene.pairs} for p in (plain, found))
    assert every - pairs == off & every != set()
    assert frozenset(("j2", "j5")) in pairs, "the plate on a2 may still hit a5"


def test_a_named_posture_is_the_one_to_stay_near(tmp_path: Path) -> None:
    arm(tmp_path)
    task = {"kind": "hold", "direction": [0, 0, -1], "minimize": [{"kind": "near_posture", "posture": "home"}]}
    term: Any = problem(tmp_path, task=task).task.minimize[0]  # type: ignore[union-attr]
    assert {name: (v.value, v.unit) for name, v in term.posture.items()} == {"j1": (0.1, "rad"), "j3": (-0.2, "rad")}
    for name, message in (("hom", "did you mean 'home'"), ("open", "no posture called 'open'")):
        with pytest.raises(po.errors.InputError, match=message):
            problem(tmp_path, task={**task, "minimize": [{"kind": "near_posture", "posture": name}]})
    bounded = {"kind": "near_posture", "posture": "home", "at_most": {"j2": "5 deg"}}
    with pytest.raises(po.errors.InputError, match="j2 has a bound and no value"):
        problem(tmp_path, task={**task, "minimize": [], "subject_to": [bounded]})
    free = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur5e"}})
    with pytest.raises(po.errors.InputError, match="no posture called 'home'"):
        free.replace(task=task)


@pytest.mark.parametrize(("text", "message"), [
    ("<robot", "line 1: the file is not XML"),
    ("<sdf/>", "no SRDF"),
    ('<robot><disable_collisions link1="x" link2="y"/></robot>', "none of its links is in the URDF"),
    ('<robot><group_state name="h"><joint name="j1" value="up"/></group_state></robot>', "'up' of a joint"),
    ('<robot><group_state name="h"><joint name="j1" value="1e300"/></group_state></robot>', "not plausible"),
    ('<robot><group_state name="h&#10;movej([9])"/></robot>', "<group_state name=…>: the text holds a line br"),
    ('<robot><disable_collisions link1="a0" link2="x&#x2028;"/></robot>', "link2=…>: the text holds a line break"),
    ('<robot><group_state name="h"/><group_state name="h"/></robot>', "'h' of the group '' is stated twice"),
    (
        '<robot><group_state name="h"><joint name="j1" value="0"/><joint name="j1" value="1"/></group_state></robot>',
        "'h' states the joint 'j1' twice",
    ),
])  # fmt: skip
def test_files_that_are_none(tmp_path: Path, text: str, message: str) -> None:
    arm(tmp_path)
    with pytest.raises(po.errors.InputError, match=message) as caught:
        problem(tmp_path, srdf=text)
    assert caught.value.issues[0].key == ("robot", "srdf")


def test_the_published_panda() -> None:
    folder = robots_folder() / "panda_description"
    robot = UrdfRobot(file="urdf/panda_collision.urdf", srdf="srdf/panda.srdf").build(folder)
    root = ET.parse(folder / "srdf" / "panda.srdf").getroot()
    state = {j.attrib["name"]: float(j.attrib["value"]) for j in root.iter("joint") if j.get("value")}
    assert dict(dict(robot.named_postures)["default"]) == {k: v for k, v in state.items() if "finger" not in k}
    off = {frozenset((e.attrib["link1"], e.attrib["link2"])) for e in root.iter("disable_collisions")}
    assert frozenset(("panda_link0", "panda_link4")) in off
    assert frozenset(("base", "panda_joint4")) in robot.allowed_collisions
