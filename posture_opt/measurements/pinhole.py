"""A pinhole camera with plumb-bob distortion: where a point is in the picture, and along which ray a pixel looks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.numerics import Array

INTRINSICS = ("focal_length", "c_x", "c_y", "k1", "k2", "p1", "p2")
"""What of a camera can be unknown beside its pose: the share by which its focal lengths are longer [1], the shift of
its principal point in focal lengths [1], and what is added to its distortion [1]."""
_UNDISTORTING_ROUNDS = 30
"""Of a fixed-point iteration; some ten suffice at usual lenses."""
_LEAST_DEPTH_M = 1e-6
"""A point nearer to the plane of the lens has no picture."""


@dataclass(frozen=True)
class Intrinsics:
    """What a calibration of a camera says: OpenCV's camera matrix and distortion coefficients.

    Args:
        focal: f_x, f_y [px]; centre: c_x, c_y [px].
        distortion: k1, k2, p1, p2, k3 [1].
        size: width and height of the picture [px]; zeros where they are not known.
    """

    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: tuple[float, ...] = (0.0,) * 5
    size: tuple[int, int] = (0, 0)

    @property
    def row(self) -> Array:
        """(9,) f_x, f_y, c_x, c_y, k1, k2, p1, p2, k3."""
        return np.array([*self.focal, *self.centre, *self.distortion])

    def rays(self, pixels: Array) -> Array:
        """(N, 2) the points ``(x', y')`` at a depth of one whose pictures are the pixels (N, 2), by iteration."""
        distorted = (pixels - self.centre) / self.focal
        found = distorted.copy()
        for _ in range(_UNDISTORTING_ROUNDS):
            radial, tangential, _ = _distortion(found, np.array(self.distortion)[:, None])
            found = (distorted - tangential) / radial[:, None]
        return np.asarray(found)

    def changed(self, unknowns: Array) -> Intrinsics:
        """The intrinsics with the values of `INTRINSICS` (7,) that a fit found."""
        k = tuple(float(d + e) for d, e in zip(self.distortion, [*unknowns[3:], 0.0], strict=True))
        fx, fy = (f * (1 + float(unknowns[0])) for f in self.focal)
        cx, cy = (c + f * float(u) for c, f, u in zip(self.centre, self.focal, unknowns[1:3], strict=True))
        return Intrinsics((fx, fy), (cx, cy), k, self.size)


@dataclass(frozen=True, eq=False)
class Picture:
    """Where points are in their pictures, and how that changes.

    Args:
        pixels: (N, 2) [px]; by_point: (N, 2, 3) their derivatives by the points in the camera's frame [px/m].
        by_intrinsics: (N, 2, 7) by the unknowns of `INTRINSICS` [px].
    """

    pixels: Array
    by_point: Array
    by_intrinsics: Array


def projected(points: Array, rows: Array, unknowns: Array) -> Picture:
    """The pictures of points by ``u = f_x x'' + c_x`` with the distorted ``x''``; OpenCV's ``projectPoints``.

    ``x' = x/z``, ``x'' = x' (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x'y' + p2 (r² + 2x'²)``, likewise ``y''``.

    Args:
        points: (N, 3) in the frame of the camera [m], z along its axis.
        rows: (N, 9) of `Intrinsics.row`; unknowns: (N, 7) of `INTRINSICS`.
    """
    depth = np.where(np.abs(points[:, 2]) < _LEAST_DEPTH_M, _LEAST_DEPTH_M, points[:, 2])
    flat = points[:, :2] / depth[:, None]
    f0, k = rows[:, :2], rows[:, 4:].T.copy()
    k[:4] += unknowns[:, 3:].T
    f = f0 * (1 + unknowns[:, :1])
    radial, tangential, slope = _distortion(flat, k)
    bent = flat * radial[:, None] + tangential
    by_flat = f[:, :, None] * slope
    by_point = np.empty((len(points), 2, 3))
    by_point[:, :, :2] = by_flat / depth[:, None, None]
    by_point[:, :, 2] = -np.einsum("nij,nj->ni", by_flat, flat) / depth[:, None]
    pixels = f * bent + rows[:, 2:4] + f0 * unknowns[:, 1:3]
    return Picture(pixels, by_point, _by_intrinsics(flat, bent, f0, f))


def _by_intrinsics(flat: Array, bent: Array, f0: Array, f: Array) -> Array:
    """(N, 2, 7) derivatives of pixels by the unknowns of `INTRINSICS`."""
    x, y = flat.T
    square = x**2 + y**2
    found = np.zeros((len(flat), 2, len(INTRINSICS)))
    found[:, :, 0] = f0 * bent
    found[:, 0, 1], found[:, 1, 2] = f0.T
    found[:, :, 3], found[:, :, 4] = f * flat * square[:, None], f * flat * square[:, None] ** 2
    found[:, :, 5] = f * np.stack([2 * x * y, square + 2 * y**2], axis=1)
    found[:, :, 6] = f * np.stack([square + 2 * x**2, 2 * x * y], axis=1)
    return found


def _distortion(flat: Array, k: Array) -> tuple[Array, Array, Array]:
    """The radial factor (N,), the tangential shift (N, 2), and the derivative (N, 2, 2) of the distorted points.

    Args:
        flat: (N, 2) x', y'; k: (5, N) or (5, 1) coefficients.
    """
    x, y = flat.T
    square = x**2 + y**2
    k1, k2, p1, p2, k3 = k
    radial: Any = 1 + square * (k1 + square * (k2 + square * k3))
    tangential = np.stack(
        [2 * p1 * x * y + p2 * (square + 2 * x**2), p1 * (square + 2 * y**2) + 2 * p2 * x * y], axis=1
    )
    growth = 2 * (k1 + square * (2 * k2 + 3 * square * k3))
    slope = np.empty((len(flat), 2, 2))
    slope[:, 0, 0] = radial + growth * x**2 + 2 * p1 * y + 6 * p2 * x
    slope[:, 1, 1] = radial + growth * y**2 + 6 * p1 * y + 2 * p2 * x
    slope[:, 0, 1] = slope[:, 1, 0] = growth * x * y + 2 * p1 * x + 2 * p2 * y
    return radial, tangential, slope
