"""Names and small tools of numerical code that every room shares."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

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


class DerivedAgain:
    """Pickles and copies as what it was made from: what its cached properties hold is derived again on demand.

    CasADi's symbols do not travel: a process that gets one knows nothing of the others that it stands among.
    """

    def __getstate__(self) -> dict[str, Any]:
        kind = type(self)
        return {name: value for name, value in vars(self).items() if not _is_cached(kind, name)}


def _is_cached(kind: type[Any], name: str) -> bool:
    return isinstance(getattr(kind, name, None), cached_property)
