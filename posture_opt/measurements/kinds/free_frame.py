"""A frame of which nothing is known beforehand, as small turns and a shift about the one that suits the nominal arm."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from posture_opt.measurements.rotations import roll_pitch_yaw, turned_by
from posture_opt.numerics import Array, Json

FRAME_UNKNOWNS = (("x", "m"), ("y", "m"), ("z", "m"), ("roll", "rad"), ("pitch", "rad"), ("yaw", "rad"))
"""Names and SI units of the six unknowns: the shift d, then the turns."""


@dataclass(frozen=True, eq=False)
class FreeFrame:
    """``T m = t₀ + d + R₀ Rz Ry Rx m``: points m of the frame in the world, d and the turns small unknowns.

    Args:
        reference: (4, 4) (R₀, t₀).
    """

    reference: Array = field(default_factory=lambda: np.eye(4))

    @classmethod
    def fitted(cls, points: Array, there: Array) -> FreeFrame:
        """The reference that takes ``there`` (N, 3) best to ``points`` (N, 3), world [m]. Source: Umeyama (1991)."""
        U, _, Vt = np.linalg.svd((points - points.mean(axis=0)).T @ (there - there.mean(axis=0)))
        T = np.eye(4)
        T[:3, :3] = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        T[:3, 3] = points.mean(axis=0) - T[:3, :3] @ there.mean(axis=0)
        return cls(T)

    def rotated(self, values: Array, vectors: Array, by: int | None = None) -> Array:
        """(N, 3) ``R₀ Rz Ry Rx`` times vectors (N, 3), or its derivative by one of the turns; ``values`` (N, ≥ 6)."""
        turned = np.einsum("nij,nj->ni", turned_by(values[:, 3:6], by), vectors)
        return np.asarray(turned @ self.reference[:3, :3].T)

    def placed(self, values: Array, points: Array) -> Array:
        """(N, 3) ``T m`` of points (N, 3) of the frame."""
        return np.asarray(self.rotated(values, points) + self.reference[:3, 3] + values[:, :3])

    def seen_from(self, values: Array, points: Array) -> Array:
        """(N, 3) ``T⁻¹ p`` of points (N, 3) of the world."""
        R = self.reference[:3, :3] @ turned_by(values[:, 3:6])
        return np.asarray(np.einsum("nji,nj->ni", R, points - self.reference[:3, 3] - values[:, :3]))

    def slope(self, values: Array, points: Array, axis: int) -> tuple[Any, ...]:
        """Three coordinates of ``∂(T m)/∂`` one of the six unknowns."""
        if axis < 3:
            return tuple(1.0 if a == axis else 0.0 for a in range(3))
        return tuple(self.rotated(values, points, axis - 3).T)

    def pose(self, values: Array) -> Array:
        """(4, 4) of the frame with its unknowns ``values`` (≥ 6,)."""
        T = self.reference.copy()
        T[:3, 3] += values[:3]
        T[:3, :3] = T[:3, :3] @ turned_by(values[None, 3:6])[0]
        return T


def described_pose(T: Array) -> dict[str, Json]:
    """x, y, z [m], roll, pitch, yaw [rad] of a pose (4, 4)."""
    found: dict[str, Json] = dict(zip("xyz", map(float, T[:3, 3]), strict=True))
    return found | roll_pitch_yaw(T[:3, :3])
