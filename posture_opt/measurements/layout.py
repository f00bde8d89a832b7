"""How a text table is laid out: what separates its cells, and which line names its columns."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from posture_opt.texts import unguarded

BLANKS = " "  # Separator of cells between which there are blanks, one or more
_SEPARATORS = ("\t", ";", ",", BLANKS)  # Separators that are tried; where two fit alike, the one that comes first
# What the cells of a line of units may hold
_UNIT_WORDS = {
    *("", "-", "m", "mm", "cm", "um", "µm", "μm", "in", "deg", "°", "º", "Grad", "Grd", "rad", "mrad"),
    *("s", "ms", "kg", "degC", "°C", "K", "px"),
}
# A number with any marks, or NaN
_NUMBER_PATTERN = re.compile(r"[-+]?[\d.,' ]*\d[\d.,' ]*(?:[eE][-+]?\d+)?|nan", re.IGNORECASE)
# ``name [unit]``, the unit optional
_BRACKETED_HEADER = re.compile(r"^\s*(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*$")
# ``name (unit)``, as some instruments write it
ROUND_HEADER = re.compile(r"^\s*(?P<name>.*?)\s*\((?P<unit>[^()]*)\)\s*$")


@dataclass(frozen=True)
class TextLine:
    """One line without its end, and its number in the file."""

    number: int
    text: str

    @property
    def comment(self) -> str | None:
        """What a comment says behind its mark; ``None`` for other lines."""
        text = self.text.lstrip()
        mark = next((mark for mark in ("#", "%", "//") if text.startswith(mark)), None)
        return None if mark is None else text[len(mark) :].strip()


@dataclass(frozen=True)
class Layout:
    """How a text table is laid out."""

    separator: str  # of cells; `BLANKS` for one or more blanks
    titles: tuple[str, ...]  # the column headers
    line: int  # of the header, from 1; 0: there is none
    last: int  # the last line before the rows
    skipped: int = 0  # how many lines before the header are no comments

    @classmethod
    def of(cls, sample: Sequence[TextLine], known: Collection[str], numbered: bool) -> Layout:
        found = [_laid_out(sample, separator, known, numbered) for separator in _SEPARATORS]
        return max(found, key=lambda pair: pair[0])[1]


def split_cells(text: str, separator: str) -> list[str]:
    """The cells of one line; between blanks, ``joint1 [deg]`` is one cell."""
    if separator == BLANKS:
        return re.sub(r"\s+\[", "[", text.strip()).split()
    return [*map(unguarded, next(csv.reader([text], delimiter=separator, skipinitialspace=True), []))]


def name_and_unit(title: str) -> tuple[str, str]:
    """Name and unit of a header such as ``joint1 [deg]``; no unit where there are no brackets."""
    match = _BRACKETED_HEADER.match(title)
    return (match["name"], (match["unit"] or "").strip()) if match else (title.strip(), "")


def is_number(cell: str) -> bool:
    """Whether a cell looks like a number, with whatever marks."""
    return bool(_NUMBER_PATTERN.fullmatch(cell.strip()))


def _laid_out(
    sample: Sequence[TextLine], separator: str, known: Collection[str], numbered: bool
) -> tuple[tuple[int, int, int], Layout]:
    rows = [(line, split_cells(line.text if line.comment is None else line.comment, separator)) for line in sample]
    scores = [sum(cell.strip() in known or name_and_unit(cell)[0] in known for cell in cells) for _, cells in rows]
    plain = [k for k, (line, _) in enumerate(rows) if line.comment is None]
    filled = [[cell for cell in rows[k][1] if cell.strip()] for k in plain]
    numeric = [bool(cells) and sum(map(is_number, cells)) * 2 >= len(cells) for cells in filled]
    # Three rows of numbers behind each other begin the table; a line of numbers within the header is none.
    first = next((k for i, k in enumerate(plain) if all(numeric[i : i + 3])), len(rows))
    best = max(range(len(rows)), key=lambda k: (scores[k], -k), default=0)
    if not scores[best]:
        before = [k for k in plain if k < first]
        best = before[-1] if before and first < len(rows) else plain[0] if plain else 0
    headless = numbered and best == first
    width = len(rows[best][1]) if rows else 0
    same = sum(len(cells) == width for line, cells in rows[best + 1 :] if line.comment is None) if width > 1 else 0
    titles, last = ([""] * width, best - 1) if headless else _with_units(rows, best)
    while not headless and len(titles) > 1 and not titles[-1].strip():  # of instruments that end lines with a separator
        titles = titles[:-1]
    skipped = sum(k < best for k in plain)
    line = 0 if headless else rows[best][0].number
    layout = Layout(separator, tuple(titles), line, rows[last][0].number if last >= 0 else 0, skipped)
    return (scores[best], same, -_SEPARATORS.index(separator)), layout


def _with_units(rows: Sequence[tuple[TextLine, list[str]]], at: int) -> tuple[list[str], int]:
    titles = rows[at][1]
    if at + 1 >= len(rows):
        return titles, at
    cells = [cell.strip().strip("[]()") for cell in rows[at + 1][1]]
    if len(cells) != len(titles) or not any(cells) or not {*cells} <= _UNIT_WORDS:
        return titles, at
    both = zip(titles, cells, strict=True)
    return [f"{title.strip()} [{unit}]" if unit and "[" not in title else title for title, unit in both], at + 1
