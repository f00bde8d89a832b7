"""Two parts of a predicted spread: scatter from repeat to repeat, and errors that stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.encoding import Encoded, encoded
from posture_opt.numerics import Array
from posture_opt.uncertainty.clearance import coverage_radius
from posture_opt.uncertainty.regions import deviation
from posture_opt.uncertainty.sources import Sources, stated_name
from posture_opt.uncertainty.spread import Spread
from posture_opt.uncertainty.tool_point import ToolPoint


@dataclass(frozen=True)
class SpreadParts(Encoded):
    """Standard deviation along the worst axis and 95 % radius [m] of scatter and of the systematic part."""

    scatter_sigma: float  # of what is drawn anew at every repeat
    scatter_radius: float
    systematic_sigma: float  # of what is not known of errors that stay
    systematic_radius: float
    parameters: tuple[str, ...]  # the names that the systematic part comes from, the largest contribution first

    @property
    def mostly_systematic(self) -> bool:
        return self.systematic_radius > self.scatter_radius

    def fields_json(self) -> dict[str, object]:
        return {
            "scatter": encoded(self, "sigma_max=scatter_sigma radius95=scatter_radius"),
            "systematic": encoded(self, "sigma_max=systematic_sigma radius95=systematic_radius parameters"),
        }


def spread_parts(spread: Spread, basis: Array) -> SpreadParts:
    """The parts of a spread in the directions (3, m) that count for a task, orthonormal columns, world.

    The systematic part is the covariance of the tool point by the errors that stay alone, computed as that of the
    spread; scatter is the rest, sides of approach that are not known included.
    """
    names, J = spread.tool_point.every_source[0], basis.T @ spread.tool_point.every_column(spread.q)
    C = constant_covariance(spread, names)
    systematic = positive_part(J @ C @ J.T + basis.T @ _curvature_covariance(spread) @ basis)
    scatter = positive_part(basis.T @ spread.covariance @ basis - systematic)
    values, axes = np.linalg.eigh(systematic)
    leading = _leading_parameters(names, axes[:, -1] @ J, C) if values[-1] > 0 else ()
    parameters = tuple(dict.fromkeys(map(stated_name, leading)))
    among = spread.covariance
    return SpreadParts(*_sigma_and_radius(scatter, among), *_sigma_and_radius(systematic, among), parameters)


def _leading_parameters(names: Sequence[str], c: Array, C: Array) -> tuple[str, ...]:
    """Up to three parameters whose uncertainty makes most of ``cᵀ C c``, the largest contribution first.

    Correlated estimates have errors that mostly cancel: the variance is that of the eigenvectors of ``diag(c) C
    diag(c)``, each of which adds to it; those that make 80 % of it are looked at. c (k,) [m per SI unit], C (k, k).
    """
    values, V = np.linalg.eigh(C * np.outer(c, c))
    part = np.maximum(values, 0.0) * V.sum(axis=0) ** 2
    order = np.argsort(-part)
    enough = int(np.searchsorted(np.cumsum(part[order]), 0.8 * part.sum())) + 1
    weight = (V[:, order[:enough]] ** 2) @ part[order[:enough]]
    ranked = np.argsort(-weight, kind="stable")[:3]
    return tuple(names[i] for i in ranked if weight[i] >= 0.3 * weight[ranked[0]])


def constant_covariance(spread: Spread, names: Sequence[str]) -> Array:
    """(k, k) covariance of the errors of ``names`` that stay; zero of what the problem does not state."""
    at = {name: k for k, name in enumerate(spread.sources.names)}
    C = np.zeros((len(names), len(names)))
    known = [i for i, name in enumerate(names) if name in at]
    rows = [at[names[i]] for i in known]
    C[np.ix_(known, known)] = spread.sources.constant[np.ix_(rows, rows)]
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
    """Largest σ and 95 % radius [m] of a covariance (m, m) [m²]; zero where it is rounding of ``among``."""
    sigma = deviation(float(np.linalg.eigvalsh(C)[-1]), among)
    return sigma, coverage_radius(0.95, C, np.zeros(len(C))) if sigma > 0 else 0.0


def positive_part(C: Array) -> Array:
    """(..., m, m) the matrix with zero in place of negative eigenvalues, which rounding and higher orders leave."""
    values, V = np.linalg.eigh((C + np.swapaxes(C, -1, -2)) / 2)
    return np.asarray((V * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(V, -1, -2))
