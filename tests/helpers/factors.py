"""The product of a chain's factors in plain NumPy, written without a line of the package."""

from __future__ import annotations

import numpy as np


def elementary(kind, axis, value):
    """(4, 4) translation along, or rotation about, a coordinate axis."""
    T = np.eye(4)
    if kind == "translate":
        T[axis, 3] = value
        return T
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(value), np.sin(value)
    T[i, i], T[i, j], T[j, i], T[j, j] = c, -s, s, c
    return T


def product(factors, q, parameters=None):
    """(4, 4) product of the factors at the joint values ``q``, errors given by name in ``parameters``."""
    T = np.eye(4)
    for f in factors:
        value = f.nominal + (parameters or {}).get(f.parameter, 0.0)
        if f.joint is not None:
            value += q[f.joint]
        T = T @ elementary(f.kind, f.axis, value)
    return T


def pose(robot, q, parameters=None):
    """(4, 4) T_world_tool."""
    return product(robot.factors, q, parameters)


def differences(f, x, h=1e-6):
    """(m, k) Jacobian of f (k,) -> (m,) by central differences: good to 1e-9 for lengths and angles of order one."""
    return np.array([(f(x + step) - f(x - step)) / (2 * h) for step in h * np.eye(len(x))]).T


def joint_jacobian(robot, q):
    """(3, n) derivative of the tool point with respect to the joints."""
    return differences(lambda moved: pose(robot, moved)[:3, 3], np.asarray(q, dtype=float))


def parameter_jacobian(robot, q, names):
    """(3, k) derivative of the tool point with respect to the named parameters."""
    return differences(lambda p: pose(robot, q, dict(zip(names, p, strict=True)))[:3, 3], np.zeros(len(names)))


def random_postures(robot, n, seed=0):
    """(n, robot.n) postures, uniform within the limits."""
    return np.random.default_rng(seed).uniform(robot.lower, robot.upper, (n, robot.n))


def frame(robot, q, index):
    """(4, 4) T_world_link of the frame behind ``links[index]``."""
    before = [f for link in robot.links[: index + 1] for f in link]
    return product([*robot.base, *before], q)
