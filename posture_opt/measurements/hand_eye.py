"""Where cameras and boards are, in closed form: the pose of a board in a picture, robot-world hand-eye calibration."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from posture_opt.numerics import Array, Codes, Mask

_ROUNDS = 20
"""Gauss-Newton steps of one picture at most; five are usual."""
_LEAST_FLAT, _LEAST_SOLID = 4, 6
"""Points from which a picture shows the pose of a flat board, or of other known points."""
_FLATNESS = 1e-3
"""Thickness over extent up to which known points count as flat."""
_ON_TOOL_M, _IN_CELL_M = 0.1, 1.0
"""How far what the tool carries is from the tool point, and what stands in the cell from the base, roughly."""
_LEAST_TURN = 1e-2
"""Singular value over the largest, below which turns show nothing of a shift but noise and errors of the arm."""
_GROSS = 4.0
"""Times the median misfit: a picture farther off is taken for a wrong detection."""


def board_pose(points: Array, rays: Array) -> Array | None:
    """T_camera_board (4, 4) from known points and the rays that they are seen along; None where too few are seen.

    A homography (Zhang 2000) or a direct linear transformation first, then least squares of the rays. A flat board far
    away looks alike in two poses, mirrored in depth: the better one is kept.

    Args:
        points: (n, 3) on the board [m]; rays: (n, 2) at a depth of one.
    """
    if len(points) < _LEAST_FLAT:
        return None
    middle = points.mean(axis=0)
    size, axes = np.linalg.svd(points - middle, full_matrices=False)[1:]
    if size[1] < _FLATNESS * size[0]:
        return None  # on a line
    if size[2] > _FLATNESS * size[0]:
        if len(points) < _LEAST_SOLID:
            return None
        starts = [_by_direct_transformation(points - middle, rays)]
    else:
        axes[2] = np.cross(axes[0], axes[1])
        T = _by_homography((points - middle) @ axes[:2].T, rays)
        starts = [T @ _rigid(axes, np.zeros(3)), _mirrored(T) @ _rigid(axes, np.zeros(3))]
    fits = [_polished(T, points - middle, rays) for T in starts]
    _, best = min(fits, key=lambda fit: fit[0])
    return best @ _rigid(np.eye(3), -middle)


def robot_world_hand_eye(A: Array, B: Array, points: Array, on_tool: bool) -> tuple[Array, Array]:
    """T_camera_mount and T_carrier_board with ``A_i = Z B_i W``, and pictures that disagree left out.

    The rotations by Shah (2013), equation 18, and both together by Li, Wang, Wu (2010), equation 12: where all turns
    are about parallel axes, only the shifts tell the rotations apart. The better of both is kept. Along such axes
    camera and board move together: what the tool carries is then near it, and what stands in the cell may be far.

    Args:
        A: (n, 4, 4) T_camera_board of every picture; B: (n, 4, 4) T_mount_carrier.
        points: (k, 3) on the board, by which solutions are compared [m].
        on_tool: whether the tool carries the camera, and else the board.
    """
    kept = np.ones(len(A), dtype=bool)
    for _ in range(3):
        turns = [closed_rotations(A[kept, :3, :3], B[kept, :3, :3]), _by_li(A[kept], B[kept])]
        solutions = [_with_shifts(A[kept], B[kept], Z, X, on_tool) for Z, X in turns]
        misfits = [_misfit(A, Z @ B @ W, points) for Z, W in solutions]
        best = int(np.argmin([float(np.median(m[kept])) for m in misfits]))
        kept = _agreeing(misfits[best])
    return solutions[best]


def mean_pose(T: Array) -> Array:
    """The pose (4, 4) in the middle of poses (n, 4, 4): medians of the entries, its rotation made one."""
    middle = np.median(T, axis=0)
    return _rigid(_nearest(middle[:3, :3]), middle[:3, 3])


def camera_of_moving_points(R: Array, p: Array, rays: Array, marker: Codes) -> tuple[Array, Array] | None:
    """T_camera_mount (4, 4) and markers (k, 3) of the carrier, none of them known; None where pictures are too few.

    ``x × (P (p + R m) + t) = 0`` with the ray x is linear in P, t and the products of P with the coordinates of every
    m: the smallest singular vector. The marker seen most often decides the camera, the others follow.

    Args:
        R, p: (n, 3, 3), (n, 3) T_mount_carrier [m]; rays: (n, 2); marker: (n,) codes from 0.
    """
    most = int(np.argmax(np.bincount(marker)))
    own = marker == most
    if own.sum() * 2 < 39:
        return None
    centre, size = p[own].mean(axis=0), float(np.std(p[own]))
    A = _lifted(R[own], (p[own] - centre) / size, rays[own])
    if A is None:
        return None
    P, t, products = A[:9].reshape(3, 3), A[9:12], A[12:].reshape(3, 9)
    sign = np.sign(np.linalg.det(P))
    scale = sign * abs(np.linalg.det(P)) ** (1 / 3)
    turned = _nearest(P / scale)
    m = np.array([np.trace(P.T @ products[j].reshape(3, 3)) for j in range(3)]) / float(np.sum(P**2)) * size
    Z = _rigid(turned, t / scale * size - turned @ centre)
    return Z, np.array([m if k == most else seen_marker(Z, R[marker == k], p[marker == k], rays[marker == k])
                        for k in range(int(marker.max()) + 1)])  # fmt: skip


def seen_marker(Z: Array, R: Array, p: Array, rays: Array) -> Array:
    """(3,) the marker on the carrier with rays (n, 2) in its pictures, T_camera_mount being Z: linear least squares."""
    a = np.column_stack([rays, np.ones(len(rays))])
    skew = np.zeros((len(a), 3, 3))
    skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -a[:, 2], a[:, 1], -a[:, 0]
    skew[:, 1, 0], skew[:, 2, 0], skew[:, 2, 1] = a[:, 2], -a[:, 1], a[:, 0]
    left = skew @ Z[:3, :3] @ R
    right = -np.einsum("nij,nj->ni", skew, p @ Z[:3, :3].T + Z[:3, 3])
    return np.asarray(np.linalg.lstsq(left.reshape(-1, 3), right.ravel(), rcond=None)[0])


def _lifted(R: Array, p: Array, rays: Array) -> Array | None:
    """(39,) P, t and the products ``P m_j`` of `camera_of_moving_points`, up to a factor."""
    n = len(p)
    # P p + t + Σ_j m_j P r_j: a linear function of P (9), t (3), and m_j P (27), for each of the three coordinates
    columns = np.zeros((n, 3, 39))
    for i in range(3):
        columns[:, i, 3 * i : 3 * i + 3] = p
        columns[:, i, 9 + i] = 1.0
        for j in range(3):
            columns[:, i, 12 + 9 * j + 3 * i : 15 + 9 * j + 3 * i] = R[:, :, j]
    rows = columns[:, :2] - rays[:, :, None] * columns[:, 2:]
    _, size, V = np.linalg.svd(rows.reshape(-1, 39), full_matrices=False)
    return V[-1] if size[-2] > 0 else None


def _by_homography(flat: Array, rays: Array) -> Array:
    """T_camera_plane (4, 4) from points (n, 2) in a plane and their rays."""
    scale = float(np.abs(flat).max())
    source = np.column_stack([flat / scale, np.ones(len(flat))])
    rows = np.zeros((len(flat), 2, 9))
    rows[:, 0, :3], rows[:, 1, 3:6] = source, source
    rows[:, :, 6:] = -rays[:, :, None] * source[:, None, :]
    H = np.linalg.svd(rows.reshape(-1, 9))[2][-1].reshape(3, 3) / np.array([scale, scale, 1.0])
    H = H / np.linalg.norm(H[:, :2], axis=0).mean()
    H = H if H[2, 2] > 0 else -H  # the board is before the camera
    return _rigid(_nearest(np.column_stack([H[:, :2], np.cross(H[:, 0], H[:, 1])])), H[:, 2])


def _by_direct_transformation(points: Array, rays: Array) -> Array:
    """T_camera_board (4, 4) from points (n, 3) in space and their rays."""
    scale = float(np.abs(points).max())
    source = np.column_stack([points / scale, np.ones(len(points))])
    rows = np.zeros((len(points), 2, 12))
    rows[:, 0, :4], rows[:, 1, 4:8] = source, source
    rows[:, :, 8:] = -rays[:, :, None] * source[:, None, :]
    P = np.linalg.svd(rows.reshape(-1, 12))[2][-1].reshape(3, 4) / np.array([scale, scale, scale, 1.0])
    P = P * np.sign(np.linalg.det(P[:, :3])) / abs(np.linalg.det(P[:, :3])) ** (1 / 3)
    return _rigid(_nearest(P[:, :3]), P[:, 3])


def _mirrored(T: Array) -> Array:
    """The other pose in which a flat board far away looks alike: depths along the line of sight change their sign."""
    sight = T[:3, 3] / np.linalg.norm(T[:3, 3])
    flipped = T[:3, :2] - 2 * np.outer(sight, sight @ T[:3, :2])
    return _rigid(np.column_stack([flipped, np.cross(flipped[:, 0], flipped[:, 1])]), T[:3, 3])


def _polished(T: Array, points: Array, rays: Array) -> tuple[float, Array]:
    """The sum of squares of rays, and the pose (4, 4), after Gauss-Newton steps from T."""
    cost = np.inf
    for _ in range(_ROUNDS):
        turned = points @ T[:3, :3].T
        x = turned + T[:3, 3]
        depth = np.where(np.abs(x[:, 2]) < 1e-6, 1e-6, x[:, 2])
        error = x[:, :2] / depth[:, None] - rays
        now = float(np.sum(error**2)) + (0.0 if (x[:, 2] > 0).all() else 1e6)
        if not now < cost * (1 - 1e-9):
            break
        cost, best = now, T
        slope = np.zeros((len(x), 2, 3))
        slope[:, 0, 0] = slope[:, 1, 1] = 1 / depth
        slope[:, :, 2] = -x[:, :2] / depth[:, None] ** 2
        J = np.concatenate([slope, np.cross(turned[:, None, :], slope)], axis=2).reshape(-1, 6)
        step = np.linalg.lstsq(J, -error.ravel(), rcond=1e-12)[0]
        T = _rigid(_nearest(_turn_by(step[3:]) @ T[:3, :3]), T[:3, 3] + step[:3])
    return cost, best


def closed_rotations(R_A: Array, R_B: Array) -> tuple[Array, Array]:
    """Rotations of Z and W⁻¹ with ``R_A = Z R_B W``, (n, 3, 3) each: the largest singular pair of ``Σ R_B ⊗ R_A``."""
    K = np.einsum("nij,nkl->ikjl", R_B, R_A).reshape(9, 9)
    U, _, Vt = np.linalg.svd(K)
    X, Z = Vt[0].reshape(3, 3).T, U[:, 0].reshape(3, 3).T
    sign = np.sign(np.linalg.det(Z)) or 1.0
    return _nearest(sign * Z), _nearest(sign * X)


def _by_li(A: Array, B: Array) -> tuple[Array, Array]:
    """Rotations of Z and W⁻¹ of `robot_world_hand_eye`, with the shifts in one linear system."""
    n, eye = len(A), np.eye(3)
    rows, wanted = np.zeros((n, 12, 24)), np.zeros((n, 12))
    for k in range(n):
        R_A, t_A, R_B, t_B = A[k, :3, :3], A[k, :3, 3], B[k, :3, :3], B[k, :3, 3]
        rows[k, :9, :9], rows[k, :9, 9:18] = np.kron(R_A, eye), -np.kron(eye, R_B.T)
        rows[k, 9:, 9:18], rows[k, 9:, 18:21], rows[k, 9:, 21:] = np.kron(eye, t_B), -R_A, eye
        wanted[k, 9:] = t_A
    found = np.linalg.lstsq(rows.reshape(-1, 24), wanted.ravel(), rcond=1e-9)[0]
    Z = _nearest(found[9:18].reshape(3, 3))
    X = _nearest(np.einsum("nji,jk,nkl->il", A[:, :3, :3], Z, B[:, :3, :3]))
    return Z, X


def _with_shifts(A: Array, B: Array, Z: Array, X: Array, on_tool: bool) -> tuple[Array, Array]:
    """Z and ``W = X⁻¹`` as poses, the shifts by ``R_A t_X − t_Z = Z t_B − t_A``, the least over what is usual."""
    usual = np.repeat([_IN_CELL_M, _ON_TOOL_M] if on_tool else [_ON_TOOL_M, _IN_CELL_M], 3)
    left = np.concatenate([A[:, :3, :3], np.broadcast_to(-np.eye(3), (len(A), 3, 3))], axis=2).reshape(-1, 6)
    right = (B[:, :3, 3] @ Z.T - A[:, :3, 3]).ravel()
    found = usual * np.linalg.lstsq(left * usual, right, rcond=_LEAST_TURN)[0]
    return _rigid(Z, found[3:]), _rigid(X.T, -X.T @ found[:3])


def _misfit(A: Array, other: Array, points: Array) -> Array:
    """(n,) how far points of the board lie apart in two poses each, root mean square over their distance [1]."""
    spread = np.einsum("nij,kj->nki", (A - other)[:, :3, :3], points) + (A - other)[:, None, :3, 3]
    return np.asarray(np.sqrt(np.mean(np.sum(spread**2, axis=2), axis=1)) / np.linalg.norm(A[:, :3, 3], axis=1))


def _agreeing(misfit: Array) -> Mask:
    """(n,) the pictures that are not far off the others."""
    return np.asarray(misfit <= max(_GROSS * float(np.median(misfit)), 1e-12))


def _rigid(R: Array, t: Array) -> Array:
    """(4, 4) of a rotation and a shift."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def _nearest(M: NDArray[Any]) -> Array:
    """The rotation closest to a (3, 3) matrix."""
    U, _, Vt = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def _turn_by(w: Array) -> Array:
    """(3, 3) nearly the rotation by a vector w: to the second order."""
    W = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    return np.asarray(np.eye(3) + W + W @ W / 2)
