"""What a Python caller states, as the plain data that a problem file would give."""

from __future__ import annotations

import math
from collections.abc import Mapping
from os import PathLike, fspath
from typing import Any

import numpy as np

_LARGEST_INT = 10**300  # beyond it no float can follow: it is infinite


def plain(value: Any) -> Any:
    """Mappings, sequences, arrays and paths as the plain types that a file would give, all of them new."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, int) and abs(value) > _LARGEST_INT:
        return math.inf if value > 0 else -math.inf
    return fspath(value) if isinstance(value, PathLike) else value
