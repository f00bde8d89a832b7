"""A lower bound: a spread that no posture can beat, because it depends on the target alone.

An error that acts before any joint has moved – the base, the first joint – shifts the tool point by
``a × (x − o)`` (or ``a``), and neither axis nor lever depends on the posture once the target ``x`` is given.
By the law of total covariance the tool point scatters at least as much as these errors alone make it scatter
when all others are held fixed, so ``B' C_fixed(x) B`` bounds the projected covariance from below. Errors of the
workpiece are independent of the arm's and the same in every posture: they are added to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.regions.regions import deviation
from posture_opt.uncertainty.sources.workpiece import of_workpiece, relative_twist, stated_name


@dataclass(frozen=True)
class LowerBound:
    """A lower bound on the largest standard deviation [m], the source that sets it and that one's share of it.

    Args:
        point: (3,) where in the target the bound is least.
        radius: distance [m] of that point from the axis of the source, NaN where the source is a shift.
    """

    sigma: float
    source: str
    share: float
    point: Array
    radius: float


def lower_bound(tool_point: ToolPoint, target: TaskTarget, basis: Array) -> LowerBound | None:
    """The bound for the part of the spread in ``basis`` (3, m); None where nothing fixed is uncertain, or where
    what is does not move the tool point in that part.

    For a region it is the least over the region: the bound is a convex function of the point.

    Args:
        tool_point: at the lever of the target.
    """
    fixed, beside = _fixed_sources(tool_point), _WorkpieceErrors.of(tool_point)
    if not (fixed or beside.names) or target.kind == "anywhere":
        return None
    covariance = _conditional(tool_point.covariance, fixed)
    columns = _Levers.of(tool_point, fixed)
    point = _least(columns, covariance, target, basis) if fixed and target.kind == "region" else target.lower
    # At a region the lever of the workpiece is zero: its errors raise the bound by as much at every point.
    J, both = basis.T @ np.hstack([columns.at(point), beside.columns]), _joined(covariance, beside.covariance)
    values, vectors = np.linalg.eigh(J @ both @ J.T)
    sigma = deviation(float(values[-1]), _joined(columns.scale(covariance), beside.moved))
    if sigma == 0:
        return None
    gains: dict[str, float] = {}
    names = [*(tool_point.names[k] for k in fixed), *map(stated_name, beside.names)]
    for name, gain in zip(names, (vectors[:, -1] @ J) ** 2 * np.diag(both), strict=True):
        gains[name] = gains.get(name, 0.0) + float(gain)
    source = max(gains, key=gains.__getitem__)
    first = names.index(source)
    radius = columns.radius(first, point) if first < len(fixed) else np.nan
    return LowerBound(sigma, source, gains[source] / sum(gains.values()), point, radius)


@dataclass(frozen=True)
class _WorkpieceErrors:
    """Errors of the workpiece: names, shift of the target by each (3, w), and covariance (w, w)."""

    names: tuple[str, ...]
    columns: Array
    covariance: Array

    @classmethod
    def of(cls, tool_point: ToolPoint) -> _WorkpieceErrors:
        linear = tool_point.linear
        rows = [] if linear is None else [k for k, name in enumerate(linear.names) if of_workpiece(name)]
        names = tuple(linear.names[k] for k in rows) if linear is not None else ()
        shifts = [relative_twist(name, tool_point.lever)[0] for name in names]
        covariance = np.zeros((0, 0)) if linear is None else linear.covariance[np.ix_(rows, rows)]
        return cls(names, np.array(shifts, dtype=float).reshape(-1, 3).T, covariance)

    @property
    def moved(self) -> Array:
        """(3, 3) what they add to the covariance of the tool relative to the target [m²]."""
        return np.asarray(self.columns @ self.covariance @ self.columns.T)


def _joined(A: Array, B: Array) -> Array:
    """Both square matrices as the blocks of one."""
    return np.block([[A, np.zeros((len(A), len(B)))], [np.zeros((len(B), len(A))), B]])


@dataclass(frozen=True)
class _Levers:
    """Axes (k, 3) and origins (k, 3) of the fixed sources, and which of them rotate."""

    axes: Array
    origins: Array
    rotates: Array

    @classmethod
    def of(cls, tool_point: ToolPoint, fixed: list[int]) -> _Levers:
        factors = tool_point.robot.factors
        reached = walk(factors, factor_values(factors, [0.0] * tool_point.robot.n))
        screws = [reached.screws[tool_point.indices[k]] for k in fixed]
        return cls(
            np.array([s.axis for s in screws], dtype=float).reshape(-1, 3),
            np.array([s.origin for s in screws], dtype=float).reshape(-1, 3),
            np.array([s.rotates for s in screws], dtype=bool),
        )

    def at(self, point: Array) -> Array:
        """(3, k) derivative of the tool point."""
        turned = np.cross(self.axes, point - self.origins)
        return np.where(self.rotates[:, None], turned, self.axes).T

    def scale(self, covariance: Array) -> Array:
        """(k, k) variances [m²] with levers as long as the way to each source: what a bound is rounding beside."""
        ways = np.where(self.rotates, 1.0 + np.linalg.norm(self.origins, axis=1), 1.0)
        return np.asarray(np.diag(np.diag(covariance)) * ways**2)

    def radius(self, k: int, point: Array) -> float:
        return float(np.linalg.norm(np.cross(self.axes[k], point - self.origins[k]))) if self.rotates[k] else np.nan


def _fixed_sources(tool_point: ToolPoint) -> list[int]:
    """Sources whose axis no joint moves: all up to the first joint, and those along or about its own axis after it."""
    factors = tool_point.robot.factors
    first = next(i for i, factor in enumerate(factors) if factor.joint is not None)
    if factors[first].kind != "rotate":
        return [k for k, index in enumerate(tool_point.indices) if index <= first]
    last = first
    while last + 1 < len(factors) and factors[last + 1].axis == factors[first].axis and factors[last + 1].joint is None:
        last += 1
    return [k for k, index in enumerate(tool_point.indices) if index <= last]


def _conditional(covariance: Array, fixed: list[int]) -> Array:
    """Covariance of the fixed sources given all others: what remains when those are known."""
    other = [k for k in range(len(covariance)) if k not in fixed]
    ff, fo, oo = covariance[np.ix_(fixed, fixed)], covariance[np.ix_(fixed, other)], covariance[np.ix_(other, other)]
    remaining = ff - fo @ np.linalg.pinv(oo) @ fo.T if other and np.any(fo) else ff
    # A finite rotation error scatters a little less than its linear lever says; stay below it.
    shrink = np.exp(-2 * np.diag(remaining).clip(0))
    return np.asarray(remaining * np.sqrt(np.outer(shrink, shrink)))


def _least(columns: _Levers, covariance: Array, target: TaskTarget, basis: Array) -> Array:
    """The point of the box with the least bound, by halving a pattern search: smooth enough, convex, 3 unknowns."""

    def value(point: Array) -> float:
        J = basis.T @ columns.at(point)
        return float(np.linalg.eigvalsh(J @ covariance @ J.T)[-1])

    # The base axis is the usual least: start from the box's point nearest to it.
    point = np.clip(columns.origins[0], target.lower, target.upper)
    best, step = value(point), (target.upper - target.lower) / 2
    while np.max(step) > 1e-5:
        moves = [
            np.clip(point + sign * np.eye(3)[k] * step, target.lower, target.upper)
            for k in range(3)
            for sign in (1, -1)
        ]
        values = [value(move) for move in moves]
        if min(values) < best * (1 - 1e-9):
            best, point = min(values), moves[int(np.argmin(values))]
        else:
            step = step / 2
    return np.asarray(point)
