"""Moments of the tool point of a robot with named sources of error: which method serves which case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol

import casadi as ca
import numpy as np

from posture_opt.model.arm import Arm, Twist
from posture_opt.model.chain import ZERO, Scalar, Vector, Walk, add, scale, stack
from posture_opt.numerics import Array
from posture_opt.robot.robot import Axis, Factor, Robot
from posture_opt.uncertainty.moments.conditional_moments import Segment, conditional_moments
from posture_opt.uncertainty.moments.exact_moments import exact_moments
from posture_opt.uncertainty.moments.integration import Integration, SharedSpan, converged, spans
from posture_opt.uncertainty.moments.node_plan import NodePlan
from posture_opt.uncertainty.moments.planar_moments import Plane, planar_moments, plane_of
from posture_opt.uncertainty.moments.second_order import transpose
from posture_opt.uncertainty.moments.shared_factors import SharedFactors
from posture_opt.uncertainty.sources.workpiece import of_workpiece, relative_twist

Method = Literal["exact", "exact, planar", "exact given shared factors, integrated over them"]


class NamedCovariance(Protocol):
    """Named sources of error with their covariance (k, k) [rad, m]."""

    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def covariance(self) -> np.ndarray: ...


@dataclass(frozen=True)
class Moments:
    """Moments of the tool point at a posture, world frame; symbols, numbers or arrays with the batch axis first.

    Args:
        position: (3,) nominal tool point [m].
        mean: (3,) exact mean [m].
        covariance: (3, 3) by ``method`` [m²].
        first_order: (3, 3) ``J Σ Jᵀ`` [m²].
        walk: the nominal chain with its effects, pose and screws.
        integration: how the mean over shared factors was taken; None in closed form, or with nodes that were given.
    """

    position: Scalar
    mean: Scalar
    covariance: Scalar
    first_order: Scalar
    walk: Walk
    integration: Integration | None = None


@dataclass(frozen=True)
class LinearSources:
    """Uncertain parameters that act on the tool point to first order: those of effects, and errors of the workpiece.

    Args:
        names: (e,) of all parameters of the robot's effects, of the sides that are not known, then of the workpiece.
        covariance: (e, e) [SI]; cross: (k, e) with the sources of the chain.
    """

    names: tuple[str, ...]
    covariance: np.ndarray
    cross: np.ndarray


@dataclass(frozen=True)
class ToolPoint:
    """The tool point of an arm under named errors, sorted from base to tool.

    Args:
        arm: the forward model.
        names: (k,) of the sources of the chain.
        indices: (k,) factor of the chain that each acts on, ascending.
        covariance: (k, k) of the sources [rad², m², rad m].
        plane: of a planar arm whose sources keep it in its plane; else None.
        linear: what acts to first order, ``None`` where nothing does. With errors of the workpiece the moments are
            those of the tool point relative to it.
        lever: (3,) from the workpiece's origin to the tool point of the task [m], world; numbers or symbols.
        offset: (3,) from that tool point to this one [m], tool frame.
    """

    arm: Arm
    names: tuple[str, ...]
    indices: tuple[int, ...]
    covariance: np.ndarray
    plane: Plane | None
    linear: LinearSources | None = None
    lever: Vector = ZERO
    offset: Vector = ZERO

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
        """The chain without effects."""
        return self.arm.robot

    @property
    def correlated(self) -> bool:
        """Whether any two sources vary together."""
        return bool(np.any(self.covariance != np.diag(np.diag(self.covariance))))

    @property
    def method(self) -> Method:
        """How the covariance is computed, for Gaussian errors: in closed form wherever there is one."""
        if not self.correlated:
            return "exact"
        return "exact, planar" if self.plane is not None else "exact given shared factors, integrated over them"

    @property
    def integrated(self) -> bool:
        """Whether correlations are integrated over numerically, at nodes."""
        return self.correlated and self.plane is None

    @cached_property
    def shared(self) -> SharedFactors:
        """The covariance of the sources as independent errors and factors that they share."""
        turning = [self.robot.factors[index].kind == "rotate" for index in self.indices]
        return SharedFactors.of(self.covariance, np.array(turning, dtype=bool))

    @cached_property
    def spans(self) -> list[SharedSpan]:
        """Where along the chain the shared factors act."""
        return spans(self.shared, self.indices, self.robot.factors)

    def behind(self, offset: Vector) -> ToolPoint:
        """Another point of the tool under the same errors.

        What effects do with the payload they do as if it were there.

        Args:
            offset: (3,) from the tool point [m], tool frame.
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

        Args:
            plan: nodes for the shared factors of correlated errors of a spatial arm. Without one, numbers are
                integrated until they have converged, and arrays and symbols have the few nodes of `NodePlan.few`.
        """
        moments = self._of_chain(q, plan)
        if self.linear is None:
            return moments
        added = self._of_linear(q, moments.walk)
        return replace(moments, covariance=moments.covariance + added, first_order=moments.first_order + added)

    def _of_chain(self, q: Sequence[Scalar], plan: NodePlan | None) -> Moments:
        """The moments by the errors of the chain alone, with the effects at their estimates."""
        whole = self.arm.reach(q)
        reached, values, shift = whole.walk, whole.values, whole.shift
        jacobian = self.jacobian(reached)
        first = jacobian @ self.covariance @ transpose(jacobian)
        integration: Integration | None = None
        if self.method == "exact, planar":
            assert self.plane is not None
            mean, C = planar_moments(self.robot, reached, values, self.indices, self.covariance, self.plane)
            moments = stack(add(mean, shift)), stack(C)
        elif not self.correlated:
            mean, C = exact_moments(self.robot.factors, values, self.variances(np.diag(self.covariance)))
            moments = stack(add(mean, shift)), stack(C)
        elif plan is None and not any(isinstance(value, ca.SX | np.ndarray) for value in values):
            found = converged(lambda segments: self._given_nodes(values, segments, shift), self.spans)
            moments, integration = (found.mean, found.covariance), found.integration
        else:
            plan = plan or NodePlan.few(self.shared, self.indices, self.robot.factors)
            mean, C = self._given_nodes(values, plan.segments, shift)
            L = jacobian @ plan.straight
            moments = _shared_subexpressions(mean, C + L @ transpose(L))
        return Moments(stack(reached.position), *moments, first, reached, integration)

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

    def _of_linear(self, q: Sequence[Scalar], reached: Walk) -> Scalar:
        """(3, 3) what `linear` adds to the covariance."""
        assert self.linear is not None
        E = self.linear_columns(q, reached)
        cross = self.jacobian(reached) @ self.linear.cross @ transpose(E) if self.indices else np.zeros((3, 3))
        return E @ self.linear.covariance @ transpose(E) + cross + transpose(cross)

    def linear_columns(self, q: Sequence[Scalar], reached: Walk, *, turns: bool = False) -> Scalar:
        """(3, e) shift of the tool point per unit of each source of `linear`; (6, e) with its rotation."""
        assert self.linear is not None
        own = [name for name in self.linear.names if not of_workpiece(name)]
        twists = [*self.arm.twists(own, q, reached), *self._relative_twists(reached)]
        columns = [(*shift, *turn) if turns else shift for shift, turn in twists]
        return stack(list(zip(*columns, strict=True)))

    def _relative_twists(self, reached: Walk) -> list[Twist]:
        """Shift and small rotation relative to the workpiece, per unit of each of its errors."""
        assert self.linear is not None
        lever = self.lever
        for along, column in zip(self.offset, reached.columns, strict=True):
            lever = lever if along == 0 else add(lever, scale(along, column))
        return [relative_twist(name, lever) for name in self.linear.names if of_workpiece(name)]

    def jacobian(self, reached: Walk) -> Scalar:
        """``∂x/∂source`` (3, k) [m/rad, m/m], world frame."""
        if not self.indices:
            return np.zeros((3, 0))
        return stack(list(zip(*(shift for shift, _ in self.arm.twists(self.indices, (), reached)), strict=True)))

    def twists(self, q: Sequence[Scalar], reached: Walk) -> Scalar:
        """(6, k) shift of the tool point and small rotation per source, world-aligned axes."""
        return stack(list(zip(*((*v, *w) for v, w in self.arm.twists(self.indices, q, reached)), strict=True)))

    def pose_first_order(self, q: Sequence[Scalar], reached: Walk) -> Scalar:
        """(6, 6) ``J Σ Jᵀ`` of the shift of the tool point and the small rotation of the tool, world-aligned axes."""
        if not self.indices:
            return self.linear_of_pose(q, reached)
        T = self.twists(q, reached)
        return T @ self.covariance @ transpose(T) + self.linear_of_pose(q, reached)

    def linear_of_pose(self, q: Sequence[Scalar], reached: Walk) -> Scalar:
        """(6, 6) the part of `pose_first_order` that `linear` adds."""
        if self.linear is None:
            return np.zeros((6, 6))
        T = self.twists(q, reached) if self.indices else np.zeros((6, 0))
        E = self.linear_columns(q, reached, turns=True)
        cross = T @ self.linear.cross @ transpose(E)
        return E @ self.linear.covariance @ transpose(E) + cross + transpose(cross)

    def variances(self, of_sources: Array) -> list[float]:
        """The variance of every factor of the chain from those of the sources (k,)."""
        variances = [0.0] * len(self.robot.factors)
        for index, variance in zip(self.indices, of_sources, strict=True):
            variances[index] = float(variance)
        return variances


def _shared_subexpressions(mean: Scalar, C: Scalar) -> tuple[Scalar, Scalar]:
    """The same; symbols with what nodes have in common written once."""
    if not isinstance(C, ca.SX):
        return mean, C
    joined = ca.cse(ca.vertcat(mean, ca.vec(C)))
    return joined[:3], ca.reshape(joined[3:], 3, 3)


def _without_nodes(entry: Scalar) -> Scalar:
    """An entry without the axis that the nodes were on."""
    return entry[..., 0] if isinstance(entry, np.ndarray) else entry


def _linear_sources(arm: Arm, sources: NamedCovariance, order: Sequence[int]) -> LinearSources | None:
    """What acts to first order, or ``None`` where nothing does; errors of the workpiece are independent of the arm's.

    Args:
        order: of the sources of the chain.
    """
    relative = [name for name in sources.names if of_workpiece(name)]
    if not arm.effects and not relative:
        return None
    units = arm.unit_sources
    names = (*arm.effect_parameters, *units, *relative)
    at = {name: k for k, name in enumerate(sources.names)}
    covariance, cross = np.zeros((len(names), len(names))), np.zeros((len(order), len(names)))
    known = [(e, at[name]) for e, name in enumerate(names) if name in at]
    for e, k in known:
        cross[:, e] = sources.covariance[list(order), k]
        for f, m in known:
            covariance[e, f] = sources.covariance[k, m]
    for e, name in enumerate(names):
        if name in units:
            covariance[e, e] = 1.0  # a side is -1 or +1, what is unmeasured stated in standard deviations
    return LinearSources(names, covariance, cross) if covariance.any() else None
