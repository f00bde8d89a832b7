"""``Statement``: one thing that a result has to say, as data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from posture_opt.statements.catalogue import SEVERITIES, Entry, Severity, Value, entries, sentence
from posture_opt.statements.quantity import Quantity

if TYPE_CHECKING:
    from posture_opt.numerics import Json


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
        """What stands before the sentence in a list; empty where it stands alone."""
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
