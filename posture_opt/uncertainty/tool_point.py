"""Moments of the tool point of a robot with named sources of error: which method serves which case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.model.chain import Scalar, Walk, add, stack
from posture_opt.robot.robot import Robot
from posture_opt.uncertainty.exact_moments import Plane, exact_moments, planar_moments, plane_of
from posture_opt.uncertainty.second_order import second_order, transpose

Method = Literal["exact", "exact, planar", "exact + second order of the correlations"]


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
    """

    position: Any
    mean: Any
    covariance: Any
    first_order: Any
    walk: Walk


@dataclass(frozen=True)
class EffectSources:
    """Uncertain parameters of effects, which act on the tool point to first order.

    Args:
        names: (e,) of all parameters of the robot's effects, then of the sides that no one knows.
        covariance: (e, e); cross: (k, e) with the sources of the chain.
    """

    names: tuple[str, ...]
    covariance: np.ndarray
    cross: np.ndarray


@dataclass(frozen=True)
class ToolPoint:
    """The tool point of ``arm`` under the errors ``names`` with ``covariance``, sorted from base to tool.

    ``effects`` holds what is uncertain of the arm's effects, ``None`` where nothing is.
    """

    arm: Arm
    names: tuple[str, ...]
    indices: tuple[int, ...]
    covariance: np.ndarray
    plane: Plane | None
    effects: EffectSources | None = None

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
        effects = _effect_sources(arm, sources, order)
        return cls(arm, names, indices, sources.covariance[np.ix_(order, order)], plane_of(robot, indices), effects)

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
        """How the covariance is computed; exact for Gaussian errors wherever a closed form exists."""
        if not self.correlated:
            return "exact"
        return "exact, planar" if self.plane is not None else "exact + second order of the correlations"

    def walk(self, q: Sequence[Scalar]) -> tuple[Walk, list[Scalar]]:
        """The walk along the nominal chain at ``q`` (n,), with its effects, and the value of every factor."""
        reached = self.arm.reach(q)
        return reached.walk, reached.values

    def moments(self, q: Sequence[Scalar], *, complete: bool = True) -> Moments:
        """Mean and covariance at the posture ``q``: n scalars, arrays (N,) or symbols.

        Without ``complete`` the correlations of a spatial arm enter to first order only.
        """
        moments = self._of_chain(q, complete)
        if self.effects is None:
            return moments
        beside = self._of_effects(q, moments.walk)
        return replace(moments, covariance=moments.covariance + beside, first_order=moments.first_order + beside)

    def _of_chain(self, q: Sequence[Scalar], complete: bool) -> Moments:
        whole = self.arm.reach(q)
        reached, values, shift = whole.walk, whole.values, whole.shift
        jacobian = self.jacobian(reached)
        first = jacobian @ self.covariance @ transpose(jacobian)
        position = stack(reached.position)
        if self.method == "exact, planar":
            assert self.plane is not None
            mean, C = planar_moments(self.robot, reached, values, self.indices, self.covariance, self.plane)
            return Moments(position, stack(add(mean, shift)), stack(C), first, reached)
        mean, C = exact_moments(self.robot.factors, values, self._variances())
        mean = add(mean, shift)
        if not self.correlated:
            return Moments(position, stack(mean), stack(C), first, reached)
        if not complete:
            across = self.covariance - np.diag(np.diag(self.covariance))
            covariance = stack(C) + jacobian @ across @ transpose(jacobian)
            return Moments(position, stack(mean), covariance, first, reached)
        # Exact for the variances; what the correlations add, complete to second order.
        full = second_order(reached, self.indices, self.covariance)
        diagonal = second_order(reached, self.indices, np.diag(np.diag(self.covariance)))
        covariance = stack(C) + (full.covariance - diagonal.covariance)
        return Moments(position, stack(mean) + (full.bias - diagonal.bias), covariance, first, reached)

    def _of_effects(self, q: Sequence[Scalar], reached: Walk) -> Any:
        """(3, 3) what the uncertainty of the effects adds to the covariance, to first order."""
        assert self.effects is not None
        E = self.effect_columns(q, reached)
        cross = self.jacobian(reached) @ self.effects.cross @ transpose(E) if self.indices else np.zeros((3, 3))
        return E @ self.effects.covariance @ transpose(E) + cross + transpose(cross)

    def effect_columns(self, q: Sequence[Scalar], reached: Walk, *, turns: bool = False) -> Any:
        """(3, e) shift of the tool point per unit of each effect's parameter; (6, e) with its rotation."""
        assert self.effects is not None
        twists = self.arm.twists(self.effects.names, q, reached)
        columns = [(*shift, *turn) if turns else shift for shift, turn in twists]
        return stack(list(zip(*columns, strict=True)))

    def pose_covariance(self, q: Sequence[float], reached: Walk) -> np.ndarray:
        """(6, 6) of shift and small rotation, first order."""
        T = np.asarray(self.twists(q, reached)) if self.indices else np.zeros((6, 0))
        found = T @ self.covariance @ T.T
        if self.effects is None:
            return np.asarray(found)
        E = np.asarray(self.effect_columns(q, reached, turns=True), dtype=float)
        cross = T @ self.effects.cross @ E.T
        return np.asarray(found + E @ self.effects.covariance @ E.T + cross + cross.T)

    def jacobian(self, reached: Walk) -> Any:
        """``∂x/∂source`` (3, k) [m/rad, m/m], world frame."""
        if not self.indices:
            return np.zeros((3, 0))
        return stack(list(zip(*(shift for shift, _ in self.arm.twists(self.indices, (), reached)), strict=True)))

    def twists(self, q: Sequence[Scalar], reached: Walk) -> Any:
        """(6, k) shift of the tool point and small rotation per source, world-aligned axes."""
        return stack(list(zip(*((*v, *w) for v, w in self.arm.twists(self.indices, q, reached)), strict=True)))

    def _variances(self) -> list[float]:
        variances = [0.0] * len(self.robot.factors)
        for index, variance in zip(self.indices, np.diag(self.covariance), strict=True):
            variances[index] = float(variance)
        return variances


def _effect_sources(arm: Arm, sources: NamedCovariance, order: Sequence[int]) -> EffectSources | None:
    """What is uncertain of the effects of a robot, or ``None`` where nothing is."""
    if not arm.effects:
        return None
    names, sides = arm.effect_parameters, arm.unknown_sides
    at = {name: k for k, name in enumerate(sources.names)}
    size = len(names) + len(sides)
    covariance, cross = np.zeros((size, size)), np.zeros((len(order), size))
    known = [(e, at[name]) for e, name in enumerate(names) if name in at]
    for e, k in known:
        cross[:, e] = sources.covariance[list(order), k]
        for f, m in known:
            covariance[e, f] = sources.covariance[k, m]
    for e in range(len(names), size):
        covariance[e, e] = 1.0  # a side is -1 or +1
    return EffectSources((*names, *sides), covariance, cross) if covariance.any() else None
