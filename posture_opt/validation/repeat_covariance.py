"""The rows of one visit share one draw of the joints' scatter: their covariance, and their part in what chance does."""

from __future__ import annotations

import numpy as np

from posture_opt.measurements.repeat_groups import rows_of
from posture_opt.numerics import Array, Codes


def whitened(e: Array, columns: Array, S: Array, visits: Codes, own: Array) -> tuple[Array, Array]:
    """Residuals (N, d) and joint columns (n, N, d) in units of the covariance ``own + S Sᵀ`` of whole visits.

    Args:
        S: (N, d, k) shift of the rows by each of k errors that all rows of a visit share, each of variance 1.
        own: (N, d) variance that every row has for itself.
    """
    d = e.shape[1]
    mixed = np.concatenate([e[:, :, None], np.moveaxis(columns, 0, 2)], axis=2)
    for rows in _by_size(visits):
        size = rows.shape[1] * d
        shared = S[rows].reshape(len(rows), size, -1)
        covariance = np.eye(size) * own[rows].reshape(len(rows), 1, size) + shared @ np.swapaxes(shared, 1, 2)
        part = np.linalg.solve(np.linalg.cholesky(covariance), mixed[rows].reshape(len(rows), size, -1))
        mixed[rows] = part.reshape(*rows.shape, d, -1)
    return mixed[:, :, 0], np.moveaxis(mixed[:, :, 1:], 2, 0)


def chance_sets(e: Array, visits: Codes | None, count: int, rng: np.random.Generator) -> Array:
    """(count, N, d) residuals as chance could have them: every visit turned at random, and visits change places.

    The rows of a visit stay together and are turned as one, as they share what the arm did; visits change places
    with others of as many rows. ``None``: each row is a visit of its own.
    """
    N, d = e.shape
    if visits is None or len(np.unique(visits)) == N:
        drawn = rng.standard_normal((count, N, d))
        lengths = np.linalg.norm(e, axis=1)[_shuffles(rng, count, N)]
        return np.asarray(drawn * (lengths / np.linalg.norm(drawn, axis=2))[:, :, None])
    sets = np.empty((count, N, d))
    for rows in _by_size(visits):
        turns = np.linalg.qr(rng.standard_normal((count, len(rows), d, d)))[0]
        others = e[rows[_shuffles(rng, count, len(rows))]]
        sets[:, rows] = others @ np.swapaxes(turns, 2, 3)
    return sets


def _by_size(visits: Codes) -> list[Codes]:
    """(V, m) the rows of the visits of m rows, one array for each m."""
    parts = rows_of(visits)
    sizes = np.array([len(rows) for rows in parts])
    return [np.stack([parts[i] for i in np.flatnonzero(sizes == m)]) for m in np.unique(sizes)]


def _shuffles(rng: np.random.Generator, count: int, n: int) -> Codes:
    return np.argsort(rng.random((count, n)), axis=1)
