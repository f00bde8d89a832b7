"""``Statement``: one thing that a result has to say, as data, and the catalogue of sentences, one file a room.

A sentence is a template. ``{joint}`` is a value or ``about``; ``{rows:row|rows}`` a number with its noun; and
``{joints:|is|are}`` the word that goes with a number or a list. There are no other conditions.
"""

from __future__ import annotations

import string
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, Literal, get_args

from posture_opt.errors import enumerated
from posture_opt.files import packaged
from posture_opt.statements.quantity import Quantity
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.numerics import Json

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
        label: text in front of it in a list, mostly one word; may be empty.
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


@dataclass(frozen=True, eq=False)
class Statement:
    """What is said of a result: an id that stays, of how much weight, about what, with which values.

    `state` makes it in the room that knows it; the sentence is in the catalogue.

    Args:
        id: ``room.what``, lower case with hyphens.
        severity: ``danger``, ``caution``, ``result``, ``note`` or ``detail``.
        about: name of a joint, parameter, obstacle or row; empty where it is about none.
        values: by the names of the template; texts, numbers, quantities and lists of names.
    """

    id: str
    severity: Severity
    about: str = ""
    values: Mapping[str, Value] = field(default_factory=dict)

    @property
    def entry(self) -> Entry:
        """What the catalogue has of this id."""
        room, _, name = self.id.partition(".")
        return entries(room)[name]

    @cached_property
    def text(self) -> str:
        """The sentence."""
        return sentence(self.entry.text, {"about": self.about, **self.values})

    def __str__(self) -> str:
        return self.text

    @property
    def label(self) -> str:
        """Text in front of the sentence in a list; may be empty."""
        return self.entry.label

    def to_json(self) -> dict[str, Json]:
        """The entry of ``statements`` in a document."""
        values = {name: _plain(value) for name, value in self.values.items()}
        return {
            "id": self.id,
            "severity": self.severity,
            "about": self.about or None,
            "values": values,
            "text": self.text,
        }


def state(id: str, about: str = "", /, **values: Value) -> Statement:
    """A statement of the severity that the catalogue has for its id.

    Args:
        id: ``room.what``, a key of the catalogue.
        about: name of what it is about.
        values: by the names of its template.

    Raises:
        KeyError: the catalogue has no such id.
    """
    room, _, name = id.partition(".")
    return Statement(id, entries(room)[name].severity, about, values)


def by_severity(statements: Iterable[Statement]) -> tuple[Statement, ...]:
    """The statements, the gravest first; those of one severity in their order."""
    return tuple(sorted(statements, key=lambda one: SEVERITIES.index(one.severity)))


def _plain(value: Value) -> Json:
    """A value as documents have it."""
    if isinstance(value, Quantity):
        return dict(value.to_json())
    return value if isinstance(value, str | int | float) else sentence("{names}", {"names": tuple(value)})
