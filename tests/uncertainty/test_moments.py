"""Moments of the tool point: closed forms against published figures, raw moments, CasADi's derivatives and sampling."""

from __future__ import annotations

from itertools import product

import casadi as ca
import numpy as np
import pytest

import posture_opt as po
from posture_opt.model.chain import factor_values, walk
from posture_opt.uncertainty.exact_moments import plane_of
from posture_opt.uncertainty.integration import NodePlan
from posture_opt.uncertainty.pose_covariance import second_order
from posture_opt.uncertainty.regions import Ellipsoid
from posture_opt.uncertainty.tool_point import ToolPoint
from tests.helpers.moments import correlated, errors_of, planar, raw_moments, scaled
from tests.helpers.shipped import preset_robot
from tests.helpers.stated import Sources, moved_base, stated
from tests.helpers.variants import conformance

Q6 = (0.3, -1.1, 1.2, -0.5, 0.7, 0.2)


def moments(problem, q):
    return ToolPoint.of(problem.arm, problem.sources).moments([float(v) for v in q])


# Planar 2R, a = 1, 1 m, sigma_a = 10 mm, sigma_theta1 = 1 deg: computed from x = a1 cos t1 + a2 cos(t1 + t2) and
# the characteristic function of the normal distribution alone, to machine precision.
# posture, sigma_theta2 [deg], then Cxx, Cyy, Cxy and semi-axes (minor, major) to first order, the same exactly, mean
TABLE = [
    ((90, -180), 1, (3.046174e-4, 2.000000e-4, 0, 0.01414214, 0.01745329),
     (3.045233e-4, 2.000478e-4, 0, 0.01414382, 0.0174506), (0, 0.000152)),
    ((90, -180), 3, (2.741557e-3, 2.000000e-4, 0, 0.01414214, 0.05235988),
     (2.733558e-3, 2.042451e-4, 0, 0.01429143, 0.05228344), (0, 0.001370)),
    ((90, -135), 1, (2.284408e-4, 4.546174e-4, 3.922038e-5, 0.01489405, 0.02147616),
     (2.284824e-4, 4.544750e-4, 3.913421e-5, 0.01489623, 0.0214723), (0.706891, 0.292956)),
    ((90, -135), 3, (1.446910e-3, 1.673087e-3, 1.257690e-3, 0.01724049, 0.05312968),
     (1.445252e-3, 1.670720e-3, 1.251444e-3, 0.01736302, 0.05305184), (0.706031, 0.293817)),
]  # fmt: skip


@pytest.mark.parametrize(("posture", "t2", "first", "exact", "mean"), TABLE)
def test_the_lecture_s_arm(posture, t2, first, exact, mean):
    found = moments(planar(1, t2), np.radians(posture))
    for C, (xx, yy, xy, minor, major) in ((found.first_order, first), (found.covariance, exact)):
        # half a unit of the last printed digit: seven digits of the entries, 1e-7 to 1e-8 m of the axes
        np.testing.assert_allclose([C[0, 0], C[1, 1]], [xx, yy], rtol=5e-7)
        assert C[0, 1] == pytest.approx(xy, rel=5e-7, abs=1e-16)
        np.testing.assert_allclose(Ellipsoid(np.zeros(2), C[:2, :2]).semi_axes, [minor, major], atol=5.1e-8)
        np.testing.assert_array_equal(C[2], 0)
    np.testing.assert_allclose(found.mean[:2], mean, atol=5.1e-7)


# Joint noise alone, straight and folded arm: the first order knows no minor axis, the true one grows with sigma
# squared. Two more postures near by: the ratio of the true minor axis to that of the first order.


@pytest.mark.parametrize("scale", [1, 10, 100])
def test_the_recursion_gives_the_raw_moments(scale):
    robot = preset_robot("puma560")
    sources = scaled(errors_of(robot, 1e-3, 1e-3), scale)
    m, C = raw_moments(robot, Q6, sources)
    found = moments(stated(robot=robot, sources=sources), Q6)
    # raw moments lose 1 / sigma^2 = 1e6 of the digits of long double; double keeps 1e-13 over 40 factors
    rounding = 1e-13 + 100 * float(np.finfo(np.longdouble).eps) * 1e6 / scale**2
    np.testing.assert_allclose(found.covariance, C, atol=rounding * C.max())
    np.testing.assert_allclose(found.mean, m, atol=1e-14)


@pytest.mark.parametrize("robot", ["puma560", "planar_2r", "scara"])
@pytest.mark.parametrize("coupled", [False, True])
def test_small_errors_keep_their_digits(robot, coupled):
    robot = preset_robot(robot)
    unit = errors_of(robot, 1.0, 1.0, ("theta", "d", "a"))
    q = (0.3, -1.1, 0.1, 0.4)[: robot.n] if robot.n < 6 else Q6
    small = scaled(correlated(unit) if coupled else unit, 1e-7)
    found = moments(stated(robot=robot, sources=small), q)
    # C = s^2 J R J' (1 + O(s^2)), and s^2 = 1e-14 is nothing; C = S - m m' would keep no digit at all
    np.testing.assert_allclose(found.covariance, found.first_order, atol=1e-13 * found.first_order.max())


def test_the_plane_may_stand_anyhow():
    tilted = planar_tilted()
    flat = planar()
    coupled = correlated(flat.sources)
    upright = moments(stated(robot=flat.robot, sources=coupled), (0.4, -1.0))
    found = moments(stated(robot=tilted, sources=coupled), (0.4, -1.0))
    base = walk(tilted.base, factor_values(tilted.base, []))
    R = np.array(base.columns, dtype=float).T
    np.testing.assert_allclose(found.covariance, R @ upright.covariance @ R.T, atol=1e-18)
    np.testing.assert_allclose(found.mean, R @ upright.mean + np.array(base.position), atol=1e-15)
    assert plane_of(tilted) is not None
    assert plane_of(preset_robot("puma560")) is None


def planar_tilted():
    return moved_base(preset_robot("planar_2r"), (0.1, 0.2, 0.3), (0.4, -0.5, 0.6))


def test_second_order_against_algorithmic_differentiation():
    robot = preset_robot("puma560")
    sources = correlated(errors_of(robot, 0.1, 0.1, ("theta", "a", "alpha")))
    arm = po.Arm(robot)
    p = ca.SX.sym("p", len(sources.names))
    place = {name: i for i, name in enumerate(sources.names)}
    x = arm.position(list(Q6), ca.vertcat(*(p[place[n]] if n in place else 0 for n in arm.parameters)))
    S = ca.DM(sources.covariance)
    J = ca.jacobian(x, p)
    hessians = [ca.hessian(x[c], p)[0] for c in range(3)]
    curvature = ca.blockcat([[ca.trace(A @ S @ B @ S) / 2 for B in hessians] for A in hessians])
    bias = ca.vertcat(*(ca.trace(S @ H) / 2 for H in hessians))
    parts = [J @ S @ J.T, curvature, bias]
    first, curvature, bias = (v.full() for v in ca.Function("f", [p], parts)(np.zeros(len(place))))
    tool_point = ToolPoint.of(po.Arm(robot), sources)
    found = second_order(tool_point.walk(list(Q6))[0], tool_point.indices, tool_point.covariance)
    for value, expected in ((found.first, first), (found.curvature, curvature)):
        np.testing.assert_allclose(value, expected, atol=1e-14)  # entries of order 0.01, hundreds of sums
    np.testing.assert_allclose(found.bias, bias[:, 0], atol=1e-14)


CASES = {
    "6R, 30 independent errors": lambda: (preset_robot("ur10"), errors_of(preset_robot("ur10"), 5e-3, 2e-3), Q6),
    "planar, all correlated": lambda: (preset_robot("planar_2r"), correlated(planar(1, 1).sources), (0.4, -1.0)),
    "planar in space, all correlated": lambda: (planar_tilted(), correlated(planar(1, 1).sources), (0.4, -1.0)),
    "planar, lengths of one machine": lambda: (preset_robot("planar_2r"), one_machine(), (0.4, -1.0)),
    "scara, all correlated": lambda: (preset_robot("scara"), scara_errors(), (0.3, -1.1, 0.05, 0.4)),
    "6R, joints and lengths correlated": lambda: (
        preset_robot("puma560"), correlated(errors_of(preset_robot("puma560"), 2e-3, 1e-3, ("theta", "a"))), Q6),
}  # fmt: skip


def one_machine():
    sources = planar(0.2, 0.3, 0.001).sources
    C = sources.covariance.copy()
    C[2, 3] = C[3, 2] = 0.8 * 1e-6
    return Sources(sources.names, C)


def scara_errors():
    return correlated(errors_of(preset_robot("scara"), 5e-3, 2e-3, ("theta", "d", "a")))


@pytest.mark.parametrize(
    ("case", "scale"),
    conformance(
        [*product([case for case in CASES if "in space" not in case], [30]), ("6R, joints and lengths correlated", 10)],
        [("planar, all correlated", 30), ("scara, all correlated", 30), ("6R, joints and lengths correlated", 10)],
    ),
)
def test_a_million_samples(case, scale):
    robot, sources, q = CASES[case]()
    n = 1_000_000 if "planar" in case or (scale == 30 and "6R" in case) else 200_000
    cloud = po.simulate(stated(robot=robot, sources=scaled(sources, scale)), q, n=n, seed=scale)
    # Five standard errors: missed once in a million entries by a right formula; two hundred are compared.
    offset = np.abs(cloud.covariance - cloud.spread.covariance)
    assert (offset <= 5 * cloud.covariance_error + 1e-30).all()
    assert (np.abs(cloud.bias - cloud.spread.bias) <= 5 * cloud.bias_error + 1e-15).all()
    if scale == 30:  # the first order would fail: the samples are many enough to tell
        assert (np.abs(cloud.covariance - cloud.spread.first_order) > 5 * cloud.covariance_error).any()


@pytest.mark.parametrize("case", list(CASES))
def test_numbers_arrays_and_symbols_agree(case):
    robot, sources, q = CASES[case]()
    tool_point = ToolPoint.of(po.Arm(robot), scaled(sources, 10))
    symbol = ca.SX.sym("q", robot.n)
    plan = NodePlan.few(tool_point.shared, tool_point.indices, robot.factors) if tool_point.integrated else None
    symbolic = tool_point.moments(ca.vertsplit(symbol))
    results = [symbolic.mean, symbolic.covariance, symbolic.first_order, symbolic.position]
    function = ca.Function("f", [symbol], results)
    Q = np.array(q) + np.random.default_rng(0).uniform(-1, 1, (7, robot.n))
    batch = tool_point.moments(list(Q.T))
    for row, posture in enumerate(Q):
        one = tool_point.moments(posture.tolist(), plan)
        values = [one.mean, one.covariance, one.first_order, one.position]
        rows = [batch.mean, batch.covariance, batch.first_order, batch.position]
        for value, many, symbols in zip(values, rows, function(posture), strict=True):
            many = many[row] if many.ndim > value.ndim else many
            np.testing.assert_allclose(many, value, atol=1e-14)  # metres of order one
            np.testing.assert_allclose(symbols.full().reshape(value.shape), value, atol=1e-14)


def test_sources_without_variance_are_left_out_and_order_does_not_matter():
    robot = preset_robot("ur5")
    sources = correlated(errors_of(robot, 1e-3, 1e-3, ("theta", "a")))
    k = len(sources.names)
    shuffled = np.random.default_rng(1).permutation(k)
    other = Sources(tuple(sources.names[i] for i in shuffled), sources.covariance[np.ix_(shuffled, shuffled)])
    padded = np.zeros((k + 1, k + 1))
    padded[:k, :k] = other.covariance
    a = moments(stated(robot=robot, sources=sources), Q6)
    b = moments(stated(robot=robot, sources=Sources((*other.names, "base.x"), padded)), Q6)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-12)
