"""Frequencies of periodic errors: as text, and whether one is a multiple of another as far as they are known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from posture_opt.errors import enumerated
from posture_opt.numerics import TURN, Array
from posture_opt.units import number

_TENTHS_FROM_CYCLES = 100.0
"""Cycles per revolution from which three digits would round to whole ones."""
_MAX_HARMONIC = 12
"""Multiple of another line up to which a line can be its harmonic."""
_HARMONIC_DEVIATION = 2.0
"""Standard errors by which the ratio of two lines may differ from a whole number."""
_SURE_HARMONIC_TOLERANCE = 0.05
"""Largest deviation that still says something: a ratio known no better lies near some whole number by accident."""

_ALIKE_WINDOW = 0.5
"""Spectral window of two lines above which the fit shares an error between them."""
_NEAR_LINES = 2.0
"""How far two lines may be apart to be two shapes of one error, in units of 2π / range; chosen on series A, B, D."""
_WINDOW_POINTS, _WINDOW_VALUES = 200, 500
"""Distances at which the window is taken, and joint values that it is taken of; chosen for time."""


def harmonic_order(cycles: Sequence[float], sizes: Sequence[tuple[float, float]], line: int, span: float) -> int:
    """Which multiple of the first line another one is for sure; 0 for none.

    The ratio of both is whole within `_HARMONIC_DEVIATION` standard errors, see `cycles_error`, and these are small.

    Args:
        cycles: per revolution of each line.
        sizes: amplitude of each line with its standard error [rad].
        line: number of the line; ``span`` the range of the joint in the data [rad], 0 where it is not known.
    """
    if not span > 0:
        return 0
    ratio = cycles[line] / cycles[0]
    errors = [cycles_error(sizes[i], span) / cycles[i] for i in (0, line)]
    deviation = _HARMONIC_DEVIATION * ratio * math.hypot(*errors)
    n = round(ratio)
    sure = 1 < n <= _MAX_HARMONIC and deviation < _SURE_HARMONIC_TOLERANCE
    return n if sure and abs(ratio - n) < deviation else 0


def cycles_error(size: tuple[float, float], span: float) -> float:
    """The standard error of the cycles of a line of amplitude A ± s, ``√12 s / (A w)``.

    Source: Rife, Boorstyn (1974), Cramér-Rao bounds of amplitude and frequency.

    Args:
        size: amplitude and its standard error [rad].
        span: w, the range of the joint that the data spread over evenly [rad].
    """
    return math.sqrt(12) * size[1] / (size[0] * span)


def resolution(q: Array) -> float:
    """The largest distance at which two lines look alike at the values q (N,) [rad] of a joint, cycles per revolution.

    Their columns do where the spectral window ``|Σ exp(i Δ q)| / N`` is above `_ALIKE_WINDOW`: Δ = 0.6 2π / range where
    the values spread evenly, and more where they come in clumps. What repeats beyond `_NEAR_LINES` is an alias.
    """
    span = float(np.ptp(q))
    if not span > 0:
        return 0.0
    near = np.linspace(0.0, _NEAR_LINES * TURN / span, _WINDOW_POINTS)
    window = np.abs(np.exp(1j * np.outer(near, q[:: -(-len(q) // _WINDOW_VALUES)])).mean(axis=1))
    return float(near[window > _ALIKE_WINDOW][-1])


def line_words(lines: Sequence[float]) -> str:
    """Lines of one joint in words: "line at 12.4 cycles per revolution"."""
    listed = enumerated([cycles_text(k) for k in lines])
    return f"line{'s' * (len(lines) > 1)} at {listed} cycles per revolution"


def cycles_text(cycles: float) -> str:
    """Cycles per revolution to a tenth, and to three digits below ten."""
    return number(cycles, 3 if cycles < _TENTHS_FROM_CYCLES else 4)
