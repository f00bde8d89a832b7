"""Robotics Toolbox for Python: random inverse kinematics, the best of 200.

The fastest idiom found: the C++ Levenberg-Marquardt solver (`ik_LM`, Chan's damping) on an ETS whose constant
transforms are folded into one a joint, one search from a random posture per random yaw, no repeats of failed ones.
A free yaw by `mask` takes two to four times as long, Newton-Raphson and Gauss-Newton two to ten times. All
solutions are scored together in NumPy, cheaper than one `jacob0` each.
"""

from __future__ import annotations

import numpy as np
from roboticstoolbox import ET, ETS

from benchmarks.arms import Arm, Array
from benchmarks.objective import position_jacobians, worst_axis
from benchmarks.ways import Solve

TITLE = "roboticstoolbox, IK sampling, best of 200"

# ik_LM stops at ½|e|² < TOLERANCE: the pose is then met within 0.5 µm and 0.5 µrad. Its default, 1e-6, is 1.4 mm.
TOLERANCE = 1e-13
ITERATIONS = 15


def ets(arm: Arm) -> ETS:
    """The arm as an elementary transform sequence with two factors a joint."""
    lower, upper = arm.limits
    factors = []
    for i, (T, axis) in enumerate(zip(arm.placements[:-1], arm.axes, strict=True)):
        factors += [ET.SE3(T), getattr(ET, f"R{axis}")(jindex=i, qlim=[lower[i], upper[i]])]
    return ETS([*factors, ET.SE3(arm.placements[-1])])


def poses(position: Array, yaw: Array) -> Array:
    """Tool poses (N, 4, 4) at `position` with the tool axis down and the given yaw angles (N,)."""
    T = np.zeros((len(yaw), 4, 4))
    T[:, 0, 0] = np.cos(yaw)
    T[:, 0, 1] = T[:, 1, 0] = np.sin(yaw)
    T[:, 1, 1] = -T[:, 0, 0]
    T[:, 2, 2] = -1.0
    T[:, :3, 3] = position
    T[:, 3, 3] = 1.0
    return T


def sampler(arm: Arm, samples: int, seed: int) -> Solve:
    """A function that gives all postures found in `samples` searches, (N, n) [rad]."""
    chain, (lower, upper) = ets(arm), arm.limits

    def sample(position: Array) -> Array:
        rng = np.random.default_rng(seed)
        starts = rng.uniform(lower, upper, (samples, len(lower)))
        found = [
            chain.ik_LM(T, q0=q0, tol=TOLERANCE, ilimit=ITERATIONS, slimit=1, k=0.1)
            for T, q0 in zip(poses(position, rng.uniform(-np.pi, np.pi, samples)), starts, strict=True)
        ]
        return np.array([solution.q for solution in found if solution.success]).reshape(-1, len(lower))

    return sample


def build(arm: Arm, samples: int = 200, seed: int = 0) -> Solve:
    sample, sigma = sampler(arm, samples, seed), np.array(arm.sigma)

    def solve(position: Array) -> Array | None:
        Q = sample(position)
        return Q[np.argmin(worst_axis(position_jacobians(arm, Q), sigma))] if len(Q) else None

    return solve
