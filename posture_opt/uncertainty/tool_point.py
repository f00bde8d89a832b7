"""Moments of the tool point of a robot with named sources of error: which method serves which case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np

from posture_opt.model.chain import Scalar, Walk, factor_values, stack, walk
from posture_opt.model.derivatives import position_column, twist_column
from posture_opt.robot.robot import Robot
from posture_opt.uncertainty.moments import exact_moments
from posture_opt.uncertainty.planar import Plane, planar_moments, plane_of
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
class ToolPoint:
    """The tool point of ``robot`` under the errors ``names`` with ``covariance``, sorted from base to tool."""

    robot: Robot
    names: tuple[str, ...]
    indices: tuple[int, ...]
    covariance: np.ndarray
    plane: Plane | None

    @classmethod
    def of(cls, robot: Robot, sources: NamedCovariance) -> ToolPoint:
        """Sort the sources along the chain, leaving out those without variance."""
        at = {factor.parameter: i for i, factor in enumerate(robot.factors) if factor.parameter}
        variance = np.diag(sources.covariance)
        order = sorted((k for k in range(len(sources.names)) if variance[k] > 0), key=lambda k: at[sources.names[k]])
        names = tuple(sources.names[k] for k in order)
        indices = tuple(at[name] for name in names)
        return cls(robot, names, indices, sources.covariance[np.ix_(order, order)], plane_of(robot, indices))

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
        """The walk along the nominal chain at ``q`` (n,), and the value of every factor [rad or m]."""
        values = factor_values(self.robot.factors, q)
        return walk(self.robot.factors, values), values

    def moments(self, q: Sequence[Scalar], *, complete: bool = True) -> Moments:
        """Mean and covariance at the posture ``q``: n scalars, arrays (N,) or symbols.

        Without ``complete`` the correlations of a spatial arm enter to first order only.
        """
        reached, values = self.walk(q)
        jacobian = self.jacobian(reached)
        first = jacobian @ self.covariance @ transpose(jacobian)
        position = stack(reached.position)
        if self.method == "exact, planar":
            assert self.plane is not None
            mean, C = planar_moments(self.robot, reached, values, self.indices, self.covariance, self.plane)
            return Moments(position, stack(mean), stack(C), first, reached)
        mean, C = exact_moments(self.robot.factors, values, self._variances())
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

    def jacobian(self, reached: Walk) -> Any:
        """``∂x/∂source`` (3, k) [m/rad, m/m], world frame."""
        if not self.indices:
            return np.zeros((3, 0))
        return stack(list(zip(*(position_column(reached, i) for i in self.indices), strict=True)))

    def twists(self, reached: Walk) -> Any:
        """(6, k) shift of the tool point and small rotation per source, world-aligned axes."""
        return stack(list(zip(*(twist_column(reached, i) for i in self.indices), strict=True)))

    def _variances(self) -> list[float]:
        variances = [0.0] * len(self.robot.factors)
        for index, variance in zip(self.indices, np.diag(self.covariance), strict=True):
            variances[index] = float(variance)
        return variances
