"""What was probably meant: the nearest known name to a mistyped one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path


def nearest(word: str, known: Iterable[str]) -> str:
    """The known name written most like ``word``, case aside; empty where none is like it."""
    by_lower = {name.lower(): name for name in known}
    found = difflib.get_close_matches(word.lower(), by_lower, 1, 0.6)
    return by_lower[found[0]] if found else ""


def nearest_file(path: Path) -> str:
    """The path beside ``path`` whose name is written most like its name; empty where none is like it."""
    try:
        names = {entry.stem: entry.name for entry in path.parent.iterdir()}
    except OSError:
        return ""
    # Without their endings: '.csv' alone makes any two names alike.
    stem = nearest(path.stem, names)
    return str(path.parent / names[stem]) if stem else ""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """``did you mean 'x'?``, or the list of what is known where nothing is like ``word``."""
    names = list(known)
    name = nearest(word, names)
    if name:
        return f"did you mean '{name}'?"
    return f"known are {listed(names)}" if names else "none is known"


def one_of(word: str, known: Iterable[str], what: str = "one of") -> str:
    """``did you mean 'x'? one of: x, y``: the nearest name where one is like ``word``, and all that are known."""
    names = list(known)
    name = nearest(word, names)
    return (f"did you mean '{name}'? " if name else "") + f"{what}: {listed(names)}"


def listed(names: Iterable[str], most: int = 40) -> str:
    """The first names of a list, as text."""
    every = list(names)
    return ", ".join(every[:most]) + (f", … ({len(every)} in all)" if len(every) > most else "")
