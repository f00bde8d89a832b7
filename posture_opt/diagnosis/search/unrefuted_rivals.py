"""Rivals where the model leaves more than noise: what explains no clearly less in the place of a cause.

The criterion that names causes takes residuals for independent noise. Where structure is left they are not: neighbours
err alike, and what a rival loses in one part of the workspace says little of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.diagnosis.search.search import SearchResult
from posture_opt.diagnosis.search.selection_criterion import beyond_instrument, implausible_members
from posture_opt.model.effects import CyclicError, Effect
from posture_opt.numerics import Array, Codes

_MOST_COMPARED = 40
"""Candidates that are compared, those that explain most by themselves; chosen for time."""
_CLEARLY_WORSE = 0.975
"""Quantile of Student's distribution, by as many blocks, of the standard errors by which a refuted rival is worse."""


def unrefuted_rivals(linearised: LinearisedData, found: SearchResult) -> dict[int, tuple[Effect, ...]]:
    """By its place among the chosen, further rivals of a named effect, which the data do not refute.

    Lines are no rivals of each other here, see `CyclicError.bands`.

    Source: Vuong (1989), the likelihood ratio of models of which neither holds the other, both perhaps wrong; its
    variance from blocks of rows, within which residuals may be correlated (Cameron, Gelbach, Miller 2011).
    """
    asked = [i for i, s in enumerate(found.chosen) if s.named and not isinstance(s.what, CyclicError)]
    others = _named_others(linearised, found)
    if not asked or not others:
        return {}
    comparison = _Comparison.of(linearised, found.chosen, found.nested.each[-1].groups)
    apart = [comparison.outside(other.Z) for other in others]
    rivals = {}
    for i in asked:
        have = {s.what.exclusive for s in found.rivals[i]}
        new = [(o, Z) for o, Z in zip(others, apart, strict=True) if o.what.exclusive not in have]
        likely = [other for other, Z in new if comparison.unrefuted(i, other.Z, Z)]
        possible = (s.what for s in likely if _can_replace(linearised, found.chosen, i, s))
        rivals[i] = tuple(what for what in possible if isinstance(what, Effect))
    return rivals


def _named_others(linearised: LinearisedData, found: SearchResult) -> list[Candidate]:
    """The effects of other kinds or at other places that explain most by themselves, the best shape of each."""
    known = {s.key for s in found.chosen}
    best: dict[object, Candidate] = {}
    for scored in sorted(found.scored, key=lambda scored: -scored.share):
        other = scored.candidate
        if isinstance(other.what, Effect) and not isinstance(other.what, CyclicError) and other.key not in known:
            best.setdefault(other.what.exclusive, other)
    chosen = list(best.values())[:_MOST_COMPARED]
    return [replace(s, Z=linearised.sensitivities.columns(s.what)) for s in chosen if isinstance(s.what, Effect)]


def _can_replace(linearised: LinearisedData, members: Sequence[Candidate], i: int, other: Candidate) -> bool:
    """Whether another cause in the place of a member would be of a size that it can have."""
    swapped = [*members[:i], other, *members[i + 1 :]]
    too_large = (*beyond_instrument(linearised, swapped), *implausible_members(linearised, swapped))
    return all(s is not other for s in too_large)


@dataclass(frozen=True, eq=False)
class _Comparison:
    """A model about to lose one member or the other.

    Args:
        Q: (m, p) orthonormal basis of geometry and members; e: (m,) what they leave.
        r: (m,) the residuals.
        directions: per member, orthonormal directions (m, k) that it alone brings.
        groups: (N,) blocks of rows, of ``block`` residuals each.
    """

    Q: Array
    e: Array
    r: Array
    directions: tuple[Array, ...]
    groups: Codes
    block: int

    @classmethod
    def of(cls, linearised: LinearisedData, members: Sequence[Candidate], groups: Codes) -> _Comparison:
        """Of the members of a model, columns of unit length."""
        A = np.concatenate([linearised.G, *(s.Z for s in members)], axis=1)
        lengths = np.linalg.norm(A, axis=0)
        Q, R = np.linalg.qr(A / np.where(lengths > 0, lengths, 1.0))
        # Of (AᵀA)⁻¹Aᵀ, row by row, each is orthogonal to all columns but its own.
        alone = Q @ np.linalg.pinv(R, rcond=1e-10).T
        edges = np.cumsum([linearised.G.shape[1], *(s.Z.shape[1] for s in members)])
        directions = tuple(np.linalg.qr(alone[:, a:b])[0] for a, b in pairwise(edges))
        r = linearised.r
        return cls(Q, r - Q @ (Q.T @ r), r, directions, groups, linearised.sensitivities.residuals.block)

    def outside(self, Z: Array) -> Array:
        """Columns (m, k) without what the model spans."""
        return np.asarray(Z - self.Q @ (self.Q.T @ Z))

    def unrefuted(self, member: int, Z: Array, outside: Array) -> bool:
        """Whether columns Z (m, k), ``outside`` the model, resemble a member and explain no clearly less without it."""
        from scipy.special import stdtrit

        B = self.directions[member]
        basis, lengths, _ = np.linalg.svd(outside + B @ (B.T @ Z), full_matrices=False)
        basis = basis[:, lengths > 1e-10 * max(lengths[0], 1e-300)]
        if np.linalg.norm(B.T @ basis, 2) < levels.MIN_RIVAL_COSINE:
            return False
        without = self.e + B @ (B.T @ self.r)
        instead = without - basis @ (basis.T @ without)
        rows = len(self.groups) * self.block
        lost = (instead[:rows] ** 2 - self.e[:rows] ** 2).reshape(-1, self.block).sum(axis=1)
        by_group = np.bincount(np.unique(self.groups, return_inverse=True)[1], lost)
        least = float(stdtrit(max(len(by_group) - 1, 1), _CLEARLY_WORSE))
        return float(lost.sum()) < least * float(np.linalg.norm(by_group))
