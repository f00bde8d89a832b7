"""Sums of sines and cosines of uneven joint values at many evenly spaced frequencies, and periodograms from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline
from posture_opt.numerics import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_array

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
