"""Designs that discriminate two models of the same data: the measurements that raise their noncentrality the most.

Of two models take one for true: its signature ``A s`` in all rows, in standard deviations, is fitted by the other with
its columns ``A_F``, geometry and all else among them. The lack of fit that remains is the noncentrality

``λ = min_β |A s − A_F β|² = sᵀ M s − sᵀ M_F M_FF⁻¹ M_Fᵀ s``  with the information  ``M = AᵀA``.

It grows by ``dᵀ (I + A_F M_FF⁻¹ A_Fᵀ)⁻¹ d`` with a new row whose discrepancy is ``d = A s − A_F β``. This is the
T-criterion of Atkinson and Fedorov (1975), for the pair of models that is hardest to distinguish.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.numerics import Array, Codes

_RIDGE_SHARE = 1e-10  # of the information of an average design: keeps undetermined columns invertible; rounding only
_RANK_TOLERANCE = 1e-12  # of the largest eigenvalue of an information: rounding only


def detection_probability(value: float) -> float:
    """Probability ``Φ(√λ − 3.5)`` that a difference of noncentrality λ is detected.

    Example:
        >>> round(detection_probability(3.5**2), 3), round(detection_probability(22.9), 2)
        (0.5, 0.9)
    """
    from scipy.special import ndtr

    return float(ndtr(np.sqrt(max(value, 0.0)) - levels.DETECTED_ROOT_LAMBDA))


@dataclass(frozen=True, eq=False)
class OrderedPair:
    """One model taken for true, and another that is fitted in its place.

    Args:
        signature: (K,) coefficients of the true one.
        fitted: (r,) indices of the columns of the other one, with all that is fitted together with it.
        spent: λ that the data predicted and did not show: it is taken off.
    """

    signature: Array
    fitted: Codes
    spent: float = 0.0


@dataclass(frozen=True, eq=False)
class DiscriminationDesign:
    """Pairs of models, the information so far, and the candidate measurements.

    Args:
        information: (K, K) of the data and the prior.
        A: (N, b, K) columns at the candidates, in standard deviations of a measurement.
    """

    pairs: tuple[OrderedPair, ...]
    information: Array
    A: Array

    @classmethod
    def of(cls, pairs: Sequence[OrderedPair], information: Array, A: Array) -> DiscriminationDesign:
        """With columns scaled to unit information of the data and an average design, whatever their units."""
        average = np.einsum("nbk,nbk->k", A, A) / max(len(A), 1)
        scale = np.sqrt(np.maximum(np.diag(information) + average, 1e-300))
        M = information / np.outer(scale, scale) + _RIDGE_SHARE * np.eye(len(scale))
        return cls(tuple(replace(p, signature=p.signature * scale) for p in pairs), M, A / scale)

    def only(self, pairs: Sequence[int]) -> DiscriminationDesign:
        """Some of the pairs."""
        return replace(self, pairs=tuple(self.pairs[k] for k in pairs))

    def after(self, chosen: Sequence[int], rounds: float = 1.0) -> Array:
        """(K, K) information once the chosen candidates are measured so many times."""
        flat = self.A[list(chosen)].reshape(-1, self.A.shape[-1])
        return np.asarray(self.information + rounds * flat.T @ flat)

    def noncentralities(self, information: Array) -> Array:
        """(P,) λ of every pair, what is spent taken off."""
        return np.array([_pair_noncentrality(pair, information)[0] - pair.spent for pair in self.pairs])

    def chosen(self, least: int, most: int) -> list[int]:
        """At most ``most`` candidates, each once, that raise the least λ; fewer where they are enough.

        One by one, then exchanged as long as that helps (Fedorov 1972).

        Args:
            least, most: numbers of postures.
        """
        found: list[int] = []
        while len(found) < min(most, len(self.A)):
            if len(found) >= least and self.noncentralities(self.after(found)).min() >= levels.DISCRIMINATED_LAMBDA:
                break
            found.append(self._best_candidate(self.after(found), found))
        for _ in range(levels.EXCHANGE_SWEEPS):
            former = list(found)
            for place in range(len(found)):
                others = found[:place] + found[place + 1 :]
                found[place] = self._best_candidate(self.after(others), others)
            if found == former:
                break
        return self._most_informative_first(found)

    def _most_informative_first(self, chosen: list[int]) -> list[int]:
        """Those first that help most, so that the first few are a plan too."""
        order: list[int] = []
        while len(order) < len(chosen):
            rest = [i for i in chosen if i not in order]
            some = replace(self, information=self.after(order), A=self.A[rest])
            order.append(rest[some._best_candidate(some.information, [])])
        return order

    def _best_candidate(self, information: Array, taken: Sequence[int]) -> int:
        """The candidate that raises the least λ most, with a little weight on the mean over all pairs."""
        reached = np.stack([_noncentralities_with(pair, information, self.A) for pair in self.pairs])
        worth = reached.min(axis=0) + levels.MEAN_PAIR_WEIGHT * np.minimum(
            reached, 2 * levels.DISCRIMINATED_LAMBDA
        ).mean(axis=0)
        worth[list(taken)] = -np.inf
        return int(np.argmax(worth))


def _pair_noncentrality(pair: OrderedPair, M: Array) -> tuple[float, Array, Array]:
    """λ, the coefficients (r,) that reach for the signature, and a root ``L`` (r, r), ``L Lᵀ = M_FF⁻¹``.

    Of columns that are alike to rounding, as of parameters that are not identifiable, the information is held to its
    rounding error, so that its inverse stays positive.
    """
    F, s = pair.fitted, pair.signature
    values, vectors = np.linalg.eigh(M[np.ix_(F, F)])
    L = vectors / np.sqrt(np.maximum(values, _RANK_TOLERANCE * values[-1]))
    seen = M[F] @ s
    reached = L.T @ seen
    return max(float(s @ M @ s - reached @ reached), 0.0), np.asarray(L @ reached), np.asarray(L)


def _noncentralities_with(pair: OrderedPair, M: Array, A: Array) -> Array:
    """Noncentralities λ (N,) of a pair once each of the candidates A (N, b, K) is measured too.

    ``λ + dᵀ (I + V M_FF⁻¹ Vᵀ)⁻¹ d`` with the discrepancy d of the candidate and its columns V of what is fitted.
    """
    value, beta, L = _pair_noncentrality(pair, M)
    value -= pair.spent
    V = A[:, :, pair.fitted]
    d = A @ pair.signature - V @ beta
    W = V @ L
    S = W @ np.swapaxes(W, 1, 2)
    S[:, range(S.shape[1]), range(S.shape[1])] += 1.0
    return np.asarray(value + np.einsum("nb,nb->n", d, np.linalg.solve(S, d[..., None])[..., 0]))
