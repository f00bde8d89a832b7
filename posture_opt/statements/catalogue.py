"""The catalogue: id of a statement -> its severity, label and sentence, a file a room.

A sentence is a template. ``{joint}`` is a value or ``about``; ``{rows:row|rows}`` a number with its noun; and
``{joints:|is|are}`` the word that goes with a number or a list. There are no other conditions.
"""

from __future__ import annotations

import string
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, get_args

from posture_opt.errors import enumerated
from posture_opt.files import packaged
from posture_opt.statements.quantity import Quantity
from posture_opt.units import number

Severity = Literal["danger", "caution", "result", "note", "detail"]
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
"""From the gravest on."""
ROOMS = (
    *("batch", "calibration", "changes", "collision", "compensation", "diagnosis", "experiments", "export", "input"),
    *("measurements", "problem", "reading", "selection", "uncertainty", "validation"),
)
"""Rooms with statements of their own; each has a file of the catalogue."""
Value = Quantity | str | int | float | Sequence[str]


@dataclass(frozen=True)
class Entry:
    """What the catalogue has of one id.

    Args:
        severity: how grave it is; ``text`` the template of its sentence.
        label: what stands before it in a list, mostly one word; empty where the sentence stands alone.
        section: the part of the report where it belongs when it is not on the first screen.
    """

    severity: Severity
    text: str
    label: str = ""
    section: str = ""


@cache
def entries(room: str) -> Mapping[str, Entry]:
    """The entries of a room by the end of their id, in the order of its file; empty of a room without a file."""
    if room not in ROOMS:
        return {}
    text = packaged("posture_opt.statements", "catalogue", f"{room}.toml")
    return {name: Entry(**fields) for name, fields in tomllib.loads(text).items()}


def every_entry() -> dict[str, Entry]:
    """All entries by their whole id."""
    return {f"{room}.{name}": entry for room in ROOMS for name, entry in entries(room).items()}


class _Sentence(string.Formatter):
    """Fills a template: quantities format themselves, lists are enumerated, nouns and verbs follow the number."""

    def format_field(self, value: Any, spec: str) -> str:
        size = len(value) if isinstance(value, tuple | list) else value
        if "|" in spec:
            *noun, one, several = spec.split("|")
            word = one if size == 1 else several
            return word if noun else f"{_text(value)} {word}"
        return _text(value) if not spec else format(value, spec)


def _text(value: Value) -> str:
    """A value in a sentence."""
    if isinstance(value, str | Quantity):
        return str(value)
    if isinstance(value, int):
        return f"{value:,}"
    return number(value) if isinstance(value, float) else enumerated(map(str, value))


_SENTENCE = _Sentence()


def sentence(template: str, values: Mapping[str, Value]) -> str:
    """The sentence of a template with these values; it begins with a capital, unless a name begins it.

    >>> sentence("{rows:row|rows} {rows:|is|are} {by}", {"rows": 2, "by": "far off"})
    '2 rows are far off'
    """
    return _SENTENCE.vformat(template, (), values)
