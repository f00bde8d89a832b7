"""The smooth criteria of the optimisation problem against NumPy's eigenvalues and the quadrature that reports use."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

import posture_opt as po
from posture_opt.selection.terms import criteria
from posture_opt.uncertainty.clearance import log_miss_probability, within_clearance
from tests.helpers.factors import joint_jacobian
from tests.helpers.variants import conformance

ROUNDED = 2e-4  # of the trace: the corner where eigenvalues meet is rounded off by 1e-4 of it, in 3D by some more


def evaluated(expressions, C):
    symbol = ca.SX.sym("C", *C.shape)
    function = ca.Function("f", [symbol], [ca.vertcat(*expressions(symbol))])
    return np.asarray(function(C)).ravel()


def covariances(m):
    """Random ones, those with equal eigenvalues, and flat ones; far from unit size, as variances in m² are."""
    rng = np.random.default_rng(m)
    spectra = [rng.uniform(0, 1, m) for _ in range(20)]
    spectra += [np.ones(m), np.eye(m)[0], np.append(np.ones(m - 1), 0.0), np.append(1e-4, np.ones(m - 1))]
    turns = [np.linalg.qr(rng.standard_normal((m, m)))[0] for _ in spectra]
    return [1e-8 * Q @ np.diag(values) @ Q.T for values, Q in zip(spectra, turns, strict=True)]


@pytest.mark.parametrize("m", [1, 2, 3])
def test_eigenvalues_are_numpy_s_but_for_the_rounded_corner(m):
    for C in covariances(m):
        atol = ROUNDED * np.trace(C)
        values = np.linalg.eigvalsh(C)
        np.testing.assert_allclose(evaluated(criteria.eigenvalues, C), values, atol=atol)
        assert evaluated(lambda C: [criteria.worst(C)], C) == pytest.approx(values[-1], abs=atol)


def log_miss(C, bias, clearance):
    symbols = ca.SX.sym("C", *C.shape), ca.SX.sym("b", len(C)), ca.SX.sym("r")
    return float(ca.Function("f", [*symbols], [criteria.log_miss(*symbols)])(C, bias, clearance))


@pytest.mark.parametrize("ratio", [1.0, 0.5, 0.2, 0.05])
@pytest.mark.parametrize("clearance", [0.5, 1.0, 3.0, 8.0])
def test_probability_in_the_plane_are_those_of_the_quadrature(ratio, clearance):
    C, bias = np.diag([1.0, ratio**2]), np.array([0.1, 0.2])
    # 48 nodes of the trapezoid rule: the thinner the ellipse, the sharper the integrand. A fifth keeps four digits.
    atol = 1e-6 if ratio >= 0.5 else 2e-4
    assert log_miss(C, bias, clearance) == pytest.approx(log_miss_probability(C, clearance, bias), abs=atol)


@pytest.mark.parametrize("C", [np.eye(1), np.diag([1.0, 0.2])])
def test_probability_keep_a_slope_where_the_probability_is_below_every_float(C):
    assert log_miss(C, np.zeros(len(C)), 60.0) > log_miss(C, np.zeros(len(C)), 61.0) > -2000


# --- The posture of greatest manipulability: where it is known, and against many random postures ----------------------

ARMS = {
    "panda": {"position": ["0.5 m", "0.1 m", "0.2 m"]},
    "scara": {"region": {"min": ["0.1 m", "0.1 m", "-0.1 m"], "max": ["0.25 m", "0.2 m", "0 m"]}},
}


def solved(robot: str, **task: Any) -> Any:
    return po.select_posture(
        po.problem_from_dict(
            {
                "robot": {"kind": "preset", "name": robot},
                "uncertainty": {"repeatability": "0.05 mm"},
                "task": {"kind": "insert", **task},
            }
        )
    )


def test_the_planar_arm_is_most_manipulable_with_its_elbow_at_a_right_angle() -> None:
    """det J = a1 a2 sin θ2 (Yoshikawa 1985, section 4): θ2 = ±90°, wherever the hole may be placed."""
    found = solved("planar_2r", direction=[0, -1, 0]).most_manipulable
    assert abs(found.posture["joint2"]) == pytest.approx(np.pi / 2, abs=1e-3)
    assert found.manipulability == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize("robot", conformance(ARMS, ["scara"]))
def test_no_feasible_posture_of_the_search_is_more_manipulable(robot: str) -> None:
    solution = solved(robot, **ARMS[robot])
    found, arm = solution.most_manipulable, solution.problem.robot
    others = [np.linalg.svd(joint_jacobian(arm, q)[:3], compute_uv=False) for q in solution.feasible]
    # The term adds 1 % of the root mean square of the singular values where one of them is zero.
    assert found.manipulability >= max(np.prod(s[:3]) ** (1 / 3) for s in others) * (1 - 1e-4)
    assert found.sigma_max >= solution.critical.sigma_max * (1 - 1e-6)
    assert solution.to_json()["most_manipulable"]["sigma_max"] == found.sigma_max
    assert "posture of greatest manipulability" in solution.report()


@pytest.mark.parametrize("m", [2, 3])
def test_criteria_have_a_slope_where_eigenvalues_meet(m):
    C = ca.SX.sym("C", m, m)
    for criterion in (criteria.worst, criteria.area):
        slope = ca.Function("slope", [C], [ca.jacobian(criterion(C), C)])
        assert np.isfinite(np.asarray(slope(1e-8 * np.eye(m)))).all()


@pytest.mark.parametrize("clearance", [0.5, 2.0, 20.0])
def test_probability_on_a_line_are_two_normal_tails(clearance):
    # A rational approximation of erfc: seven digits near the middle, a constant factor far out.
    found = log_miss(np.eye(1), np.array([0.3]), clearance)
    assert found == pytest.approx(log_miss_probability([[1.0]], clearance, [0.3]), rel=5e-4)


@pytest.mark.parametrize(("ratio", "clearance"), [(1.0, 0.5), (0.3, 1.0), (0.1, 3.0)])
def test_probability_in_space_is_that_of_the_ball(ratio, clearance):
    turned = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    C, bias = turned @ np.diag([1.0, ratio**2, ratio]) @ turned.T, np.array([0.1, 0.0, 0.2])
    assert log_miss(C, bias, clearance) == pytest.approx(np.log1p(-within_clearance(C, clearance, bias)), abs=0.05)
