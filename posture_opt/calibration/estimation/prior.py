"""``Prior``: what is known of an arm before it is measured, as further rows of a least squares problem."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from posture_opt.numerics import Array

_MIN_CORRELATION_EIGENVALUE = (
    1e-8  # of a variance, in correlations: a ten-thousandth of a standard deviation is as good as nothing
)
_MIN_PRIOR_SIGMA = 1e-10  # rad, m: nothing is known better


@dataclass(frozen=True, eq=False)
class Prior:
    """Independent knowledge of some deviations: ``W x[rows]`` is a standard normal vector.

    It adds the rows ``w W`` to the Jacobian, w the standard deviation of the residuals: data that the model explains
    badly weigh less against it.

    Args:
        errors: in place of ``W`` where errors of the estimate are counted, of what weighs more than it is known; None
            where they are the same.
    """

    rows: tuple[int, ...] = ()
    W: Array = field(default_factory=lambda: np.zeros((0, 0)))
    errors: Array | None = None

    @classmethod
    def of(cls, rows: list[int], covariance: Array) -> Prior:
        """From the covariance of the deviations ``rows``; what has no variance in it, as after a calibration, is held.

        ``W = Λ^(−½) Vᵀ D⁻¹`` with the correlations ``V Λ Vᵀ`` and the standard deviations D.

        Args:
            rows: indices of the deviations; covariance: (p, p) [rad², m²].
        """
        if not rows:
            return cls()
        # A variance that is rounding would weigh so much that all else drowned in it.
        covariance = covariance + np.diag(np.maximum(_MIN_PRIOR_SIGMA**2 - np.diag(covariance), 0.0))
        sigma = np.sqrt(np.diag(covariance))
        values, vectors = np.linalg.eigh(covariance / np.outer(sigma, sigma))
        return cls(tuple(rows), (vectors / np.sqrt(np.maximum(values, _MIN_CORRELATION_EIGENVALUE))).T / sigma)

    def counted_as(self, known: Prior) -> Prior:
        """The same weight in an estimate, whose errors are counted with what is ``known`` of the same rows."""
        return replace(self, errors=known.W)

    @property
    def of_errors(self) -> Prior:
        """What errors of the estimate are counted with."""
        return self if self.errors is None else Prior(self.rows, self.errors)

    def matrix(self, k: int) -> Array:
        """``W`` in the columns of all k unknowns."""
        wide = np.zeros((len(self.rows), k))
        wide[:, list(self.rows)] = self.W
        return wide


def known_rows(prior: Prior | None, weight: float, directions: Array) -> Array:
    """The prior as further rows (p, r) of the Jacobian by the steps ``directions`` (k, r)."""
    rows = np.zeros((0, directions.shape[1]))
    return rows if prior is None else np.asarray(weight * prior.matrix(len(directions)) @ directions)
