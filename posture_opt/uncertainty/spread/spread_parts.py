"""Two parts of a predicted spread: what changes from repeat to repeat, and what is not known of errors that stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.numerics import Array, Json
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.regions.coverage_radius import coverage_radius
from posture_opt.uncertainty.regions.regions import deviation
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.sources.workpiece import stated_name
from posture_opt.uncertainty.spread.spread import Spread

_MAX_LISTED_PARAMETERS = 3
"""Parameters that are named."""
_EXPLAINED_SHARE = 0.8
"""Share of the variance that the combinations which are looked at make together."""
_MIN_WEIGHT_SHARE = 0.3
"""Share of the largest weight below which a parameter is not named."""


@dataclass(frozen=True)
class SpreadParts:
    """Standard deviation along the worst axis and 95 % radius [m] of scatter and of the systematic part.

    Args:
        scatter_sigma, scatter_radius: of what is drawn anew at every repeat.
        systematic_sigma, systematic_radius: of what is not known of errors that stay.
        parameters: the names that the systematic part comes from, the largest contribution first.
    """

    scatter_sigma: float
    scatter_radius: float
    systematic_sigma: float
    systematic_radius: float
    parameters: tuple[str, ...]

    @property
    def mostly_systematic(self) -> bool:
        """Whether what is not known reaches farther than scatter does."""
        return self.systematic_radius > self.scatter_radius

    def to_json(self) -> dict[str, Json]:
        """Plain numbers [m]."""
        return {
            "scatter": {"sigma_max": self.scatter_sigma, "radius95": self.scatter_radius},
            "systematic": {
                "sigma_max": self.systematic_sigma, "radius95": self.systematic_radius,
                "parameters": list(self.parameters),
            },
        }  # fmt: skip


def spread_parts(spread: Spread, basis: Array) -> SpreadParts:
    """The parts of a spread in the directions that count for a task.

    The systematic part is the covariance of the tool point by the errors that stay alone, computed as that of the
    spread; scatter is the rest, sides of approach that are not known included.

    Args:
        spread: at a posture.
        basis: (3, m) orthonormal columns, world.
    """
    names, J = source_columns(spread)
    C = constant_covariance(spread, names)
    J = basis.T @ J
    systematic = positive_part(J @ C @ J.T + basis.T @ _curvature_covariance(spread) @ basis)
    scatter = positive_part(basis.T @ spread.covariance @ basis - systematic)
    values, axes = np.linalg.eigh(systematic)
    leading = leading_parameters(names, axes[:, -1] @ J, C) if values[-1] > 0 else ()
    parameters = tuple(dict.fromkeys(map(stated_name, leading)))
    among = spread.covariance
    return SpreadParts(*_sigma_and_radius(scatter, among), *_sigma_and_radius(systematic, among), parameters)


def leading_parameters(names: Sequence[str], c: Array, C: Array) -> tuple[str, ...]:
    """The parameters whose uncertainty makes most of the variance ``cᵀ C c``, the largest contribution first.

    Estimates that are correlated have errors that mostly cancel: the variance is that of the eigenvectors of
    ``diag(c) C diag(c)``, each of which adds to it, and the parameters are those that these are made of.

    Args:
        names: (k,) of the parameters.
        c: (k,) sensitivities [m per unit].
        C: (k, k) covariance of the parameters [SI].
    """
    values, V = np.linalg.eigh(C * np.outer(c, c))
    part = np.maximum(values, 0.0) * V.sum(axis=0) ** 2
    order = np.argsort(-part)
    enough = int(np.searchsorted(np.cumsum(part[order]), _EXPLAINED_SHARE * part.sum())) + 1
    weight = (V[:, order[:enough]] ** 2) @ part[order[:enough]]
    ranked = np.argsort(-weight, kind="stable")[:_MAX_LISTED_PARAMETERS]
    return tuple(names[i] for i in ranked if weight[i] >= _MIN_WEIGHT_SHARE * weight[ranked[0]])


def source_columns(spread: Spread) -> tuple[tuple[str, ...], Array]:
    """Names (k,) of all sources and the shift of the tool point by one unit of each (3, k) [m per SI unit], world."""
    point = spread.tool_point
    reached = point.walk(spread.q)[0]
    J = np.asarray(point.jacobian(reached), dtype=float)
    if point.linear is None:
        return point.names, J
    E = np.asarray(point.linear_columns(spread.q, reached), dtype=float)
    return (*point.names, *point.linear.names), np.concatenate([J, E], axis=1)


def constant_covariance(spread: Spread, names: Sequence[str]) -> Array:
    """(k, k) covariance of the errors of ``names`` that stay; zero of what the problem does not state."""
    sources = spread.sources
    at = {name: k for k, name in enumerate(sources.names)}
    C = np.zeros((len(names), len(names)))
    known = [i for i, name in enumerate(names) if name in at]
    rows = [at[names[i]] for i in known]
    C[np.ix_(known, known)] = sources.constant[np.ix_(rows, rows)]
    return C


def _curvature_covariance(spread: Spread) -> Array:
    """(3, 3) what the errors of the chain that stay add to the covariance beyond first order [m²]."""
    sources = spread.sources
    staying = ToolPoint.of(spread.tool_point.arm, Sources(sources.names, sources.constant))
    if not staying.names:
        return np.zeros((3, 3))
    moments = replace(staying, linear=None).moments(spread.q)
    return np.asarray(moments.covariance - moments.first_order)


def _sigma_and_radius(C: Array, among: Array) -> tuple[float, float]:
    """Largest standard deviation and 95 % radius [m] of a covariance (m, m) [m²]; zero where it is rounding of
    ``among``.
    """
    sigma = deviation(float(np.linalg.eigvalsh(C)[-1]), among)
    return sigma, coverage_radius(0.95, C, np.zeros(len(C))) if sigma > 0 else 0.0


def positive_part(C: Array) -> Array:
    """(m, m) the matrix with zero in place of negative eigenvalues, which rounding and higher orders leave."""
    values, V = np.linalg.eigh((C + C.T) / 2)
    return np.asarray((V * np.maximum(values, 0.0)) @ V.T)
