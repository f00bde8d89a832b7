"""Arms that were measured in a small cube at constant orientation, where base and tool can hardly be told apart."""

from __future__ import annotations

import numpy as np

from tests.hidden.arms import ARMS
from tests.hidden.designs import Session, draw_centre
from tests.hidden.draw import Draw, geometry, place, stated
from tests.hidden.families import Setting
from tests.hidden.mechanics import Arm, exponential, walk

NOISE = 0.05e-3  # m
EDGE = 60e-3  # m


def small_volume(seed: int, name: str, rows: int, *, tilt: float = 0.0, digits: int = 9) -> tuple[Draw, Arm]:
    """The files' content and the true arm: free frames, orientations that vary by ``tilt`` [rad].

    Joint values are logged and commanded to so many ``digits`` of a degree.
    """
    rng = np.random.default_rng(seed)
    arm = place(rng, ARMS[name]())
    q = None
    while q is None:
        centre = draw_centre(rng, arm)
        q = _postures(arm, centre, rng.uniform(-EDGE / 2, EDGE / 2, (rows, 3)), rng.normal(0, 1, (rows, 3)) * tilt)
    q = np.radians(np.round(np.degrees(q), digits))
    points = walk(arm, q, geometry(rng, arm, Setting())).p + rng.normal(0, NOISE, (rows, 3))
    zero, none = np.zeros(rows), np.zeros((rows, arm.n))
    session = Session(q, np.arange(rows), none, none, zero, zero + 20, 30.0 * np.arange(rows), False, False, False)
    word = bool(rng.random() < 0.5)
    return Draw(stated(rng, arm, True), True, word, session, points, None, {}, None, {"sigma": NOISE}), arm


def _postures(arm: Arm, centre: np.ndarray, shifts: np.ndarray, turns: np.ndarray) -> np.ndarray | None:
    """Joint values (N, n) that shift and turn the tool from where it is at the ``centre``; None out of limits."""
    q, found = centre.copy(), []
    p0, R0 = _pose(arm, centre[None])
    for shift, turn in zip(shifts, exponential(turns) @ R0, strict=True):
        for _ in range(60):
            p, R = _pose(arm, q[None])
            off = np.r_[p0[0] + shift - p[0], _vector(turn @ R[0].T)]
            if np.abs(off).max() < 1e-10:
                break
            moved, turned = _pose(arm, q + 1e-6 * np.eye(arm.n))
            J = np.concatenate([moved - p, [_vector(T @ R[0].T) for T in turned]], axis=1).T / 1e-6
            q = q + J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(6), off)
        else:
            return None
        found.append(q)
    found = np.array(found)
    return found if np.all((found > arm.lower) & (found < arm.upper)) else None


def _pose(arm: Arm, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    reached = walk(arm, q)
    return reached.p, reached.R_link[:, -1]


def _vector(R: np.ndarray) -> np.ndarray:
    return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
