"""A table as plain text that survives a mail: columns two blanks apart, a rule under the header, no word broken."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from itertools import zip_longest

GAP = "  "


def text_table(
    headers: Sequence[str],
    rows: Iterable[Sequence[str]],
    text_columns: int = 1,
    width: int | None = None,
    rule: bool = True,
) -> str:
    """The table of header and rows; where it is wider than ``width``, its widest columns are wrapped.

    Args:
        headers: (k,) texts.
        rows: (k,) texts each.
        text_columns: how many columns from the left are words, aligned on the left; the others are numbers.
        width: columns of text at most, as far as no word has to be broken; None: as wide as it is.
        rule: whether dashes stand under the header.
    """
    table = [headers, *rows]
    bounds = _bounds(list(zip(*table, strict=True)), width)
    wrapped = [[_wrapped(cell, bound) for cell, bound in zip(cells, bounds, strict=True)] for cells in table]
    widths = [max(len(line) for lines in column for line in lines) for column in zip(*wrapped, strict=True)]
    rows_of_text = [_row(cells, widths, text_columns) for cells in wrapped]
    if rule:
        rows_of_text.insert(1, GAP.join("-" * size for size in widths))
    return "\n".join(rows_of_text)


def _bounds(columns: Sequence[Sequence[str]], width: int | None) -> list[int]:
    """How wide each column may be: its longest cell, cut at the largest common bound under which the table fits."""
    longest = [max(map(len, cells)) for cells in columns]
    if width is None:
        return longest
    words = [max((len(word) for cell in cells for word in cell.split()), default=1) for cells in columns]
    left = width - len(GAP) * (len(columns) - 1)
    bounds = longest
    for bound in range(max(longest, default=0), 0, -1):
        bounds = [max(word, min(size, bound)) for word, size in zip(words, longest, strict=True)]
        if sum(bounds) <= left:
            break
    return bounds


def _wrapped(cell: str, size: int) -> list[str]:
    if len(cell) <= size:
        return [cell]
    return textwrap.wrap(cell, size, break_long_words=False, break_on_hyphens=False) or [""]


def _row(cells: Sequence[Sequence[str]], widths: Sequence[int], text_columns: int) -> str:
    """The lines of one row: words on the left of their columns, numbers on the right."""
    lines = []
    for parts in zip_longest(*cells, fillvalue=""):
        aligned = [
            part.ljust(size) if k < text_columns else part.rjust(size)
            for k, (part, size) in enumerate(zip(parts, widths, strict=True))
        ]
        lines.append(GAP.join(aligned).rstrip())
    return "\n".join(lines)
