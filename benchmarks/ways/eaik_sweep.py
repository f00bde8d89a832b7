"""The truth for a 6R arm: EAIK's analytic inverse over a fine sweep of the yaw, the best branches refined."""

from __future__ import annotations

import numpy as np
from eaik.IK_HP import HPRobot
from scipy.optimize import minimize_scalar

from benchmarks.arms import Arm, Array
from benchmarks.objective import position_jacobians, worst_axis
from benchmarks.ways import Solve
from benchmarks.ways.rtb_sampling import poses

TITLE = "EAIK, yaw sweep, 720 steps, refined"
REFINED = 3


def build(arm: Arm, steps: int = 720) -> Solve:
    inverse, sigma = AnalyticInverse(arm), np.array(arm.sigma)

    def score(Q: Array) -> Array:
        return worst_axis(position_jacobians(arm, Q), sigma)

    def solve(position: Array) -> Array | None:
        yaws = np.linspace(-np.pi, np.pi, steps, endpoint=False)
        Q, step = inverse(poses(position, yaws))
        if not len(Q):
            return None
        values = score(Q)
        candidates = [Q[np.argmin(values)]]
        for i in _separate(values, step, steps):
            candidates += _refined(inverse, score, position, yaws[step[i]], Q[i], 2 * np.pi / steps)
        found = np.array(candidates)
        return found[np.argmin(score(found))]

    return solve


class AnalyticInverse:
    """All postures within the limits that reach the given poses exactly."""

    def __init__(self, arm: Arm) -> None:
        self.lower, self.upper = arm.limits
        T, axes, points = np.eye(4), [], []
        for placement, axis in zip(arm.placements[:-1], arm.axes, strict=True):
            T = T @ placement
            axes.append(T[:3, "xyz".index(axis)])
            points.append(T[:3, 3])
        self.zero = T @ arm.placements[-1]
        points.append(self.zero[:3, 3])
        self.robot = HPRobot(np.array(axes), np.diff(points, axis=0, prepend=np.zeros((1, 3))))

    def __call__(self, poses: Array) -> tuple[Array, Array]:
        """Postures (N, n) and the index of the pose that each reaches (N,); least-squares answers are left out."""
        poses = poses.copy()
        poses[:, :3, :3] = poses[:, :3, :3] @ self.zero[:3, :3].T  # EAIK's tool is aligned with the base at q = 0
        Q: list[Array] = []
        index: list[int] = []
        for i, pose in enumerate(poses):
            solution = self.robot.IK(pose)
            for q, least_squares in zip(solution.Q, solution.is_LS, strict=True):
                if not least_squares and np.all(self.lower <= q) and np.all(q <= self.upper):
                    Q.append(q)
                    index.append(i)
        return np.array(Q).reshape(-1, len(self.lower)), np.array(index, dtype=int)


def _separate(values: Array, step: Array, steps: int) -> list[int]:
    """The best few postures whose yaw angles are not neighbours."""
    chosen: list[int] = []
    for i in np.argsort(values):
        if all(min(abs(step[i] - step[j]), steps - abs(step[i] - step[j])) > 1 for j in chosen):
            chosen.append(int(i))
        if len(chosen) == REFINED:
            break
    return chosen


def _refined(inverse, score, position: Array, yaw: float, q: Array, width: float) -> list[Array]:  # type: ignore[no-untyped-def]
    """The best posture of q's branch with a yaw within `width`, by Brent's bounded search."""

    def nearest(angle: float) -> Array | None:
        Q, _ = inverse(poses(position, np.array([angle])))
        distance = np.abs(Q - q).max(axis=1) if len(Q) else np.array([np.inf])
        return Q[np.argmin(distance)] if distance.min() < 0.5 else None

    def value(angle: float) -> float:
        posture = nearest(angle)
        return np.inf if posture is None else float(score(posture[None])[0]) * 1e8

    outcome = minimize_scalar(value, bounds=(yaw - width, yaw + width), method="bounded", options={"xatol": 1e-6})
    posture = nearest(outcome.x)
    return [] if posture is None else [posture]
