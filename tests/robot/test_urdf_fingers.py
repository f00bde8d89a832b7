"""Fingers of a gripper end the chain of a URDF: by name, as two alike, as coupled, as a short slide."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

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
    "two slides alike": (
        ("m1", "prismatic", "l6", "a", "0 0.2", ""),
        ("m2", "prismatic", "l6", "b", "0 0.2", ""),
    ),
    "two alike of two joints each": (
        ("m1", "revolute", "l6", "a", "0 0.8", ""),
        ("m2", "revolute", "l6", "b", "0 0.8", ""),
        ("m3", "revolute", "a", "c", "0 0.8", ""),
        ("m4", "revolute", "b", "d", "0 0.8", ""),
    ),
    "one that mimics a named one": (
        ("left_finger", "revolute", "l6", "a", "0 0.8", ""),
        ("pad", "revolute", "l6", "b", "-0.8 0", "left_finger"),
    ),
    "one that a named one mimics": (
        ("drive", "revolute", "l6", "a", "0 0.8", ""),
        ("right_finger", "revolute", "l6", "b", "0 0.7", "drive"),
    ),
    "a short slide at the end": (("m1", "prismatic", "l6", "a", "0 0.03", ""),),
}


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
