"""Subsets of every size of some members, by backward elimination: what is lost without each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from posture_opt.diagnosis.scores.score_tests import unit_columns
from posture_opt.numerics import Array, Codes, Mask

_RIDGE_SHARE = 1e-10  # of columns of length one: what depends on others keeps an inverse


@dataclass(frozen=True, eq=False)
class Subset:
    """Some members of a set, and the coefficients of all columns: those known first, zero for who is no member."""

    members: tuple[int, ...]
    coefficients: Array


def nested_subsets(columns: Sequence[Array], known: Array, r: Array, learn: Mask | None = None) -> list[Subset]:
    """Subsets of every size of members, each without the one whose loss costs least: backward elimination.

    The inverse of the normal matrix is downdated at every removal, so that all subsets cost about one inversion.

    Args:
        columns: each (m, k) of one member; known: (m, g) what is always fitted to r (m,).
        learn: (m,) the rows that teach; all if None.

    Returns:
        From the empty set to that of all members.
    """
    sizes = [Z.shape[1] for Z in columns]
    A, scale = unit_columns(np.concatenate([known, *columns], axis=1), learn)
    edges = np.cumsum([known.shape[1], *sizes])
    places = [np.arange(a, b) for a, b in pairwise(edges)]
    C: Array = np.asarray(np.linalg.inv(A.T @ A + _RIDGE_SHARE * np.eye(A.shape[1])), dtype=float)
    theta = C @ (A.T @ r)
    kept, found = list(range(len(columns))), list[Subset]()
    while True:
        found.append(Subset(tuple(kept), theta * scale))
        if not kept:
            return found[::-1]
        gone = kept[int(np.argmin(_wald_costs(C, theta, [places[i] for i in kept])))]
        own = places[gone]
        # The inverse of what is left of the Gram matrix, by the Schur complement.
        share = np.linalg.solve(C[np.ix_(own, own)], C[own]).T
        C, theta = C - share @ C[own], theta - share @ theta[own]
        theta[own] = 0.0
        kept.remove(gone)


def _wald_costs(C: Array, theta: Array, each: Sequence[Codes]) -> Array:
    """Rise of the sum of squares without each of some groups of parameters: ``θᵀ C⁻¹ θ`` (Wald)."""
    found, sizes = np.zeros(len(each)), np.array([len(own) for own in each])
    for size in np.unique(sizes):
        alike = np.flatnonzero(sizes == size)
        own = np.array([each[int(i)] for i in alike])
        block, part = C[own[:, :, None], own[:, None, :]], theta[own]
        found[alike] = np.einsum("ik,ik->i", part, np.linalg.solve(block, part[:, :, None])[:, :, 0])
    return found
