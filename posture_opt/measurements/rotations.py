"""Rotations, rigid transformations, and a frame of which nothing is known beforehand."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from posture_opt.numerics import Array, Json


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


def rotation_matrices(quaternions: Array) -> Array:
    """Rotation matrices (N, 3, 3) of unit quaternions (N, 4), w first."""
    # ``R(q) v`` turns v as the quaternion does (Hamilton's convention, active rotation)
    w, x, y, z = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def quaternions_of(R: Array) -> Array:
    """(N, 4) unit quaternions, w first, of matrices (N, 3, 3): the largest column of ``4 q qᵀ``, scaled to 1."""
    t, skew = np.trace(R, axis1=-2, axis2=-1), np.stack(skew_part(R - np.swapaxes(R, -1, -2)), axis=-1)
    K = np.empty((len(R), 4, 4))
    K[:, 0, 0], K[:, 0, 1:], K[:, 1:, 0] = 1 + t, skew, skew
    K[:, 1:, 1:] = R + np.swapaxes(R, -1, -2) + (1 - t)[:, None, None] * np.eye(3)
    largest = np.argmax(np.nan_to_num(np.diagonal(K, axis1=-2, axis2=-1)), axis=1)
    found = K[np.arange(len(R)), largest]
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def rotation_vectors(R: Array) -> Array:
    """Rotation vectors (N, 3) [rad] of rotation matrices (N, 3, 3), by way of the quaternion."""
    # ``log(R)``: axis times angle, ``θ = atan2(|w|, (tr R − 1)/2)`` with w the vector of the skew part; exact near
    # zero, and not defined at half a turn
    skew = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=-1) / 2
    sine = np.linalg.norm(skew, axis=-1)
    angle = np.arctan2(sine, (np.trace(R, axis1=-2, axis2=-1) - 1) / 2)
    ratio = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), 1.0)
    return skew * ratio[:, None]


def skew_part(W: Array) -> tuple[Array, Array, Array]:
    """Three coordinates (N,) of the vector w with ``W v = w × v``, of skew matrices W (N, 3, 3)."""
    return W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]


def roll_pitch_yaw(R: Array) -> dict[str, float]:
    """Roll, pitch, yaw [rad] of ``R = Rz(yaw) Ry(pitch) Rx(roll)``; at a pitch of 90° all of the turn is yaw."""
    level = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], level)
    if level < 1e-9:
        return {"roll": 0.0, "pitch": pitch, "yaw": math.atan2(-R[0, 1], R[1, 1])}
    return {"roll": math.atan2(R[2, 1], R[2, 2]), "pitch": pitch, "yaw": math.atan2(R[1, 0], R[0, 0])}


def nearest_rotation(M: NDArray[Any]) -> Array:
    """The rotation closest to a (3, 3) matrix, by Kabsch's singular value decomposition."""
    U, _, Vt = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def cross_matrices(v: Array) -> Array:
    """(n, 3, 3) matrices ``[v]×`` of vectors (n, 3): ``[v]× a = v × a``."""
    W = np.zeros((len(v), 3, 3))
    W[:, 2, 1], W[:, 0, 2], W[:, 1, 0] = v.T
    return W - np.swapaxes(W, 1, 2)


def rigid(R: Array, t: Array) -> Array:
    """(…, 4, 4) of rotations (…, 3, 3) and shifts (…, 3)."""
    T = np.zeros((*t.shape[:-1], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


# Names and SI units of the six unknowns of a frame: the shift d, then the turns
FRAME_UNKNOWNS = (("x", "m"), ("y", "m"), ("z", "m"), ("roll", "rad"), ("pitch", "rad"), ("yaw", "rad"))


@dataclass(frozen=True, eq=False)
class FreeFrame:
    """``T m = t₀ + d + R₀ Rz Ry Rx m``: points m of the frame in the world, d and the turns small unknowns."""

    reference: Array = field(default_factory=lambda: np.eye(4))  # (4, 4) (R₀, t₀)

    @classmethod
    def fitted(cls, points: Array, there: Array) -> FreeFrame:
        """The reference that takes ``there`` (N, 3) best to ``points`` (N, 3), world [m]. Source: Umeyama (1991)."""
        R = nearest_rotation((points - points.mean(axis=0)).T @ (there - there.mean(axis=0)))
        return cls(rigid(R, points.mean(axis=0) - R @ there.mean(axis=0)))

    def turn(self, values: Array, by: int | None = None) -> Array:
        """(N, 3, 3) ``R₀ Rz Ry Rx``, or its derivative by one of the turns; ``values`` (N, ≥ 6)."""
        return np.asarray(self.reference[:3, :3] @ turned_by(values[:, 3:6], by))

    def rotated(self, values: Array, vectors: Array, by: int | None = None) -> Array:
        """(N, 3) ``R₀ Rz Ry Rx`` times vectors (N, 3), or its derivative by one of the turns; ``values`` (N, ≥ 6)."""
        return np.asarray(np.einsum("nij,nj->ni", self.turn(values, by), vectors))

    def placed(self, values: Array, points: Array) -> Array:
        """(N, 3) ``T m`` of points (N, 3) of the frame."""
        return np.asarray(self.rotated(values, points) + self.reference[:3, 3] + values[:, :3])

    def seen_from(self, values: Array, points: Array) -> Array:
        """(N, 3) ``T⁻¹ p`` of points (N, 3) of the world."""
        moved = points - self.reference[:3, 3] - values[:, :3]
        return np.asarray(np.einsum("nji,nj->ni", self.turn(values), moved))

    def slope(self, values: Array, points: Array, axis: int) -> tuple[Any, ...]:
        """Three coordinates of ``∂(T m)/∂`` one of the six unknowns."""
        if axis < 3:
            return tuple(1.0 if a == axis else 0.0 for a in range(3))
        return tuple(self.rotated(values, points, axis - 3).T)

    def pose(self, values: Array) -> Array:
        """(4, 4) of the frame with its unknowns ``values`` (≥ 6,)."""
        return rigid(self.turn(values[None])[0], self.reference[:3, 3] + values[:3])


def described_pose(T: Array) -> dict[str, Json]:
    """x, y, z [m], roll, pitch, yaw [rad] of a pose (4, 4)."""
    found: dict[str, Json] = dict(zip("xyz", map(float, T[:3, 3]), strict=True))
    return found | roll_pitch_yaw(T[:3, :3])
