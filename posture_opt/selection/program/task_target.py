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
from posture_opt.model.chain import Scalar, Shell
from posture_opt.numerics import Array
from posture_opt.robot.posture import drawn_between
from posture_opt.selection.tasks import Task
from posture_opt.selection.tasks.workpiece import Workpiece
from posture_opt.uncertainty.task_spread import across_basis

_DEPENDENT = 1e-7  # rad or m/rad: singular values below it are rounding, of quarter turns typed with seven digits too
_SAMPLES = 12  # random postures: more than the columns that can be independent, so that none is missed


PLANE_TOLERANCE = 1e-6  # distance [m] from its plane at which a target counts as outside of it


@dataclass(frozen=True)
class Reach:
    """Freedom of tool point and tool axis, found at random postures; motion by corrections counts as none."""

    directions: Array  # (3, r) orthonormal basis of the tool point's motion, world
    offset: Array  # (3,) a point that the tool reaches [m]
    axis_rank: int  # ways the tool axis turns: 0 fixed, 1 in a plane, 2 everywhere
    axis: Array  # (3,) fixed axis, or normal of its plane, else zeros
    axis_freedom: int  # at one posture; less than ``axis_rank`` on a cone
    orients_at_point: bool  # the axis turns with the tool point held fixed
    radius: float  # largest distance between tool points seen [m]
    plane_slack: float  # distance [m] from its plane at which a target is outside of it
    axis_slack: float  # error of the tool axis [rad] that counts as none
    shell: Shell  # bounds the tool point by the lengths of the links

    @classmethod
    def of(cls, arm: Arm, tool_axis: tuple[float, float, float]) -> Reach:
        """The reach of ``arm``: ranges of stacked Jacobians and axis turns ``ω_i × a`` at random postures."""
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
        lean = 2 * min(robot.skew, 0.05)  # beyond 0.05 rad, corrections make another arm
        U = _range(np.hstack(jacobians), lean)
        turned = _range(np.hstack(turns), 0.0, lean * math.sqrt(_SAMPLES * robot.n))
        rank = (
            0
            if turned.shape[1] == 0
            else 1
            if bool(np.linalg.svd(np.array(axes), compute_uv=False)[-1] < max(_DEPENDENT, lean * math.sqrt(len(axes))))
            else 2
        )
        both = [np.vstack([U.T @ J, A]) for J, A in zip(jacobians, turns, strict=True)]
        orients = max(np.linalg.matrix_rank(M, tol=_DEPENDENT) for M in both) >= U.shape[1] + rank
        radius = max(float(np.linalg.norm(p - points[0])) for p in points)
        axis = axes[0] if rank == 0 else np.asarray(np.linalg.svd(np.array(axes))[2][-1]) if rank == 1 else np.zeros(3)
        freedom = max(int(np.linalg.matrix_rank(A, tol=max(_DEPENDENT, lean))) for A in turns)
        able, size = bool(orients and rank > 0), max(radius, 1e-3)
        plane_slack = PLANE_TOLERANCE + lean * size + min(robot.lift, size)
        # 2e-5 rad: quarter turns in files are rounded
        return cls(U, points[0], rank, axis, freedom, able, size, plane_slack, 2e-5 + lean, Shell.of(robot))

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
        """(3,) shift [m] of a box (3,), (3,) to the plane or line that the tool point cannot leave."""
        N = self.normals
        point = np.clip(self.offset, lower, upper)
        # Least distance from the box by exact steps along one coordinate at a time: a convex quadratic in 3 unknowns.
        for _ in range(200 if N.shape[1] else 0):
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
        slack = 0.01 * self.shell.most  # effects and corrections move the tool point by less
        return self.misses(lower, upper) or self.shell.misses(lower, upper, slack)


def _range(columns: Array, lean: float = 0.0, least: float = 0.0) -> Array:
    """(3, r) orthonormal basis of what columns (3, k) span, singular values below the tolerances left out."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    keep = s > max(max(1e-9, lean) * max(float(s[0]), 1e-6), least)
    basis = U[:, keep]
    return np.eye(3) if basis.shape[1] == 3 else _aligned(basis, lean)


def _aligned(basis: Array, lean: float) -> Array:
    projector = basis @ basis.T
    columns = [e for e in np.eye(3) if np.linalg.norm(projector @ e - e) < max(1e-9, lean)]
    return np.array(columns).T if columns and len(columns) == basis.shape[1] else basis


SIZES = dict.fromkeys(("lower", "upper", "direction", "b1", "b2"), 3)
SIZES |= dict.fromkeys(("clearance", "sin_tilt", "scale"), 1) | dict.fromkeys(("axis", "a1", "a2", "spin", "lever"), 3)
FREE = 1e6  # a bound on the tool point that no arm reaches: the target is free


@dataclass(frozen=True)
class TaskTarget:
    """The target of one solve."""

    lower: Array  # (3,) box for the tool point, world [m]
    upper: Array  # (3,) equal for a point, ±``FREE`` for anywhere
    direction: Array  # (3,) unit vector, world
    basis: Array  # (3, 2) complement of ``direction``, its first column in the plane of a planar arm
    axis: Array  # (3,) where the tool axis is to point, world
    axis_basis: Array  # (3, 2) complement of ``axis``
    clearance: float = math.nan  # radial [m]
    tilt: float = 0.0  # allowed angle of the tool axis [rad]
    scale: float = 1.0  # variance [m²] that the objective is divided by
    spin: Array = field(default_factory=lambda: np.zeros(3))  # (3,) where `spin_axis` points, world; zero: free
    lever: Array = field(default_factory=lambda: np.zeros(3))  # (3,) from the workpiece's origin [m], world

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
        """The target at another point (3,), world [m]."""
        point = _vector(position, "position")
        return replace(self, lower=point, upper=point)

    def with_direction(self, direction: Array, reach: Reach) -> TaskTarget:
        """The target with direction and tool axis along another vector (3,), world."""
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
        return bool(np.any(self.spin))

    def with_axis(self, axis: Array, reach: Reach) -> TaskTarget:
        """The target with the tool axis along a unit vector (3,), world, instead of the direction."""
        return replace(self, axis=axis, axis_basis=across_basis(axis, reach.normal))

    def moved(self, w: Array) -> TaskTarget:
        """The target in a frame moved from the world's to w = (x, y, z, yaw) [m, rad]: ``T_world_workpiece p``."""
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
        """The stated clearance [m], or None."""
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
    array = np.asarray(value, dtype=float)
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise InputError(Issue(f"{what} needs three finite numbers", (what,), value, "for example (0.6, 0.2, 0.1)"))
    return array
