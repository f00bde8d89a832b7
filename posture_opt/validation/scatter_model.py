"""``Scatter``: what a Gaussian likelihood needs to know of errors that scatter."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from posture_opt.measurements.measurements import rows_of
from posture_opt.numerics import Array, Codes, Mask


@dataclass(frozen=True, eq=False)
class Scatter:
    """What a Gaussian likelihood needs to know of errors that scatter about unknown or zero means."""

    columns: Array  # (G, d, n) ``∂x/∂joint`` at each posture
    squares: Array  # (G, d, d) sums of squares and products [m²]
    freedom: Array  # (G,) of each: rows less one where the mean is unknown
    # (G, d, d), or zero: a part of the covariance that is known beforehand [m²]
    known: Array = field(default_factory=lambda: np.zeros((1, 1, 1)))

    @classmethod
    def of(cls, errors: Array, columns: Array, groups: Codes | None = None, known: Array | None = None) -> Scatter:
        """Of errors (N, d) about zero, or about the means of ``groups`` (N,): rows of one posture.

        errors (N, d) [m]; columns: (N, d, n) shift by a unit of each joint's error [m/rad, m/m].
        """
        if groups is None:
            own = np.zeros((1, 1, 1)) if known is None else known
            return cls(columns, errors[:, :, None] * errors[:, None, :], np.ones(len(errors)), own)
        _, first, code, count = np.unique(groups, return_index=True, return_inverse=True, return_counts=True)
        mean = _group_sums(errors, code, len(count)) / count[:, None]
        centred = errors - mean[code]
        squares = _group_sums(centred[:, :, None] * centred[:, None, :], code, len(count))
        many = count > 1
        return cls(columns[first[many]], squares[many], np.asarray(count[many] - 1.0))

    def take(self, cases: Codes | Mask) -> Scatter:
        """The cases of some indices."""
        known = self.known[cases] if len(self.known) == len(self.freedom) > 1 else self.known
        return Scatter(self.columns[cases], self.squares[cases], self.freedom[cases], known)

    def log_likelihoods(self, covariance: Array) -> Array:
        """(G,) log-likelihoods of normal scatter, covariances (G, d, d) or (d, d) [m²]; −∞ of singular ones."""
        d = self.squares.shape[-1]
        sign, size = np.linalg.slogdet(covariance)
        sound = (sign > 0) & np.isfinite(size)
        inverse = np.linalg.inv(np.where(sound[..., None, None], covariance, np.eye(d)))
        distance = np.sum(inverse * self.squares, axis=(-2, -1))
        found = -0.5 * (self.freedom * (size + d * np.log(2 * np.pi)) + distance)
        return np.where(sound, found, -np.inf)


def joint_covariances(columns: Array, sigma: Array, instrument: float) -> Array:
    """Covariances ``s² I + J diag(σ²) Jᵀ`` (N, d, d) [m²] of instrument and joints.

    columns: J (N, d, n) [m/rad, m/m]; sigma: (n,) [rad, m]; instrument: s [m].
    """
    scaled = columns * sigma
    return np.asarray(scaled @ np.swapaxes(scaled, -1, -2) + instrument**2 * np.eye(columns.shape[1]))


def _group_sums(values: Array, code: Codes, count: int) -> Array:
    """Sums (count, …) of values (N, …) over the rows of each code (N,)."""
    found = np.zeros((count, *values.shape[1:]))
    np.add.at(found, code, values)
    return found


def whitened_repeats(e: Array, columns: Array, S: Array, repeats: Codes, own: Array) -> tuple[Array, Array]:
    """Residuals (N, d) and joint columns (n, N, d) in units of the covariance ``own + S Sᵀ`` of whole repeats.

    ``L⁻¹ e`` with ``L Lᵀ = own + S Sᵀ`` of all rows of a repeat together, as they share what the arm did; repeats of as
    many rows are solved at once.

    S (N, d, k) shift of the rows by each of k errors that all rows of a repeat share, each of variance 1; own (N, d)
    variance that every row has for itself.

    Returns Residuals (N, d) and columns (n, N, d), of unit covariance.
    """
    d = e.shape[1]
    mixed = np.concatenate([e[:, :, None], np.moveaxis(columns, 0, 2)], axis=2)
    for rows in _by_size(repeats):
        size = rows.shape[1] * d
        shared = S[rows].reshape(len(rows), size, -1)
        covariance = np.eye(size) * own[rows].reshape(len(rows), 1, size) + shared @ np.swapaxes(shared, 1, 2)
        part = np.linalg.solve(np.linalg.cholesky(covariance), mixed[rows].reshape(len(rows), size, -1))
        mixed[rows] = part.reshape(*rows.shape, d, -1)
    return mixed[:, :, 0], np.moveaxis(mixed[:, :, 1:], 2, 0)


def null_sets(e: Array, repeats: Codes | None, count: int, rng: np.random.Generator) -> Array:
    """(count, N, d) residuals as chance could have them: every repeat turned at random, and repeats change places."""
    N, d = e.shape
    if repeats is None or len(np.unique(repeats)) == N:
        drawn = rng.standard_normal((count, N, d))
        lengths = np.linalg.norm(e, axis=1)[_permutations(rng, count, N)]
        return np.asarray(drawn * (lengths / np.linalg.norm(drawn, axis=2))[:, :, None])
    sets = np.empty((count, N, d))
    for rows in _by_size(repeats):
        turns = np.linalg.qr(rng.standard_normal((count, len(rows), d, d)))[0]
        others = e[rows[_permutations(rng, count, len(rows))]]
        sets[:, rows] = others @ np.swapaxes(turns, 2, 3)
    return sets


def _by_size(repeats: Codes) -> list[Codes]:
    parts = rows_of(repeats)
    sizes = np.array([len(rows) for rows in parts])
    return [np.stack([parts[i] for i in np.flatnonzero(sizes == m)]) for m in np.unique(sizes)]


def _permutations(rng: np.random.Generator, count: int, n: int) -> Codes:
    """Random permutations (count, n) of n indices."""
    return np.argsort(rng.random((count, n)), axis=1)
