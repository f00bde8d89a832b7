"""Prioritised inverse kinematics of many poses (Nakamura 1987) with saturated limits (Flacco et al. 2012)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.model.chain import stretched
from posture_opt.numerics import Array, Mask
from posture_opt.robot.posture import drawn_between
from posture_opt.robot.robot import Robot
from posture_opt.selection.program.task_target import Reach

REACHED_TOLERANCE = 1e-7
"""m and rad: what a posture leaves of a pose that it reaches; steps that converge leave 1e-12."""
_DIFFERENCE_STEP = 1e-7  # rad or m


@dataclass(frozen=True, eq=False)
class Poses:
    """N wanted tool points (N, 3) [m] and orientations (N, 3, 3), None for any or where ``axis`` holds more; world."""

    position: Array
    rotation: Array | None
    axis: Array | None = None  # (N, 3) unit vectors, world, that the tool axis is held along; rows of NaN leave it free
    tool_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)  # (3,) unit vector, tool frame

    def take(self, rows: Mask) -> Poses:
        """The poses of some rows, given as a mask (N,)."""
        rotation, axis = (None if given is None else given[rows] for given in (self.rotation, self.axis))
        return Poses(self.position[rows], rotation, axis, self.tool_axis)

    def repeated(self, count: int) -> Poses:
        """One pose ``count`` times, to be compared with as many postures."""
        given = self.rotation, self.axis
        rotation, axis = (None if one is None else np.repeat(one, count, axis=0) for one in given)
        return Poses(np.repeat(self.position, count, axis=0), rotation, axis, self.tool_axis)


@dataclass(frozen=True, eq=False)
class Misses:
    """Wanted minus reached poses of N postures."""

    position: Array  # (N, 3) of the tool point [m], world
    rotation: Array  # (N, 3) vectors [rad], world, that turn the reached orientation, or tool axis, into the wanted one


class NearestPostures:
    """The inverse kinematics of one chain without effects, for many rows at once.

    Attributes:
        directions: (3, r) orthonormal, world: in which the arm moves its tool point at will.
        turns: in how many ways it turns the tool with the point held.

    Example:
        >>> import numpy as np, posture_opt as po
        >>> solver = NearestPostures(po.load_problem("insert_planar_2r").robot)
        >>> q = solver.solve(Poses(np.array([[1.2, 0.3, 0.0]]), None), np.array([[0.5, -0.5]]))
        >>> bool(solver.reached(q, Poses(np.array([[1.2, 0.3, 0.0]]), None))[0])
        True
    """

    def __init__(self, robot: Robot) -> None:
        self.robot: Robot = robot
        self._arm = Arm(robot)
        self._lower, self._upper = np.array(robot.lower), np.array(robot.upper)
        reach = Reach.of(self._arm, (0.0, 0.0, 1.0))
        self.directions: Array = reach.directions
        self._normals, self._plane_slack = reach.normals, reach.plane_slack
        self._first, self._stretched = stretched(robot)
        self.turns: int = self._freedom() - self.directions.shape[1]

    def misses(self, q: Array, wanted: Poses) -> Misses:
        """What postures (N, n) [rad or m] miss of N wanted poses."""
        return pose_misses(np.asarray(self._arm.pose(q), dtype=float), wanted)

    def solve(self, wanted: Poses, near: Array, start: Array | None = None) -> Array:
        """``min |q − near|²`` with ``f(q) = pose`` and limits (N, n) [rad or m]; rows that diverge are fitted one by
        one."""
        q, beyond = self.followed(wanted, near, start), self.beyond(wanted)
        for row in np.flatnonzero(~self.reached(q, wanted)):
            one = wanted.take(np.arange(len(q)) == row)
            # A reachable pose takes 10 to 30 evaluations; of others a fit only says by how much it fails.
            q[row] = self._fitted_posture(one, q[row], 15 if beyond[row] else 100)
        return q

    def off_plane(self, p: Array, by_effects: Array, wanted: Poses) -> Array:
        """(N,) distance [m] of targets from the arm's plane, beyond the ``by_effects`` (N, 3) shift of its points p
        (N, 3)."""
        off, allowed = (np.linalg.norm(v @ self._normals, axis=1) for v in (wanted.position - p, by_effects))
        return np.asarray(np.where(off > self._plane_slack + allowed, off, 0.0))

    def beyond(self, wanted: Poses) -> Mask:
        """(N,) whether tool points are farther from the first joint than the arm is long: no posture gets there."""
        return np.asarray(np.linalg.norm(wanted.position - self._first, axis=1) > self._stretched)

    def followed(self, wanted: Poses, near: Array, start: Array | None = None) -> Array:
        """(N, n) end of Newton's method, each step within limits and 0.3 rad or m."""
        q = np.clip(near if start is None else start, self._lower, self._upper).copy()
        open_rows = np.ones(len(q), dtype=bool)
        for _ in range(80):
            step = self._step(q[open_rows], wanted.take(open_rows), near[open_rows])
            longest = np.abs(step).max(axis=1, initial=0.0)
            # Longer steps [rad or m] of a linear model of a rotation mean nothing.
            step *= np.minimum(1.0, 0.3 / np.maximum(longest, 1e-300))[:, None]
            q[open_rows] = np.clip(q[open_rows] + step, self._lower, self._upper)
            # Less [rad or m] is rounding, where the Jacobian is poor.
            open_rows[np.flatnonzero(open_rows)[longest < 1e-11]] = False
            if not open_rows.any():
                break
        return q

    def _fitted_posture(self, one: Poses, near: Array, most: int) -> Array:
        """(n,) nearest posture by least squares: beside singular postures Newton's steps jump to and fro."""
        from scipy.optimize import least_squares

        def left(q: Array) -> Array:
            found = self.misses(q[None], one)
            return np.concatenate([(found.position @ self.directions)[0], found.rotation[0] * self._rotation_weight])

        def slopes(q: Array) -> Array:
            """All forward differences in one call: one posture costs as much as many."""
            moved = self.misses(np.vstack([q, q + _DIFFERENCE_STEP * np.eye(len(q))]), one.repeated(len(q) + 1))
            rows = np.hstack([moved.position @ self.directions, moved.rotation * self._rotation_weight])
            return np.asarray((rows[1:] - rows[0]).T / _DIFFERENCE_STEP)

        start = np.clip(near, self._lower + 1e-9, self._upper - 1e-9)  # a fit within bounds starts off them
        found = least_squares(
            left, start, slopes, bounds=(self._lower, self._upper), xtol=1e-15, ftol=1e-15, gtol=1e-12, max_nfev=most
        )
        return np.asarray(found.x)

    @property
    def _rotation_weight(self) -> float:
        """Weight [m/rad] of the rotation in a fit: what cannot be had must not cost the tool point."""
        return 1.0 if self.turns >= 3 else 1e-3

    def reached(self, q: Array, wanted: Poses) -> Mask:
        """Whether postures (N, n) are at their poses (N,), to `REACHED_TOLERANCE`, in what the arm moves at will."""
        left = self.misses(q, wanted)
        off = np.linalg.norm(left.position @ self.directions, axis=1)
        held = self.turns >= (3 if wanted.axis is None else 2)
        turned = np.linalg.norm(left.rotation, axis=1) if held else np.zeros(len(q))
        return np.asarray((off < REACHED_TOLERANCE) & (turned < REACHED_TOLERANCE))

    def _step(self, q: Array, wanted: Poses, near: Array) -> Array:
        """One step (N, n); joints driven beyond a limit are set to it and taken out, one round each."""
        left = self.misses(q, wanted)
        J = np.asarray(self._arm.jacobian(q), dtype=float)
        parts = [(self.directions.T @ J[:, :3], left.position @ self.directions, self.directions.shape[1])]
        if wanted.rotation is not None:
            parts.append((J[:, 3:], left.rotation, min(self.turns, 3)))
        elif wanted.axis is not None:
            # Projectors across the axes; an axis of NaN holds nothing.
            across = np.nan_to_num(np.eye(3) - wanted.axis[:, :, None] * wanted.axis[:, None, :], nan=0.0)
            parts.append((across @ J[:, 3:], left.rotation, min(self.turns, 2)))
        free, held = np.ones_like(q), np.zeros_like(q)
        step = held
        for _ in range(self.robot.n):
            step = _prioritised_step(parts, near - q, free, held)
            low, high = q + step < self._lower, q + step > self._upper
            beyond = (low | high) & (free > 0)
            if not beyond.any():
                break
            free = np.where(beyond, 0.0, free)
            held = np.where(beyond, np.where(low, self._lower, self._upper) - q, held)
        return step

    def _freedom(self) -> int:
        rng = np.random.default_rng(0)
        q = rng.uniform(*drawn_between(self.robot), (12, self.robot.n))
        J = np.asarray(self._arm.jacobian(q), dtype=float)
        parts = np.concatenate([self.directions.T @ J[:, :3], J[:, 3:]], axis=1)
        return int(np.linalg.matrix_rank(parts, tol=max(1e-7, 2 * min(self.robot.skew, 0.05))).max())


def pose_misses(T: Array, wanted: Poses) -> Misses:
    """``wanted.position − p`` and rotation vectors of ``R_wanted Rᵀ`` at poses (N, 4, 4), world; 0 where any does."""
    position = wanted.position - T[:, :3, 3]
    if wanted.rotation is None and wanted.axis is not None:
        return Misses(position, _turns_between(T[:, :3, :3] @ np.array(wanted.tool_axis), wanted.axis))
    if wanted.rotation is None:
        return Misses(position, np.zeros_like(position))
    return Misses(position, rotation_vectors(wanted.rotation @ T[:, :3, :3].transpose(0, 2, 1)))


def _turns_between(reached: Array, wanted: Array) -> Array:
    """(N, 3) rotation vectors [rad] across both of unit vectors (N, 3) that turn one into the other; 0 for NaN."""
    held = np.where(np.isnan(wanted), reached, wanted)
    across, cosine = np.cross(reached, held), (reached * held).sum(axis=1)
    sine = np.linalg.norm(across, axis=1)
    angle = np.arctan2(sine, cosine)
    return np.asarray(across * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0)[:, None])


def rotation_vectors(R: Array) -> Array:
    """(N, 3) axis times angle [rad] of rotations (N, 3, 3), exact for small angles and up to half a turn."""
    v = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    sine, cosine = np.linalg.norm(v, axis=1), (np.trace(R, axis1=1, axis2=2) - 1) / 2
    angle = np.arctan2(sine, cosine)
    scaled: Array = v * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0)[:, None]
    # Half a turn has no sine: the axis is the column of R + 1 that is longest.
    for row in np.flatnonzero((sine < 1e-9) & (cosine < 0)):
        columns = R[row] + np.eye(3)
        axis = columns[:, np.argmax(np.linalg.norm(columns, axis=0))]
        scaled[row] = np.pi * axis / np.linalg.norm(axis)
    return scaled


def _prioritised_step(parts: list[tuple[Array, Array, int]], to_near: Array, free: Array, held: Array) -> Array:
    """(N, n) step: each (A (N, m, n), b (N, m), rank) as ``A dq = b`` in the null space of those before, then near."""
    step = held.copy()
    null = free[:, :, None] * np.eye(free.shape[1])
    for A, b, rank in parts:
        left = b - np.einsum("nij,nj->ni", A, step)
        inverse = _damped_inverse(A @ null, rank, (b**2).sum(axis=1))
        step = step + np.einsum("nij,nj->ni", inverse, left)
        null = null - inverse @ A @ null
    last: Array = step + np.einsum("nij,nj->ni", null, to_near - step)
    return last


def _damped_inverse(A: Array, rank: int, squared: Array) -> Array:
    """``V diag(s / (s² + λ)) Uᵀ`` (N, n, m), λ proportional to the squared error (Sugihara 2011)."""
    U, s, V = np.linalg.svd(A, full_matrices=False)
    kept = s[:, :rank]
    weights = kept / (kept**2 + (0.1 * squared + 1e-16)[:, None])  # singular values below 1e-8 move nothing
    inverse: Array = np.einsum("nki,nk,nmk->nim", V[:, :rank], weights, U[:, :, :rank])
    return inverse
