"""Score tests of many candidates at once, periodograms, and the null distribution of the largest of them.

A candidate with the columns Z explains ``|P r|²`` of residuals r that the baseline leaves, P the projector on what Z
adds to it. Under the null the F ratio of that has its usual distribution; the largest of many dependent ones does not,
so its distribution is simulated by flipping the signs of whole poses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.numerics import Array, Codes, Mask, factored_columns, thin_svd

if TYPE_CHECKING:
    from scipy.sparse import csr_array


_RANK_TOLERANCE = 1e-6  # of the largest singular value: linear dependence, to rounding of inner products


@dataclass(frozen=True, eq=False)
class ProjectedBaseline:
    """What is fitted before any candidate, and what it leaves of the residuals: ``e = (I − Q Qᵀ) r``.

    Args:
        Q: (m, k) orthonormal basis of what is fitted.
        e: (m,) whitened residuals [1], orthogonal to Q.
        flipped: (m, 1 + B) these residuals, and B copies with the signs of whole groups flipped, leverage-corrected
            and orthogonal to Q again (Winkler et al. 2014).
        count: the number of residuals; more than m where they are coordinates in a few directions.
    """

    Q: Array
    e: Array
    flipped: Array
    count: int

    @classmethod
    def of(
        cls, r: Array, columns: Array, groups: Codes, flips: int, seed: int, count: int = 0,
    ) -> ProjectedBaseline:  # fmt: skip
        """From residuals (m,), the columns (m, k) of what is fitted, and the group (m,) of every residual."""
        Q = orthonormal_basis(columns)
        e = r - Q @ (Q.T @ r)
        rng = np.random.default_rng(seed)
        leverage = np.minimum(np.einsum("ij,ij->i", Q, Q), 0.99)  # above, a residual says nothing of the noise
        signs = rng.choice([-1.0, 1.0], size=(int(groups.max(initial=0)) + 1, flips)).astype(np.int8)
        flipped = np.empty((len(e), 1 + flips))
        flipped[:, 0], drawn = e, flipped[:, 1:]
        np.multiply(signs[groups], (e / np.sqrt(1 - leverage))[:, None], out=drawn)
        inside = Q.T @ drawn
        for first in range(0, len(e), 4096):  # some rows at a time, for memory
            drawn[first : first + 4096] -= Q[first : first + 4096] @ inside
        return cls(Q, e, flipped, count or len(r))

    @property
    def freedom(self) -> int:
        return self.count - int(self.Q.shape[1])

    @cached_property
    def rss(self) -> Array:
        """(1 + B,) sums of squares."""
        return np.asarray(np.einsum("ij,ij->j", self.flipped, self.flipped))

    @property
    def undrawn(self) -> ProjectedBaseline:
        """Without the flipped data sets: of many rows they are large."""
        return replace(self, flipped=self.flipped[:, :1].copy())

    def project(self, Z: Array) -> Array:
        """Columns ``Z`` (m, k) projected off the baseline."""
        return np.asarray(Z - self.Q @ (self.Q.T @ Z))


def orthonormal_basis(columns: Array, learn: Mask | None = None) -> Array:
    """Orthonormal basis (m, rank) of columns (m, k) of any scales, of what they are in the rows ``learn`` (m,).

    See `unit_columns`: the rank depends neither on units nor on rounding.
    """
    scaled = unit_columns(columns, learn)[0]
    kept = scaled[:, np.any(scaled, axis=0)]
    if (factored := factored_columns(kept)) is not None:
        return factored[0]
    U, s, _ = thin_svd(kept)
    return np.asarray(U[:, s > 1e-7 * s.max(initial=1e-300)])


def unit_columns(columns: Array, learn: Mask | None = None) -> tuple[Array, Array]:
    """Columns (m, k) over their lengths in all rows, zero but in the rows ``learn`` (m,), and 1 / length (k,).

    Scaled to length one in the rows that teach alone, a direction that these do not know, as to a point that none of
    them touches, would be the rounding of other parameters, which can explain whatever it is made of.
    """
    norms = np.linalg.norm(columns, axis=0)
    scale = np.where(norms > 0, 1 / np.where(norms > 0, norms, 1.0), 0.0)
    scaled = columns * scale
    return (scaled if learn is None else np.where(learn[:, None], scaled, 0.0)), scale


def projected_basis(baseline: ProjectedBaseline, Z: Array) -> tuple[Array, float]:
    """Orthonormal basis (m, k) of columns Z (m, k) projected off a baseline, and the share ρ of length that is left.

    No columns where less than `levels.MIN_SURVIVING_SHARE` is left.
    """
    rest = baseline.project(Z)
    norms = np.linalg.norm(Z, axis=0)
    rho = float(np.max(np.linalg.norm(rest, axis=0) / np.where(norms > 0, norms, 1.0), initial=0.0))
    if rho < levels.MIN_SURVIVING_SHARE:
        return np.zeros((len(Z), 0)), rho
    U, s, _ = thin_svd(rest / np.where(norms > 0, norms, 1.0))
    return np.asarray(U[:, s > max(levels.MIN_SURVIVING_SHARE, _RANK_TOLERANCE * float(s[0]))]), rho


@dataclass(frozen=True, eq=False)
class ProjectedColumns:
    """Orthonormal bases of candidates projected off a baseline, by their inner products alone.

    Args:
        edges: (candidates + 1,) where the directions of each begin; as many as `projected_basis` has.
        gram: (R, R) inner products of all directions; scores: (R,) those with the residuals that the baseline leaves.
    """

    edges: Codes
    gram: Array
    scores: Array

    @property
    def sizes(self) -> Codes:
        """(candidates,) how many directions each has."""
        return np.diff(self.edges)

    @cached_property
    def gains(self) -> Array:
        """(candidates,) what each explains by itself."""
        return np.array([np.sum(self.scores[a:b] ** 2) for a, b in pairwise(self.edges)])

    @classmethod
    def of(cls, baseline: ProjectedBaseline, candidates: Sequence[Array]) -> ProjectedColumns:
        """From the columns (m, k) of each candidate."""
        Z = np.concatenate([np.zeros((len(baseline.e), 0)), *candidates], axis=1, dtype=float)
        edges = np.cumsum([0, *(Z.shape[1] for Z in candidates)])
        norms = np.linalg.norm(Z, axis=0)
        Z /= np.where(norms > 0, norms, 1.0)
        cross = baseline.Q.T @ Z
        gram, scores = Z.T @ Z - cross.T @ cross, Z.T @ baseline.e
        turned = [_kept_directions(gram[a:b, a:b]) for a, b in pairwise(edges)]
        ends = np.cumsum([0, *(t.shape[1] for t in turned)])
        T = np.zeros((edges[-1], ends[-1]))
        for t, a, b, first, end in zip(turned, edges[:-1], edges[1:], ends[:-1], ends[1:], strict=True):
            T[a:b, first:end] = t
        return cls(ends, np.asarray(T.T @ gram @ T), np.asarray(T.T @ scores))


def _kept_directions(gram: Array) -> Array:
    """(k, r) what makes orthonormal directions of k projected columns of former length one; as `projected_basis`."""
    if np.sqrt(max(np.diag(gram).max(initial=0.0), 0.0)) < levels.MIN_SURVIVING_SHARE:
        return np.zeros((len(gram), 0))
    values, vectors = np.linalg.eigh(gram)
    s = np.sqrt(np.maximum(values, 0.0))
    clear = s > max(levels.MIN_SURVIVING_SHARE, _RANK_TOLERANCE * float(s[-1]))
    return np.asarray(vectors[:, clear] / s[clear])


def log_p(explained: Array, rss: Array, size: int | Array, freedom: float | Array) -> Array:
    """Natural logarithm of the p-value of the F test of ``size`` directions that explain so much of ``rss``.

    ``P(F_{s, ν} > (explained / s) / (left / ν))`` with ν = ``freedom`` − s; beyond 1e-280 the leading term of its tail,
    ``−ν/2 · log(1 + s F / ν)``.
    """
    from scipy.special import fdtrc

    size = np.asarray(size, dtype=float)
    left = np.maximum(rss - explained, 1e-30 * explained + 1e-300)  # less than rounding leaves
    nu = np.maximum(freedom - size, 1.0)
    F = (explained / size) / (left / nu)
    with np.errstate(divide="ignore"):
        exact = np.log(fdtrc(size, nu, F))
    tail = -nu / 2 * np.log1p(size * F / nu)
    return np.where(np.isfinite(exact) & (exact > -650), exact, tail)


def fitted_sizes(gram: Array, scores: Array, variance: Array | float) -> tuple[Array, Array]:
    """Sizes (k, p) of k columns with a Gram matrix, ``−G⁻¹ Zᵀe``, and their standard errors, zero of a single column.

    Args:
        gram: (k, k) inner products of the columns; scores: (k, p) those with p vectors of residuals.
        variance: (p,) of these residuals.
    """
    norms = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    inverse = np.linalg.pinv(gram / np.outer(norms, norms), rcond=1e-10, hermitian=True) / np.outer(norms, norms)
    own = np.zeros(1) if len(gram) == 1 else np.maximum(np.diag(inverse), 0.0)
    return -inverse @ scores, np.sqrt(own[:, None] * variance)


def stacked_sizes(gram: Array, scores: Array, variance: Array) -> tuple[Array, Array]:
    """As `fitted_sizes`, of many groups of k > 1 columns at once: sizes and errors (f, n, k).

    Args:
        gram: (f, n, k, k); scores: (f, n, k); variance: (f, 1).
    """
    norms = np.sqrt(np.maximum(np.einsum("fikk->fik", gram), 1e-300))
    lengths = norms[:, :, :, None] * norms[:, :, None, :]
    inverse = np.linalg.pinv(gram / lengths, rcond=1e-10, hermitian=True) / lengths
    own = np.maximum(np.einsum("fikk->fik", inverse), 0.0)
    return -(inverse @ scores[..., None])[..., 0], np.sqrt(own * variance[:, :, None])


def beyond_limits(sizes: Array, errors: Array, low: float | Array, high: float | Array) -> Mask:
    """Which sizes are physically impossible; of several together, by more than two standard errors of each.

    One mass of several may come out a little below zero where it is hardly there.
    """
    return np.asarray((sizes < low - 2 * errors) | (sizes > high + 2 * errors))


def explained_squares(baseline: ProjectedBaseline, candidates: Sequence[Array]) -> tuple[Array, Array, Array]:
    """Of candidates (each (m, k)) given a baseline: shares ρ, ranks, and the sums of squares that they explain.

    As `projected_basis` has it, and from the inner products alone. Shapes (candidates,), (candidates,) and
    (candidates, 1 + B), a sum of squares of each column of flipped residuals.
    """
    widths, rows = np.array([Z.shape[1] for Z in candidates], dtype=np.intp), len(baseline.e)
    rho, kept = np.zeros(len(widths)), np.zeros(len(widths), dtype=int)
    gains = np.zeros((len(widths), baseline.flipped.shape[1]))
    for width in np.unique(widths):
        alike = np.flatnonzero(widths == width)
        for own in np.array_split(alike, -(-len(alike) * width * rows // 4_000_000) or 1):  # blocks of 32 MB
            Z = np.concatenate([candidates[i] for i in own], axis=1, dtype=float)
            inner = _gram_matrices(Z, width), _gram_matrices(baseline.Q.T @ Z, width)
            scores = (Z.T @ baseline.flipped).reshape(len(own), width, -1)
            rho[own], kept[own], gains[own] = _explained_by_width(*inner, scores)
    return rho, kept, gains


def _gram_matrices(columns: Array, k: int) -> Array:
    """(n, k, k) inner products of each k of the columns (m, n k)."""
    own = np.moveaxis(columns.reshape(len(columns), columns.shape[1] // k, k), 0, 1)
    return np.asarray(np.swapaxes(own, 1, 2) @ own)


def _explained_by_width(gram: Array, taken: Array, scores: Array) -> tuple[Array, Codes, Array]:
    """ρ (n,), ranks (n,) and sums of squares (n, 1 + B) of n candidates of k columns.

    Args:
        gram: (n, k, k); taken: what the baseline takes of it; scores: (n, k, 1 + B).
    """
    norms = np.sqrt(np.einsum("nkk->nk", gram))
    norms = np.where(norms > 0, norms, 1.0)
    rest = (gram - taken) / (norms[:, :, None] * norms[:, None, :])
    rho = np.sqrt(np.maximum(np.einsum("nkk->nk", rest).max(axis=1, initial=0.0), 0.0))
    values, vectors = np.linalg.eigh(rest)
    s = np.sqrt(np.maximum(values, 0.0))
    clear = s > np.maximum(levels.MIN_SURVIVING_SHARE, _RANK_TOLERANCE * s[:, -1:])
    clear &= rho[:, None] >= levels.MIN_SURVIVING_SHARE
    parts = np.swapaxes(vectors, 1, 2) @ (scores / norms[:, :, None])
    weights = np.where(clear, 1 / np.where(clear, values, 1.0), 0.0)
    return rho, clear.sum(axis=1), np.sum(parts**2 * weights[:, :, None], axis=1)


@dataclass(frozen=True, eq=False)
class NullDistribution:
    """The least log p-value (B,) of each family of candidates in each of B sign-flipped data sets."""

    least: Mapping[str, Array]

    def family_wise(self, log_p_value: float, family: str) -> float:
        """Family-wise p-value: the probability that noise alone gives any candidate of any family so much evidence.

        Within the family from the flipped sets where they reach that far (Westfall, Young 1993), beyond them along
        their exponential tail, which for F tests falls by e for each e of p and more slowly where the noise has long
        tails; between families the level is shared out (weighted Bonferroni).
        """
        p = p_value_of_maximum(-self.least[family], -log_p_value, 1.0)
        return float(min(1.0, p / levels.FAMILY_SHARES[family]))


def p_value_of_maximum(most: Array, value: float, slowest: float = 1e-12) -> float:
    """p-value of ``value`` among the maxima ``most`` (B,) of draws: counted, and beyond them along an exponential tail.

    Counted from ten exceedances on (Knijnenburg et al. 2009). The tail has the mean excess of the largest tenth
    (Pickands 1975, with shape zero), at least ``slowest``.

    Example:
        >>> import numpy as np
        >>> draws = np.arange(1.0, 100.0)
        >>> p_value_of_maximum(draws, 50.0), p_value_of_maximum(draws, 200.0) < 1e-8
        (0.51, True)
    """
    share = (1 + float(np.sum(most >= value))) / (1 + len(most))
    if share > 10 / (1 + len(most)):
        return share
    start = float(np.quantile(most, 0.9))
    excess = max(float(np.mean(most[most >= start] - start)), slowest)
    return float(min(share, max(0.1 * np.exp(-(value - start) / excess), 1e-300)))


_WIDTH = 10  # points of the grid that a value is spread over: sums to nine digits


@dataclass(frozen=True, eq=False)
class FourierSums:
    """``Σ_n a_n exp(i k q_n)`` at evenly spaced frequencies k, without the matrix of all sines.

    The values are spread over a grid with a Kaiser-Bessel window, transformed, and divided by the window's transform:
    ``O(N w + M log M)`` a column, w the width of the window and M the grid, in place of ``O(N K)``.

    Source: Dutt, Rokhlin (1993); Greengard, Lee (2004); Beatty, Nishimura, Pauly (2005) for the window.

    Args:
        spread: (M, N) sparse; what each value gives to the grid.
        middle: (N,) the phase of each value at the middle frequency.
        window: (K,) the transform of the window; ``modes`` (K,) where each frequency is in that of the grid.
    """

    spread: csr_array
    middle: Array
    window: Array
    modes: Array

    @classmethod
    def of(cls, q: Array, cycles: Array) -> FourierSums:
        """At joint values (N,) [rad] and frequencies (K,) [cycles per revolution]."""
        from scipy.fft import next_fast_len
        from scipy.sparse import csr_array

        shape = 0.75 * np.pi * _WIDTH  # of the window for a grid twice as fine as need be (Beatty et al. 2005)
        count, rows = len(cycles), np.arange(len(q))
        step = float(cycles[1] - cycles[0]) if count > 1 else 0.0
        size = next_fast_len(max(2 * count, 2 * _WIDTH))
        at = np.mod(step * q / (2 * np.pi), 1.0) * size
        points = np.ceil(at - _WIDTH / 2).astype(int)[:, None] + np.arange(_WIDTH)
        away = (points - at[:, None]) / (_WIDTH / 2)
        weights = np.i0(shape * np.sqrt(np.maximum(1 - away**2, 0.0)))
        places = (weights.ravel(), (np.mod(points, size).ravel(), np.repeat(rows, _WIDTH)))
        spread = csr_array(places, shape=(size, len(q)))
        modes = np.arange(count) - count // 2
        root = np.sqrt(shape**2 - (_WIDTH * np.pi * modes / size) ** 2)
        middle = np.exp(1j * cycles[count // 2] * q)
        return cls(spread, middle, _WIDTH * np.sinh(root) / root, np.mod(modes, size))

    def __call__(self, a: Array) -> tuple[Array, Array]:
        """Sums with sines and with cosines, (K, p) each, of columns (N, p); 64 at a time, for memory."""
        from scipy.fft import ifft

        sums = np.empty((len(self.modes), a.shape[1]), dtype=complex)
        for first in range(0, a.shape[1], 64):
            own = slice(first, first + 64)
            # Real weights times real and imaginary parts: half of what complex products cost.
            turned = np.ascontiguousarray(self.middle[:, None] * a[:, own]).view(float)
            grid = (self.spread @ turned).view(complex)
            sums[:, own] = ifft(grid, axis=0, norm="forward")[self.modes] / self.window[:, None]
        return sums.imag, sums.real


def weighted_squares(q: Array, cycles: Array, weights: Array) -> tuple[Array, Array, Array]:
    """``Σ w sin²``, ``Σ w sin cos`` and ``Σ w cos²`` (K, p) at joint values (N,) [rad], of weights (N, p).

    As ``sin² = (1 − cos 2kq) / 2``, the sums are those of twice the joint values.
    """
    s, c = FourierSums.of(2 * q, cycles)(weights)
    total = weights.sum(axis=0)
    return (total - c) / 2, s / 2, (total + c) / 2


def scan_frequencies(
    baseline: ProjectedBaseline, joint_columns: Array, q: Array, cycles: Array
) -> tuple[Array, Array]:  # fmt: skip
    """Periodogram of one joint: the sum of squares (K,) of each of K frequencies, and the largest (B,) of flipped sets.

    Explained by a sine and a cosine together, the baseline projected off: the generalised Lomb-Scargle periodogram
    (Lomb 1976; Scargle 1982).

    Args:
        joint_columns: (N, block) whitened residual per unit of the joint [1/rad].
        q: (N,) joint values [rad]; cycles: (K,) frequencies [cycles per revolution].
    """
    N, block = joint_columns.shape
    c = joint_columns
    series = np.einsum("nb,nbf->nf", c, baseline.flipped[: c.size].reshape(N, block, -1))
    basis = np.einsum("nb,nbk->nk", c, baseline.Q[: c.size].reshape(N, block, -1))
    square = np.einsum("nb,nb->n", c, c)
    sines, cosines = FourierSums.of(q, cycles)(np.concatenate([basis, series], axis=1))
    k = basis.shape[1]
    qs, qc, bs, bc = sines[:, :k], cosines[:, :k], sines[:, k:], cosines[:, k:]
    # Gram matrix of sine and cosine off the baseline, and bᵀ G⁻¹ b.
    products = zip(weighted_squares(q, cycles, square[:, None]), ((qs, qs), (qs, qc), (qc, qc)), strict=True)
    ss, sc, cc = (own - np.einsum("ij,ij->i", a, b)[:, None] for own, (a, b) in products)
    det = ss * cc - sc * sc
    good = det > 1e-6 * np.maximum(ss * cc, 1e-300)
    gain = np.where(good, (cc * bs * bs - 2 * sc * bs * bc + ss * bc * bc) / np.where(good, det, 1.0), 0.0)
    return gain[:, 0], gain[:, 1:].max(axis=0, initial=0.0)
