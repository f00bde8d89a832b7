"""Terms on joints, torque, orientation and probability, against Pinocchio, sampled poses and given numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pinocchio
import pytest

import posture_opt as po
from posture_opt.selection.terms import Term
from posture_opt.selection.terms.arm_terms import JointTorque
from posture_opt.selection.terms.spreads import OrientationSpread
from tests.helpers.pin import PinArm, robots_folder
from tests.helpers.said import said
from tests.helpers.sampled import sampled_pose
from tests.helpers.variants import conformance

SCARA = {"position": ["0.25 m", "0.1 m", "-0.05 m"]}
UR10 = {"position": ["0.6 m", "0.2 m", "0.2 m"]}
PANDA = {"position": ["0.5 m", "0.1 m", "0.2 m"]}
SAMPLED = [("panda", PANDA), ("scara", SCARA)]


def problem(robot: Any = "ur10", **task: Any) -> Any:
    section = {"kind": "preset", "name": robot} if isinstance(robot, str) else robot
    return po.problem_from_dict(
        {"robot": section, "uncertainty": {"repeatability": "0.05 mm"}, "task": {"kind": "insert", **task}}
    )


def values(given: Any, term: Term, q: Any) -> np.ndarray:
    """The quantity of a term at a posture."""
    solved = po.PostureSelector(given, compiled=False)
    asked = solved.engine(solved.target).optimisation_problem
    quantity = ca.substitute(term.quantity(asked.quantities), asked.nlp.p, ca.DM(solved.target.parameters))
    return np.asarray(ca.Function("term", [asked.q], [quantity])(q)).ravel()


# --- torque -------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_torques_of_gravity_are_pinocchios() -> None:
    urdf = Path(robots_folder()) / "ur_description/urdf/ur10_robot.urdf"
    given = problem(
        {"kind": "urdf", "file": str(urdf), "base_link": "base_link", "tip_link": "tool0", "payload": "4 kg"}
    )
    pin = PinArm(urdf)
    frame = pin.model.frames[pin.model.getFrameId("tool0")]
    payload = pinocchio.Inertia(4.0, np.zeros(3), np.zeros((3, 3)))
    pin.model.appendBodyToJoint(frame.parentJoint, payload, frame.placement)
    names = given.robot.joint_names
    for q in np.random.default_rng(0).uniform(-2, 2, (8, 6)):
        full = pin.configuration(dict(zip(names, q, strict=True)))
        tau = pinocchio.computeGeneralizedGravity(pin.model, pin.model.createData(), full)
        expected = [-tau[pin.model.joints[pin.model.getJointId(name)].idx_v] for name in names]
        np.testing.assert_allclose(values(given, JointTorque(kind="joint_torque"), q), expected, atol=1e-6)


def test_a_bound_on_one_torque_is_kept_and_costs_spread() -> None:
    robot, target, joint = "panda", PANDA, "panda_joint3"
    free = po.select_posture(problem(robot, **target, payload="3 kg"))
    index = free.problem.robot.joint_names.index(joint)
    before = values(free.problem, JointTorque(kind="joint_torque"), free.q)
    most = 0.9 * abs(before[index])
    bound = {"kind": "joint_torque", "at_most": {joint: f"{most:.9g} N m"}}
    found = po.select_posture(problem(robot, **target, payload="3 kg", subject_to=[bound]))
    assert abs(values(found.problem, JointTorque(kind="joint_torque"), found.q)[index]) <= most * (1 + 1e-6)
    assert found.critical.sigma_max >= free.critical.sigma_max
    assert joint in str(found.explain())


def test_torque_without_masses_and_of_a_prismatic_joint_is_refused() -> None:
    with pytest.raises(po.errors.InputError, match="masses or centres of mass"):
        problem("scara", **SCARA, subject_to=[{"kind": "joint_torque", "at_most": "5 N m"}])
    joints = [
        {
            "name": "lift", "type": "prismatic", "theta": "0 deg", "a": "0 m", "alpha": "90 deg",
            "limits": ["0 m", "1 m"],
        },
        {"name": "arm", "type": "revolute", "d": "0 m", "a": "1 m", "alpha": "0 deg"},
    ]  # fmt: skip
    weighed = [{**joint, "mass": "2 kg", "com": ["0 m", "0 m", "0 m"]} for joint in joints]
    with pytest.raises(po.errors.InputError, match=r"lift is prismatic.*leave it out"):
        problem({"kind": "dh", "joints": weighed}, subject_to=[{"kind": "joint_torque", "at_most": {"lift": "5 N m"}}])


# --- orientation --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("robot", "target"), conformance(SAMPLED, SAMPLED[:1]))
def test_orientation_spread_is_that_of_sampled_poses(robot: str, target: dict[str, Any]) -> None:
    given = problem(robot, **target)
    q = np.random.default_rng(3).uniform(given.robot.lower, given.robot.upper).clip(-2, 2)
    _, C, _, error = sampled_pose(given.robot, q, list(given.sources.names), given.sources.covariance, 40_000)
    axis = np.asarray(given.arm.pose(q), dtype=float)[:3, 2]
    across = np.linalg.svd(axis[None])[2][1:].T
    parts = {"tilt": across, "spin": axis[:, None], "all": np.eye(3)}
    # Three standard errors of the sample; the roundings of criteria are 1e-4 of the mean.
    slack = 3 * float(np.abs(error[3:, 3:]).max()) + 1e-4 * float(np.trace(C[3:, 3:]))
    for part, basis in parts.items():
        sigma = values(given, OrientationSpread(kind="orientation_spread", of=part), q)[0]
        expected = np.linalg.eigvalsh(basis.T @ C[3:, 3:] @ basis)[-1]
        assert sigma**2 == pytest.approx(expected, abs=slack), part


@pytest.mark.parametrize(("robot", "target"), conformance(SAMPLED, SAMPLED[1:]))
def test_the_orientation_that_is_told_is_that_of_sampled_poses(robot: str, target: dict[str, Any]) -> None:
    bound = {"kind": "orientation_spread", "of": "all", "at_most": "5 deg"}
    given = problem(robot, **target, subject_to=[bound])
    solution = po.select_posture(given)
    _, C, _, error = sampled_pose(given.robot, solution.q, list(given.sources.names), given.sources.covariance, 40_000)
    told, slack = solution.to_json()["orientation"], 3 * float(np.abs(error[3:, 3:]).max())
    axis = np.asarray(given.arm.pose(solution.q), dtype=float)[:3, 2]
    across = np.linalg.svd(axis[None])[2][1:].T
    tilt = np.linalg.eigvalsh(across.T @ C[3:, 3:] @ across)[-1]
    assert told["tilt_sigma_max"] ** 2 == pytest.approx(tilt, abs=slack)
    assert told["spin_sigma"] ** 2 == pytest.approx(axis @ C[3:, 3:] @ axis, abs=slack)
    assert told["spin_sigma_first_order"] == pytest.approx(told["spin_sigma"], rel=1e-4)
    assert "selection.orientation-first-order" in said(solution)


@pytest.mark.long
def test_a_bound_on_the_tilt_chooses_another_posture() -> None:
    tilt = OrientationSpread(kind="orientation_spread")
    given = problem("panda", **PANDA, tilt="20 deg", direction=[1, 0, -1])
    free = po.select_posture(given)
    before = values(given, tilt, free.q)[0]
    bound = {"kind": "orientation_spread", "at_most": f"{0.97 * before:.9g} rad"}
    found = po.select_posture(problem("panda", **PANDA, tilt="20 deg", direction=[1, 0, -1], subject_to=[bound]))
    assert values(given, tilt, found.q)[0] <= 0.97 * before + 1e-9
    assert found.critical.sigma_max >= free.critical.sigma_max


# --- joints -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "target", "held"),
    [
        pytest.param("ur10", UR10, {"wrist_3": "25 deg"}, marks=pytest.mark.conformance),
        pytest.param(
            "panda", PANDA, {"panda_joint3": "-10 deg", "panda_joint7": "45 deg"}, marks=pytest.mark.conformance
        ),
        ("scara", SCARA, {"joint4": "-30 deg"}),
    ],
)
def test_joints_are_held_where_they_are_asked_to_be(robot: str, target: dict[str, Any], held: dict[str, str]) -> None:
    free = po.select_posture(problem(robot, **target))
    found = po.select_posture(problem(robot, **target, subject_to=[{"kind": "fixed_joints", "values": held}]))
    assert found.status == "optimal"
    for name, value in held.items():
        assert found.posture[name] == pytest.approx(np.radians(float(value.split()[0])), abs=1e-12)
    assert found.critical.sigma_max >= free.critical.sigma_max * (1 - 1e-6)
    assert found.spread.position == pytest.approx([float(v.split()[0]) for v in target["position"]], abs=1e-6)


def test_a_stroke_that_is_held_and_misses_the_target_names_the_joint() -> None:
    held = {"kind": "fixed_joints", "values": {"joint3": "20 mm"}}
    with pytest.raises(po.errors.NoSolutionError, match=r"joint3 is held at 20 mm, .*: hold joint3 at 50 mm"):
        po.select_posture(problem("scara", **SCARA, subject_to=[held]))


@pytest.mark.parametrize(
    ("term", "message"),
    [
        ({"kind": "fixed_joints", "values": {"joint3": "20 deg"}}, "joint3 is prismatic and takes a length"),
        ({"kind": "fixed_joints", "values": {"joint1": "20 mm"}}, "joint1 is revolute and takes an angle"),
        ({"kind": "fixed_joints", "values": {"joint9": "20 mm"}}, "'joint9' is no joint of this arm"),
        ({"kind": "fixed_joints", "values": {"joint3": "5 m"}}, "beyond its limits"),
        (
            {"kind": "near_posture", "posture": {"joint1": "0 deg"}, "at_most": {"joint2": "5 deg"}},
            "no place in posture",
        ),
        ({"kind": "near_posture", "posture": {"joint3": "0 mm"}, "at_most": {"joint3": "5 deg"}}, "takes a length"),
    ],
)
def test_values_of_joints_are_checked_against_the_arm(term: dict[str, Any], message: str) -> None:
    with pytest.raises(po.errors.InputError, match=message):
        problem("scara", **SCARA, subject_to=[term])


def test_a_joint_that_is_held_is_no_quantity_to_minimise() -> None:
    with pytest.raises(po.errors.InputError, match=r"task.minimize\[0\].*move it to subject_to"):
        problem("scara", **SCARA, minimize=[{"kind": "fixed_joints", "values": {"joint4": "0 deg"}}])


def test_closeness_counts_strokes_and_bounds_joints_one_by_one() -> None:
    other = {"joint1": "60 deg", "joint3": "10 mm"}
    bounds = {"joint1": "5 deg"}
    near = {"kind": "near_posture", "posture": other, "at_most": bounds}
    with pytest.raises(po.errors.NoSolutionError, match="near_posture of joint1"):
        po.select_posture(problem("scara", **SCARA, subject_to=[near]))
    present = po.select_posture(problem("scara", **SCARA)).posture
    wide = {"kind": "near_posture", "posture": {"joint1": f"{present['joint1']} rad"}, "at_most": {"joint1": "1 deg"}}
    found = po.select_posture(problem("scara", **SCARA, subject_to=[wide]))
    assert found.posture["joint1"] == pytest.approx(present["joint1"], abs=np.radians(1))


def test_joints_with_dots_in_their_names_can_be_named() -> None:
    joint = {"type": "revolute", "a": "1 m", "alpha": "0 deg", "d": "0 m", "mass": "1 kg", "com": ["0 m"] * 3}
    names = ["target.arm", "tool_axis.arm"]
    robot = {"kind": "dh", "joints": [{"name": name, **joint} for name in names]}
    near = {"kind": "near_posture", "posture": {names[0]: "0 deg"}, "at_most": {names[0]: "1 deg"}}
    with pytest.raises(po.errors.NoSolutionError, match=r"near_posture of target\.arm"):
        po.select_posture(problem(robot, direction=[0, -1, 0], position=["0 m", "0.9 m", "0 m"], subject_to=[near]))


# --- probability ---


def test_success_without_a_hole_is_refused() -> None:
    with pytest.raises(po.errors.InputError, match="needs the clearance"):
        po.select_posture(problem("scara", **SCARA, subject_to=[{"kind": "success", "at_least": 0.9}]))


# --- all ----------------------------------------------------------------------------------------------------------


def test_a_margin_of_limits_leaves_out_joints_that_are_held() -> None:
    further = [{"kind": "fixed_joints", "values": {"joint4": "30 deg"}}, {"kind": "limit_margin", "at_least": "5 deg"}]
    found = po.select_posture(problem("scara", **SCARA, subject_to=further))
    assert found.status == "optimal"
    assert found.posture["joint4"] == pytest.approx(np.radians(30))
