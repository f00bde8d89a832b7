"""Rows side by side: NumPy's and the interpreter's numbers, for every operation and any angle."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import posture_opt as po
from posture_opt.model.c_rows import LANES
from posture_opt.model.compiled import BatchFunction, LaneFunction
from posture_opt.model.toolchain import find_compiler

needs_compiler = pytest.mark.skipif(not find_compiler(), reason="no C compiler on this machine")


def lanes(expression: ca.SX, x: ca.SX, compiled: bool | None = True) -> LaneFunction:
    return LaneFunction(ca.Function("f", [x], [ca.densify(expression)]), compiled=compiled)


@needs_compiler
def test_sines_are_right_to_the_last_place() -> None:
    x = ca.SX.sym("x", 1)
    rng = np.random.default_rng(0)
    multiples = np.arange(-40, 41) * (np.pi / 4)
    angles = np.concatenate([
        rng.uniform(-7, 7, 20_000), rng.uniform(-1e6, 1e6, 20_000), rng.uniform(-1, 1, 2000) * 1e-8, multiples,
        np.nextafter(multiples, 9), [0.0, 999_999.9], rng.uniform(-1e12, 1e12, 1000),
    ])  # fmt: skip
    found = lanes(ca.vertcat(ca.sin(x), ca.cos(x)), x)(angles[:, None])
    exact = np.stack([np.sin(angles.astype(np.longdouble)), np.cos(angles.astype(np.longdouble))], axis=1)
    assert np.finfo(np.longdouble).eps < 1e-18, "no truth to compare with on this machine"
    apart = np.abs(found - exact)
    assert apart.max() < 2e-16
    last_place = np.spacing(np.abs(exact).astype(float))
    assert np.all(apart <= 2.5 * last_place)  # also where a sine is nearly zero


@needs_compiler
@pytest.mark.parametrize("n", [0, 1, LANES - 1, LANES, LANES + 1, 1000])
def test_every_operation_is_the_interpreters(n: int) -> None:
    x = ca.SX.sym("x", 3)
    a, b, c = ca.vertsplit(x)
    positive = ca.fabs(a) + 0.5
    every = [
        a + b, a - b, a * b, a / positive, -a, a * a, 2 * a, 1 / positive, ca.sqrt(positive), a**3, positive**b,
        ca.fmin(a, b), ca.fmax(a, b), ca.atan2(a, b), a < b, a <= b, a == b, a != b, ca.logic_and(a, b),
        ca.logic_or(a, b), ca.logic_not(a), ca.if_else(a < 0, b, c), ca.copysign(a, b), ca.fmod(a, positive),
        ca.hypot(a, b), ca.sign(a), ca.fabs(a), ca.tan(a), ca.asin(a / 9), ca.acos(a / 9), ca.atan(a), ca.exp(a),
        ca.log(positive), ca.floor(a), ca.ceil(a), ca.tanh(a), ca.sinh(a), ca.cosh(a), ca.erf(a), ca.log1p(positive),
        ca.expm1(a), ca.sin(a + ca.cos(b * ca.sin(c))), ca.SX(0.1), ca.SX(-3.0), ca.SX(0),
    ]  # fmt: skip
    function = ca.Function("f", [x], [ca.densify(ca.vertcat(*every))])
    Q = np.random.default_rng(n).uniform(-3, 3, (n, 3))
    Q[::7, 0] = 0.0
    Q[::5, 1] = Q[::5, 0]
    rows = LaneFunction(function, compiled=True)
    assert rows.compiled
    np.testing.assert_allclose(rows(Q), BatchFunction(function, compiled=False)(Q), rtol=4e-15, atol=4e-15)
    np.testing.assert_array_equal(rows(Q), np.array([rows(q[None])[0] for q in Q]).reshape(n, len(every)))


def test_without_a_compiler_rows_are_interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    x = ca.SX.sym("x", 2)
    assert not lanes(ca.sin(x), x, compiled=False).compiled
    monkeypatch.setenv("CC", "")
    monkeypatch.setenv("PATH", "")
    rows = lanes(ca.sin(x), x, compiled=None)
    assert not rows.compiled
    np.testing.assert_allclose(rows(np.eye(2)), np.sin(np.eye(2)), rtol=1e-15)
    with pytest.raises(po.errors.InputError, match="nothing compiled"):
        lanes(ca.sin(x), x, compiled=True)
