"""How well the nominal arm agrees with measurements whatever its base and tool are: a linear question.

With the flange at ``p(q)``, ``R(q)``, a tool offset t and the base turned by B and shifted by b, the tool point is
``x = B p + B R t + b``: linear in B, in the products ``B ⊗ t`` and in b. So one linear least-squares fit shows
whether the commanded joints can have led to the measured points, and ``B`` comes out as a free 3×3 matrix: its
scale is that of the units, its determinant says whether the frame is right-handed. Where the rows are too few for
all its unknowns, B is held to a scaled rotation or reflection and found in turns with t.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from posture_opt.measurements.measurements import Measurements, nominal_poses
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot

_MAX_SAMPLE_ROWS = 400
"""Postures suffice for a question about whole columns."""
_RANK_TOLERANCE = 1e-8
"""Share of the largest singular value below which a direction is rounding."""
_MIN_POSTURES = 6
"""Postures for the scaled rotation: 18 coordinates for its 10 unknowns."""
_ALTERNATIONS = 20
"""Turns of rotation and tool; five suffice for measured arms."""
_MIN_FREE_MOTION = 0.02
"""Share of the tool's motion that must be free of the wrist's, so that B can be separated from the tool."""

Misfit = Callable[[Array], float]
"""Joint values (m, n) of the sample -> what the nominal arm leaves unexplained, as a share; NaN where too few."""


@dataclass(frozen=True)
class AffineFit:
    """The free linear map from the nominal tool points to the measured ones.

    Args:
        misfit: RMS of what the map leaves over that of the measured points, with its degrees of freedom; NaN where
            there are too few.
        map: (k, d) from the d world axes along which the nominal tool moves to the k measured axes; ``None`` where the
            postures do not determine it.
        axes: (d,) indices of those world axes.
    """

    misfit: float
    map: Array | None
    axes: Codes


def sample_rows(data: Measurements) -> Codes:
    """(m,) indices of rows of different poses, of the robot and the target that have most rows; evenly spread, at
    most 400.
    """
    pairs = data.robot * (data.target.max(initial=0) + 1) + data.target
    chosen = np.flatnonzero(pairs == np.bincount(pairs).argmax())
    if not data.touches:
        _, first = np.unique(data.pose[chosen], return_index=True)
        chosen = chosen[np.sort(first)]
    step = np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), _MAX_SAMPLE_ROWS)).round().astype(np.intp))
    return np.asarray(chosen[step])


def affine_fit(robot: Robot, q: Array, measured: Array) -> AffineFit:
    """The agreement of postures with measured coordinates.

    Args:
        robot: the nominal arm, for its flange.
        q: (m, n) joint values [rad or m].
        measured: (m, k) coordinates of the measured axes [m].
    """
    points, rotations = nominal_poses(robot, q)
    turned = _centred_columns(rotations.reshape(len(q), 9))
    moved, target = _centred_columns(points), _centred_columns(measured)
    axes = np.flatnonzero(np.sqrt(np.mean(moved**2, axis=0)) > 1e-9)
    basis = _column_basis(turned)
    moved = _projected_off(moved[:, axes], basis)
    free = len(q) - 1 - basis.shape[1] - len(axes)
    spread = np.sqrt(np.sum(target**2) / len(q))
    if not len(axes) or spread == 0:
        return AffineFit(np.nan, None, axes)
    if free < (len(q) - 1) / 2:
        return _similarity_fit(_centred_columns(points), _centred_columns(rotations), target, axes)
    rest = _projected_off(target, basis)
    singular = np.linalg.svd(moved, compute_uv=False) / np.sqrt(len(q))
    known = singular[-1] > _MIN_FREE_MOTION * np.sqrt(np.mean(np.sum(_centred_columns(points) ** 2, axis=1)))
    fitted, *_ = np.linalg.lstsq(moved, rest, rcond=_RANK_TOLERANCE)
    misfit = np.sqrt(np.sum((rest - moved @ fitted) ** 2) / free) / spread
    return AffineFit(float(misfit), np.asarray(fitted.T, dtype=float) if known else None, axes)


def _similarity_fit(points: Array, rotations: Array, measured: Array, axes: Codes) -> AffineFit:
    """The agreement by a scaled rotation, or by a reflection where only that one fits.

    Args:
        points: (m, 3) nominal tool points less their mean [m].
        rotations: (m, 3, 3) nominal rotations less their mean.
        measured: (m, 3) [m], less their mean.
        axes: (d,) along which the nominal tool moves.
    """
    if len(points) < _MIN_POSTURES or measured.shape[1] < 3:
        return AffineFit(np.nan, None, axes)
    (proper, turn), (improper, flip) = (_scaled_rotation(points, rotations, measured, sign) for sign in (1.0, -1.0))
    best, found = (improper, flip) if improper < proper / 5 else (proper, turn)
    return AffineFit(best, found[:, axes], axes)


def _scaled_rotation(points: Array, rotations: Array, measured: Array, sign: float) -> tuple[float, Array]:
    """Misfit and map (3, 3) of the scaled rotation, in turns with the tool offset (Umeyama 1991, eqs. 40-43).

    ``sign`` is +1 for a rotation, −1 for a reflection; the other arguments are those of `_similarity_fit`.
    """
    tool = np.zeros(3)
    for _ in range(_ALTERNATIONS):
        reached = points + rotations @ tool
        left, singular, right = np.linalg.svd(measured.T @ reached)
        signs = np.array([1.0, 1.0, sign * np.sign(np.linalg.det(left @ right))])
        turn, scale = (left * signs) @ right, (singular @ signs) / max(np.sum(reached**2), 1e-300)
        wanted = measured @ turn / scale - points if scale > 0 else np.zeros_like(points)
        tool, *_ = np.linalg.lstsq(rotations.reshape(-1, 3), wanted.ravel(), rcond=_RANK_TOLERANCE)
    rest = measured - scale * (points + rotations @ tool) @ turn.T
    free = (measured.size - 10) / measured.size
    return float(np.sqrt(np.sum(rest**2) / np.sum(measured**2) / free)), np.asarray(scale * turn)


def touch_misfit(robot: Robot, q: Array, point: Codes) -> float:
    """RMS distance of the touches of one point from their mean, with the best tool offset.

    It is given as a share of the reach times the RMS change of orientation within a point: postures that hardly
    differ agree with anything.

    Args:
        robot: the nominal arm.
        q: (m, n) joint values [rad or m].
        point: (m,) code of the touched point of each row.

    Returns:
        The share; NaN where the rows are too few for points and tool.
    """
    points, rotations = nominal_poses(robot, q)
    flat = np.column_stack([points, rotations.reshape(len(q), 9)])
    codes, count = np.unique(point, return_inverse=True)[1], np.bincount(point)
    count = count[count > 0]
    means = np.column_stack([np.bincount(codes, column) / count for column in flat.T])
    flat = flat - means[codes]
    offsets = flat[:, 3:].reshape(-1, 3)
    free = 3 * (len(q) - len(count)) - 3
    if free < 3 * len(q) / 2:
        return float("nan")
    tool, *_ = np.linalg.lstsq(offsets, -flat[:, :3].ravel(), rcond=_RANK_TOLERANCE)
    rest = flat[:, :3].ravel() + offsets @ tool
    turned = np.sqrt(np.sum(offsets**2) / (2 * len(q)))
    size = reach(robot) * turned
    return float(np.sqrt(3 * np.sum(rest**2) / free) / size) if size > 0 else float("nan")


def reach(robot: Robot) -> float:
    """The length of the stretched chain, slides at their longest [m]."""
    strokes = sum(max(abs(j.lower), abs(j.upper)) for j in robot.joints if j.type == "prismatic")
    return strokes + robot.length


def _centred_columns(values: Array) -> Array:
    """Values (m, …) less their mean over the rows."""
    return np.asarray(values - values.mean(axis=0))


def _column_basis(columns: Array) -> Array:
    """(m, r) orthonormal columns that span the given ones (m, k)."""
    left, singular, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, singular > _RANK_TOLERANCE * max(singular[0], np.sqrt(len(columns)))])


def _projected_off(columns: Array, basis: Array) -> Array:
    """Columns (m, k) less their projection on an orthonormal basis (m, r)."""
    return np.asarray(columns - basis @ (basis.T @ columns))
