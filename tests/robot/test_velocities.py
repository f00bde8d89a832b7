"""Largest joint speeds: data sheets as others copied them, URDF files, and what a problem file says instead."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import posture_opt as po
from posture_opt.robot import load_preset, preset_names
from tests.helpers.pin import PinArm, robots_folder

UNKNOWN = {"planar_2r", "puma560", "scara", "ts2_60"}  # none is published, or none was at hand


def problem(robot):
    return po.problem_from_dict({"robot": robot, "task": {"kind": "insert"}})


@pytest.mark.parametrize("name", preset_names())
def test_a_speed_has_its_source(name):
    robot = load_preset(name)
    known = [not math.isnan(v) for v in robot.velocities]
    assert all(known) == ("velocity" in dict(robot.sources)) == (name not in UNKNOWN)
    assert all(0.5 < v < 26 for v, yes in zip(robot.velocities, known, strict=True) if yes)


@pytest.mark.parametrize(
    ("name", "file"), [("panda", "panda_description/urdf/panda.urdf"), ("ur10", "ur_description/urdf/ur10_robot.urdf")]
)
def test_speeds_are_those_of_the_urdf_of_others(name, file):
    model = PinArm(robots_folder() / file).model
    stated = np.array(model.velocityLimit[: load_preset(name).n])
    np.testing.assert_allclose(load_preset(name).velocities, stated, rtol=0.08)  # that UR10 rounds 120 deg/s to 2.16


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


def test_the_file_has_the_last_word():
    given = {"joint1": "720 deg/s", "joint3": "1100 mm/s"}
    robot = problem({"kind": "preset", "name": "scara", "velocity": given}).robot
    np.testing.assert_allclose(robot.velocities, [4 * math.pi, np.nan, 1.1, np.nan])
    ur = problem({"kind": "preset", "name": "ur5e", "velocity": {"elbow": "30 deg/s"}}).robot
    np.testing.assert_allclose(np.degrees(ur.velocities), [180, 180, 30, 180, 180, 180])


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


def test_a_number_is_given_its_unit():
    changed = problem({"kind": "preset", "name": "scara"}).replace(robot__velocity={"joint1": 2.0, "joint3": 0.5})
    np.testing.assert_allclose(changed.robot.velocities, [2.0, np.nan, 0.5, np.nan])
