"""The least value of a function of one number between two ends: Brent's search, written out.

SciPy's is the same; to import it would take longer than most searches for a shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable

_GOLDEN = (3 - math.sqrt(5)) / 2
_RELATIVE, _ABSOLUTE = math.sqrt(2.2e-16), 1e-5 / 3  # least steps, of x and of its unit


def bounded_minimum(f: Callable[[float], float], low: float, high: float, evaluations: int) -> tuple[float, float]:
    """Where f is least between two ends, and its value there, by parabolas and golden sections (Brent 1973, chapter 5).

    Example:
        >>> x, value = bounded_minimum(lambda x: (x - 1.25) ** 2, 0.0, 3.0, 16)
        >>> round(x, 6), round(value, 9)
        (1.25, 0.0)
    """
    x = low + _GOLDEN * (high - low)
    best = second = third = (f(x), x)
    last = step = 0.0  # the step before the last one, and the last one
    for _ in range(evaluations - 1):
        x, middle = best[1], (low + high) / 2
        least = _RELATIVE * abs(x) + _ABSOLUTE
        if abs(x - middle) <= 2 * least - (high - low) / 2:
            break
        parabola = _parabola_step(best, second, third) if abs(last) > least else None
        if parabola is not None and abs(parabola) < abs(last) / 2 and low < x + parabola < high:
            last, step = step, parabola
            if min(x + step - low, high - x - step) < 2 * least:
                step = math.copysign(least, middle - x)
        else:
            last = (low if x >= middle else high) - x
            step = _GOLDEN * last
        trial = x + math.copysign(max(abs(step), least), step)
        found = f(trial), trial
        outer = x if found[0] <= best[0] else trial
        low, high = (outer, high) if (trial >= x) == (found[0] <= best[0]) else (low, outer)
        if found[0] <= best[0]:
            best, second, third = found, best, second
        elif found[0] <= second[0] or second[1] == x:
            second, third = found, second
        elif found[0] <= third[0] or third[1] in (x, second[1]):
            third = found
    return best[1], best[0]


def _parabola_step(
    best: tuple[float, float], second: tuple[float, float], third: tuple[float, float]
) -> float | None:  # fmt: skip
    """From the best of three (value, place) to the lowest point of their parabola; None where it has none."""
    (fx, x), (fw, w), (fv, v) = best, second, third
    r, q = (x - w) * (fx - fv), (x - v) * (fx - fw)
    twice = 2 * (q - r)
    return -((x - v) * q - (x - w) * r) / twice if twice else None
