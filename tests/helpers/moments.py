"""Robots, sources and raw-moment arithmetic for the tests of uncertainty."""

from __future__ import annotations

import numpy as np

from tests.helpers.shipped import preset_robot
from tests.helpers.stated import Sources, stated


def planar(t1=1.0, t2=1.0, a=0.01, robot=None):
    """The lecture's planar arm, a = 1, 1 m: sigma of the angles [deg], of both lengths [m]."""
    sigma = {"joint1.theta": np.radians(t1), "joint2.theta": np.radians(t2), "joint1.a": a, "joint2.a": a}
    return stated(robot=robot or preset_robot("planar_2r"), sources=Sources.independent(sigma))


def errors_of(robot, angle, length, kinds=("theta", "d", "a", "alpha", "beta")):
    """Independent errors of all DH parameters of the named kinds: sigma [rad] and [m]."""
    kept = {
        n: f for n, f in robot.parameters.items() if n.split(".")[0] in robot.joint_names and n.split(".")[1] in kinds
    }
    return Sources.independent({n: angle if f.kind == "rotate" else length for n, f in kept.items()})


def correlated(sources, seed=0, dof=None):
    """The same standard deviations with random correlations."""
    k = len(sources.names)
    A = np.random.default_rng(seed).standard_normal((k, dof or 2 * k))
    S = A @ A.T
    return with_correlations(sources, S / np.sqrt(np.outer(np.diag(S), np.diag(S))))


def with_correlations(sources, R):
    return Sources(sources.names, R * np.outer(sources.sigma, sources.sigma))


def scaled(sources, factor):
    return Sources(sources.names, sources.covariance * factor**2)


def raw_moments(robot, q, sources):
    """Mean and covariance for independent sources by E[p] and E[p p'] in long double, C = E[p p'] - m m'.

    A walk from the tool with the homogeneous second moment S = E[(p, 1) (p, 1)']: every elementary transform is
    linear in (cos, sin) or in the translation, whose own moments are known.
    """
    variance = dict(zip(sources.names, np.diag(sources.covariance), strict=True))
    S = np.zeros((4, 4), np.longdouble)
    S[3, 3] = 1
    for factor in reversed(robot.factors):
        v = np.longdouble(variance.get(factor.parameter, 0.0))
        value = np.longdouble(factor.nominal) + (q[factor.joint] if factor.joint is not None else 0)
        S = sum(w * (T @ S @ T.T) for w, T in _nodes(factor, value, v))
    m = S[:3, 3]
    return m.astype(float), (S[:3, :3] - np.outer(m, m)).astype(float)


def _nodes(factor, value, v):
    """Weights and transforms with the same first two trigonometric (or ordinary) moments as the error."""
    if factor.kind == "translate":
        steps = [(np.longdouble(1) / 2, np.sqrt(v)), (np.longdouble(1) / 2, -np.sqrt(v))]
        return [(w, _exact(factor, value + t)) for w, t in steps]
    # E cos = e^(-v/2), E cos 2e = e^(-2v): four angles 0, +-pi/2 and pi carry both, by symmetry without any sine.
    c1, c2 = np.exp(-v / 2), np.exp(-2 * v)
    quarter = (1 - c2) / 4
    weights = [((1 + c2) / 2 + c1) / 2, quarter, ((1 + c2) / 2 - c1) / 2, quarter]
    return [(w, _exact(factor, value, turns)) for turns, w in enumerate(weights)]


def _exact(factor, value, quarter_turns=0):
    T = np.eye(4, dtype=np.longdouble)
    if factor.kind == "translate":
        T[factor.axis, 3] = value
        return T
    i, j = (factor.axis + 1) % 3, (factor.axis + 2) % 3
    c, s = np.cos(value), np.sin(value)
    for _ in range(quarter_turns):
        c, s = -s, c
    T[i, i], T[i, j], T[j, i], T[j, j] = c, -s, s, c
    return T
