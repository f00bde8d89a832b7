"""Fingers of a gripper end the chain of a URDF; an SRDF has pairs that are not checked, and named postures."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.robot.urdf import UrdfRobot
from posture_opt.robot.urdf_reader import read_urdf
from posture_opt.robot.urdf_tree import chosen_tip
from tests.helpers.pin import robots_folder

ARM = tuple((f"j{k}", "revolute", f"l{k - 1}", f"l{k}", "-2 2", "") for k in range(1, 7))
"""name, type, parent, child, limits, joint that it mimics"""


def write_urdf(folder: Path, rows: Sequence[tuple[str, ...]]) -> None:
    links = dict.fromkeys(name for row in rows for name in row[2:4])
    bodies = "".join(f'<link name="{name}"/>' for name in links)
    joints = ""
    for name, kind, parent, child, limits, mimics in rows:
        lower, upper = limits.split()
        joints += f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        joints += f'<origin xyz="0 0.1 0.2"/><axis xyz="0 0 1"/><limit lower="{lower}" upper="{upper}"/>'
        joints += (f'<mimic joint="{mimics}" offset="0.3"/>' if mimics else "") + "</joint>"
    (folder / "arm.urdf").write_text(f'<robot name="r">{bodies}{joints}</robot>', encoding="utf-8")


def tip_of(folder: Path, rows: Sequence[tuple[str, ...]]) -> tuple[str, int]:
    """The last link of the chain that is chosen, and how many joints it has."""
    write_urdf(folder, rows)
    robot = UrdfRobot(file="arm.urdf").build(folder)
    return dict(robot.sources)["tip_link"], robot.n


GRIPPERS: dict[str, tuple[tuple[str, ...], ...]] = {
    "one jaw, by its name": (("jointGripper", "revolute", "l6", "mover", "-1.57 0", ""),),
    "two slides alike": (("m1", "prismatic", "l6", "a", "0 0.2", ""), ("m2", "prismatic", "l6", "b", "0 0.2", "")),
    "two alike of two joints each": (
        ("m1", "revolute", "l6", "a", "0 0.8", ""), ("m2", "revolute", "l6", "b", "0 0.8", ""),
        ("m3", "revolute", "a", "c", "0 0.8", ""), ("m4", "revolute", "b", "d", "0 0.8", ""),
    ),
    "one that mimics a named one": (
        ("left_finger", "revolute", "l6", "a", "0 0.8", ""), ("pad", "revolute", "l6", "b", "-0.8 0", "left_finger"),
    ),
    "one that a named one mimics": (
        ("drive", "revolute", "l6", "a", "0 0.8", ""), ("right_finger", "revolute", "l6", "b", "0 0.7", "drive"),
    ),
    "a short slide at the end": (("m1", "prismatic", "l6", "a", "0 0.03", ""),),
}  # fmt: skip


@pytest.mark.parametrize("gripper", GRIPPERS)
def test_the_chain_ends_before_fingers(tmp_path: Path, gripper: str) -> None:
    assert tip_of(tmp_path, (*ARM, *GRIPPERS[gripper])) == ("l6", 6)


def test_a_tool_frame_beside_the_fingers_is_the_tip(tmp_path: Path) -> None:
    frame = ("tcp_joint", "fixed", "l6", "hand_tcp", "0 1", "")
    camera = ("camera_joint", "fixed", "l6", "camera", "0 1", "")
    assert tip_of(tmp_path, (*ARM, frame, *GRIPPERS["two slides alike"])) == ("hand_tcp", 6)
    assert tip_of(tmp_path, (*ARM, frame, camera, *GRIPPERS["two slides alike"])) == ("hand_tcp", 6)


NO_GRIPPERS: dict[str, tuple[tuple[tuple[str, ...], ...], str, int]] = {
    "a quill": ((*ARM[:3], ("quill", "prismatic", "l3", "end", "0 0.18", "")), "end", 4),
    "a wrist that turns the gripper": ((*ARM[:5], ("gripper_roll", "revolute", "l5", "end", "-3 3", "")), "end", 6),
    "a robot named after a finger": (
        tuple((f"finger{k}", kind, a, b, limits, "") for k, (_, kind, a, b, limits, _) in enumerate(ARM)),
        "l6",
        6,
    ),
    "a small linear stage": ((("x", "prismatic", "l0", "l1", "0 0.05", ""),), "l1", 1),
}


@pytest.mark.parametrize("arm", NO_GRIPPERS)
def test_what_is_no_finger_stays_in_the_chain(tmp_path: Path, arm: str) -> None:
    rows, tip, joints = NO_GRIPPERS[arm]
    assert tip_of(tmp_path, rows) == (tip, joints)


def test_a_linkage_that_follows_the_arm_is_no_finger(tmp_path: Path) -> None:
    """The wrist of a palletiser stays level by a mimic joint, which the chain cannot have."""
    with pytest.raises(po.errors.InputError, match=r"'level' mimics 'j2'.*follows: j2, estimate: \{ratio: 1\}"):
        tip_of(tmp_path, (*ARM[:3], ("level", "revolute", "l3", "end", "-2 2", "j2")))


def test_a_joint_that_follows_one_outside_of_the_chain_is_held(tmp_path: Path) -> None:
    write_urdf(tmp_path, (*ARM, ("bent", "revolute", "l6", "tip", "-2 2", "elsewhere")))
    bent, straight = (UrdfRobot(file="arm.urdf", tip_link=tip).build(tmp_path) for tip in ("tip", "l6"))
    assert bent.n == straight.n == 6
    assert "held at 0.3" in str(bent.notes)
    q = np.linspace(0.1, 0.6, 6)
    T = np.linalg.inv(po.Arm(straight).pose(q)) @ po.Arm(bent).pose(q)
    np.testing.assert_allclose(T[:3, 3], [0, 0.1, 0.2], atol=1e-12)
    np.testing.assert_allclose(np.arctan2(T[1, 0], T[0, 0]), 0.3, atol=1e-12)


def test_two_arms_on_one_torso_are_no_fingers(tmp_path: Path) -> None:
    arms = tuple((f"{s}{n}", k, a if a == "l0" else s + a, s + b, m, "") for s in "ab" for n, k, a, b, m, _ in ARM)
    with pytest.raises(po.errors.InputError, match="2 last links"):
        tip_of(tmp_path, arms)


PUBLISHED = {
    "z1_description/urdf/z1.urdf": ("gripperStator", 6),
    "panda_description/urdf/panda.urdf": ("panda_hand_tcp", 7),
    "xarm_description/urdf/xarm7.urdf": ("link_eef", 7),
    "kinova_description/robots/kinova.urdf": ("j2s6s200_end_effector", 6),
    "so_arm_description/urdf/so100.urdf": ("gripper", 5),
    "ur_description/urdf/ur5_gripper.urdf": ("tool0", 6),
    "tiago_description/robots/tiago.urdf": ("hand_tool_link", 8),
}


@pytest.mark.parametrize("file", PUBLISHED)
def test_chains_of_published_arms(file: str) -> None:
    path = robots_folder() / file
    if not path.exists():
        pytest.skip("this version of example-robot-data lacks it")
    tree = read_urdf(path)
    (base,) = tree.roots()
    tip = chosen_tip(tree, base).link
    assert (tip, sum(joint.type != "fixed" for joint in tree.path(base, tip))) == PUBLISHED[file]


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
