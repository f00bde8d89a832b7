"""Robot formats: DH and MDH tables against the textbooks, URDF against Pinocchio, bad input against its message."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

import posture_opt as po
from posture_opt.robot import RobotSpec, UrdfRobot
from tests.helpers.factors import frame, parameter_jacobian, pose
from tests.helpers.pin import BARE, PinArm, robots_folder
from tests.helpers.urdfs import urdf_text

ROUNDING = 1e-12  # dozens of factors of rounding 1e-16, metres and radians of order one
ROW = {"name": "j", "a": "0.3 m", "alpha": "40 deg", "d": "0.2 m", "theta": "-25 deg"}
SLIDE = ROW | {"type": "prismatic", "limits": ["0 mm", "300 mm"]}


def read(section):
    return TypeAdapter(RobotSpec).validate_python(section)


def textbook_dh(theta, d, a, alpha):
    """Siciliano et al., Robotics (2009), equation 2.52."""
    ct, st, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
    return np.array([[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]])


def textbook_mdh(theta, d, a, alpha):
    """Craig, Introduction to Robotics (2005), equation 3.6."""
    ct, st, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
    return np.array([[ct, -st, 0, a], [st * ca, ct * ca, -sa, -sa * d], [st * sa, ct * sa, ca, ca * d], [0, 0, 0, 1]])


@pytest.mark.parametrize(("kind", "textbook"), [("dh", textbook_dh), ("mdh", textbook_mdh)])
@pytest.mark.parametrize("row", [ROW, SLIDE])
def test_table_rows_are_those_of_the_textbook(kind, textbook, row):
    robot = read({"kind": kind, "joints": [row]}).build(Path())
    q, theta, d = 0.17, math.radians(-25), 0.2
    values = (theta, d + q) if row is SLIDE else (theta + q, d)
    expected = textbook(*values, 0.3, math.radians(40))
    np.testing.assert_allclose(pose(robot, [q]), expected, atol=ROUNDING)


@pytest.mark.parametrize(("kind", "textbook"), [("dh", textbook_dh), ("mdh", textbook_mdh)])
def test_each_parameter_is_the_error_of_its_column(kind, textbook):
    robot = read({"kind": kind, "joints": [ROW]}).build(Path())
    nominal = {"theta": math.radians(-25), "d": 0.2, "a": 0.3, "alpha": math.radians(40)}
    for name in nominal:
        expected = textbook(**(nominal | {name: nominal[name] + 0.01}))
        np.testing.assert_allclose(pose(robot, [0.0], {f"j.{name}": 0.01}), expected, atol=ROUNDING)


def test_base_and_tool_frame_the_arm():
    frames = {"base": {"xyz": ["1 m", "0 m", "0 m"], "rpy": ["0 deg", "0 deg", "90 deg"]}, "tool": {"xyz": ["0 m"] * 3}}
    plain = read({"kind": "dh", "joints": [ROW]}).build(Path())
    robot = read({"kind": "dh", "joints": [ROW], **frames}).build(Path())
    T_world_base = np.array([[0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    np.testing.assert_allclose(pose(robot, [0.4]), T_world_base @ pose(plain, [0.4]), atol=ROUNDING)
    assert {f"base.{p}" for p in ("x", "y", "z", "roll", "pitch", "yaw")} <= set(robot.parameters)
    assert {f"tool.{p}" for p in ("x", "y", "z", "roll", "pitch", "yaw")} <= set(robot.parameters)


@pytest.mark.parametrize(("section", "place", "message"), [
    ({"joints": []}, "joints", "at least one joint"),
    ({"joints": [ROW | {"name": f"j{i}"} for i in range(21)]}, "joints", "21 joints"),
    ({"joints": [ROW, ROW]}, "joints", "given twice: j"),
    ({"joints": [ROW | {"name": "a:b"}]}, "name", "'a:b' holds ':'"),
    ({"joints": [ROW | {"name": "tool"}]}, "name", "taken by the tool frame"),
    ({"joints": [ROW | {"name": ""}]}, "name", "must not be empty"),
    ({"joints": [ROW | {"limits": ["10 deg", "-10 deg"]}]}, "limits", "crossed"),
    ({"joints": [ROW | {"limits": ["0 mm", "10 mm"]}]}, "limits", "not a unit of angle"),
    ({"joints": [SLIDE | {"limits": ["0 deg", "10 deg"]}]}, "limits", "not a unit of length"),
    ({"joints": [ROW | {"type": "prismatic"}]}, "limits", "needs its limits"),
    ({"joints": [ROW | {"type": "ball"}]}, "type", "'revolute' or 'prismatic'"),
    ({"joints": [ROW | {"mass": "-1 kg"}]}, "mass", "not negative"),
    ({"joints": [ROW | {"gear_ratio": 0}]}, "gear_ratio", "not zero"),
    ({"joints": [ROW | {"lenght": "1 m"}]}, "lenght", "Extra inputs"),
    ({"joints": [ROW], "payload": "-1 kg"}, "payload", "not negative"),
    ({"joints": [ROW], "gravity": [0, 0, math.nan]}, 2, "finite"),
    ({"joints": [ROW], "tool": "fixed"}, "tool", "'fixed' is no frame"),
])  # fmt: skip
def test_bad_tables(section, place, message):
    with pytest.raises(ValidationError) as caught:
        read({"kind": "dh", **section})
    (fault,) = caught.value.errors()
    assert fault["loc"][-1] == place
    assert message in fault["msg"]


ARMS = [
    # file below example-robot-data/robots, base link, tip link (None: by default), joints
    ("ur_description/urdf/ur3_robot.urdf", "base_link", "ee_link", 6),
    ("ur_description/urdf/ur10_robot.urdf", None, None, 6),
    ("ur_description/urdf/ur5_gripper.urdf", "base_link", "tool0", 6),
    ("panda_description/urdf/panda.urdf", None, "panda_hand_tcp", 7),
    ("panda_description/urdf/panda.urdf", None, "panda_leftfinger", 8),  # prismatic finger
    ("kinova_description/robots/kinova.urdf", None, "j2s6s200_end_effector", 6),  # continuous joints
    ("xarm_description/urdf/xarm7.urdf", None, None, 7),
    ("z1_description/urdf/z1.urdf", None, "gripperMover", 7),
    ("so_arm_description/urdf/so101.urdf", None, "gripper_frame_link", 5),
    ("talos_data/robots/talos_reduced.urdf", None, "gripper_right_base_link", 9),
    ("tiago_description/robots/tiago.urdf", None, "wrist_ft_tool_link", 8),  # prismatic torso
    ("baxter_description/urdf/baxter.urdf", None, "left_gripper", 7),
    ("pr2_description/urdf/pr2.urdf", "base_link", "r_gripper_tool_frame", 8),  # prismatic torso, continuous wrist
    ("icub_description/robots/icub.urdf", None, "l_hand_dh_frame", 10),  # axes askew
    ("human_description/robots/human.urdf", None, "left_hand", 13),
    ("g1_description/urdf/g1_29dof_rev_1_0.urdf", None, "left_rubber_hand", 10),
    ("hextilt_description/urdf/hextilt_flying_arm_5.urdf", None, None, 5),
]


# Capsules about meshes take most of the time, and have tests of their own.
@pytest.mark.parametrize(("file", "base", "tip", "joints"), ARMS)
def test_urdf_arms_agree_with_pinocchio(file, base, tip, joints):
    path = robots_folder() / file
    robot = UrdfRobot(file=path.name, base_link=base, tip_link=tip, shape=BARE).build(path.parent)
    assert robot.n == joints
    base, tip = (dict(robot.sources)[link] for link in ("base_link", "tip_link"))
    arm = PinArm(path)
    for q in np.random.default_rng(1).uniform(robot.lower, robot.upper, (5, robot.n)):
        expected = arm.pose(dict(zip(robot.joint_names, q, strict=True)), base, tip)
        np.testing.assert_allclose(pose(robot, q), expected, atol=ROUNDING)


@pytest.mark.parametrize(("file", "tip"), [
    ("ur_description/urdf/ur10_robot.urdf", "tool0"),
    ("panda_description/urdf/panda.urdf", "panda_link8"),  # the hand is fixed to link 7, off the chain
    ("tiago_description/robots/tiago.urdf", "wrist_ft_tool_link"),
])  # fmt: skip
def test_urdf_masses_agree_with_pinocchio(file, tip):
    path = robots_folder() / file
    robot = UrdfRobot(file=str(path), tip_link=tip, shape=BARE).build(Path())
    base = dict(robot.sources)["base_link"]
    arm, q = PinArm(path), np.random.default_rng(2).uniform(robot.lower, robot.upper)
    for index, joint in enumerate(robot.joints):
        mass, centre = arm.centre(dict(zip(robot.joint_names, q, strict=True)), joint.name, base)
        assert joint.mass == pytest.approx(mass, rel=1e-12)
        np.testing.assert_allclose((frame(robot, q, index) @ [*joint.com, 1.0])[:3], centre, atol=ROUNDING)


ORIGIN = ((0.1, -0.2, 0.3), (0.4, -0.5, 0.6))


@pytest.mark.parametrize("rpy", [(0.4, -0.5, 0.6), (0.3, math.pi / 2, 0.2), (0.3, -math.pi / 2, 0.2),
                                 (0.0, 1.57079632679, 0.0), (3.0, 1.57079632, -2.0)])  # fmt: skip
@pytest.mark.parametrize("axis", [(0, -1, 0), (-1, 0, 0), (0, 0, -2), (1, 2, -3), (0, 1, 1e-9)])
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_urdf_axes_and_origins(tmp_path, kind, axis, rpy):
    rows = [("lift", *ORIGIN, axis, None), ("bend", ORIGIN[0], rpy, axis, None), ("tip", *ORIGIN, None, None)]
    text = urdf_text(rows).replace('"revolute"', f'"{kind}"')
    (tmp_path / "arm.urdf").write_text(text)
    robot, arm = UrdfRobot(file="arm.urdf").build(tmp_path), PinArm(text)
    for q in ([0.0, 0.0], [0.7, -1.3]):
        expected = arm.pose({"lift": q[0], "bend": q[1]}, "base", "link3")
        np.testing.assert_allclose(pose(robot, q), expected, atol=ROUNDING)


def test_urdf_parameters_are_the_errors_of_the_origin(tmp_path):
    def built(xyz, rpy):
        (tmp_path / "arm.urdf").write_text(urdf_text([("j", xyz, rpy, (0, 1, 0), None)]))
        return UrdfRobot(file="arm.urdf").build(tmp_path)

    for xyz, rpy in (ORIGIN, (ORIGIN[0], (0.4, 0.0, 0.6)), (ORIGIN[0], (0.4, math.pi / 2, 0.6))):
        nominal = built(xyz, rpy)
        # An error of roll is one of the number only without pitch; its own test is the next.
        for i, name in enumerate(("x", "y", "z", "yaw", "pitch", "roll")[: 5 + (rpy[1] == 0)]):
            numbers = [*xyz, *rpy[::-1]]
            numbers[i] += 0.01
            expected = pose(built(tuple(numbers[:3]), tuple(numbers[:2:-1])), [0.3])
            np.testing.assert_allclose(pose(nominal, [0.3], {f"j.{name}": 0.01}), expected, atol=ROUNDING)
        np.testing.assert_allclose(pose(nominal, [0.3], {"j.theta": 0.01}), pose(nominal, [0.31]), atol=ROUNDING)


def test_a_sigma_of_urdf_angles_has_one_meaning_at_every_pitch(tmp_path):
    """The spread of a tool point that stands still while the pitch of a joint's origin is swept through 90°."""
    sigma = {"j.roll": 1e-3, "j.pitch": 2e-3, "j.yaw": 0.5e-3}
    found = []
    for pitch in np.linspace(1.45, 1.65, 81).tolist():
        rows = [
            ("j", (0.1, 0, 0.3), (0.3, pitch, 0.2), (0, 0, 1), None),
            ("tip", (0.2, 0.3, 0.1), (0, 0, 0), None, None),
        ]
        (tmp_path / "arm.urdf").write_text(urdf_text(rows))
        robot = UrdfRobot(file="arm.urdf").build(tmp_path)
        T = pose(robot, [0.0])
        lever = T[:3, 3] - [0.1, 0, 0.3]
        axes = {
            "roll": [math.cos(0.2), math.sin(0.2), 0],
            "pitch": [-math.sin(0.2), math.cos(0.2), 0],
            "yaw": [0, 0, 1],
        }
        expected = sum(np.outer(v, v) for v in (sigma[f"j.{k}"] * np.cross(a, lever) for k, a in axes.items()))
        J = parameter_jacobian(robot, [0.0], list(sigma))
        C = J @ np.diag(np.square(list(sigma.values()))) @ J.T
        np.testing.assert_allclose(C, expected, atol=1e-12)
        found.append(math.sqrt(np.linalg.eigvalsh(C)[-1]))
    # Neighbours are 2.5 mrad apart in pitch, and a turn of the lever by that changes sigma by no larger a part.
    assert np.max(np.abs(np.diff(found))) < 5e-3 * np.max(found)


def test_urdf_limits(tmp_path):
    rows = [(name, (0, 0, 0.1), (0, 0, 0), (0, 0, 1), None) for name in ("a", "b", "c")]
    text = urdf_text(rows).replace('lower="-3" upper="3"', 'lower="-1" upper="2"', 1)
    text = text.replace('"b" type="revolute"', '"b" type="continuous"').replace('lower="-3" upper="3"', "", 1)
    text = text.replace('<limit lower="-3" upper="3" effort="1" velocity="1"/>', "")
    (tmp_path / "arm.urdf").write_text(text)
    robot = UrdfRobot(file="arm.urdf").build(tmp_path)
    turn = 2 * math.pi
    assert (robot.lower, robot.upper) == ((-1.0, -turn, -turn), (2.0, turn, turn))
    assert [note.split()[1] for note in robot.notes] == ["c"]
    assert all(math.isnan(joint.mass) for joint in robot.joints)


LINK = '<link name="{}"/>'
GOOD = urdf_text([("j", (0, 0, 1), (0, 0, 0), (0, 0, 1), None)])
CHAIN = urdf_text([(name, (0, 0, 1), (0, 0, 0), (0, 0, 1), None) for name in ("first", "second")])


@pytest.mark.parametrize(("text", "message"), [
    ("", "not XML"),
    ("<robot name='x'><link name='a'></robot>", "not XML"),
    ("<sdf version='1.7'/>", "begins with <sdf>"),
    ('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>',
     "1: this is a xacro file, not a URDF: it holds <xacro:arm> – expand it first"),
    ("<robot name='x'/>", "no <link>"),
    (GOOD.replace('name="link1"', 'name="base"'), "two links are named 'base'"),
    (CHAIN.replace('name="second"', 'name="first"'), "two joints are named 'first'"),
    (CHAIN.replace('<parent link="link1"/><child link="link2"/>', '<parent link="base"/><child link="link1"/>'),
     "is the child of two joints"),
    (CHAIN.replace('<parent link="base"/>', '<parent link="link2"/>').replace('<link name="base"/>', ""),
     "closed loop"),
    (GOOD.replace('<child link="link1"/>', '<child link="hand"/>'), "'hand' that the file does not have"),
    (GOOD.replace('<child link="link1"/>', ""), "4: joint 'j' has no <child> – write <child link"),
    (GOOD.replace('<child link="link1"/>', "<child/>"), "<child> of joint 'j' lacks its link"),
    (GOOD.replace('xyz="0 0 1"', 'xyz="0 0 one"'),
     '4: joint \'j\': <origin xyz="0 0 one"> does not hold 3 finite numbers'),
    (GOOD.replace('lower="-3"', 'lower=""'), '<limit lower=""> does not hold one finite number'),
    (GOOD.replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"'), "axis of length zero"),
    (GOOD.replace('lower="-3"', 'lower="4"'), "crossed"),
    (GOOD.replace('name="j"', 'name="j[1]"'), "'j[1]' holds '['"),
    (GOOD.replace('"revolute"', '"fixed"'), "no joint moves"),
    (GOOD.replace('"revolute"', '"planar"'), "'j' is planar"),
    (GOOD.replace('"revolute"', '"prismatic"').replace('lower="-3"', ""), "no limits"),
    (CHAIN.replace("</joint>\n</robot>", '<mimic joint="first"/></joint></robot>'), "mimics 'first'"),
    (GOOD.replace("</robot>", LINK.format("lonely") + "</robot>"), "2 root links"),
    (urdf_text([(f"j{i}", (0, 0, 1), (0, 0, 0), (0, 0, 1), None) for i in range(21)]), "21 joints are more than"),
    ('<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>',
     "1: a robot description has no DOCTYPE and no entities – remove <!DOCTYPE"),
    ('<?xml version="1.0" encoding="utf-9"?><robot name="x"/>', "unknown encoding: utf-9"),
    ("<robot>" + "<a/>" * 100_000 + "</robot>", "more than 100000 elements"),
    ("<robot>" + "<a>" * 100 + "</a>" * 100 + "</robot>", "1: more than 100 elements stand inside each other"),
    (GOOD.replace("</robot>", '<link name="a"/><link name="b"/><joint name="k"><parent link="a"/><child link="b"/>'
     '</joint><joint name="l"><parent link="b"/><child link="a"/></joint></robot>'), "closed loop, 'k' among them"),
])  # fmt: skip
def test_bad_urdf_files(tmp_path, text, message):
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.raises(po.errors.InputError) as caught:
        UrdfRobot(file="arm.urdf").build(tmp_path)
    assert message in str(caught.value)
    assert all(issue.key for issue in caught.value.issues)


@pytest.mark.parametrize(("good", "bad"), [
    ('"revolute"', '"planar"'),  # in the chain
    ('xyz="0 0 1"', 'xyz="x"'),  # origin and axis
    ('<parent link="', '<parent link="no_'),
])  # fmt: skip
def test_every_bad_joint_of_a_chain_at_once(good, bad, tmp_path):
    (tmp_path / "arm.urdf").write_text(CHAIN.replace(good, bad))
    with pytest.raises(po.errors.InputError) as caught:
        UrdfRobot(file="arm.urdf").build(tmp_path)
    lines = [issue.message.split(":")[1] for issue in caught.value.issues]
    assert sorted(set(lines)) == ["4", "6"]


@pytest.mark.parametrize(
    "declared", ['<!ENTITY mm "e-3">', '<!ENTITY pi "3.14159">', '<!ENTITY x SYSTEM "/etc/hosts">', ""]
)
def test_no_entity_changes_a_number(declared, tmp_path):
    text = GOOD.replace('xyz="0 0 1"', 'xyz="500&mm; 0 0"', 1)
    (tmp_path / "arm.urdf").write_text(f"<?xml version='1.0'?>\n<!DOCTYPE robot [{declared}]>\n{text}")
    with pytest.raises(po.errors.InputError, match=r"arm\.urdf:2: a robot description has no DOCTYPE and no entities"):
        UrdfRobot(file="arm.urdf").build(tmp_path)


@pytest.mark.parametrize(("keys", "key", "message"), [
    ({"tip_link": "link_1"}, "tip_link", "did you mean 'link1'"),
    ({"base_link": "bass"}, "base_link", "did you mean 'base'"),
    ({"base_link": "link1", "tip_link": "base"}, "tip_link", "no chain from 'link1' to 'base'"),
    ({"tip_link": "link2", "base_link": "link2"}, "file", "no joint is attached to 'link2'"),
])  # fmt: skip
def test_links_that_make_no_chain(tmp_path, keys, key, message):
    (tmp_path / "arm.urdf").write_text(CHAIN)
    with pytest.raises(po.errors.InputError, match=message) as caught:
        UrdfRobot(file="arm.urdf", **keys).build(tmp_path)
    assert caught.value.issues[0].key == (key,)


@pytest.mark.parametrize(
    ("origin", "limit", "beside", "limits", "said"),
    [
        ("0 0 0.2", "-170 170", "", (-170, 170), ["are these degrees?"]),
        ('0 0 0.2" rpy="0 90 0', "-1 1", "", (-1, 1), ["are these degrees?"]),
        ("0 0 200", "-1 1", "", (-1, 1), ["is the file in mm?"]),
        ("0 0 0.2", "-2 2", '<calibration rising="0.05"/>', (-2, 2), ["corrections: j.theta"]),
        ("0 0 0.2", "-2 2", '<safety_controller soft_lower_limit="-1" soft_upper_limit="3"/>', (-1, 2), ["<safety_"]),
        ("0 0 0.2", "-2 2", '<safety_controller soft_lower_limit="0" soft_upper_limit="0"/>', (-2, 2), []),
        ("0 0 0.2", "-2 2", '<calibration rising="0"/>', (-2, 2), []),
    ],
)
def test_what_no_arm_has_and_what_controllers_add_is_noted(tmp_path, origin, limit, beside, limits, said):
    lower, upper = limit.split()
    joint = f'<origin xyz="{origin}"/><axis xyz="0 1 0"/><limit lower="{lower}" upper="{upper}"/>{beside}'
    links = '<link name="a"/><link name="b"/>'
    joint = f'<joint name="j" type="revolute"><parent link="a"/><child link="b"/>{joint}</joint>'
    (tmp_path / "r.urdf").write_text(f'<robot name="r">{links}{joint}</robot>', encoding="utf-8")
    robot = UrdfRobot(file="r.urdf").build(tmp_path)
    assert (robot.lower[0], robot.upper[0]) == limits
    assert len(robot.notes) == len(said)
    assert all(part in note for part, note in zip(said, robot.notes, strict=True))


@pytest.mark.parametrize(("mass", "payload", "refused"), [("20 kg", "61 kg", True), ("20 kg", "59 kg", False)])
def test_a_payload_that_no_arm_of_its_mass_carries_is_in_grams(mass, payload, refused):
    row = {"name": "j1", "type": "revolute", "a": "1 m", "mass": mass, "com": ["0.5 m", "0 m", "0 m"]}
    document = {"robot": {"kind": "dh", "joints": [row], "payload": payload}}
    if not refused:
        assert po.problem_from_dict(document).robot.payload == 59
        return
    with pytest.raises(po.errors.InputError, match="no arm like this one carries 61 kg") as caught:
        po.problem_from_dict(document)
    assert caught.value.issues[0].key == ("robot", "payload")
