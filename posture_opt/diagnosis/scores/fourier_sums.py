"""Sums of sines and cosines of uneven joint values at many evenly spaced frequencies, by a fast Fourier transform."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from posture_opt.numerics import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_KERNEL_POINTS = 10  # points of the grid that a value is spread over: sums to nine digits
_KAISER_SHAPE = (
    0.75 * np.pi * _KERNEL_POINTS
)  # of the Kaiser-Bessel window for a grid twice as fine as need be (Beatty et al. 2005)
_COLUMNS_AT_ONCE = 64  # transformed at a time, for memory


@dataclass(frozen=True, eq=False)
class FourierSums:
    """``Σ_n a_n exp(i k q_n)`` at evenly spaced frequencies k, without the matrix of all sines.

    The values are spread over a grid with a Kaiser-Bessel window, transformed, and divided by the window's transform.
    Source: Dutt, Rokhlin (1993); Greengard, Lee (2004); Beatty, Nishimura, Pauly (2005) for the window.

    The cost is ``O(N w + M log M)`` a column, w = 10 the width of the window and M the grid; the direct sums take O(N
    K).

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

        count, rows = len(cycles), np.arange(len(q))
        step = float(cycles[1] - cycles[0]) if count > 1 else 0.0
        size = next_fast_len(max(2 * count, 2 * _KERNEL_POINTS))
        at = np.mod(step * q / (2 * np.pi), 1.0) * size
        first = np.ceil(at - _KERNEL_POINTS / 2).astype(int)
        points = first[:, None] + np.arange(_KERNEL_POINTS)
        away = (points - at[:, None]) / (_KERNEL_POINTS / 2)
        weights = np.i0(_KAISER_SHAPE * np.sqrt(np.maximum(1 - away**2, 0.0)))
        places = (weights.ravel(), (np.mod(points, size).ravel(), np.repeat(rows, _KERNEL_POINTS)))
        spread = csr_array(places, shape=(size, len(q)))
        modes = np.arange(count) - count // 2
        root = np.sqrt(_KAISER_SHAPE**2 - (_KERNEL_POINTS * np.pi * modes / size) ** 2)
        middle = np.exp(1j * cycles[count // 2] * q)
        return cls(spread, middle, _KERNEL_POINTS * np.sinh(root) / root, np.mod(modes, size))

    def __call__(self, a: Array) -> tuple[Array, Array]:
        """Sums with sines and with cosines, (K, p) each, of columns (N, p)."""
        sums = np.concatenate([*self._blocks(a)], axis=1)
        return sums.imag, sums.real

    def _blocks(self, a: Array) -> Iterator[NDArray[np.complex128]]:
        """Complex sums (K, p) of some columns at a time."""
        from scipy.fft import ifft

        for first in range(0, a.shape[1], _COLUMNS_AT_ONCE):
            turned = self.middle[:, None] * a[:, first : first + _COLUMNS_AT_ONCE]
            # Real weights times real and imaginary parts: half of what complex products cost.
            grid = (self.spread @ np.ascontiguousarray(turned).view(float)).view(complex)
            yield ifft(grid, axis=0, norm="forward")[self.modes] / self.window[:, None]


def weighted_squares(q: Array, cycles: Array, weights: Array) -> tuple[Array, Array, Array]:
    """``Σ w sin²``, ``Σ w sin cos`` and ``Σ w cos²`` (K, p) at joint values (N,) [rad], of weights (N, p).

    As ``sin² = (1 − cos 2kq) / 2``, the sums are those of twice the joint values.
    """
    s, c = FourierSums.of(2 * q, cycles)(weights)
    total = weights.sum(axis=0)
    return (total - c) / 2, s / 2, (total + c) / 2
