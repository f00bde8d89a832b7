"""Moments of the tool point of a robot with named sources of error: which method serves which case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol

import casadi as ca
import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.model.chain import ZERO, Scalar, Vector, Walk, add, scale, stack
from posture_opt.numerics import Array
from posture_opt.robot.robot import Axis, Factor, Robot
from posture_opt.uncertainty.exact_moments import (
    Plane,
    Segment,
    conditional_moments,
    exact_moments,
    planar_moments,
    plane_of,
)
from posture_opt.uncertainty.integration import (
    Integration,
    NodePlan,
    SharedFactors,
    SharedSpan,
    converged,
    spans,
)
from posture_opt.uncertainty.sources import of_workpiece, relative_twist

Method = Literal["exact", "exact, planar", "exact given shared factors, integrated over them"]


class NamedCovariance(Protocol):
    """Named sources of error with their covariance (k, k) [rad, m]."""

    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def covariance(self) -> np.ndarray: ...


@dataclass(frozen=True)
class Moments:
    """Moments of the tool point at a posture, world frame; symbols, numbers or arrays with the batch axis first."""

    position: Scalar  # (3,) nominal tool point [m]
    mean: Scalar  # (3,) exact mean [m]
    covariance: Scalar  # (3, 3) by `ToolPoint.method` [m²]
    first_order: Scalar  # (3, 3) J Σ Jᵀ [m²]
    walk: Walk  # the nominal chain with its effects
    integration: Integration | None = None  # None in closed form, or with nodes that were given


@dataclass(frozen=True)
class LinearSources:
    """Uncertain parameters that act on the tool point to first order: those of effects, and errors of the workpiece."""

    names: tuple[str, ...]  # (e,) parameters of the effects, sides that are not known, then of the workpiece
    covariance: np.ndarray  # (e, e) [SI]
    cross: np.ndarray  # (k, e) with the sources of the chain


@dataclass(frozen=True)
class ToolPoint:
    """The tool point of an arm under named errors, sorted from base to tool.

    With errors of the workpiece among the linear sources the moments are those relative to it.
    """

    arm: Arm
    names: tuple[str, ...]  # (k,) of the sources of the chain
    indices: tuple[int, ...]  # (k,) factor of the chain that each acts on, ascending
    covariance: np.ndarray  # (k, k) of the sources [rad², m², rad m]
    plane: Plane | None  # of a planar arm whose sources keep it in its plane
    linear: LinearSources | None = None
    lever: Vector = ZERO  # (3,) from the workpiece's origin to the tool point of the task [m], world
    offset: Vector = ZERO  # (3,) from that tool point to this one [m], tool frame

    @classmethod
    def of(cls, arm: Arm, sources: NamedCovariance) -> ToolPoint:
        """Sort the sources along the chain, leaving out those without variance."""
        robot = arm.robot
        at = {factor.parameter: i for i, factor in enumerate(robot.factors) if factor.parameter}
        variance = np.diag(sources.covariance)
        own = [k for k in range(len(sources.names)) if variance[k] > 0 and sources.names[k] in at]
        order = sorted(own, key=lambda k: at[sources.names[k]])
        names = tuple(sources.names[k] for k in order)
        indices = tuple(at[name] for name in names)
        linear = _linear_sources(arm, sources, order)
        return cls(arm, names, indices, sources.covariance[np.ix_(order, order)], plane_of(robot, indices), linear)

    @property
    def robot(self) -> Robot:
        return self.arm.robot

    @property
    def method(self) -> Method:
        """How the covariance is computed, for Gaussian errors: in closed form wherever there is one."""
        if not np.any(self.covariance != np.diag(np.diag(self.covariance))):
            return "exact"
        return "exact, planar" if self.plane is not None else "exact given shared factors, integrated over them"

    @property
    def integrated(self) -> bool:
        """Whether correlations are integrated over numerically, at nodes."""
        return self.method.startswith("exact given")

    @cached_property
    def shared(self) -> SharedFactors:
        """The covariance of the sources as independent errors and factors that they share."""
        turning = [self.robot.factors[index].kind == "rotate" for index in self.indices]
        return SharedFactors.of(self.covariance, np.array(turning, dtype=bool))

    @cached_property
    def spans(self) -> list[SharedSpan]:
        """Where along the chain the shared factors act."""
        return spans(self.shared, self.indices, self.robot.factors)

    @cached_property
    def every_source(self) -> tuple[tuple[str, ...], Array]:
        """Names (k + e,) and covariance (k + e, k + e) [SI] of the sources of the chain, then the linear ones."""
        if self.linear is None:
            return self.names, self.covariance
        linear = self.linear
        covariance = np.block([[self.covariance, linear.cross], [linear.cross.T, linear.covariance]])
        return (*self.names, *linear.names), covariance

    def every_column(self, q: Sequence[float]) -> Array:
        """(3, k + e) shift of the tool point at ``q`` (n,) per unit of `every_source` [m per SI unit], world."""
        reached = self.walk(q)[0]
        J = np.asarray(self.jacobian(reached), dtype=float)
        return J if self.linear is None else np.hstack([J, np.asarray(self.linear_columns(q, reached), dtype=float)])

    def behind(self, offset: Vector) -> ToolPoint:
        """The point of the tool at an offset (3,) [m], tool frame, under the same errors.

        What effects do with the payload they do as if it were there.
        """
        axes: tuple[Axis, ...] = (0, 1, 2)
        more = tuple(Factor("translate", axis, length) for axis, length in zip(axes, offset, strict=True))
        robot, total = replace(self.robot, tool=(*self.robot.tool, *more)), add(self.offset, offset)
        return replace(self, arm=replace(self.arm, robot=robot), plane=plane_of(robot, self.indices), offset=total)

    def seen_from(self, lever: Sequence[Scalar]) -> ToolPoint:
        """The same point where the workpiece's origin is at another lever (3,) from it [m], world."""
        x, y, z = lever
        return replace(self, lever=(x, y, z))

    def walk(self, q: Sequence[Scalar]) -> tuple[Walk, list[Scalar]]:
        """The walk along the nominal chain at ``q`` (n,), with its effects, and the value of every factor."""
        reached = self.arm.reach(q)
        return reached.walk, reached.values

    def moments(self, q: Sequence[Scalar], plan: NodePlan | None = None) -> Moments:
        """Mean and covariance at the posture ``q``: n scalars, arrays (N,) or symbols.

        Correlated errors of a spatial arm take the nodes of a plan. Without one, numbers are integrated until they
        have converged, and arrays and symbols have the few nodes of `NodePlan.few`.
        """
        moments = self._of_chain(q, plan)
        if self.linear is None:
            return moments
        E = self.linear_columns(q, moments.walk)
        added = self._linear_covariance(self.jacobian(moments.walk), E)
        return replace(moments, covariance=moments.covariance + added, first_order=moments.first_order + added)

    def _of_chain(self, q: Sequence[Scalar], plan: NodePlan | None) -> Moments:
        whole = self.arm.reach(q)
        reached, values, shift = whole.walk, whole.values, whole.shift
        jacobian = self.jacobian(reached)
        first = jacobian @ self.covariance @ transpose(jacobian)
        integration: Integration | None = None
        if not self.integrated:
            if self.plane is not None and self.method == "exact, planar":
                m, D = planar_moments(self.robot, reached, values, self.indices, self.covariance, self.plane)
            else:
                m, D = exact_moments(self.robot.factors, values, self.variances(np.diag(self.covariance)))
            mean, C = stack(add(m, shift)), stack(D)
        elif plan is None and not any(isinstance(value, ca.SX | np.ndarray) for value in values):
            found = converged(lambda segments: self._given_nodes(values, segments, shift), self.spans)
            mean, C, integration = found.mean, found.covariance, found.integration
        else:
            plan = plan or NodePlan.few(self.shared, self.indices, self.robot.factors)
            mean, C = self._given_nodes(values, plan.segments, shift)
            L = jacobian @ plan.straight
            C = C + L @ transpose(L)
            if isinstance(C, ca.SX):  # what nodes have in common is written once
                joined = ca.cse(ca.vertcat(mean, ca.vec(C)))
                mean, C = joined[:3], ca.reshape(joined[3:], 3, 3)
        return Moments(stack(reached.position), mean, C, first, reached, integration)

    def segments(self, q: Sequence[float], goal: float) -> Sequence[Segment]:
        """Nodes for the shared factors that give the covariance at ``q`` to the relative error ``goal``."""
        whole = self.arm.reach(q)
        return converged(lambda s: self._given_nodes(whole.values, s, whole.shift), self.spans, goal).segments

    def _given_nodes(
        self, values: Sequence[Scalar], segments: Sequence[Segment], shift: Vector
    ) -> tuple[Scalar, Scalar]:
        """Mean (3,) and covariance (3, 3) with nodes, which are on the last axis until they are mixed."""
        columns = [value[:, None] if isinstance(value, np.ndarray) else value for value in values]
        mean, C = conditional_moments(self.robot.factors, columns, self.variances(self.shared.own), segments)
        moved = add((_without_nodes(mean[0]), _without_nodes(mean[1]), _without_nodes(mean[2])), shift)
        return stack(moved), stack([[_without_nodes(entry) for entry in row] for row in C])

    def linear_columns(self, q: Sequence[Scalar], reached: Walk, *, turns: bool = False) -> Scalar:
        """(3, e) shift of the tool point per unit of each source of `linear`; (6, e) with its rotation."""
        assert self.linear is not None
        lever = self.lever
        for along, column in zip(self.offset, reached.columns, strict=True):
            lever = lever if along == 0 else add(lever, scale(along, column))
        own = [name for name in self.linear.names if not of_workpiece(name)]
        relative = [relative_twist(name, lever) for name in self.linear.names if of_workpiece(name)]
        twists = [*self.arm.twists(own, q, reached), *relative]
        return stack(list(zip(*((*shift, *turn) if turns else shift for shift, turn in twists), strict=True)))

    def jacobian(self, reached: Walk) -> Scalar:
        """``∂x/∂source`` (3, k) [m/rad, m/m], world frame."""
        if not self.indices:
            return np.zeros((3, 0))
        return stack(list(zip(*(shift for shift, _ in self.arm.twists(self.indices, (), reached)), strict=True)))

    def twists(self, q: Sequence[Scalar], reached: Walk) -> Scalar:
        """(6, k) shift of the tool point and small rotation per source, world-aligned axes."""
        if not self.indices:
            return np.zeros((6, 0))
        return stack(list(zip(*((*v, *w) for v, w in self.arm.twists(self.indices, q, reached)), strict=True)))

    def pose_first_order(self, q: Sequence[Scalar], reached: Walk) -> Scalar:
        """(6, 6) ``J Σ Jᵀ`` of the shift of the tool point and the small rotation of the tool, world-aligned axes."""
        linear = self.linear_of_pose(q, reached)
        if not self.indices:
            return linear
        T = self.twists(q, reached)
        return T @ self.covariance @ transpose(T) + linear

    def linear_of_pose(self, q: Sequence[Scalar], reached: Walk) -> Scalar:
        """(6, 6) the part of `pose_first_order` that `linear` adds."""
        if self.linear is None:
            return np.zeros((6, 6))
        return self._linear_covariance(self.twists(q, reached), self.linear_columns(q, reached, turns=True))

    def _linear_covariance(self, T: Scalar, E: Scalar) -> Scalar:
        """(m, m) what `linear` adds to a covariance, by the columns of chain T (m, k) and linear sources E (m, e)."""
        assert self.linear is not None
        added = E @ self.linear.covariance @ transpose(E)
        cross = T @ self.linear.cross @ transpose(E) if self.indices else 0.0 * added
        return added + cross + transpose(cross)

    def variances(self, of_sources: Array) -> list[float]:
        """The variance of every factor of the chain from those of the sources (k,)."""
        variances = [0.0] * len(self.robot.factors)
        for index, variance in zip(self.indices, of_sources, strict=True):
            variances[index] = float(variance)
        return variances


def transpose(matrix: Scalar) -> Scalar:
    """The transpose of an SX, or of arrays with the batch axis first."""
    return matrix.T if isinstance(matrix, ca.SX) else np.swapaxes(matrix, -1, -2)


def _without_nodes(entry: Scalar) -> Scalar:
    return entry[..., 0] if isinstance(entry, np.ndarray) else entry


def _linear_sources(arm: Arm, sources: NamedCovariance, order: Sequence[int]) -> LinearSources | None:
    """Errors of the workpiece are independent of the arm's; ``order`` is that of the sources of the chain."""
    relative = [name for name in sources.names if of_workpiece(name)]
    if not arm.effects and not relative:
        return None
    units = arm.unit_sources
    names = (*arm.effect_parameters, *units, *relative)
    at = {name: k for k, name in enumerate(sources.names)}
    covariance, cross = np.zeros((len(names), len(names))), np.zeros((len(order), len(names)))
    known = [e for e, name in enumerate(names) if name in at]
    rows = [at[names[e]] for e in known]
    covariance[np.ix_(known, known)] = sources.covariance[np.ix_(rows, rows)]
    cross[:, known] = sources.covariance[np.ix_(list(order), rows)]
    for e, name in enumerate(names):
        if name in units:
            covariance[e, e] = 1.0  # a side is -1 or +1, what is unmeasured stated in standard deviations
    return LinearSources(names, covariance, cross) if covariance.any() else None
