"""Stated errors against what happens: coverage over many draws, errors that neighbours share, an outside simulator."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import posture_opt as po
from posture_opt.calibration.assumptions.frames import arm_and_data, fit_frames
from posture_opt.calibration.estimation.fit import estimate_parameters, with_clustered_errors
from posture_opt.calibration.estimation.fit_setup import determine_directions
from tests.helpers.free_arms import BASE, TOOL, TWO, problem_of, rows, simulated_points
from tests.helpers.pin import robots_folder
from tests.helpers.simulated_arm import SimulatedArm

PLANAR = {"base": {"xyz": ["0 m"] * 3}, "tool": {"xyz": ["0 m"] * 3}}
WRONG = {"j1.theta": 2e-3, "j1.a": 1e-3, "j2.theta": -3e-3, "j2.a": -5e-4}


@pytest.mark.campaign
def test_intervals_of_95_percent_hold_the_truth_in_95_percent_of_300_draws() -> None:
    problem = problem_of(TWO, robot=PLANAR)
    rng = np.random.default_rng(7)
    q = rng.uniform(-2.5, 2.5, (30, 2))
    exact = simulated_points(TWO, q, np.eye(4), np.eye(4), WRONG)
    data = rows(problem, q, exact[:, :2])
    residuals, _ = arm_and_data(problem, data)
    zero = np.zeros(len(residuals.parameters))
    known = determine_directions(problem, residuals, zero, None, True)
    names = [p.name for p in residuals.parameters]
    at = [names.index(name) for name in WRONG]
    assert known.fixed[at].all()
    hits = np.zeros(len(at))
    for _ in range(300):
        noisy = copy.copy(data)
        object.__setattr__(noisy, "position", exact + rng.normal(0, 2e-5, exact.shape))
        found = estimate_parameters(
            replace(residuals, data=noisy), zero, known.directions, known.prior, weight=known.noise
        )
        # Student's t with 60 - 4 degrees of freedom.
        hits += np.abs(found.x[at] - list(WRONG.values())) < 2.003 * np.sqrt(np.diag(found.covariance)[at])
    # Binomial: 285 ± 3.8 of 300 for each of the four; 92 % and 98 % are 276 and 294.
    assert (hits >= 276).all()
    assert (hits <= 294).all()


@pytest.mark.campaign
def test_predicted_regions_hold_95_percent_of_what_was_left_out() -> None:
    problem = problem_of(TWO, robot=PLANAR)
    shares = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        q = rng.uniform(-2.5, 2.5, (60, 2))
        points = simulated_points(TWO, q, np.eye(4), np.eye(4), WRONG)[:, :2] + rng.normal(0, 2e-5, (60, 2))
        shares.append(po.calibrate(problem, rows(problem, q, points), folds=2).coverage["calibrated"])
    # 1800 rows: 95 % ± 0.5 %.
    assert 0.935 < np.mean(shares) < 0.965


@pytest.mark.campaign
def test_standard_errors_know_that_neighbouring_postures_err_alike() -> None:
    # Each joint reads a sine of its own angle wrong, which no parameter of the model can express: 600 rows in 60 heaps
    # tell hardly more than the 60 would. Over 40 arms, the estimates must scatter as far as their errors say.
    problem = problem_of(TWO, robot={"base": {"xyz": ["0 m"] * 3}, "tool": {"xyz": ["0 m"] * 3}})
    z = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        q = np.repeat(rng.uniform(-2.5, 2.5, (60, 2)), 10, axis=0) + rng.normal(0, 0.01, (600, 2))
        wrong = q + 1e-3 * np.sin(11 * q + rng.uniform(0, 6.28, 2))
        data = rows(problem, q, simulated_points(TWO, wrong, np.eye(4), np.eye(4), {}) + rng.normal(0, 1e-5, (600, 3)))
        residuals, _ = arm_and_data(problem, data)
        zero = np.zeros(len(residuals.parameters))
        known = determine_directions(problem, residuals, zero, None, True)
        assert known.design > 2
        found = estimate_parameters(
            residuals, zero, known.directions, known.prior, weight=known.noise, design=known.design
        )
        C = with_clustered_errors(found).covariance
        names = [p.name for p in residuals.parameters]
        z += [found.x[j] / np.sqrt(C[j, j]) for j in map(names.index, ("j1.a", "j2.a", "j2.theta"))]
    # As if rows were independent, it would be 3. 40 arms with a few estimates each: 1 ± 0.1, and some blocks cut heaps.
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25


def test_a_urdf_arm_whose_frames_pinocchio_perturbed_predicts_postures_never_seen() -> None:
    file = robots_folder() / "ur_description" / "urdf" / "ur5_robot.urdf"
    model = pin.buildModelFromUrdf(str(file))
    rng = np.random.default_rng(12)
    for joint in range(1, model.njoints):
        off = np.concatenate([rng.normal(0, 3e-4, 3), rng.normal(0, 5e-4, 3)])
        model.jointPlacements[joint] = model.jointPlacements[joint] * pin.exp6(pin.Motion(off))
    at, workspace = model.getFrameId("tool0"), model.createData()

    def points(commands: np.ndarray) -> np.ndarray:
        found = []
        for q in commands:
            pin.framesForwardKinematics(model, workspace, q)
            found.append(np.array(workspace.oMf[at].translation))
        return np.array(found)

    robot = {"kind": "urdf", "file": str(file), "base_link": "base_link", "tip_link": "tool0", "joints": None}
    problem = problem_of([], robot=robot)
    q = rng.uniform(-2.5, 2.5, (150, 6))
    result = po.calibrate(problem, rows(problem, q, points(q) + rng.normal(0, 2e-5, (150, 3))))
    assert 0.8 < result.variance < 1.25  # χ² over some 420 degrees of freedom: ± 3 σ
    other = rng.uniform(-2.5, 2.5, (50, 6))
    left = arm_and_data(problem, rows(problem, other, points(other)))[0].error(result.x)
    # About 30 directions from 450 coordinates of 20 µm: 20 µm · √3 · √(30/450) ≈ 9 µm on average.
    assert np.sqrt((left**2).sum(axis=1).mean()) < 2e-5
    assert result.nominal.rms > 5e-4


def test_the_whole_fit_agrees_with_scipy() -> None:
    from scipy.optimize import least_squares

    problem = problem_of(TWO, robot={"base": "free", "tool": {"xyz": ["0 m"] * 3}})
    rng = np.random.default_rng(13)
    q = rng.uniform(-2.5, 2.5, (40, 2))
    data = rows(problem, q, simulated_points(TWO, q, np.eye(4), np.eye(4), WRONG) + rng.normal(0, 2e-5, (40, 3)))
    residuals, _ = arm_and_data(problem, data)
    x0 = fit_frames(residuals)
    D = determine_directions(problem, residuals, x0, None, False).directions
    ours = estimate_parameters(residuals, x0, D, robust=False)
    theirs = least_squares(lambda z: residuals.whitened(x0 + D @ z), np.zeros(D.shape[1]), xtol=1e-14, ftol=1e-14)
    # A thousandth of a standard error is where our fit comes to rest.
    errors = np.sqrt(np.diag(ours.covariance))
    np.testing.assert_allclose(ours.x, x0 + D @ theirs.x, atol=3e-3 * errors.max())
    J = theirs.jac
    covariance = ours.variance * D @ np.linalg.inv(J.T @ J) @ D.T
    np.testing.assert_allclose(errors, np.sqrt(np.diag(covariance)), rtol=1e-4, atol=1e-12)


def test_a_tool_of_unknown_length_on_a_tilted_axis_is_in_the_standard_errors() -> None:
    # The axes of a SCARA are parallel: base.z and tool.z are one at the nominal arm, and the tool's 120 mm stay with
    # the base. On axes found tilted by half a milliradian the missing length displaces the tool point by 0.1 mm, which
    # the elbow makes up for: fifteen of the standard errors that noise alone leaves it.
    table = (
        ("j1", "revolute", 0.0, 0.3, 0.4, 0.0), ("j2", "revolute", 0.0, 0.0, 0.3, np.pi),
        ("j3", "prismatic", 0.0, 0.0, 0.0, 0.0), ("j4", "revolute", 0.0, 0.05, 0.0, 0.0),
    )  # fmt: skip
    rng = np.random.default_rng(0)
    errors = {f"{row[0]}.{k}": rng.normal(0, 5e-4) for row in table for k in ("theta", "d", "a", "alpha")}
    arm = SimulatedArm(table, errors, base=BASE, tool=TOOL)
    q = arm.drawn(60, rng)
    problem = po.problem_from_dict({
        "robot": SimulatedArm(table).section(base="free", tool="free"),
        "uncertainty": {"measurement": {"position": "0.02 mm"}},
    })  # fmt: skip
    columns = {f"{row[0]} [{'m' if row[1] == 'prismatic' else 'rad'}]": q[:, i] for i, row in enumerate(table)}
    points = arm.points(q) + rng.normal(0, 2e-5, (60, 3))
    columns |= {f"{axis} [m]": points[:, i] for i, axis in enumerate("xyz")}
    result = po.calibrate(problem, po.read_measurements(columns, problem))
    off = {
        p.name: (x - errors.get(p.name, 0.0)) / s
        for p, x, s, fixed in zip(result.parameters, result.x, result.std, result.fixed, strict=True)
        if fixed and p.group == "geometry"
    }
    assert "j2.theta" in off
    assert max(map(abs, off.values())) < 4  # of some ten correlated normals
    assert result.std[[p.name for p in result.parameters].index("j1.alpha")] < 2e-5  # and no more than is due
