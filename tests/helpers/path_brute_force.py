"""The best motion along a path by brute force: dense inverse kinematics, dynamic programming; nothing of the package.

Kinematics are the product of an arm's factors, all rows of a batch at once. Postures of a point are those that Newton's
method reaches with some joints held on a grid; the sensitivities of joint errors are geometric.
"""

from __future__ import annotations

import numpy as np

REACHED = 1e-9


def poses(robot, Q):
    """(N, 4, 4) tool poses, (N, n, 3) joint axes and (N, n, 3) points on them, world, of postures (N, n)."""
    T = np.tile(np.eye(4), (len(Q), 1, 1))
    axes, points = np.zeros((len(Q), robot.n, 3)), np.zeros((len(Q), robot.n, 3))
    for f in robot.factors:
        value = np.full(len(Q), f.nominal)
        if f.joint is not None:
            axes[:, f.joint], points[:, f.joint] = T[:, :3, f.axis], T[:, :3, 3]
            value = value + Q[:, f.joint]
        E = np.tile(np.eye(4), (len(Q), 1, 1))
        if f.kind == "translate":
            E[:, f.axis, 3] = value
        else:
            i, j = (f.axis + 1) % 3, (f.axis + 2) % 3
            c, s = np.cos(value), np.sin(value)
            E[:, i, i], E[:, i, j], E[:, j, i], E[:, j, j] = c, -s, s, c
        T = T @ E
    return T, axes, points


def jacobians(robot, Q):
    """Tool point (N, 3), tool axis z (N, 3) and their derivatives (N, 3, n)."""
    T, axes, points = poses(robot, Q)
    x, z = T[:, :3, 3], T[:, :3, 2]
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])[:, None]
    J = np.where(slides, axes, np.cross(axes, x[:, None] - points))
    turned = np.where(slides, 0.0, np.cross(axes, z[:, None]))
    return x, z, np.swapaxes(J, 1, 2), np.swapaxes(turned, 1, 2)


def reached(robot, Q, point, axis, free):
    """Those of the postures (N, n) that Newton's method brings to ``point`` and, where given, ``axis``.

    Args:
        free: indices of the joints that it may move; the others are held.
    """
    Q = Q.copy()
    for _ in range(40):
        x, z, J, turned = jacobians(robot, Q)
        gap, A = point - x, J[:, :, free]
        if axis is not None:
            gap, A = np.hstack([gap, axis - z]), np.concatenate([A, turned[:, :, free]], axis=1)
        damped = np.swapaxes(A, 1, 2) @ A + 1e-10 * np.eye(len(free))
        step = np.linalg.solve(damped, np.swapaxes(A, 1, 2) @ gap[..., None])[..., 0]
        longest = np.max(np.abs(step), axis=1, keepdims=True)
        Q[:, free] += step / np.maximum(longest / 0.5, 1.0)
        turns = np.array([joint.type == "revolute" for joint in robot.joints])
        Q = np.where(turns, (Q + np.pi) % (2 * np.pi) - np.pi, Q)
    x, z, _, _ = jacobians(robot, Q)
    gap = np.linalg.norm(point - x, axis=1)
    gap = gap if axis is None else np.maximum(gap, np.linalg.norm(axis - z, axis=1))
    inside = np.all((np.array(robot.lower) <= Q) & (np.array(robot.upper) >= Q), axis=1)
    return distinct(Q[(gap < REACHED) & inside])


def distinct(Q, digits=5):
    """Rows that differ."""
    return Q[np.unique(np.round(Q, digits), axis=0, return_index=True)[1]]


def across(robot, Q, tangent, sigma):
    """(N,) largest standard deviation [m] across ``tangent``, independent joint errors ``sigma`` (n,), first order."""
    _, _, J, _ = jacobians(robot, Q)
    J = J * sigma
    P = np.eye(3) - np.outer(tangent, tangent)
    return np.sqrt(np.linalg.eigvalsh(P @ J @ np.swapaxes(J, 1, 2) @ P)[:, -1])


def bottleneck(layers, costs, largest, ignored=()):
    """Least possible largest cost of a way with no joint step above ``largest``; infinite where there is none.

    Steps are compared but for whole turns: in favour of the brute force.
    """
    value = costs[0]
    for A, B, cost in zip(layers, layers[1:], costs[1:], strict=False):
        step = np.abs((B[None] - A[:, None] + np.pi) % (2 * np.pi) - np.pi)
        step[..., list(ignored)] = 0.0
        before = np.where(step.max(axis=2) <= largest, value[:, None], np.inf).min(axis=0)
        value = np.maximum(before, cost)
    return float(value.min())


def tangents_of(points):
    """(K, 3) bisectors of the directions of travel of an open path."""
    along = np.diff(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    both = np.vstack([along[:1], along[:-1] + along[1:], along[-1:]])
    return both / np.linalg.norm(both, axis=1, keepdims=True)
