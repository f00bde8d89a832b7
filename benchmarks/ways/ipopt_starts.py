"""The best known: IPOPT through CasADi, from 64 feasible postures. A reference for quality, not built for speed."""

from __future__ import annotations

import casadi as ca
import numpy as np

from benchmarks.arms import Arm, Array
from benchmarks.objective import SCALE
from benchmarks.ways import Solve
from benchmarks.ways.rtb_sampling import sampler

TITLE = "IPOPT, 64 feasible starts"


def build(arm: Arm, starts: int = 64, seed: int = 1) -> Solve:
    solver, n = _solver(arm), len(arm.sigma)
    sample = sampler(arm, 8 * starts, seed)
    lower, upper = arm.limits
    bounds = {
        "lbx": [*lower, 0.0],
        "ubx": [*upper, np.inf],
        "lbg": [0.0] * 5 + [0.0] * 4,
        "ubg": [0.0] * 5 + [np.inf] * 4,
    }

    def solve(position: Array) -> Array | None:
        found: list[tuple[float, Array]] = []
        for q in sample(position)[:starts]:
            outcome = solver(x0=[*q, 1.0], p=position, **bounds)
            if solver.stats()["success"]:
                found.append((float(outcome["f"]), np.array(outcome["x"]).ravel()[:n]))
        return min(found, key=lambda pair: pair[0])[1] if found else None

    return solve


def _solver(arm: Arm) -> ca.Function:
    """min t over (q, t) so that t I - C is positive semidefinite: (t - c11)(t - c22) >= c12², t >= c11, t >= c22."""
    n = len(arm.sigma)
    q, t, target = ca.SX.sym("q", n), ca.SX.sym("t"), ca.SX.sym("target", 3)
    T = _forward(arm, q)
    J = ca.jacobian(T[:2, 3], q)
    C = J @ ca.diag(ca.DM(np.square(arm.sigma) * SCALE)) @ J.T
    pose = ca.vertcat(T[:3, 3] - target, T[:2, 2])
    rows = ca.vertcat((t - C[0, 0]) * (t - C[1, 1]) - C[0, 1] ** 2, t - C[0, 0], t - C[1, 1], -T[2, 2])
    nlp = {"x": ca.vertcat(q, t), "p": target, "f": t, "g": ca.vertcat(pose, rows)}
    quiet = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"}
    return ca.nlpsol("best_known", "ipopt", nlp, {**quiet, "ipopt.tol": 1e-9, "ipopt.max_iter": 300})


def _forward(arm: Arm, q: ca.SX) -> ca.SX:
    T = ca.SX.eye(4)
    for i, (placement, axis) in enumerate(zip(arm.placements[:-1], arm.axes, strict=True)):
        T = T @ ca.DM(placement) @ _turn(axis, q[i])
    return T @ ca.DM(arm.placements[-1])


def _turn(axis: str, angle: ca.SX) -> ca.SX:
    T = ca.SX.eye(4)
    k = "xyz".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    T[i, i] = T[j, j] = ca.cos(angle)
    T[j, i] = ca.sin(angle)
    T[i, j] = -ca.sin(angle)
    return T
