"""How a text table is laid out: what separates its cells, and which line names its columns."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from posture_opt.csv_text import unguarded
from posture_opt.measurements.text_lines import TextLine

BLANKS = " "
"""Separator of cells between which there are blanks, one or more."""
_SEPARATORS = ("\t", ";", ",", BLANKS)
"""Separators that are tried; where two fit alike, the one that comes first."""
_UNIT_WORDS = {
    "m",
    "mm",
    "cm",
    "um",
    "µm",
    "μm",
    "in",
    "deg",
    "°",
    "º",
    "Grad",
    "Grd",
    "rad",
    "mrad",
    "s",
    "ms",
    "kg",
    "degC",
    "°C",
    "K",
    "px",
}
"""What the cells of a line of units may hold."""
_NUMBER_PATTERN = re.compile(r"[-+]?[\d.,' ]*\d[\d.,' ]*(?:[eE][-+]?\d+)?|nan", re.IGNORECASE)
"""A number with any marks, or NaN."""
_MIN_NUMBER_ROWS = 3
"""Rows of numbers behind each other that begin the table; a line of numbers within the header is none."""
BRACKETED_HEADER = re.compile(r"^\s*(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*$")
"""``name [unit]``, the unit optional."""
ROUND_HEADER = re.compile(r"^\s*(?P<name>.*?)\s*\((?P<unit>[^()]*)\)\s*$")
"""``name (unit)``, as some instruments write it."""


@dataclass(frozen=True)
class Layout:
    """How a text table is laid out.

    Args:
        separator: of cells; `BLANKS` for one or more blanks.
        titles: the column headers.
        line: of the header, from 1; 0: there is none.
        last: the last line before the rows.
        skipped: how many lines before the header are no comments.
    """

    separator: str
    titles: tuple[str, ...]
    line: int
    last: int
    skipped: int = 0

    @classmethod
    def of(cls, sample: Sequence[TextLine], known: Collection[str], numbered: bool) -> Layout:
        """The layout under which most column headers are known, and then most rows have as many cells as headers.

        Args:
            sample: the first lines, blank ones left out.
            known: headers that mean something, with and without their unit.
            numbered: columns are given by number, so that the file needs no header.
        """
        found = [_laid_out(sample, separator, known, numbered) for separator in _SEPARATORS]
        return max(found, key=lambda pair: pair[0])[1]

    def cells(self, text: str) -> list[str]:
        """The cells of a line."""
        return split_cells(text, self.separator)


def split_cells(text: str, separator: str) -> list[str]:
    """The cells of one line; between blanks, ``joint1 [deg]`` is one cell."""
    if separator == BLANKS:
        return re.sub(r"\s+\[", "[", text.strip()).split()
    return [*map(unguarded, next(csv.reader([text], delimiter=separator, skipinitialspace=True), []))]


def name_of(title: str) -> str:
    """A column header without its unit in brackets.

    Example:
        >>> name_of("joint1 [deg]")
        'joint1'
    """
    match = BRACKETED_HEADER.match(title)
    return match["name"] if match else title.strip()


def is_number(cell: str) -> bool:
    """Whether a cell looks like a number, with whatever marks."""
    return bool(_NUMBER_PATTERN.fullmatch(cell.strip()))


def _laid_out(
    sample: Sequence[TextLine], separator: str, known: Collection[str], numbered: bool
) -> tuple[tuple[int, int, int], Layout]:
    """How well a separator fits (known headers, rows of that width, rank of the separator), and the layout with it."""
    rows = [(line, split_cells(line.text if line.comment is None else line.comment, separator)) for line in sample]
    scores = [sum(cell.strip() in known or name_of(cell) in known for cell in cells) for _, cells in rows]
    plain = [k for k, (line, _) in enumerate(rows) if line.comment is None]
    numeric = [_mostly_numbers(rows[k][1]) for k in plain]
    first = next((k for i, k in enumerate(plain) if all(numeric[i : i + _MIN_NUMBER_ROWS])), len(rows))
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


def _mostly_numbers(cells: Sequence[str]) -> bool:
    """Whether at least half of the filled cells are numbers."""
    filled = [cell for cell in cells if cell.strip()]
    return bool(filled) and sum(map(is_number, filled)) * 2 >= len(filled)


def _with_units(rows: Sequence[tuple[TextLine, list[str]]], at: int) -> tuple[list[str], int]:
    """The column headers with the units of a line of units right behind them, and the last line that is no row."""
    titles = rows[at][1]
    if at + 1 >= len(rows):
        return titles, at
    cells = [cell.strip().strip("[]()") for cell in rows[at + 1][1]]
    if len(cells) != len(titles) or not any(cells) or not {*cells} <= {*_UNIT_WORDS, "", "-"}:
        return titles, at
    joined = [
        f"{title.strip()} [{unit}]" if unit and "[" not in title else title
        for title, unit in zip(titles, cells, strict=True)
    ]
    return joined, at + 1
