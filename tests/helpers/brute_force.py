"""The best posture in a cell by brute force: random postures led to the target, coal, and random steps downhill.

Nothing of the package is used but the robot's numbers and which pairs count.
"""

from __future__ import annotations

import numpy as np

from tests.helpers import coal_distance
from tests.helpers.capsules import in_the_world

_DAMPING = 1e-6
_ARRIVED = 1e-6


def elementary(kind, axis, values):
    """(N, 4, 4) translations along, or rotations about, a coordinate axis."""
    T = np.tile(np.eye(4), (len(values), 1, 1))
    if kind == "translate":
        T[:, axis, 3] = values
        return T
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(values), np.sin(values)
    T[:, i, i], T[:, i, j], T[:, j, i], T[:, j, j] = c, -s, s, c
    return T


def tool_and_jacobian(robot, Q):
    """(N, 4, 4) pose of the tool and (N, 6, n) its geometric Jacobian, linear first."""
    T, joints = np.tile(np.eye(4), (len(Q), 1, 1)), []
    for f in robot.factors:
        if f.joint is not None:
            joints.append((f, T[:, :3, f.axis], T[:, :3, 3]))
        T = T @ elementary(f.kind, f.axis, f.nominal + (Q[:, f.joint] if f.joint is not None else np.zeros(len(Q))))
    columns = []
    for f, axis, origin in joints:
        turns = f.kind == "rotate"
        linear = np.cross(axis, T[:, :3, 3] - origin) if turns else axis
        columns.append(np.hstack([linear, axis if turns else np.zeros_like(axis)]))
    return T, np.stack(columns, axis=2)


def led_to(robot, Q, point, direction, steps=40):
    """Postures (k, n) of Q (N, n) that damped Gauss-Newton steps bring to a point, z of the tool along a direction."""
    for _ in range(steps):
        T, J = tool_and_jacobian(robot, Q)
        axis = T[:, :3, 2]
        error = np.hstack([point - T[:, :3, 3], np.cross(axis, direction)])
        across = np.eye(3) - axis[:, :, None] * axis[:, None, :]
        J = np.concatenate([J[:, :3], across @ J[:, 3:]], axis=1)
        step = J.transpose(0, 2, 1) @ np.linalg.solve(J @ J.transpose(0, 2, 1) + _DAMPING * np.eye(6), error[..., None])
        Q = np.clip(Q + np.clip(step[..., 0], -0.5, 0.5), robot.lower, robot.upper)
    T, _ = tool_and_jacobian(robot, Q)
    error = np.linalg.norm(np.hstack([point - T[:, :3, 3], T[:, :3, 2] - direction]), axis=1)
    return Q[error < _ARRIVED]


def sigma_across(robot, Q, sigma, basis):
    """(N,) largest standard deviation in the span of ``basis`` (3, 2), first order in joint errors ``sigma`` (n,)."""
    _, J = tool_and_jacobian(robot, Q)
    A = (basis.T @ J[:, :3]) * sigma
    return np.sqrt(np.linalg.eigvalsh(A @ A.transpose(0, 2, 1))[:, -1])


def clearance(scene, q):
    """The least distance at one posture, by coal [m]."""
    return min(distances(scene, q))


def slack(scene, q):
    """By how much the nearest pair exceeds what it has to keep at one posture, by coal [m]."""
    return min(np.array(distances(scene, q)) - scene.required)


def distances(scene, q):
    """The distance of every pair that is checked at one posture, by coal [m]."""
    solids = [coal_distance.capsule(*in_the_world(scene.robot, q, capsule)) for capsule in scene.placed.capsules]
    thin = [capsule.radius - counted for capsule, counted in zip(scene.placed.capsules, scene.own_radii, strict=True)]
    own = [coal_distance.distance(solids[i], solids[j]) + thin[i] + thin[j] for i, j in scene.own]
    others = zip(scene.obstacles, scene.against, strict=True)
    far = [coal_distance.distance(solids[k], coal_distance.solid(o)) for o, chosen in others for k in chosen]
    return own + far


def best_posture(scene, sigma, basis, point, direction, rng, *, starts=2000, kept=6, rounds=12, tried=12):
    """The least sigma among postures that are clear, and the posture (n,)."""
    robot = scene.robot
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    Q = led_to(robot, rng.uniform(low, high, (starts, robot.n)), point, direction)
    found = [(s, q) for s, q in clear_ones(scene, Q, sigma, basis, most=8 * kept)]
    best = []
    for value, q in found[:: max(len(found) // kept, 1)][:kept] + found[:2]:
        length = 0.3
        for _ in range(rounds):
            near = led_to(robot, q + rng.normal(size=(tried, robot.n)) * length, point, direction, steps=12)
            better = clear_ones(scene, near, sigma, basis, most=1, below=value)
            (value, q), length = better[0] if better else (value, q), length * (0.9 if better else 0.5)
        best.append((value, q))
    return min(best, key=lambda pair: pair[0])


def clear_ones(scene, Q, sigma, basis, most, below=np.inf):
    """At most so many (sigma, posture) that keep the margin and are below a value, the least first."""
    values = sigma_across(scene.robot, Q, sigma, basis) if len(Q) else np.zeros(0)
    found = []
    for k in np.argsort(values):
        if values[k] >= below or len(found) == most:
            break
        if slack(scene, Q[k]) >= 0:
            found.append((float(values[k]), Q[k]))
    return found
