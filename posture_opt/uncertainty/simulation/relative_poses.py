"""Drawn tool poses as seen from a workpiece that is drawn with them: the whole motion, not its first order."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from posture_opt.model.chain import Vector
from posture_opt.numerics import Array
from posture_opt.uncertainty.sources.workpiece import ANGLE, COORDINATES, FEATURE, POSITION, of_workpiece


def relative_poses(shift: Array, rotation: Array, named: Mapping[str, Array], lever: Vector) -> tuple[Array, Array]:
    """Shifts (N, 3) [m] and rotation vectors (N, 3) [rad] of the tool relative to a feature, in its nominal axes.

    The workpiece with the shift t and the turn R(φ) about its origin brings its feature, itself off by f, to
    ``t + R (l + f)``. In its frame the tool with the error e is off by ``Rᵀ (e − t − (R − 1) l) − f``, turned by
    ``Rᵀ R_tool``.

    Args:
        shift, rotation: (N, 3) of the tool, world axes; they come back as they are where no workpiece is drawn.
        named: drawn errors (N,) by the names of their sources [SI].
        lever: (3,) l from the workpiece's origin to the feature [m], world.
    """
    if not any(map(of_workpiece, named)):
        return shift, rotation
    t, phi, f = (_drawn(stated, named, len(shift)) for stated in (POSITION, ANGLE, FEATURE))
    arm = np.broadcast_to(np.asarray(lever, dtype=float), shift.shape)
    off = shift - t - _turned(phi, arm)
    return off + _turned(-phi, off) - f, _composed(-phi, rotation)


def _drawn(stated: str, named: Mapping[str, Array], count: int) -> Array:
    """(N, 3) the coordinates of one error of the file; zeros where it is not drawn."""
    zero = np.zeros(count)
    return np.stack([named.get(f"{stated}.{c}", zero) for c in COORDINATES], axis=-1)


def _turned(phi: Array, v: Array) -> Array:
    """(N, 3) ``R(φ) v − v``, without cancellation."""
    angle, unit = _angle_and_axis(phi)
    first = np.cross(unit, v)
    return np.asarray(np.sin(angle) * first + 2 * np.sin(angle / 2) ** 2 * np.cross(unit, first))


def _composed(a: Array, b: Array) -> Array:
    """(N, 3) rotation vector of ``R(a) R(b)``, by quaternions."""
    (angle_a, unit_a), (angle_b, unit_b) = _angle_and_axis(a), _angle_and_axis(b)
    wa, va, wb, vb = (
        np.cos(angle_a / 2),
        unit_a * np.sin(angle_a / 2),
        np.cos(angle_b / 2),
        unit_b * np.sin(angle_b / 2),
    )
    w = wa * wb - np.sum(va * vb, axis=1, keepdims=True)
    v = wa * vb + wb * va + np.cross(va, vb)
    sine = np.linalg.norm(v, axis=1, keepdims=True)
    # q and -q are one rotation: the half of it with w >= 0 is the short way.
    angle = 2 * np.arctan2(sine, np.abs(w)) * np.where(w < 0, -1.0, 1.0)
    return np.asarray(v * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0))


def _angle_and_axis(phi: Array) -> tuple[Array, Array]:
    """Angles (N, 1) [rad] and unit vectors (N, 3) of rotation vectors; zeros for no rotation."""
    angle = np.linalg.norm(phi, axis=1, keepdims=True)
    return angle, np.divide(phi, angle, out=np.zeros_like(phi), where=angle > 0)
