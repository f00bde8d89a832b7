"""Which preset a mistyped name, a part of one, or a maker's name may mean."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Mapping

_LEAST_LIKENESS = 0.6
"""Ratio of difflib from which two names are alike, its own default."""
_LEAST_LETTERS = 3
"""A shorter word is in the title of nearly every arm."""


def presets_like(word: str, titles: Mapping[str, str]) -> tuple[str, ...]:
    """The presets that a word may mean, the likeliest alone where one is: case, blanks, ``-`` and ``_`` do not count.

    In this order: the same name; a name with its maker in front; names that begin so, or whose titles contain it; the
    name written most like it, sought in its own family (``kr120``: all ``kr…``), and the whole family where none is.

    Args:
        word: as it was typed.
        titles: name of each preset -> its maker and type, "KUKA KR 210 R2700-2".

    Example:
        >>> presets_like("kr210", {"kr210_r2700": "KUKA KR 210 R2700-2", "ur10": "Universal Robots UR10"})
        ('kr210_r2700',)
    """
    asked = _plain(word)
    names = {_plain(name): name for name in titles}
    if asked in names:
        return (names[asked],)
    behind_maker = [name for plain, name in names.items() if asked.endswith(plain)]
    if behind_maker:
        return (max(behind_maker, key=len),)
    begun = [name for plain, name in names.items() if asked and plain.startswith(asked)]
    titled = [name for name, title in titles.items() if len(asked) >= _LEAST_LETTERS and asked in _plain(title)]
    if begun or titled:
        return tuple(begun or titled)
    family = [plain for plain in names if _letters(plain) == _letters(asked) != ""]
    found = difflib.get_close_matches(asked, family or names, 1, _LEAST_LIKENESS)
    return tuple(names[plain] for plain in found or family)


def _plain(name: str) -> str:
    """Letters and digits of a name, in lower case and without accents."""
    return re.sub(r"[^a-z0-9]", "", unicodedata.normalize("NFKD", name).lower())


def _letters(plain: str) -> str:
    """What stands in front of the first digit: the family of an arm."""
    return re.split(r"\d", plain, maxsplit=1)[0]
