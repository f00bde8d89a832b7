"""What a Python caller states, as the plain data that a problem file would give."""

from __future__ import annotations

import math
from collections.abc import Mapping
from os import PathLike, fspath
from typing import Any

import numpy as np

Plain = Any
"""A value of a problem file before its schema has read it: text, number, or lists and mappings of them."""
Section = dict[str, Plain]
"""A section of a problem file, or all of them, by their keys."""

_MAX_INTEGER = 10**300  # beyond it no float can follow: it is infinite


def plain(value: object) -> Plain:
    """Mappings, sequences, arrays and paths as the plain types that a file would give, all of them new.

    The key ``on`` may be given as True, which YAML 1.1 makes of it, as PyYAML does.

    >>> plain({"q": np.array([0.5, 1.0]), 2: (2, 3), True: "tool"})
    {'q': [0.5, 1.0], '2': [2, 3], 'on': 'tool'}
    """
    if isinstance(value, Mapping):
        return {"on" if key is True else str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, int) and abs(value) > _MAX_INTEGER:
        return math.inf if value > 0 else -math.inf
    return fspath(value) if isinstance(value, PathLike) else value
