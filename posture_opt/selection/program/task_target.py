"""``TaskTarget``: where one solve is to bring the tool point: the parameters of the optimisation problem.

What an arm can do at all comes first: the directions it moves its tool point in, and whether it can point its axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.model.arm import Arm
from posture_opt.model.chain import Scalar
from posture_opt.model.reach_bound import Shell
from posture_opt.numerics import Array
from posture_opt.robot.joint_ranges import drawn_between
from posture_opt.selection.tasks import Task
from posture_opt.selection.tasks.workpiece import Workpiece
from posture_opt.uncertainty.spread.task_spread import across_basis

_RANK = 1e-9  # of the largest singular value: rounding of a product of some ten rotations
_DEPENDENT = 1e-7  # rad or m/rad: singular values below it are rounding, of quarter turns typed with seven digits too
_SAMPLES = 12  # random postures: more than the columns that can be independent, so that none is missed
_SWEEPS = 200  # over three coordinates: the exact steps converge geometrically
_MOST_SKEW = 0.05  # rad; beyond it, corrections do not correct an arm but make another one

_SHELL_SLACK = 0.01  # of the stretched arm: effects and corrections move the tool point by less

PLANE_TOLERANCE = 1e-6
"""Distance [m] from its plane at which a target counts as outside of it."""
AXIS_SLACK = 2e-5
"""Error of the tool axis [rad] that counts as none for an arm with too few joints to turn it at will: the quarter
turns in its file are rounded, and exact alignment may not exist. The lean of a calibrated arm's axes adds to it."""


@dataclass(frozen=True)
class Reach:
    """Degrees of freedom of the tool point and of the tool axis, found at random postures.

    Args:
        directions: (3, r) orthonormal basis of the directions in which the tool point moves, world frame.
        offset: (3,) a point that the tool reaches; where r < 3 all reachable points share its other components.
        axis_rank: how many ways the tool axis turns: 0 fixed, 1 in a plane, 2 everywhere.
        axis: (3,) the tool axis where it is fixed, the normal of its plane where it turns in one, else zeros.
        axis_freedom: in how many ways the axis moves at one posture; less than ``axis_rank`` on a cone.
        orients_at_point: whether the axis can still be turned with the tool point held fixed.
        radius: largest distance between tool points seen [m], a length scale.
        plane_slack: distance [m] from its plane at which a target counts as outside of it.
        axis_slack: error of the tool axis [rad] that counts as none for an arm that cannot turn it at will.
        shell: what the tool point stays within, by the lengths of the links.

    What an arm does by its corrections alone, a planar one that a calibration found to be slightly skew, it does not
    do at will: such motion counts as none.
    """

    directions: Array
    offset: Array
    axis_rank: int
    axis: Array
    axis_freedom: int
    orients_at_point: bool
    radius: float
    plane_slack: float
    axis_slack: float
    shell: Shell

    @classmethod
    def of(cls, arm: Arm, tool_axis: tuple[float, float, float]) -> Reach:
        """What ``arm`` can do with ``tool_axis`` (3,), tool frame, found at random postures.

        The range of the stacked Jacobians of some postures is what the tool point moves in; of the stacked turns of
        the axis, ``ω_i × a``, what the axis turns in. Singular values below a tolerance count as none.
        """
        rng = np.random.default_rng(0)
        robot = arm.robot
        moving = [k for k, joint in enumerate(robot.joints) if joint.lower < joint.upper]
        a_tool = np.array(tool_axis) / np.linalg.norm(tool_axis)
        points, axes, jacobians, turns = [], [], [], []
        for _ in range(_SAMPLES):
            q = rng.uniform(*drawn_between(robot))
            T = np.asarray(arm.pose(q), dtype=float)
            J = np.asarray(arm.jacobian(q), dtype=float)[:, moving]
            axis = T[:3, :3] @ a_tool
            points.append(T[:3, 3])
            axes.append(axis)
            jacobians.append(J[:3])
            turns.append(np.cross(J[3:].T, axis).T)
        lean = 2 * min(robot.skew, _MOST_SKEW)
        U = _range(np.hstack(jacobians), lean)
        turned = _range(np.hstack(turns), 0.0, lean * math.sqrt(_SAMPLES * robot.n))
        rank = 0 if turned.shape[1] == 0 else 1 if _planar(axes, lean) else 2
        both = [np.vstack([U.T @ J, A]) for J, A in zip(jacobians, turns, strict=True)]
        orients = max(np.linalg.matrix_rank(M, tol=_DEPENDENT) for M in both) >= U.shape[1] + rank
        radius = max(float(np.linalg.norm(p - points[0])) for p in points)
        axis = axes[0] if rank == 0 else _normal(axes) if rank == 1 else np.zeros(3)
        freedom = max(int(np.linalg.matrix_rank(A, tol=max(_DEPENDENT, lean))) for A in turns)
        able, size = bool(orients and rank > 0), max(radius, 1e-3)
        plane_slack = PLANE_TOLERANCE + lean * size + min(robot.lift, size)
        return cls(U, points[0], rank, axis, freedom, able, size, plane_slack, AXIS_SLACK + lean, Shell.of(robot))

    @cached_property
    def normals(self) -> Array:
        """(3, 3 − r) directions in which the tool point cannot move."""
        full, _, _ = np.linalg.svd(np.hstack([self.directions, np.zeros((3, 1))]))
        return np.asarray(full[:, self.directions.shape[1] :])

    @property
    def normal(self) -> Array | None:
        """(3,) of the plane that the tool point moves in; None for an arm that moves it in space, or along a line."""
        return self.normals[:, 0] if self.normals.shape[1] == 1 else None

    def outside(self, lower: Array, upper: Array) -> Array:
        """(3,) shift [m] that brings the box to the plane (or line) that the tool point cannot leave.

        Args:
            lower, upper: (3,) corners of the box, world [m].
        """
        N = self.normals
        point = np.clip(self.offset, lower, upper)
        # Least distance from the box by exact steps along one coordinate at a time: a convex quadratic in 3 unknowns.
        for _ in range(_SWEEPS if N.shape[1] else 0):
            before = point.copy()
            for k in range(3):
                slope, curvature = N[k] @ (N.T @ (point - self.offset)), N[k] @ N[k]
                if curvature > 1e-15:
                    point[k] = np.clip(point[k] - slope / curvature, lower[k], upper[k])
            if np.array_equal(point, before):  # as soon as the first sweep, where the box is a point
                break
        return np.asarray(N @ (N.T @ (self.offset - point)))

    def misses(self, lower: Array, upper: Array) -> bool:
        """Whether no point of the box (3,), (3,) [m] lies in the plane (or line) of the tool point."""
        return bool(np.linalg.norm(self.outside(lower, upper)) > self.plane_slack)

    def excludes(self, lower: Array, upper: Array) -> bool:
        """Whether the lengths of the links, or its plane, keep the tool point from the box (3,), (3,) [m]."""
        slack = _SHELL_SLACK * self.shell.most
        return self.misses(lower, upper) or self.shell.misses(lower, upper, slack)


def _range(columns: Array, lean: float = 0.0, least: float = 0.0) -> Array:
    """(3, r) orthonormal basis of what columns (3, k) span, singular values below the tolerances left out."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    keep = s > max(max(_RANK, lean) * max(float(s[0]), 1e-6), least)
    basis = U[:, keep]
    return np.eye(3) if basis.shape[1] == 3 else _aligned(basis, lean)


def _aligned(basis: Array, lean: float) -> Array:
    """The same subspace spanned by coordinate axes where these lie in it: they read better in a printed problem."""
    projector = basis @ basis.T
    columns = [e for e in np.eye(3) if np.linalg.norm(projector @ e - e) < max(1e-9, lean)]
    return np.array(columns).T if columns and len(columns) == basis.shape[1] else basis


def _planar(axes: list[Array], lean: float) -> bool:
    """Whether unit vectors (3,) all lie in one plane through the origin, up to ``lean`` [rad]."""
    return bool(np.linalg.svd(np.array(axes), compute_uv=False)[-1] < max(_DEPENDENT, lean * math.sqrt(len(axes))))


def _normal(axes: list[Array]) -> Array:
    """(3,) unit normal of the plane that is nearest to unit vectors (3,)."""
    return np.asarray(np.linalg.svd(np.array(axes))[2][-1])


SIZES = {
    "lower": 3,
    "upper": 3,
    "direction": 3,
    "b1": 3,
    "b2": 3,
    "clearance": 1,
    "sin_tilt": 1,
    "scale": 1,
    "axis": 3,
    "a1": 3,
    "a2": 3,
    "spin": 3,
    "lever": 3,
}
FREE = 1e6
"""A bound on the tool point that no arm reaches: the target is free."""


@dataclass(frozen=True)
class TaskTarget:
    """The target of one solve.

    Args:
        lower, upper: (3,) box for the tool point, world [m]; equal for a point, ±``FREE`` for anywhere.
        direction: (3,) unit vector, world: the spread counts across it, along it, or whole.
        basis: (3, 2) orthonormal complement of ``direction``; the first column in the plane of a planar arm.
        axis: (3,) unit vector, world: where the tool axis is to point; the direction, unless a path says otherwise.
        axis_basis: (3, 2) orthonormal complement of ``axis``, as ``basis``.
        clearance: radial [m], NaN where not given.
        tilt: allowed angle between the tool axis and ``axis`` [rad].
        scale: variance [m²] that the objective is divided by.
        spin: (3,) unit vector, world: where `spin_axis` of the tool is to point; zero where the spin is free.
        lever: (3,) from the workpiece's origin to the target [m], world: what the workpiece's angle acts with.
    """

    lower: Array
    upper: Array
    direction: Array
    basis: Array
    axis: Array
    axis_basis: Array
    clearance: float = math.nan
    tilt: float = 0.0
    scale: float = 1.0
    spin: Array = field(default_factory=lambda: np.zeros(3))
    lever: Array = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def of(cls, task: Task, reach: Reach) -> TaskTarget:
        """The target that the task of a problem file states."""
        lower, upper = np.full(3, -FREE), np.full(3, FREE)
        if task.position is not None:
            lower = upper = np.array(task.position)
        elif task.region is not None:
            lower, upper = np.array(task.region.min), np.array(task.region.max)
        d = np.array(task.direction) / np.linalg.norm(task.direction)
        B = across_basis(d, reach.normal)
        clearance = math.nan if task.clearance is None else task.clearance
        spin = np.zeros(3) if task.heading is None else np.cross(d, task.heading)
        lever = np.zeros(3) if task.position is None else np.array(task.lever_at(task.position))
        return cls(lower, upper, d, B, d, B, clearance, task.tilt, spin=spin, lever=lever)

    def with_position(self, position: Array) -> TaskTarget:
        """The same target at another point (3,), world [m].

        Raises:
            InputError: not three finite numbers.
        """
        point = _vector(position, "position")
        return replace(self, lower=point, upper=point)

    def with_direction(self, direction: Array, reach: Reach) -> TaskTarget:
        """The same target along another direction (3,), world, the tool axis along it.

        Raises:
            InputError: not three finite numbers, a vector of length zero, or a task whose yaw belongs to its own
                direction.
        """
        d = _vector(direction, "direction")
        if np.linalg.norm(d) < 1e-12:
            raise InputError(Issue("a direction of length zero points nowhere", ("direction",), direction))
        d = d / np.linalg.norm(d)
        B = across_basis(d, reach.normal)
        if self.spun and not np.allclose(d, self.direction):
            raise InputError(Issue("the yaw of the task holds for its own direction", ("direction",), direction))
        return replace(self, direction=d, basis=B, axis=d, axis_basis=B)

    @property
    def spun(self) -> bool:
        """Whether the spin of the tool is held."""
        return bool(np.any(self.spin))

    def with_axis(self, axis: Array, reach: Reach) -> TaskTarget:
        """The same target, the tool axis along the unit vector ``axis`` (3,), world, instead of the direction."""
        return replace(self, axis=axis, axis_basis=across_basis(axis, reach.normal))

    def moved(self, w: Array) -> TaskTarget:
        """The same point in a frame that was the world's and is now at the placement w = (x, y, z, yaw) [m, rad].

        Points become ``T_world_workpiece p``, directions are turned by its Rz(yaw).
        """
        assert self.kind == "point", "a box that is turned is none"
        turn = math.cos(w[3]), math.sin(w[3])
        point = turned_about_z(self.lower, *turn) + w[:3]
        vectors = (self.direction, *self.basis.T, self.axis, *self.axis_basis.T, self.spin, self.lever)
        d, b1, b2, a, a1, a2, spin, lever = (turned_about_z(vector, *turn) for vector in vectors)
        basis, axis_basis = np.column_stack([b1, b2]), np.column_stack([a1, a2])
        moved = replace(self, lower=point, upper=point, direction=d, basis=basis, axis=a, axis_basis=axis_basis)
        return replace(moved, spin=spin, lever=lever)

    def in_task(self, task: Task) -> Task:
        """The task with the place, the direction and the clearance of this target; with a lever, on its workpiece."""
        stated: dict[str, Any] = {"direction": _entries(self.direction), "clearance": self.given_clearance}
        if self.kind == "point":
            stated["position"] = _entries(self.lower)
        if np.any(self.lever):
            x, y, z = ((v, v) for v in _entries(self.lower - self.lever))
            stated["workpiece"] = Workpiece().model_copy(update={"x": x, "y": y, "z": z})
        return task.model_copy(update=stated)

    @property
    def given_clearance(self) -> float | None:
        """The clearance [m]; None where none is given."""
        return None if math.isnan(self.clearance) else self.clearance

    @cached_property
    def kind(self) -> str:
        """``point``, ``region`` or ``anywhere``."""
        if np.array_equal(self.lower, self.upper):
            return "point"
        return "anywhere" if bool(np.all(self.upper >= FREE)) else "region"

    @cached_property
    def parameters(self) -> Array:
        """(33,) the parameters of the optimisation problem, in the order of ``SIZES``."""
        clearance = 1.0 if math.isnan(self.clearance) else self.clearance
        numbers = [clearance, math.sin(self.tilt), self.scale]
        spread = [self.lower, self.upper, self.direction, *self.basis.T]
        return np.concatenate([*spread, numbers, self.axis, *self.axis_basis.T, self.spin, self.lever])


def spin_axis(tool_axis: tuple[float, float, float]) -> Array:
    """(3,) unit vector across the tool axis, tool frame, by which the spin is measured: ``z × x`` of a tool axis z."""
    a = np.array(tool_axis) / np.linalg.norm(tool_axis)
    b = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    return np.asarray(b / np.linalg.norm(b))


def target_symbols() -> tuple[ca.SX, dict[str, ca.SX]]:
    """The parameter vector (33,) of the optimisation problem, and its parts by the names of ``SIZES``."""
    p = ca.SX.sym("p", sum(SIZES.values()))
    parts = ca.vertsplit(p, [0, *np.cumsum(list(SIZES.values())).tolist()])
    return p, dict(zip(SIZES, parts, strict=True))


def turned_about_z(vector: Scalar, c: Scalar, s: Scalar) -> Scalar:
    """(3,) a vector turned about z by the angle of that cosine and sine: numbers, or symbols of CasADi."""
    parts = (c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2])
    return np.array(parts) if isinstance(vector, np.ndarray) else ca.vertcat(*parts)


def _entries(vector: Array) -> tuple[float, float, float]:
    """A vector (3,) as plain numbers."""
    x, y, z = map(float, vector)
    return x, y, z


def _vector(value: Array, what: str) -> Array:
    """Three finite numbers (3,).

    Raises:
        InputError: they are not; ``what`` names them.
    """
    array = np.asarray(value, dtype=float)
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise InputError(Issue(f"{what} needs three finite numbers", (what,), value, "for example (0.6, 0.2, 0.1)"))
    return array
