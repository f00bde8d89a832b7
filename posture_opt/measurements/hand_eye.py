"""Where cameras and boards are, in closed form: the pose of a board in a picture, robot-world hand-eye calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.errors import BadValueError
from posture_opt.measurements.camera_section import Bodies, Intrinsics
from posture_opt.measurements.rotations import cross_matrices, nearest_rotation, rigid
from posture_opt.numerics import Array, Codes, Mask

_FLATNESS = 1e-3  # Thickness over extent up to which known points count as flat


def board_pose(points: Array, rays: Array) -> Array | None:
    """T_camera_board (4, 4) from known points and the rays that they are seen along; None where too few are seen."""
    # A homography (Zhang 2000) or a direct linear transformation first, then least squares of the rays. A flat board
    # far away looks alike in two poses, mirrored in depth: the better one is kept.
    # points: (n, 3) on the board [m]; rays: (n, 2) at a depth of one
    if len(points) < 4:
        return None
    middle = points.mean(axis=0)
    size, axes = np.linalg.svd(points - middle, full_matrices=False)[1:]
    if size[1] < _FLATNESS * size[0]:
        return None  # on a line
    if size[2] > _FLATNESS * size[0]:
        if len(points) < 6:
            return None
        P = _projection(points - middle, rays)  # a direct linear transformation, up to a factor
        P = P * np.sign(np.linalg.det(P[:, :3])) / abs(np.linalg.det(P[:, :3])) ** (1 / 3)
        starts = [rigid(nearest_rotation(P[:, :3]), P[:, 3])]
    else:
        axes[2] = np.cross(axes[0], axes[1])
        T = _by_homography((points - middle) @ axes[:2].T, rays)
        starts = [T @ rigid(axes, np.zeros(3)), _mirrored(T) @ rigid(axes, np.zeros(3))]
    fits = [_polished(T, points - middle, rays) for T in starts]
    _, best = min(fits, key=lambda fit: fit[0])
    return best @ rigid(np.eye(3), -middle)


def robot_world_hand_eye(A: Array, B: Array, points: Array, on_tool: bool) -> tuple[Array, Array]:
    """T_camera_mount and T_carrier_board with ``A_i = Z B_i W``, and pictures that disagree left out."""
    # The rotations by Shah (2013), equation 18, and both together by Li, Wang, Wu (2010), equation 12: where all
    # turns are about parallel axes, only the shifts tell the rotations apart. The better of both is kept. Along such
    # axes camera and board move together: what the tool carries is then near it, and what stands in the cell may be
    # far.
    # A: (n, 4, 4) T_camera_board of every picture; B: (n, 4, 4) T_mount_carrier; points: (k, 3) on the board, by
    # which solutions are compared [m]
    kept = np.ones(len(A), dtype=bool)
    for _ in range(3):
        turns = [closed_rotations(A[kept, :3, :3], B[kept, :3, :3]), _by_li(A[kept], B[kept])]
        solutions = [_with_shifts(A[kept], B[kept], Z, X, on_tool) for Z, X in turns]
        misfits = [_misfit(A, Z @ B @ W, points) for Z, W in solutions]
        best = int(np.argmin([float(np.median(m[kept])) for m in misfits]))
        # A picture farther off than four times the median is taken for a wrong detection.
        kept = misfits[best] <= max(4 * float(np.median(misfits[best])), 1e-12)
    return solutions[best]


def camera_of_moving_points(R: Array, p: Array, rays: Array, marker: Codes) -> Array | None:
    """T_camera_mount (4, 4) by markers of the carrier that nobody knows; None where pictures are too few."""
    # ``x × (P (p + R m) + t) = 0`` with the ray x is linear in P, t and the products of P with the coordinates of the
    # marker m seen most often: the smallest singular vector.
    # R, p: (n, 3, 3), (n, 3) T_mount_carrier [m]; rays: (n, 2); marker: (n,) codes from 0
    own = marker == int(np.argmax(np.bincount(marker)))
    if own.sum() * 2 < 39:
        return None
    centre, size = p[own].mean(axis=0), float(np.std(p[own]))
    A = _lifted(R[own], (p[own] - centre) / size, rays[own])
    if A is None:
        return None
    P = A[:9].reshape(3, 3)
    scale = np.sign(np.linalg.det(P)) * abs(np.linalg.det(P)) ** (1 / 3)
    turned = nearest_rotation(P / scale)
    return rigid(turned, A[9:12] / scale * size - turned @ centre)


def seen_marker(Z: Array, R: Array, p: Array, rays: Array) -> Array:
    """(3,) the marker on the carrier with rays (n, 2) in its pictures, T_camera_mount being Z: linear least squares."""
    a = np.column_stack([rays, np.ones(len(rays))])
    skew = cross_matrices(a)
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


def _projection(points: Array, rays: Array) -> Array:
    """(3, k + 1) P with rays (n, 2) along ``P (x, 1)``, by a direct linear transformation from points x (n, k)."""
    scale = np.r_[np.full(points.shape[1], float(np.abs(points).max())), 1.0]
    source = np.column_stack([points, np.ones(len(points))]) / scale
    k = len(scale)
    rows = np.zeros((len(points), 2, 3 * k))
    rows[:, 0, :k], rows[:, 1, k : 2 * k] = source, source
    rows[:, :, 2 * k :] = -rays[:, :, None] * source[:, None, :]
    return np.asarray(np.linalg.svd(rows.reshape(-1, 3 * k))[2][-1].reshape(3, k) / scale)


def _by_homography(flat: Array, rays: Array) -> Array:
    """T_camera_plane (4, 4) from points (n, 2) in a plane and their rays."""
    H = _projection(flat, rays)
    H = H / np.linalg.norm(H[:, :2], axis=0).mean()
    H = H if H[2, 2] > 0 else -H  # the board is before the camera
    return rigid(nearest_rotation(np.column_stack([H[:, :2], np.cross(H[:, 0], H[:, 1])])), H[:, 2])


def _mirrored(T: Array) -> Array:
    sight = T[:3, 3] / np.linalg.norm(T[:3, 3])
    flipped = T[:3, :2] - 2 * np.outer(sight, sight @ T[:3, :2])
    return rigid(np.column_stack([flipped, np.cross(flipped[:, 0], flipped[:, 1])]), T[:3, 3])


def _polished(T: Array, points: Array, rays: Array) -> tuple[float, Array]:
    """The sum of squares of rays, and the pose (4, 4), after Gauss-Newton steps from T."""
    cost = np.inf
    for _ in range(20):  # five are usual
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
        W = cross_matrices(step[None, 3:])[0]
        T = rigid(nearest_rotation((np.eye(3) + W + W @ W / 2) @ T[:3, :3]), T[:3, 3] + step[:3])
    return cost, best


def closed_rotations(R_A: Array, R_B: Array) -> tuple[Array, Array]:
    """Rotations of Z and W⁻¹ with ``R_A = Z R_B W``, (n, 3, 3) each: the largest singular pair of ``Σ R_B ⊗ R_A``."""
    K = np.einsum("nij,nkl->ikjl", R_B, R_A).reshape(9, 9)
    U, _, Vt = np.linalg.svd(K)
    X, Z = Vt[0].reshape(3, 3).T, U[:, 0].reshape(3, 3).T
    sign = np.sign(np.linalg.det(Z)) or 1.0
    return nearest_rotation(sign * Z), nearest_rotation(sign * X)


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
    Z = nearest_rotation(found[9:18].reshape(3, 3))
    X = nearest_rotation(np.einsum("nji,jk,nkl->il", A[:, :3, :3], Z, B[:, :3, :3]))
    return Z, X


def _with_shifts(A: Array, B: Array, Z: Array, X: Array, on_tool: bool) -> tuple[Array, Array]:
    """Z and ``W = X⁻¹`` as poses, the shifts by ``R_A t_X − t_Z = Z t_B − t_A``, the least over what is usual."""
    # What the tool carries is about 0.1 m from the tool point, and what stands in the cell 1 m from the base [m].
    usual = np.repeat([1.0, 0.1] if on_tool else [0.1, 1.0], 3)
    left = np.concatenate([A[:, :3, :3], np.broadcast_to(-np.eye(3), (len(A), 3, 3))], axis=2).reshape(-1, 6)
    right = (B[:, :3, 3] @ Z.T - A[:, :3, 3]).ravel()
    # Turns with a singular value below 1 % show nothing of a shift but noise and errors of the arm.
    found = usual * np.linalg.lstsq(left * usual, right, rcond=1e-2)[0]
    return rigid(Z, found[3:]), rigid(X.T, -X.T @ found[:3])


def _misfit(A: Array, other: Array, points: Array) -> Array:
    """(n,) how far points of the board lie apart in two poses each, root mean square over their distance [1]."""
    spread = np.einsum("nij,kj->nki", (A - other)[:, :3, :3], points) + (A - other)[:, None, :3, 3]
    return np.asarray(np.sqrt(np.mean(np.sum(spread**2, axis=2), axis=1)) / np.linalg.norm(A[:, :3, 3], axis=1))


def first_frames(pictures: Pictures, cameras: int) -> tuple[Array, Array]:
    """T_mount_camera (C, 4, 4) of cameras and T_carrier_body (B, 4, 4) by the nominal arm, without any guess."""
    # Boards of known geometry first: the pose of each in every picture, then robot-world hand-eye calibration.
    # Markers of which nothing is known are triangulated, or decide the camera where no board is seen.
    by_boards = {c: pictures.camera_by_boards(c) for c in range(cameras)}
    found = {c: pictures.camera_by_markers(c) if T is None else T for c, T in by_boards.items()}
    bodies = [pictures.body(b, found) for b in range(len(pictures.bodies.names))]
    return np.array([np.linalg.inv(found[c]) for c in range(cameras)]), np.array(bodies)


@dataclass(frozen=True, eq=False)
class Pictures:
    """What cameras saw, row by row, and where the nominal arm was."""

    bodies: Bodies
    # R, p: (N, 3, 3), (N, 3) T_mount_carrier: the tool in the world, for a camera on the tool the world in the tool
    R: Array
    p: Array
    rays: Array  # (N, 2) at a depth of one
    # camera, marker, pose: (N,) codes
    camera: Codes
    marker: Codes
    pose: Codes
    on_tool: Mask  # (N,) whether the arm has the camera

    @classmethod
    def of(
        cls, bodies: Bodies, intrinsics: Sequence[Intrinsics], on_tool: Mask, pose: tuple[Array, Array],
        pixels: Array, codes: tuple[Codes, Codes],
    ) -> Pictures:  # fmt: skip
        """By the tool's ``pose`` (N, 3, 3), (N, 3) in the world, and the ``codes`` of cameras and markers."""
        # on_tool: (N,) whether the arm carries the camera; pixels: (N, 2)
        (R, p), (camera, marker) = pose, codes
        inverse = np.swapaxes(R, 1, 2)
        p = np.where(on_tool[:, None], -np.einsum("nij,nj->ni", inverse, p), p)
        R = np.where(on_tool[:, None, None], inverse, R)
        rays = np.zeros((len(p), 2))
        for c, one in enumerate(intrinsics):
            rays[camera == c] = one.rays(pixels[camera == c])
        rows = np.concatenate([R.reshape(len(p), 9), p], axis=1).round(12)
        poses = np.unique(rows, axis=0, return_inverse=True)[1].ravel().astype(np.intp)
        return cls(bodies, R, p, rays, camera, marker, poses, on_tool)

    def shown(self, camera: int, body: int) -> tuple[Array, Array]:
        """(n, 4, 4) T_camera_body and T_mount_carrier of the pictures of one board by one camera."""
        rows = np.flatnonzero((self.camera == camera) & (self.bodies.body[self.marker] == body))
        poses = np.unique(self.pose[rows])
        poses = poses[np.linspace(0, len(poses) - 1, min(len(poses), 80)).astype(int)]
        A, B = [], []
        for code in poses:
            own = rows[self.pose[rows] == code]
            if (T := board_pose(self.bodies.points[self.marker[own]], self.rays[own])) is not None:
                A.append(T)
                B.append(rigid(self.R[own[0]], self.p[own[0]]))
        return np.array(A).reshape(-1, 4, 4), np.array(B).reshape(-1, 4, 4)

    def camera_by_boards(self, camera: int) -> Array | None:
        """T_camera_mount by the board that most pictures show; None where none shows enough."""
        shown = [self.shown(camera, int(b)) for b in np.flatnonzero(self.bodies.rigid)]
        best = max(range(len(shown)), key=lambda k: len(shown[k][0]), default=-1)
        if best < 0 or len(shown[best][0]) < 3:
            return None
        points = self.bodies.points[self.bodies.body == np.flatnonzero(self.bodies.rigid)[best]]
        on_tool = bool(self.on_tool[self.camera == camera].all())
        return robot_world_hand_eye(*shown[best], points, on_tool)[0]

    def camera_by_markers(self, camera: int) -> Array:
        """T_camera_mount by markers of which nothing is known."""
        rows = np.flatnonzero(self.camera == camera)
        codes = np.unique(self.marker[rows], return_inverse=True)[1].astype(np.intp)
        found = camera_of_moving_points(self.R[rows], self.p[rows], self.rays[rows], codes)
        if found is None:
            hint = "20 pictures of one marker, or 3 of four points of a known board (data.markers), are the least"
            raise BadValueError("too few pictures to say where the camera is", hint)
        return found

    def body(self, body: int, cameras: Mapping[int, Array]) -> Array:
        """T_carrier_body (4, 4) by the cameras that see it."""
        if not self.bodies.rigid[body]:
            rows = np.flatnonzero(self.bodies.body[self.marker] == body)
            camera = int(np.argmax(np.bincount(self.camera[rows])))
            rows = rows[self.camera[rows] == camera]
            found = np.eye(4)
            found[:3, 3] = seen_marker(cameras[camera], self.R[rows], self.p[rows], self.rays[rows])
            return found
        shown = {c: self.shown(c, body) for c in cameras}
        most = max(shown, key=lambda c: len(shown[c][0]))
        A, B = shown[most]
        if not len(A):
            name = self.bodies.names[body]
            raise BadValueError(f"no picture shows four points of the board '{name}'", "leave out its rows")
        middle = np.median(np.linalg.inv(cameras[most] @ B) @ A, axis=0)
        return rigid(nearest_rotation(middle[:3, :3]), middle[:3, 3])
