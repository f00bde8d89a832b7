"""``Section``: one table of RESULTS.md, with what its figure shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Chart:
    """Which columns of a table a figure shows.

    Args:
        label: of the numbers, with their unit.
        numbers: columns shown: as lines over the first column where that is a number, else as bars beside its words.
        logarithmic: whether the axis of the numbers is.
    """

    label: str
    numbers: tuple[int, ...]
    logarithmic: bool = True


@dataclass(frozen=True)
class Section:
    """A table with its title, what was measured, and remarks below it.

    Args:
        key: name of the figure's file.
        formats: of the columns; for None stands a dash.
    """

    key: str
    title: str
    text: str
    headers: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    formats: tuple[str, ...]
    notes: tuple[str, ...] = ()
    chart: Chart | None = None

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Section:
        chart = document["chart"]
        return cls(
            **{key: document[key] for key in ("key", "title", "text")},
            **{key: tuple(document[key]) for key in ("headers", "formats", "notes")},
            rows=tuple(map(tuple, document["rows"])),
            chart=None if chart is None else Chart(chart["label"], tuple(chart["numbers"]), chart["logarithmic"]),
        )

    def markdown(self, picture: str | None) -> Iterator[str]:
        """The lines of the section; ``picture`` is the address of its figure."""
        yield from (f"## {self.title}", "", self.text, "")
        yield f"| {' | '.join(self.headers)} |"
        yield f"|{'|'.join('---' if spec == '' else '--:' for spec in self.formats)}|"
        for row in self.rows:
            cells = ("–" if v is None else format(v, spec) for v, spec in zip(row, self.formats, strict=True))
            yield f"| {' | '.join(cells)} |"
        yield ""
        for note in self.notes:
            yield f"- {note}"
        if self.notes:
            yield ""
        if picture:
            yield from (f"![{self.title}]({picture})", "")
