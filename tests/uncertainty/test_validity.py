"""The validity index of the first-order ellipse against its published values and against counted coverage."""

from __future__ import annotations

import json
import math

import casadi as ca
import numpy as np
import pytest

from posture_opt.uncertainty.pose_covariance import Validity
from posture_opt.uncertainty.regions import Ellipsoid

LINK_SIGMA = 0.01


def arm(x):
    """Tool point of the planar arm; x = a1, a2, theta1, theta2."""
    a1, a2, t1, t2 = x
    return np.array([a1 * np.cos(t1) + a2 * np.cos(t1 + t2), a1 * np.sin(t1) + a2 * np.sin(t1 + t2)])


def expansion(t2, sigma, links=LINK_SIGMA):
    """C1, C2, bias, nominal values and standard deviations of the 2R arm at (90, t2) degrees, by CasADi."""
    x = ca.SX.sym("x", 4)
    f = ca.vertcat(x[0] * ca.cos(x[2]) + x[1] * ca.cos(x[2] + x[3]), x[0] * ca.sin(x[2]) + x[1] * ca.sin(x[2] + x[3]))
    evaluate = ca.Function("f", [x], [ca.jacobian(f, x), *(ca.hessian(f[i], x)[0] for i in range(2))])
    nominal = np.array([1.0, 1.0, math.pi / 2, math.radians(t2)])
    sd = np.array([links, links, math.radians(sigma), math.radians(sigma)])
    J, *H = (value.full() for value in evaluate(nominal))
    S = np.diag(sd**2)
    C2 = np.array([[np.trace(a @ S @ b @ S) / 2 for b in H] for a in H])
    return J @ S @ J.T, C2, np.array([np.trace(a @ S) / 2 for a in H]), nominal, sd


# theta2, sigma [deg], curvature index, coverage of the nominal 95 % first-order ellipse; links 1 m, 10 mm.
CASES = [
    (-90, 5, 0.20, 0.946),
    (-90, 10, 0.40, 0.933),
    (-90, 20, 0.81, 0.895),
    (-10, 2, 0.16, 0.946),
    (-10, 3, 0.35, 0.931),
    (-10, 5, 0.91, 0.858),
    (-10, 10, 2.9, 0.636),
    (-10, 20, 7.4, 0.406),
    (-180, 3, 0.24, 0.944),
    (-180, 5, 0.66, 0.910),
    (-180, 10, 2.6, 0.714),
    (-180, 20, 10.6, 0.391),
]


@pytest.mark.parametrize(("t2", "sigma", "curvature", "coverage"), CASES)
def test_index_and_the_coverage_that_it_warns_of(t2, sigma, curvature, coverage):
    C1, C2, bias, nominal, sd = expansion(t2, sigma)
    validity = Validity.of(C1, C2, bias)
    assert validity.curvature == pytest.approx(curvature, rel=0.03)  # printed to two digits

    n = 100_000
    points = arm((nominal + sd * np.random.default_rng(6).standard_normal((n, 4))).T).T
    counted = Ellipsoid(arm(nominal), C1).contains(points, 0.95).mean()
    assert counted == pytest.approx(coverage, abs=3e-3)  # four standard deviations of the count
    if validity.verdict == "good":
        assert counted > 0.943
    if validity.verdict == "doubtful":
        assert 0.92 < counted < 0.946
    assert (validity.verdict == "wrong") == (counted < 0.92)


@pytest.mark.parametrize("sigma", [1e-3, 0.1, 3])
def test_a_singular_posture_without_link_errors_has_no_first_order(sigma):
    validity = Validity.of(*expansion(-180, sigma, links=0.0)[:3])
    assert math.isinf(validity.curvature)
    assert math.isinf(validity.bias_mahalanobis)
    assert validity.verdict == "wrong"
    assert validity.statement.id == "uncertainty.first-order-singular"
    document = validity.to_json()
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["curvature"] is None
    assert document["curvature_infinite"] is True


def test_polar_coordinates_of_jcgm_102():
    # JCGM 102:2011, 9.3: u = 0.010 on both coordinates. At x1 = 0.100 the first order holds, at 0.010 and 0.001 (where
    # it says u(y2) = 10 rad, more than a turn) it does not.
    for x1, verdict in ((0.100, "good"), (0.010, "wrong"), (0.001, "wrong")):
        u2 = 1e-4
        J = np.diag([1.0, 1 / x1])
        H = [np.array([[0, 0], [0, 1 / x1]]), np.array([[0, -1 / x1**2], [-1 / x1**2, 0]])]
        C2 = np.array([[np.trace(a @ b) * u2**2 / 2 for b in H] for a in H])
        validity = Validity.of(u2 * J @ J.T, C2, [np.trace(a) * u2 / 2 for a in H])
        assert validity.verdict == verdict
    assert 2 * math.pi < math.sqrt(u2) * J[1, 1] == pytest.approx(10.0)
