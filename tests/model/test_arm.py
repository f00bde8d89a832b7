"""The forward model against Pinocchio, plain products of factors, complex steps and its own symbols."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pinocchio
import pytest

import posture_opt as po
from posture_opt.model.chain import Shell, factor_values, walk
from posture_opt.robot import UrdfRobot
from tests.helpers.factors import pose, random_postures
from tests.helpers.pin import BARE, PinArm, robots_folder
from tests.helpers.shipped import preset_robot
from tests.helpers.variants import STRUCTURES

ROUNDING = 1e-12  # dozens of factors of rounding 1e-16, metres and radians of order one
URDFS = [
    ("ur_description/urdf/ur10_robot.urdf", "base_link", "tool0"),
    ("panda_description/urdf/panda.urdf", "panda_link0", "panda_hand_tcp"),
    ("tiago_description/robots/tiago.urdf", "base_footprint", "wrist_ft_tool_link"),  # with a prismatic torso
    ("z1_description/urdf/z1.urdf", "link00", "link06"),
]


def read(file, base, tip):
    return UrdfRobot(file=str(robots_folder() / file), base_link=base, tip_link=tip, shape=BARE).build(Path())


@pytest.mark.parametrize(("file", "base", "tip"), URDFS)
def test_pose_and_jacobian_are_pinocchio_s(file, base, tip):
    robot, outside = read(file, base, tip), PinArm(robots_folder() / file)
    arm = po.Arm.from_problem(SimpleNamespace(arm=po.Arm(robot)))
    for q in random_postures(robot, 20):
        named = dict(zip(robot.joint_names, q, strict=True))
        np.testing.assert_allclose(arm.pose(q), outside.pose(named, base, tip), atol=ROUNDING)
        np.testing.assert_allclose(arm.jacobian(q), pinocchio_jacobian(outside, named, base, tip), atol=ROUNDING)


def pinocchio_jacobian(outside, named, base, tip):
    """(6, n) of the tip, axes of the base link, columns in the order of the names."""
    model, data = outside.model, outside.data
    full = pinocchio.computeFrameJacobian(
        model, data, outside.configuration(named), model.getFrameId(tip), pinocchio.LOCAL_WORLD_ALIGNED
    )
    pinocchio.updateFramePlacements(model, data)
    R = data.oMf[model.getFrameId(base)].rotation.T
    columns = [full[:, model.joints[model.getJointId(name)].idx_v] for name in named]
    return np.array([np.concatenate([R @ column[:3], R @ column[3:]]) for column in columns]).T


@pytest.mark.parametrize("name", STRUCTURES)
def test_pose_is_the_product_of_the_factors(name):
    robot = preset_robot(name)
    arm = po.Arm(robot)
    rng = np.random.default_rng(0)
    for q in random_postures(robot, 3):
        p = rng.normal(0, 0.1, len(arm.parameters))
        expected = pose(robot, q, dict(zip(arm.parameters, p, strict=True)))
        np.testing.assert_allclose(arm.pose(q, p), expected, atol=ROUNDING)
        np.testing.assert_allclose(arm.position(q, p), expected[:3, 3], atol=ROUNDING)


@pytest.mark.parametrize("name", STRUCTURES)
def test_parameter_jacobian_is_the_complex_step(name):
    robot = preset_robot(name)
    arm = po.Arm(robot)
    rng = np.random.default_rng(1)
    (q,) = random_postures(robot, 1)
    p = rng.normal(0, 0.1, len(arm.parameters))
    found = arm.parameter_jacobian(q, p)
    for k, parameter in enumerate(arm.parameters):
        shift, rotation = complex_step(robot, q, dict(zip(arm.parameters, p, strict=True)), parameter)
        np.testing.assert_allclose(found[:, k], [*shift, *rotation], atol=ROUNDING)


@pytest.mark.parametrize("name", STRUCTURES)
def test_jacobian_is_the_complex_step_of_the_joint(name):
    robot = preset_robot(name)
    (q,) = random_postures(robot, 1, seed=2)
    found = po.Arm(robot).jacobian(q)
    joints = {f.joint: f.parameter for f in robot.factors if f.joint is not None}
    for joint in range(robot.n):  # an error of the joint value adds to it
        shift, rotation = complex_step(robot, q, {}, joints[joint])
        np.testing.assert_allclose(found[:, joint], [*shift, *rotation], atol=ROUNDING)


def complex_step(robot, q, p, name, h=1e-30):
    """∂x and the axial vector of ∂R Rᵀ: exact, for the step is too small to matter and nothing is subtracted."""
    values = factor_values(robot.factors, q, {**p, name: np.array([p.get(name, 0.0) + 1j * h])})
    reached = walk(robot.factors, [np.atleast_1d(value) for value in values])
    shift = [complex(np.ravel(entry)[0]).imag / h for entry in reached.position]
    R = np.array([[np.ravel(entry)[0] for entry in column] for column in reached.columns]).T
    W = (R.imag / h) @ R.real.T
    return shift, [W[2, 1], W[0, 2], W[1, 0]]


@pytest.mark.parametrize("name", ["planar_2r", "scara", "ur5e", "panda"])
def test_symbols_give_the_numbers(name):
    robot = preset_robot(name)
    arm = po.Arm(robot)
    p = ca.SX.sym("p", len(arm.parameters))
    outputs = [arm.pose(arm.q, p), arm.jacobian(arm.q, p), arm.parameter_jacobian(arm.q, p), arm.position(arm.q, p)]
    function = ca.Function("f", [arm.q, p], outputs)
    rng = np.random.default_rng(3)
    for q in random_postures(robot, 3):
        given = rng.normal(0, 0.1, len(arm.parameters))
        numbers = [arm.pose(q, given), arm.jacobian(q, given), arm.parameter_jacobian(q, given), arm.position(q, given)]
        for symbols, number in zip(function(q, given), numbers, strict=True):
            np.testing.assert_allclose(symbols.full().reshape(number.shape), number, atol=ROUNDING)


# --- The spheres that bound an arm's reach hold every posture, and hold it closely where the arm can stretch and
# fold

LONG_TOOL = {"xyz": ["1 m", "1 m", "1 m"], "rpy": ["0 deg", "0 deg", "-45 deg"]}


def two_links() -> dict[str, object]:
    joint = {"type": "revolute", "alpha": "0 deg", "d": "0 m", "theta": "0 deg", "limits": ["-180 deg", "180 deg"]}
    joints = [{"name": "j1", "a": "1 m", **joint}, {"name": "j2", "a": "0.4 m", **joint}]
    return {"kind": "dh", "joints": joints}


@pytest.mark.parametrize("name", ["panda", "ur10", "scara", "irb120", "planar_2r"])
@pytest.mark.parametrize("tool", [None, LONG_TOOL])
def test_no_posture_leaves_the_spheres(name: str, tool: dict[str, object] | None) -> None:
    robot = {"kind": "preset", "name": name} | ({"tool": tool} if tool else {})
    arm = po.Arm.from_problem(po.problem_from_dict({"robot": robot}))
    shell = Shell.of(arm.robot)
    Q = np.random.default_rng(3).uniform(arm.robot.lower, arm.robot.upper, (300, arm.robot.n))
    found = np.linalg.norm([np.asarray(arm.pose(q), dtype=float)[:3, 3] - shell.centre for q in Q], axis=1)
    assert shell.least - 1e-12 <= found.min()
    assert found.max() <= shell.most + 1e-12


@pytest.mark.parametrize("x", ["0.3 m", "1.7 m"])
def test_a_target_beyond_the_spheres_is_refused_without_a_random_start(x: str) -> None:
    task = {"kind": "insert", "direction": [0, -1, 0], "position": [x, "0 m", "0 m"]}
    asked = {"robot": two_links(), "uncertainty": {"sigma": {"j1.theta": "1 deg"}}, "task": task}
    with pytest.raises(po.errors.NoSolutionError, match="the target is out of reach by 300 mm") as caught:
        po.select_posture(po.problem_from_dict(asked))
    assert caught.value.solution is not None
    assert caught.value.solution.to_json()["solver"]["starts"] == 0
