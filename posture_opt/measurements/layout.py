"""How a text table is laid out: what separates its cells, and which line names its columns."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from posture_opt.measurements.text_lines import TextLine

BLANKS = " "
_SEPARATORS = ("\t", ";", ",", BLANKS)
_UNITS = {"m", "mm", "cm", "um", "µm", "μm", "in", "deg", "°", "rad", "mrad", "s", "ms", "kg", "degC", "°C", "K"}
_NUMBER = re.compile(r"[-+]?[\d.,' ]*\d[\d.,' ]*(?:[eE][-+]?\d+)?|nan", re.IGNORECASE)
_RUN = 3  # rows of numbers behind each other; a line of numbers among the heads is none
HEAD = re.compile(r"^\s*(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*$")
ROUND = re.compile(r"^\s*(?P<name>.*?)\s*\((?P<unit>[^()]*)\)\s*$")


@dataclass(frozen=True)
class Layout:
    """Separator, heads, the line of the header (0: there is none), the lines before the rows, and what was skipped."""

    separator: str
    heads: tuple[str, ...]
    line: int
    last: int
    skipped: int = 0

    @classmethod
    def of(cls, sample: Sequence[TextLine], known: Collection[str], numbered: bool) -> Layout:
        """The layout under which most heads are known, and then most rows have as many cells as heads.

        Args:
            sample: the first lines, blank ones left out.
            known: heads that mean something, with and without their unit.
            numbered: columns are told by number, so that the file needs no header.
        """
        found = [_laid_out(sample, separator, known, numbered) for separator in _SEPARATORS]
        return max(found, key=lambda pair: pair[0])[1]

    def cells(self, text: str) -> list[str]:
        """The cells of a line."""
        return split(text, self.separator)


def split(text: str, separator: str) -> list[str]:
    """The cells of one line; between blanks, ``joint1 [deg]`` is one cell."""
    if separator == BLANKS:
        return re.sub(r"\s+\[", "[", text.strip()).split()
    return next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])


def name_of(head: str) -> str:
    """A head without its unit in brackets."""
    match = HEAD.match(head)
    return match["name"] if match else head.strip()


def is_number(cell: str) -> bool:
    """Whether a cell looks like a number, with whatever marks."""
    return bool(_NUMBER.fullmatch(cell.strip()))


def _laid_out(
    sample: Sequence[TextLine], separator: str, known: Collection[str], numbered: bool
) -> tuple[tuple[int, int, int], Layout]:
    """How well a separator fits, and the layout with it."""
    rows = [(line, split(line.text if line.comment is None else line.comment, separator)) for line in sample]
    scores = [sum(cell.strip() in known or name_of(cell) in known for cell in cells) for _, cells in rows]
    plain = [k for k, (line, _) in enumerate(rows) if line.comment is None]
    numeric = [_mostly_numbers(rows[k][1]) for k in plain]
    first = next((k for i, k in enumerate(plain) if all(numeric[i : i + _RUN])), len(rows))
    best = max(range(len(rows)), key=lambda k: (scores[k], -k), default=0)
    if not scores[best]:
        before = [k for k in plain if k < first]
        best = before[-1] if before and first < len(rows) else plain[0] if plain else 0
    headless = numbered and best == first
    width = len(rows[best][1]) if rows else 0
    same = sum(len(cells) == width for line, cells in rows[best + 1 :] if line.comment is None) if width > 1 else 0
    heads, last = ([""] * width, best - 1) if headless else _with_units(rows, best)
    while not headless and len(heads) > 1 and not heads[-1].strip():  # of instruments that end lines with a separator
        heads = heads[:-1]
    skipped = sum(k < best for k in plain)
    line = 0 if headless else rows[best][0].number
    layout = Layout(separator, tuple(heads), line, rows[last][0].number if last >= 0 else 0, skipped)
    return (scores[best], same, -_SEPARATORS.index(separator)), layout


def _mostly_numbers(cells: Sequence[str]) -> bool:
    filled = [cell for cell in cells if cell.strip()]
    return bool(filled) and sum(map(is_number, filled)) * 2 >= len(filled)


def _with_units(rows: Sequence[tuple[TextLine, list[str]]], at: int) -> tuple[list[str], int]:
    """The heads with the units of a line of units right behind them, and the last line that is no row."""
    heads = rows[at][1]
    if at + 1 >= len(rows):
        return heads, at
    cells = [cell.strip().strip("[]()") for cell in rows[at + 1][1]]
    if len(cells) != len(heads) or not any(cells) or not {*cells} <= {*_UNITS, "", "-"}:
        return heads, at
    joined = [
        f"{head.strip()} [{unit}]" if unit and "[" not in head else head
        for head, unit in zip(heads, cells, strict=True)
    ]
    return joined, at + 1
