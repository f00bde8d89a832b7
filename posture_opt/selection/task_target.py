"""``TaskTarget``: where one solve is to bring the tool point: the parameters of the optimisation problem."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.numerics import Array
from posture_opt.selection.reach import Reach
from posture_opt.selection.tasks import Task

SIZES = {"lower": 3, "upper": 3, "direction": 3, "b1": 3, "b2": 3, "clearance": 1, "sin_tilt": 1, "scale": 1}
FREE = 1e6
"""A bound on the tool point that no arm reaches: the target is free."""


@dataclass(frozen=True)
class TaskTarget:
    """The target of one solve.

    Args:
        lower, upper: (3,) box for the tool point, world [m]; equal for a point, ±``FREE`` for anywhere.
        direction: (3,) unit vector, world.
        basis: (3, 2) orthonormal complement of ``direction``; the first column in the plane of a planar arm.
        clearance: radial [m], NaN where not given.
        tilt: allowed angle between tool axis and direction [rad].
        scale: variance [m²] that the objective is divided by.
    """

    lower: Array
    upper: Array
    direction: Array
    basis: Array
    clearance: float = math.nan
    tilt: float = 0.0
    scale: float = 1.0

    @classmethod
    def of(cls, task: Task, reach: Reach) -> TaskTarget:
        """The target that the task of a problem file states."""
        lower, upper = np.full(3, -FREE), np.full(3, FREE)
        if task.position is not None:
            lower = upper = np.array(task.position)
        elif task.region is not None:
            lower, upper = np.array(task.region.min), np.array(task.region.max)
        d = np.array(task.direction) / np.linalg.norm(task.direction)
        clearance = math.nan if task.clearance is None else task.clearance
        return cls(lower, upper, d, complement(d, reach), clearance, task.tilt)

    def with_position(self, position: Array) -> TaskTarget:
        """The same target at another point."""
        point = _vector(position, "position")
        return replace(self, lower=point, upper=point)

    def with_direction(self, direction: Array, reach: Reach) -> TaskTarget:
        """The same target along another direction."""
        d = _vector(direction, "direction")
        if np.linalg.norm(d) < 1e-12:
            raise InputError(Issue("a direction of length zero points nowhere", ("direction",), direction))
        d = d / np.linalg.norm(d)
        return replace(self, direction=d, basis=complement(d, reach))

    @property
    def kind(self) -> str:
        """``point``, ``region`` or ``anywhere``."""
        if np.array_equal(self.lower, self.upper):
            return "point"
        return "anywhere" if bool(np.all(self.upper >= FREE)) else "region"

    def parameters(self) -> Array:
        """(18,) the parameters of the optimisation problem, in the order of ``SIZES``."""
        clearance = 1.0 if math.isnan(self.clearance) else self.clearance
        tail = [clearance, math.sin(self.tilt), self.scale]
        return np.concatenate([self.lower, self.upper, self.direction, self.basis[:, 0], self.basis[:, 1], tail])


def target_symbols() -> tuple[ca.SX, dict[str, ca.SX]]:
    """The parameter vector of the optimisation problem and its named parts."""
    p = ca.SX.sym("p", sum(SIZES.values()))
    parts = ca.vertsplit(p, [0, *np.cumsum(list(SIZES.values())).tolist()])
    return p, dict(zip(SIZES, parts, strict=True))


def complement(d: Array, reach: Reach) -> Array:
    """(3, 2) orthonormal basis of the plane across ``d``; its first vector in the arm's plane where there is one."""
    normals = reach.normals
    in_plane = normals.shape[1] == 1 and abs(normals[:, 0] @ d) < 1e-9
    helper = normals[:, 0] if in_plane else np.eye(3)[np.argmin(np.abs(d))]
    b1 = np.cross(helper, d) if in_plane else helper - d * (helper @ d)
    b1 = b1 / np.linalg.norm(b1)
    # A sign that people expect: the largest component positive.
    b1 = b1 * np.sign(b1[np.argmax(np.abs(b1))])
    return np.column_stack([b1, np.cross(d, b1)]) + 0.0


def _vector(value: Array, what: str) -> Array:
    array = np.asarray(value, dtype=float)
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise InputError(Issue(f"{what} needs three finite numbers", (what,), value, "for example (0.6, 0.2, 0.1)"))
    return array
