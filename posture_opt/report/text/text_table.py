"""Tables as plain text, fitted to a width: cells wrapped between words, rows as columns, or columns in groups."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from itertools import zip_longest

from posture_opt.report.text.blocks import Table

GAP = "  "
_MAX_ROW_LINES = 4  # of a row: cells that wrap more often are hard to read


def fitted_table(table: Table, width: int) -> str:
    """The table in the first of these shapes that fits ``width`` columns.

    As it is; wrapped between words, unless a row gets more than three lines; with rows as columns; its columns in
    groups, each behind the words of the rows.
    """
    grid = _grid(table)
    if _width(grid) <= width:
        return grid
    wrapped = _grid(table, width)
    if _width(wrapped) <= width and _tallest(table, width) <= _MAX_ROW_LINES:
        return wrapped
    turned = _grid(table.transposed())
    if _width(turned) <= width:
        return turned
    groups = _groups(table, width)
    return "\n\n".join(_grid(group, width) for group in groups) if len(groups) > 1 else wrapped


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
        rule: whether dashes are under the header.
    """
    wrapped = _wrapped_rows([headers, *rows], width)
    widths = [max(len(line) for lines in column for line in lines) for column in zip(*wrapped, strict=True)]
    rows_of_text = [_row(cells, widths, text_columns) for cells in wrapped]
    if rule:
        rows_of_text.insert(1, GAP.join("-" * size for size in widths))
    return "\n".join(rows_of_text)


def _grid(table: Table, width: int | None = None) -> str:
    """The whole table as text."""
    return text_table(table.headers, table.rows, table.text_columns, width)


def _width(text: str) -> int:
    """The length of the longest line."""
    return max(map(len, text.splitlines()), default=0)


def _tallest(table: Table, width: int) -> int:
    """Lines of the tallest row below the header."""
    rows = _wrapped_rows([table.headers, *table.rows], width)[1:]
    return max((len(lines) for cells in rows for lines in cells), default=1)


def _wrapped_rows(table: Sequence[Sequence[str]], width: int | None) -> list[list[list[str]]]:
    """The lines of every cell."""
    bounds = _bounds(list(zip(*table, strict=True)), width)
    return [[_wrapped(cell, bound) for cell, bound in zip(cells, bounds, strict=True)] for cells in table]


def _groups(table: Table, width: int) -> list[Table]:
    """The table cut between columns into tables that fit, each beginning with the first column of words."""
    first = min(table.text_columns, 1)
    groups: list[list[int]] = [[]]
    for k in range(first, len(table.headers)):
        if groups[-1] and _width(_grid(_columns(table, [*range(first), *groups[-1], k]))) > width:
            groups.append([])
        groups[-1].append(k)
    return [_columns(table, [*range(first), *group]) for group in groups]


def _columns(table: Table, kept: Sequence[int]) -> Table:
    """The table of some of its columns."""
    words = sum(k < table.text_columns for k in kept)
    return Table(tuple(table.headers[k] for k in kept), tuple(tuple(row[k] for k in kept) for row in table.rows), words)


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
    """The lines of one cell, cut between words."""
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
