"""Success at many postures under the same draws of the errors that stay: what combinations of postures are compared by.

``P(all) = E_δ Π_k P(|b_k + A_k δ + ε_k| <= 1)`` in units of the clearance. With the draws of δ fixed, every posture has
one vector of probabilities, and a combination of postures the mean of the product of theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from posture_opt.numerics import Array
from posture_opt.uncertainty.moments.gaussian_rules import first_primes
from posture_opt.uncertainty.spread.success_of_all import IDLE_SHARE, NO_SCATTER_SHARE, within_circle

_QUADRATURE = (12, 4.0)  # nodes and half range: right to 0.003
_ROWS_AT_ONCE = 512  # bounds the memory


class ErrorParts(NamedTuple):
    """The errors at P postures in the m = 1 or 2 directions that count, over the clearance.

    Args:
        bias: (P, m) mean.
        shared: (P, m, r) shift by independent standard normals that are one draw for all places.
        scatter: (P, m, m) covariance of what is a new draw at each.
    """

    bias: Array
    shared: Array
    scatter: Array

    @classmethod
    def of(cls, bias: Array, shared: Array, covariance: Array) -> ErrorParts:
        """From the whole covariance (P, m, m); what is left of it beside ``shared`` is scatter, if that is not tiny."""
        linear = shared @ np.swapaxes(shared, 1, 2)
        values, axes = np.linalg.eigh(covariance - linear)
        values = np.maximum(values, 0.0)
        scatter = (axes * values[:, None, :]) @ np.swapaxes(axes, 1, 2)
        whole, stays = np.trace(covariance, axis1=1, axis2=2), np.trace(linear, axis1=1, axis2=2)
        still = (values.sum(axis=1) <= NO_SCATTER_SHARE * whole) & (stays > 0)
        factor = np.sqrt(whole / np.where(stays > 0, stays, 1.0))
        shared = np.where(still[:, None, None], shared * factor[:, None, None], shared)
        return cls(bias, shared, np.where(still[:, None, None], 0.0, scatter))


@dataclass(frozen=True)
class SharedDraws:
    """Draws δ (N, r) of the errors that stay, standard normal."""

    delta: Array

    @classmethod
    def of(cls, shared: Sequence[Array], count: int) -> SharedDraws:
        """``count`` draws in the combinations of δ that move some postures ``shared`` (P, m, r), the leading one best.

        Multiples of irrational steps (R. D. Richtmyer, Los Alamos report LA-1342, 1951), half of them mirrored.
        """
        from scipy.special import ndtri

        _, s, Vt = np.linalg.svd(np.concatenate([A.reshape(-1, A.shape[-1]) for A in shared]), full_matrices=False)
        leading = Vt[s > IDLE_SHARE * max(float(s[0]) if len(s) else 0.0, 1e-300)]
        steps = np.outer(np.arange(1, count // 2 + 1), np.sqrt(first_primes(len(leading))))
        z = ndtri(np.clip((steps + 0.5) % 1.0, 1e-12, 1 - 1e-12))
        return cls(np.vstack([z, -z]) @ leading)

    def success(self, errors: ErrorParts) -> Array:
        """(P, N) the probability of each posture given each draw."""
        found = [np.zeros((0, len(self.delta)))]
        for first in range(0, len(errors.bias), _ROWS_AT_ONCE):
            bias, shared, scatter = (part[first : first + _ROWS_AT_ONCE] for part in errors)
            mean = bias[:, None] + self.delta @ np.swapaxes(shared, 1, 2)
            found.append(within_circle(mean, scatter, 1.0, _QUADRATURE))
        return np.vstack(found)
