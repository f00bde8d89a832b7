"""Names and small tools of numerical code that every room shares."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Real numbers; the docstring of a function says which shape and unit."""
Codes = NDArray[np.intp]
"""Whole numbers that index rows or name groups of them."""
Mask = NDArray[np.bool_]
"""True where something holds."""
Progress = Callable[[int, int], None]
"""Is told how many of how many parts of a computation are done."""


def finite_or_none(value: float) -> float | None:
    """The number, or None, which JSON writes as null, where it is infinite or NaN."""
    return value if math.isfinite(value) else None
