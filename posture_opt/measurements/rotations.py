"""Small turns about a reference orientation: ``Rz(c) Ry(b) Rx(a)`` and its derivatives."""

from __future__ import annotations

import math

import numpy as np

from posture_opt.numerics import Array


def turned_by(angles: Array, by: int | None = None) -> Array:
    """(N, 3, 3) ``Rz(c) Ry(b) Rx(a)`` of angles (N, 3) a, b, c [rad], or its derivative ``by`` one of them."""
    turns = [axis_turn(axis, angles[:, axis], by == axis) for axis in range(3)]
    return np.asarray(turns[2] @ turns[1] @ turns[0])


def axis_turn(axis: int, angle: Array, derivative: bool) -> Array:
    """(N, 3, 3) rotations about a coordinate axis by angles (N,), or their derivatives."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = (-np.sin(angle), np.cos(angle)) if derivative else (np.cos(angle), np.sin(angle))
    found = np.zeros((len(angle), 3, 3))
    found[:, axis, axis] = 0.0 if derivative else 1.0
    found[:, i, i], found[:, i, j], found[:, j, i], found[:, j, j] = c, -s, s, c
    return found


def inverted_poses(position: Array, rotation: Array) -> tuple[Array, Array]:
    """``T⁻¹`` of poses: (N, 3) ``−Rᵀ p`` [m] and (N, 4) conjugate quaternions, w first."""
    w, v, p = rotation[:, :1], -rotation[:, 1:], -position
    return p + 2 * np.cross(v, np.cross(v, p) + w * p), np.concatenate([w, v], axis=1)


def roll_pitch_yaw(R: Array) -> dict[str, float]:
    """Roll, pitch, yaw [rad] of ``R = Rz(yaw) Ry(pitch) Rx(roll)``; at a pitch of 90° all of the turn is yaw."""
    level = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], level)
    if level < 1e-9:
        return {"roll": 0.0, "pitch": pitch, "yaw": math.atan2(-R[0, 1], R[1, 1])}
    return {"roll": math.atan2(R[2, 1], R[2, 2]), "pitch": pitch, "yaw": math.atan2(R[1, 0], R[0, 0])}
