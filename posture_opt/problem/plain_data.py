"""What a Python caller states, as the plain data that a problem file would give."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from os import PathLike, fspath
from typing import Any

import numpy as np

from posture_opt.errors import Issue, KeyPath

Plain = Any
"""A value of a problem file before its schema has read it: text, number, or lists and mappings of them."""
Section = dict[str, Plain]
"""A section of a problem file, or all of them, by their keys."""

_NON_TEXT_CHARACTERS = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")
"""Control characters and halves of characters: no report, figure or JSON document can hold them."""
_MAX_INTEGER = 10**300  # beyond it no float can follow: it is infinite


def plain(value: object) -> Plain:
    """Mappings, sequences, arrays and paths as the plain types that a file would give, all of them new.

    >>> plain({"q": np.array([0.5, 1.0]), 1: (2, 3)})
    {'q': [0.5, 1.0], '1': [2, 3]}
    """
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, int) and abs(value) > _MAX_INTEGER:
        return math.inf if value > 0 else -math.inf
    return fspath(value) if isinstance(value, PathLike) else value


def text_issues(data: object, key: KeyPath = ()) -> list[Issue]:
    """Names and texts in plain data with characters that no text has, each with its key.

    Args:
        key: of ``data`` in the whole, for the messages.
    """
    if isinstance(data, str):
        found = _NON_TEXT_CHARACTERS.search(data)
        return [_text_issue(found[0], key)] if found else []
    if isinstance(data, dict):
        names = [_text_issue(found[0], key) for name in data if (found := _NON_TEXT_CHARACTERS.search(name))]
        return [*names, *(issue for name, entry in data.items() for issue in text_issues(entry, (*key, name)))]
    if isinstance(data, list):
        return [issue for i, entry in enumerate(data) for issue in text_issues(entry, (*key, i))]
    return []


def _text_issue(character: str, key: KeyPath) -> Issue:
    return Issue(f"the text holds the character U+{ord(character):04X}, which no text has", key, None, "remove it")
