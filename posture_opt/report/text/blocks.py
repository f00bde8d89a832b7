"""What a report is made of, whatever it is shown as: the lead, and blocks of sentences, facts and tables."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from posture_opt.statements import SEVERITIES, Statement, by_severity

WIDTH = 100
"""Columns of a file, and where no terminal says how wide it is."""
MAX_LINES, MAX_WORDS = 8, 90
"""Of a lead of `WIDTH` columns, its title not counted."""

Line = tuple[str, str]
"""A label, mostly empty, and a sentence."""


def lead(statements: Sequence[Statement]) -> tuple[tuple[Statement, ...], tuple[Statement, ...]]:
    """The statements of the first screen, and those of the same weight that it has no room for.

    The first result is the headline and comes first; then dangers, cautions and results in this order. Where there is
    no room for all, they count in the order dangers, second result, cautions, further results.

    Args:
        statements: of a result; notes and details are in neither part.
    """
    of = {severity: [one for one in statements if one.severity == severity] for severity in SEVERITIES}
    headline, results = next(iter(of["result"]), None), of["result"][1:]
    shown, rest = of["result"][:1], list[Statement]()
    for one in (*of["danger"], *results[:1], *of["caution"], *results[1:]):
        (shown if fits(ordered([*shown, one], headline)) else rest).append(one)
    return ordered(shown, headline), by_severity(rest)


def ordered(statements: Iterable[Statement], headline: Statement | None) -> tuple[Statement, ...]:
    """The headline, then the others, the gravest first."""
    return tuple(sorted(by_severity(statements), key=lambda one: one is not headline))


def fits(statements: Sequence[Statement]) -> bool:
    """Whether statements are a lead within its limits."""
    lines = lines_of(statements)
    words = sum(len(f"{label} {text}".split()) for label, text in lines)
    return words <= MAX_WORDS and sum(row.count("\n") + 1 for row in written(lines, WIDTH)) <= MAX_LINES


def lines_of(statements: Iterable[Statement]) -> tuple[Line, ...]:
    """Label and sentence of each statement."""
    return tuple((one.label, one.text) for one in statements)


def written(lines: Sequence[Line], width: int) -> list[str]:
    """Lines as text: labels in a column of their own, sentences without a label as wide as all."""
    column, found = max((len(label) for label, _ in lines), default=0) + 2, []
    for label, text in lines:
        first, others = (f"{label:<{column}}", " " * column) if label else ("", "")
        wrapped = textwrap.fill(text, width, initial_indent=first, subsequent_indent=others, break_on_hyphens=False)
        found.append(wrapped)
    return found


@dataclass(frozen=True)
class Facts:
    """Pairs of a label and what there is to say; ``view`` is the key of what the interactive view of a page shows."""

    rows: tuple[tuple[str, str], ...]
    view: str = ""


@dataclass(frozen=True)
class Linked:
    """What a row of a table leads to on a page."""

    file: str = ""
    picture: bytes = b""


@dataclass(frozen=True)
class Table:
    """Cells as text; the first ``text_columns`` of them are words, the others numbers.

    ``views`` are the keys of what the interactive view of a page shows for each row, ``column_views`` for each column;
    empty where it shows nothing; ``links`` what each row leads to. A table that is cut to a screen keeps the ``least``
    first rows, and its ``worst`` one.
    """

    headers: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    text_columns: int = 1
    views: tuple[str, ...] = ()
    column_views: tuple[str, ...] = ()
    links: tuple[Linked, ...] = ()
    least: int = 3
    worst: int | None = None

    def cut(self, rows: int) -> Table:
        """The first rows, the last of them the worst one where that lies further down."""
        kept = [*range(min(rows, len(self.rows)))]
        if self.worst is not None and kept and self.worst >= len(kept):
            kept[-1] = self.worst
        views = tuple(self.views[i] for i in kept) if self.views else ()
        links = tuple(self.links[i] for i in kept) if self.links else ()
        worst = kept.index(self.worst) if self.worst in kept else None
        return replace(self, rows=tuple(self.rows[i] for i in kept), views=views, links=links, worst=worst)

    def transposed(self) -> Table:
        """Rows as columns, for a table that is too wide."""
        cells = tuple(zip(self.headers, *self.rows, strict=True))
        headers, rows = (("", *self.views) if self.views else ()), self.column_views[1:]
        return Table(cells[0], cells[1:], 1, rows, headers)


Item = str | Facts | Table
NOTES = "Notes"
"""Title of the block with what has no section."""


def _as_items(statements: Sequence[Statement]) -> tuple[Item, ...]:
    facts = [(one.label, one.text) for one in statements if one.label]
    return (*(one.text for one in statements if not one.label), *([Facts(tuple(facts))] if facts else []))


class Later(Sequence[Item]):
    """Items that are ``made`` when they are first read: a report of one screen leaves out some that take long."""

    def __init__(self, made: Callable[[], Sequence[Item]]) -> None:
        self._made = made

    @cached_property
    def _items(self) -> tuple[Item, ...]:
        return tuple(self._made())

    def __getitem__(self, place: Any) -> Any:
        return self._items[place]

    def __len__(self) -> int:
        return len(self._items)


@dataclass(frozen=True)
class Block:
    """A part of a report, mostly with a title; ``figure`` names the picture that belongs to it.

    Args:
        brief: what a report of one screen shows in place of ``items``; None: all of them, empty: not this block.
        stays: whether it is the answer, and stays on a screen that has no room for all.
    """

    title: str
    items: Sequence[Item]
    figure: str = ""
    brief: tuple[Item, ...] | None = None
    stays: bool = False

    def joined(self, statements: Sequence[Statement]) -> Block:
        """The block with statements at its end, details in the whole report alone."""
        if not statements:
            return self
        notes = [one for one in statements if one.severity != "detail"]
        brief = self.items if self.brief is None else self.brief
        short = (*brief, *_as_items(notes)) if brief or notes else ()
        return replace(self, items=(*self.items, *_as_items(statements)), brief=short)

    @property
    def short(self) -> Block:
        """The block as a report of one screen shows it."""
        return self if self.brief is None else replace(self, items=self.brief, brief=None)


@dataclass(frozen=True)
class Document:
    """What a result has to say, whatever it is shown as: statements, and blocks with its tables and figures.

    A statement that is not on the first screen is in the block that its section names, at the end; one without a
    section is in the block "Notes", which comes last. Details are left out of a report of one screen.
    """

    title: str
    statements: tuple[Statement, ...]
    blocks: tuple[Block, ...]

    @cached_property
    def _lead(self) -> tuple[tuple[Statement, ...], tuple[Statement, ...]]:
        return lead(self.statements)

    @property
    def lines(self) -> tuple[Line, ...]:
        """The first screen: the headline, dangers, cautions, results."""
        return lines_of(self._lead[0])

    @cached_property
    def whole(self) -> Document:
        """The document with every statement in its place."""
        rest = [Block("Also", (Facts(lines_of(self._lead[1])),), stays=True)] if self._lead[1] else []
        sections: dict[str, list[Statement]] = {}
        for one in self.statements:
            if one.severity in ("note", "detail"):
                sections.setdefault(one.entry.section or NOTES, []).append(one)
        blocks = [block.joined(sections.pop(block.title, [])) for block in self.blocks]
        more = [Block(title, ()).joined(ones) for title, ones in sections.items() if title != NOTES]
        last = [Block(NOTES, ()).joined(sections[NOTES])] if NOTES in sections else []
        return replace(self, blocks=tuple(block for block in (*rest, *blocks, *more, *last) if block.items))


@dataclass(frozen=True)
class Summary:
    """A result in a few lines: what it is, and its most important numbers with their labels."""

    title: str
    facts: tuple[tuple[str, str], ...]
