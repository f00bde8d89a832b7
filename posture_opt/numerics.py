"""Names and small tools of numerical code that every room shares."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]  # Real numbers; the docstring of a function states which shape and unit
Codes = NDArray[np.intp]  # Whole numbers that index rows or name groups of them
Mask = NDArray[np.bool_]  # True where something holds
TURN = 2 * math.pi  # One full turn [rad]
# What a JSON document holds: plain values, lists and objects of them.
Json: TypeAlias = "bool | int | float | str | Sequence[Json] | Mapping[str, Json] | None"
# Receives ``(done, total)``: how many of how many parts of a computation are done.
Progress = Callable[[int, int], None]


def finite_or_none(value: float) -> float | None:
    """The number, or None, which JSON writes as null, where it is infinite or NaN.

    Example:
        >>> finite_or_none(0.5), finite_or_none(math.inf)
        (0.5, None)
    """
    return value if math.isfinite(value) else None


def rms(values: Array) -> float:
    """``sqrt(mean(v²))`` over all entries of an array of any shape."""
    return float(np.sqrt(np.mean(np.square(values))))


def rms_length(vectors: Array) -> float:
    """``sqrt(mean(|v|²))`` over the rows of vectors (N, m)."""
    return float(np.sqrt(np.mean(np.sum(np.square(vectors), axis=1))))


def factored_columns(A: Array) -> tuple[Array, Array] | None:
    """``A = Q K`` of many rows (m, k), Q orthonormal to rounding and K (k, k); None where the rank may not be full.

    ``AᵀA = V D Vᵀ`` makes ``A V D^-½`` orthonormal but for what rounding of inner products leaves; the Cholesky factor
    of its own Gram matrix takes that away. At a part of what a QR factorisation or an SVD of long columns costs.

    Source: Yamamoto, Nakatsukasa, Yanagisawa, Fukaya (2015), CholeskyQR2.
    """
    values, vectors = np.linalg.eigh(A.T @ A)
    if not values.min(initial=1.0) > 1e-9 * values.max(initial=1.0):  # of a Gram matrix: the rank may not be full
        return None
    root = np.sqrt(values)
    Q = A @ (vectors / root)
    L = np.linalg.cholesky(Q.T @ Q)
    return np.asarray(Q @ np.linalg.inv(L).T), np.asarray(L.T @ (root[:, None] * vectors.T))


def thin_svd(A: Array) -> tuple[Array, Array, Array]:
    """``A = U diag(s) Vᵀ`` (m, k): U (m, r), s (r,) and Vᵀ (r, k), r the smaller of both sides."""
    try:
        U, s, V = np.linalg.svd(A, full_matrices=False)
    except np.linalg.LinAlgError:  # divide and conquer may not converge where many values are all rounding
        from scipy.linalg import svd

        U, s, V = svd(A, full_matrices=False, lapack_driver="gesvd")
    return U, s, V


def round_below(value: float) -> float:
    """The largest of …, 0.5, 1, 2, 5, 10, … that does not exceed a positive value.

    >>> round_below(0.24)
    0.2
    """
    power = 10.0 ** math.floor(math.log10(value))
    return max(step * power for step in (1, 2, 5) if step * power <= value * (1 + 1e-9))


def linked(points: Array, reach: float) -> Codes:
    """(N,) codes of points (N, d) that steps of at most ``reach`` in every coordinate lead from one to the other."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(reach, p=np.inf, output_type="ndarray")
    if not len(pairs):
        return np.arange(len(points))
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.intp)


def stacked_rows(vector: Sequence[Any], n: int) -> Array:
    """(n, m) rows of a vector whose m entries are numbers, or arrays (n,) of one number a row."""
    rows = np.empty((n, len(vector)))
    for k, entry in enumerate(vector):
        rows[:, k] = entry
    return rows


class DerivedAgain:
    """Pickles and copies as what it was made from: what its cached properties hold is derived again on demand.

    CasADi's symbols cannot be sent to another process: there they would be unrelated to the symbols made there.
    """

    def __getstate__(self) -> dict[str, Any]:
        """The attributes without those that a ``cached_property`` has filled."""
        kind = type(self)
        cached = {name for name in vars(self) if isinstance(getattr(kind, name, None), cached_property)}
        return {name: value for name, value in vars(self).items() if name not in cached}
