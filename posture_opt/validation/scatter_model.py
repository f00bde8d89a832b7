"""``Scatter``: what a Gaussian likelihood needs to know of errors that scatter."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from posture_opt.numerics import Array, Codes


@dataclass(frozen=True, eq=False)
class Scatter:
    """What a Gaussian likelihood needs to know of errors that scatter about unknown or zero means.

    Args:
        columns: (G, d, n) ``∂x/∂joint`` at each posture.
        squares: (G, d, d) sums of squares and products [m²].
        freedom: (G,) of each: rows less one where the mean is unknown.
        known: (G, d, d), or zero: a part of the covariance that is known beforehand [m²].
    """

    columns: Array
    squares: Array
    freedom: Array
    known: Array = field(default_factory=lambda: np.zeros((1, 1, 1)))

    @classmethod
    def of(cls, errors: Array, columns: Array, groups: Codes | None = None, known: Array | None = None) -> Scatter:
        """Of errors (N, d) about zero, or about the means of ``groups`` (N,): rows of one posture.

        Within a group of one posture all contrasts have the same covariance, so that their squares are enough.
        Groups of a single row say nothing about scatter and are left out. ``known`` (N, d, d) goes with errors about
        zero.
        """
        if groups is None:
            own = np.zeros((1, 1, 1)) if known is None else known
            return cls(columns, errors[:, :, None] * errors[:, None, :], np.ones(len(errors)), own)
        _, first, code, count = np.unique(groups, return_index=True, return_inverse=True, return_counts=True)
        mean = _sums(errors, code, len(count)) / count[:, None]
        centred = errors - mean[code]
        squares = _sums(centred[:, :, None] * centred[:, None, :], code, len(count))
        many = count > 1
        return cls(columns[first[many]], squares[many], np.asarray(count[many] - 1.0))

    def take(self, cases: Any) -> Scatter:
        """Some of the postures."""
        known = self.known[cases] if len(self.known) == len(self.freedom) > 1 else self.known
        return Scatter(self.columns[cases], self.squares[cases], self.freedom[cases], known)

    def log_likelihoods(self, covariance: Array) -> Array:
        """(G,) log-likelihoods of normal scatter with covariances (G, d, d) or (d, d) [m²]."""
        d = self.squares.shape[-1]
        sizes = np.linalg.slogdet(covariance)[1] + d * np.log(2 * np.pi)
        distance = np.sum(np.linalg.inv(covariance) * self.squares, axis=(-2, -1))
        return np.asarray(-0.5 * (self.freedom * sizes + distance))


def covariances(columns: Array, sigma: Array, instrument: float) -> Array:
    """``s² I + J diag(σ²) Jᵀ`` (N, d, d) [m²]."""
    scaled = columns * sigma
    return np.asarray(scaled @ np.swapaxes(scaled, -1, -2) + instrument**2 * np.eye(columns.shape[1]))


def _sums(values: Array, code: Codes, count: int) -> Array:
    found = np.zeros((count, *values.shape[1:]))
    np.add.at(found, code, values)
    return found
