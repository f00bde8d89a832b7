"""Presets against what others publish: URDF descriptions through Pinocchio, poses in books and data sheets."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.robot import PresetRobot, preset_names, preset_text
from posture_opt.robot.preset import PresetFile
from tests.helpers.factors import elementary, frame, pose, random_postures
from tests.helpers.pin import PinArm, robots_folder
from tests.helpers.shipped import preset_robot
from tests.helpers.urdf_chains import CHAINS
from tests.helpers.urdfs import IIWA14, IRB120, UNIVERSAL_ROBOTS, urdf_text

ALL = [
    "crb15000", "crx10ia", "gen3", "gp25", "gp7", "iiwa14", "iiwa7", "irb120", "irb1200", "irb1600", "irb6700",
    "kr10_r1100", "kr210_r2700", "kr6_r900", "lrmate200id", "m1013", "m10id", "panda", "planar_2r", "puma560",
    "r2000ic", "scara", "ts2_60", "tx2_60", "tx2_90", "ur10", "ur10e", "ur16e", "ur20", "ur3e", "ur5", "ur5e", "vs060",
    "vs087", "xarm6", "xarm7",
]  # fmt: skip
ROUNDING = 1e-12  # a few dozen factors of rounding 1e-16 each


def at(robot, degrees):
    return pose(robot, np.radians(degrees))


@pytest.mark.parametrize("name", ALL)
def test_every_preset_says_where_it_is_from(name):
    robot = preset_robot(name)
    groups = {group for group, _ in robot.sources}
    assert {"geometry", "limits", "masses"} <= groups
    assert all(joint.lower < joint.upper for joint in robot.joints)
    assert len(robot.parameters) == len([f for f in robot.factors if f.parameter])
    assert sorted(f.joint for f in robot.factors if f.joint is not None) == list(range(robot.n))
    if robot.repeatability:
        assert robot.repeatability.source
        assert 5e-6 <= robot.repeatability.value <= 5e-4


@pytest.mark.parametrize(("name", "millimetres"), [
    ("ur5", 0.1), ("ur10", 0.1), ("ur5e", 0.03), ("ur10e", 0.05), ("panda", 0.1), ("iiwa14", 0.15), ("irb120", 0.01),
    ("puma560", 0.1), ("scara", 0.01),
])  # fmt: skip
def test_repeatability_of_the_data_sheet(name, millimetres):
    assert preset_robot(name).repeatability.value == pytest.approx(1e-3 * millimetres)


@pytest.mark.parametrize("name", ALL)
def test_rated_payload_and_repeatability_have_their_sources(name):
    """What was written down without its document says so, in a field and in words."""
    given = PresetFile.model_validate(yaml.load(preset_text(name), yaml.CSafeLoader))
    if given.rated_payload:
        assert f"{given.rated_payload.value:g} kg" in given.rated_payload.source
    if given.repeatability:
        assert given.repeatability.verified == ("unverified" not in given.repeatability.source)


@pytest.mark.parametrize("name", ["kr6_r900", "gen3"])
def test_a_turned_first_frame_is_no_part_of_the_base(name):
    """A base that the problem states stands in front of it, and it carries no parameter."""
    stated = PresetRobot.model_validate({"name": name, "base": {"xyz": ["1 m", "0 m", "0 m"]}}).build(Path())
    q, plain = np.linspace(-0.3, 0.4, stated.n), preset_robot(name)
    shifted = pose(plain, q)
    shifted[0, 3] += 1.0
    np.testing.assert_allclose(pose(stated, q), shifted, atol=ROUNDING)
    assert plain.links[0][0].parameter == ""


@pytest.mark.parametrize(("typed", "meant"), [
    ("KR 210", "'kr210_r2700'"), ("kuka_kr6", "'kr6_r900'"), ("abb irb-120", "'irb120'"), ("irb140", "'irb120'"),
    ("gofa", "'crb15000'"), ("denso", "'vs060' or 'vs087'"), ("panta", "'panda'"),
    ("FANUC", "'crx10ia', 'lrmate200id', 'm10id' or 'r2000ic'"),
])  # fmt: skip
def test_a_mistyped_name_or_a_maker_finds_its_arms(typed, meant):
    with pytest.raises(
        po.errors.InputError, match=f"there is no preset .* did you mean {meant}\\? presets: crb15000, "
    ):
        preset_robot(typed)


def test_keys_beside_the_name_replace_those_of_the_preset():
    spec = PresetRobot.model_validate({"name": "panda", "tool": {"xyz": ["0 m", "0 m", "100 mm"]}, "payload": "2 kg"})
    robot, plain = spec.build(Path()), preset_robot("panda")
    q = np.linspace(-0.3, 0.4, 7)
    step = np.linalg.inv(pose(plain, q)) @ pose(robot, q)
    np.testing.assert_allclose(step[:3, 3], [0, 0, 0.1], atol=ROUNDING)
    assert (robot.payload, plain.payload) == (2.0, 0.0)
    assert PresetRobot.model_validate({"name": "panda", "base": "free"}).build(Path()).base_free


@pytest.mark.parametrize(("name", "rows"), UNIVERSAL_ROBOTS.items())
def test_universal_robots_against_their_own_kinematics(name, rows):
    robot, arm = preset_robot(name), PinArm(urdf_text(rows))
    for q in random_postures(robot, 10):
        expected = arm.pose(dict(zip(robot.joint_names, q, strict=True)), "base", "link6")
        np.testing.assert_allclose(pose(robot, q), expected, atol=ROUNDING)


@pytest.mark.parametrize(("name", "rows"), [("irb120", IRB120), ("iiwa14", IIWA14)])
def test_against_ros_industrial(name, rows):
    robot, arm = preset_robot(name), PinArm(urdf_text(rows))
    for q in random_postures(robot, 10):
        expected = arm.pose(dict(zip(robot.joint_names, q, strict=True)), "base", f"link{len(rows)}")
        np.testing.assert_allclose(pose(robot, q), expected, atol=ROUNDING)


@pytest.mark.parametrize(("name", "rows"), CHAINS.items())
def test_against_the_description_of_the_maker_or_of_ros(name, rows):
    """All the way from the controller's base to the face of the flange, orientation included."""
    robot, arm = preset_robot(name), PinArm(urdf_text(rows))
    moving = [joint for joint, _, _, axis, _ in rows if axis]
    assert robot.joint_names == tuple(moving)
    for q in random_postures(robot, 10):
        expected = arm.pose(dict(zip(moving, q, strict=True)), "base", f"link{len(rows)}")
        np.testing.assert_allclose(pose(robot, q), expected, atol=1e-9)  # lengths of one file have nine decimals


def test_every_arm_is_held_against_a_description_or_a_book():
    by_book = {"irb120", "iiwa14", "panda", "puma560", "scara", "ts2_60", "planar_2r"}
    assert {*CHAINS, *UNIVERSAL_ROBOTS} | by_book == set(ALL)


def test_panda_against_franka_description():
    robot = preset_robot("panda")
    arm = PinArm(robots_folder() / "panda_description" / "urdf" / "panda.urdf")
    for q in random_postures(robot, 10):
        named = dict(zip(robot.joint_names, q, strict=True))
        np.testing.assert_allclose(pose(robot, q), arm.pose(named, "panda_link0", "panda_link8"), atol=ROUNDING)
    np.testing.assert_allclose(robot.lower, arm.model.lowerPositionLimit[:7])
    np.testing.assert_allclose(robot.upper, arm.model.upperPositionLimit[:7])


def check_centres(robot, arm, base, joints):
    q = random_postures(robot, 1)[0]
    for index in joints:
        mass, centre = arm.centre(dict(zip(robot.joint_names, q, strict=True)), robot.joints[index].name, base)
        here = frame(robot, q, index) @ np.append(robot.joints[index].com, 1.0)
        assert robot.joints[index].mass == pytest.approx(mass, rel=1e-9)
        np.testing.assert_allclose(here[:3], centre, atol=2e-7)  # the files give the centres to 0.1 µm at best


def test_masses_of_panda():
    arm = PinArm(robots_folder() / "panda_description" / "urdf" / "panda.urdf")
    check_centres(preset_robot("panda"), arm, "panda_link0", range(6))  # link 7 carries the hand in that file


def test_mass_of_the_last_link_of_panda():
    last = preset_robot("panda").joints[6]
    # panda.urdf, panda_link7: 0.735522 kg at (1.0517e-02, -4.252e-03, 6.1597e-02), 107 mm before the flange
    assert last.mass == 0.735522
    np.testing.assert_allclose(last.com, [1.0517e-02, -4.252e-03, 6.1597e-02 - 0.107], atol=1e-12)


WITH_MASSES = {"irb120": IRB120, **UNIVERSAL_ROBOTS, **{k: v for k, v in CHAINS.items() if any(row[4] for row in v)}}


@pytest.mark.parametrize(("name", "rows"), WITH_MASSES.items())
def test_masses_against_ros_descriptions(name, rows):
    robot = preset_robot(name)
    check_centres(robot, PinArm(urdf_text(rows)), "base", range(robot.n))


@pytest.mark.parametrize(("degrees", "position"), [
    ((0, 0, 0, 0, 0, 0), (0.4521, -0.1500, 0.4318)),
    ((0, 90, -90, 0, 0, 0), (0.0203, -0.1500, 0.8636)),
    ((0, 45, -180, 0, 45, 0), (0.5963, -0.1501, -0.0144)),
])  # fmt: skip
def test_puma_poses_in_the_book(degrees, position):
    # Corke, Robotics, Vision and Control (2011), section 7.2: qz, qr and qn of p560, printed to 0.1 mm
    np.testing.assert_allclose(at(preset_robot("puma560"), degrees)[:3, 3], position, atol=1.01e-4)


def test_irb120_limits_of_ros_industrial():
    # irb120_3_58_macro.xacro: degrees of the data sheet in radians with five digits
    robot = preset_robot("irb120")
    np.testing.assert_allclose(robot.lower, [-2.87979, -1.91986, -1.91986, -2.79253, -2.094395, -6.98132], atol=1e-5)
    np.testing.assert_allclose(robot.upper, [2.87979, 1.91986, 1.22173, 2.79253, 2.094395, 6.98132], atol=1e-5)


def test_iiwa_limits_of_ros_industrial():
    # lbr_iiwa_14_r820_macro.xacro: 170, 120 and 175 deg, each 0.02 deg inside
    robot = preset_robot("iiwa14")
    np.testing.assert_allclose(robot.upper, [2.9668, 2.0942, 2.9668, 2.0942, 2.9668, 2.0942, 3.0541], atol=5e-4)
    np.testing.assert_allclose(robot.lower, np.negative(robot.upper))


def test_scara_work_envelope():
    """Epson's table for the GX4-A351: innermost radius 142 mm, reach to the back 298.5 mm, outermost 350 mm."""
    robot = preset_robot("scara")

    def tool(theta1, theta2, stroke=0.0):
        return pose(robot, [np.radians(theta1), np.radians(theta2), stroke, 0.0])

    limit1, limit2 = np.degrees(robot.upper[:2])
    assert np.hypot(*tool(0, limit2)[:2, 3]) == pytest.approx(0.142, abs=5e-4)
    assert -tool(limit1, 180 - limit1)[0, 3] == pytest.approx(0.2985, abs=5e-5)
    np.testing.assert_allclose(tool(0, 0)[:3, 3], [0.35, 0, 0], atol=ROUNDING)
    np.testing.assert_allclose(tool(0, 0, robot.upper[2])[:3, 3], [0.35, 0, -0.15], atol=ROUNDING)
    np.testing.assert_allclose(tool(30, -20)[:3, 2], [0, 0, -1], atol=ROUNDING)


def test_ts2_60_by_the_rows_of_the_catalogue():
    """Craig's rows: a of 380 and 240 mm before joints 2 and 3, 123 mm of height, half a turn about x before joint 4."""
    robot = preset_robot("ts2_60")
    for q in random_postures(robot, 10):
        upper = elementary("rotate", 2, q[0]) @ elementary("translate", 0, 0.38) @ elementary("rotate", 2, q[1])
        lower = elementary("translate", 0, 0.24) @ elementary("translate", 2, 0.123 + q[2])
        shaft = elementary("rotate", 0, np.pi) @ elementary("rotate", 2, q[3])
        np.testing.assert_allclose(pose(robot, q), upper @ lower @ shaft, atol=ROUNDING)
    assert at(robot, (0, 0, 0, 0))[0, 3] == pytest.approx(0.62)  # the reach that Stäubli names its arm after


# --- Largest joint speeds: data sheets as others copied them, URDF files, and what a problem file says instead --------

UNKNOWN = {"planar_2r", "puma560", "scara", "ts2_60"}  # none is published, or none was at hand


def problem(robot):
    return po.problem_from_dict({"robot": robot, "task": {"kind": "insert"}})


@pytest.mark.parametrize("name", preset_names())
def test_a_speed_has_its_source(name):
    robot = preset_robot(name)
    known = [not math.isnan(v) for v in robot.velocities]
    assert all(known) == ("velocity" in dict(robot.sources)) == (name not in UNKNOWN)
    assert all(0.5 < v < 26 for v, yes in zip(robot.velocities, known, strict=True) if yes)


@pytest.mark.parametrize(
    ("name", "file"), [("panda", "panda_description/urdf/panda.urdf"), ("ur10", "ur_description/urdf/ur10_robot.urdf")]
)
def test_speeds_are_those_of_the_urdf_of_others(name, file):
    model = PinArm(robots_folder() / file).model
    stated = np.array(model.velocityLimit[: preset_robot(name).n])
    np.testing.assert_allclose(preset_robot(name).velocities, stated, rtol=0.08)  # that UR10 rounds 120 deg/s to 2.16


def test_a_urdf_brings_its_speeds(tmp_path):
    joint = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><axis xyz="0 0 1"/>{4}</joint>'
    limits = ['<limit lower="-1" upper="1" velocity="2.5"/>', '<limit lower="0" upper="0.3" velocity="0.4"/>',
              '<limit lower="-1" upper="1"/>', '<limit lower="-1" upper="1" velocity="0"/>']  # fmt: skip
    kinds = ["revolute", "prismatic", "revolute", "revolute"]
    joints = [joint.format(f"j{k}", kinds[k], f"l{k}", f"l{k + 1}", limits[k]) for k in range(4)]
    links = "".join(f'<link name="l{k}"/>' for k in range(5))
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{links}{"".join(joints)}</robot>')
    robot = problem({"kind": "urdf", "file": str(tmp_path / "arm.urdf")}).robot
    np.testing.assert_array_equal(robot.velocities, [2.5, 0.4, np.nan, np.nan])


@pytest.mark.parametrize(
    ("velocity", "message"),
    [
        ({"joint1": "720 mm/s"}, "robot.velocity.joint1: 'mm/s' is not a unit of angular velocity"),
        ({"joint3": "1 deg/s"}, "robot.velocity.joint3: 'deg/s' is not a unit of velocity"),
        ({"jiont1": "1 deg/s"}, "did you mean 'joint1'"),
        ({"joint1": 5}, "write 5 deg/s or 5 rad/s"),
        ({"joint1": "0 deg/s"}, "above zero"),
    ],
)
def test_what_is_no_speed_is_refused(velocity, message):
    with pytest.raises(po.errors.InputError, match=re.escape(message)):
        problem({"kind": "preset", "name": "scara", "velocity": velocity})
