"""The forward model against Pinocchio, plain products and complex steps; periodic errors where they were measured."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

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

ARMS = ("planar_2r", "scara", "kr6_r900", "panda")
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


@pytest.mark.parametrize("name", ARMS)
def test_pose_is_the_product_of_the_factors(name):
    robot = preset_robot(name)
    arm = po.Arm(robot)
    rng = np.random.default_rng(0)
    for q in random_postures(robot, 3):
        p = rng.normal(0, 0.1, len(arm.parameters))
        expected = pose(robot, q, dict(zip(arm.parameters, p, strict=True)))
        np.testing.assert_allclose(arm.pose(q, p), expected, atol=ROUNDING)
        np.testing.assert_allclose(arm.position(q, p), expected[:3, 3], atol=ROUNDING)


@pytest.mark.parametrize("name", ARMS)
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


@pytest.mark.parametrize("name", ARMS)
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


@pytest.mark.parametrize("name", ["scara", "panda"])
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


@pytest.mark.parametrize("name", ["panda", "scara", "planar_2r"])
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


AMPLITUDE = 0.6e-3
LOW, HIGH = -23.0, 57.0


def problem(cycles: float = 3.37, measured: tuple[float, float] | None = (LOW, HIGH), **task: Any) -> Any:
    joint = {"type": "revolute", "a": "1 m", "alpha": "0 deg", "d": "0 m", "theta": "0 deg"}
    limits = ["-270 deg", "270 deg"]
    effect: dict[str, Any] = {"kind": "cyclic_error", "joint": "joint1", "cycles": cycles, "centre": "0.3 rad"}
    effect["estimate"] = {"sin": f"{AMPLITUDE} rad", "cos": "0 rad"}
    if measured is not None:
        effect["measured_range"] = [f"{end} deg" for end in measured]
    return po.problem_from_dict({
        "robot": {"kind": "dh", "joints": [{"name": f"joint{k}", "limits": limits, **joint} for k in (1, 2)]},
        "uncertainty": {"sigma": {"joint2.theta": "0.05 mrad"}},
        "effects": [effect],
        "task": {"kind": "insert", "direction": [0, -1, 0], "position": ["1.2 m", "0.6 m", "0 m"], **task},
    })  # fmt: skip


def tool(q: np.ndarray, first: np.ndarray | float = 0.0, second: np.ndarray | float = 0.0) -> np.ndarray:
    """(..., 2) tool point with the errors of both joints [rad]."""
    a, b = q[0] + first, q[0] + first + q[1] + second
    return np.stack([np.cos(a) + np.cos(b), np.sin(a) + np.sin(b)], axis=-1)


def error(value: float, cycles: float = 3.37) -> float:
    return AMPLITUDE * float(np.sin(cycles * (value - 0.3)))


@pytest.mark.parametrize("angle", [-20.0, 56.0])
def test_within_its_range_the_error_is_corrected(angle: float) -> None:
    q = np.radians([angle, 70.0])
    assert np.asarray(problem().arm.position(q))[:2] == pytest.approx(tool(q, error(q[0])), abs=1e-12)
    assert po.propagate(problem(), q).covariance == pytest.approx(po.propagate(problem(measured=None), q).covariance)


@pytest.mark.parametrize("angle", [192.0, -168.0, 65.0])
def test_beyond_it_the_promise_holds_for_arms_of_any_phase(angle: float) -> None:
    """192 deg is as far from what was measured as -168 deg, whole turns or not: the phase has drifted away."""
    q, rng = np.radians([angle, 70.0]), np.random.default_rng(3)
    spread = po.propagate(problem(), q)
    assert spread.position[:2] == pytest.approx(tool(q), abs=1e-12)
    phase = rng.uniform(0, 2 * np.pi, 40_000)
    drawn = tool(q, AMPLITUDE * np.sin(phase), rng.normal(0, 5e-5, len(phase)))
    assert spread.covariance[:2, :2] == pytest.approx(np.cov(drawn.T), rel=0.05, abs=3e-10)
    cloud = po.simulate(problem(), q, n=20_000, seed=0)
    assert cloud.covariance[:2, :2] == pytest.approx(np.cov(drawn.T), rel=0.05, abs=3e-10)


def test_an_error_that_repeats_after_a_whole_turn_is_used_everywhere() -> None:
    """Of four cycles a revolution, the phase at 192 deg is that at -168 deg, whatever was measured."""
    repeats = problem(4.0)
    assert not repeats.arm.measured_ranges
    for angle in (192.0, -168.0):
        q = np.radians([angle, 70.0])
        expected = tool(q, AMPLITUDE * np.sin(4 * (q[0] - 0.3)))
        assert np.asarray(repeats.arm.position(q))[:2] == pytest.approx(expected, abs=1e-12)


def test_a_posture_is_chosen_within_the_range_though_the_other_elbow_is_as_good() -> None:
    """Both elbows reach the target: joint1 at -21.3 deg, or at 74.4 deg, or a turn away."""
    answer = po.select_posture(problem())
    assert LOW <= np.degrees(answer.q[0]) <= HIGH
    assert answer.to_json()["beyond_measured"] == []
    p = tool(answer.q, error(answer.q[0]))
    assert p == pytest.approx([1.2, 0.6], abs=1e-7)
    repeated = po.PostureSelector(problem(), compiled=False).solve((1.3, 0.6, 0.0))
    assert LOW <= np.degrees(repeated.q[0]) <= HIGH


def test_what_cannot_be_done_within_it_is_said_first_and_costs_what_is_lost() -> None:
    answer = po.select_posture(problem(position=["-1.2 m", "-0.6 m", "0 m"]))
    assert not LOW <= np.degrees(answer.q[0]) <= HIGH
    assert tool(answer.q) == pytest.approx([-1.2, -0.6], abs=1e-7)
    (lost,) = answer.to_json()["beyond_measured"]
    assert lost["effect"] == {"kind": "cyclic_error", "target": "joint1"}
    assert lost["range"] == pytest.approx(np.radians([LOW, HIGH]))
    danger = next(one for one in answer.statements if one.severity == "danger")
    assert (danger.id, danger.about) == ("selection.beyond-measured", "joint1")
    assert np.degrees([danger.values[end].value for end in ("low", "high")]) == pytest.approx([LOW, HIGH])  # type: ignore[union-attr]
    x = AMPLITUDE / np.sqrt(2) * np.array([-tool(answer.q)[1], tool(answer.q)[0]])
    assert answer.sigma_max >= abs(x[0])


def test_a_diagnosis_writes_down_what_it_measured(tmp_path: Any) -> None:
    rng = np.random.default_rng(8)
    q = np.column_stack([np.radians(rng.uniform(LOW, HIGH, 90)), rng.uniform(-2.5, 2.5, 90)])
    p = np.array([tool(row, error(row[0], 5.37)) for row in q]) + rng.normal(0, 2e-5, (90, 2))
    plain = problem().replace(effects=None, uncertainty__measurement={"position": "0.02 mm"})
    data = po.read_measurements(
        {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": p[:, 0], "y [m]": p[:, 1]}, plain
    )
    extended = po.extended_problem(plain, po.diagnose(plain, data))
    for name, content in extended.files("extended").items():
        (tmp_path / name).write_bytes(content)
    (known,) = po.load_problem(tmp_path / "extended.yaml").arm.measured_ranges
    assert known.effect.kind == "cyclic_error"
    assert np.degrees([known.low, known.high]) == pytest.approx(np.degrees([q[:, 0].min(), q[:, 0].max()]), abs=0.01)
