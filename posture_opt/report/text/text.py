"""Reports as plain text, as wide as the terminal: tables are fitted, and no word is broken."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterable, Sequence
from functools import partial
from itertools import zip_longest

from posture_opt.report.text.blocks import WIDTH, Block, Document, Facts, Summary, Table, written

NARROWEST, WIDEST = 60, 140


def terminal_width() -> int:
    """Columns of the terminal (``COLUMNS`` overrules it), of which reports use 60 to 140; 100 without a terminal."""
    return min(max(shutil.get_terminal_size((WIDTH, 24)).columns, NARROWEST), WIDEST)


def render(report: Document, width: int = WIDTH) -> str:
    """A report as text, every line at most ``width`` columns wide: title and answer first, without a gap."""
    head = [*textwrap.wrap(report.title or "Report", width), *written(report.lines, width)]
    return "\n\n".join(["\n".join(head), *(_block(block, width) for block in report.blocks)]) + "\n"


def render_summary(summary: Summary, width: int = WIDTH) -> str:
    """A summary as text: its title, and a fact a line."""
    facts = textwrap.indent(_facts(Facts(summary.facts), width - 2), "  ")
    return f"{textwrap.shorten(summary.title, width)}\n{facts}"


def paragraph(text: str, width: int = WIDTH) -> str:
    """Wrapped text."""
    return textwrap.fill(text, width, break_on_hyphens=False)


def _block(block: Block, width: int) -> str:
    texts = [
        paragraph(item, width) if isinstance(item, str)
        else _facts(item, width) if isinstance(item, Facts)
        else fitted_table(item, width)
        for item in block.items
    ]  # fmt: skip
    # Sentences and facts follow each other, a table keeps a blank line on both sides.
    body = texts[0] if texts else ""
    for before, item, text in zip(block.items, block.items[1:], texts[1:], strict=False):
        apart = isinstance(item, Table) or isinstance(before, Table)
        body += ("\n\n" if apart else "\n") + text
    if not block.title:
        return body
    title = textwrap.wrap(block.title, width)
    return "\n".join([*title, "-" * max(map(len, title)), body])


def _facts(facts: Facts, width: int) -> str:
    column = max((len(label) for label, _ in facts.rows), default=0) + 2
    lines = []
    for label, value in facts.rows:
        wrapped = textwrap.wrap(value, width - column, break_on_hyphens=False) or [""]
        lines += [f"{label:<{column}}{wrapped[0]}", *(" " * column + line for line in wrapped[1:])]
    return "\n".join(lines)


GAP = "  "


def fitted_table(table: Table, width: int) -> str:
    """The table in the first of these shapes that fits ``width`` columns.

    As it is; wrapped between words, unless a row gets more than three lines; with rows as columns; its columns in
    groups, each behind the words of the rows.
    """
    grid = _grid(table)
    if _width(grid) <= width:
        return grid
    wrapped = _grid(table, width)
    # Cells that wrap into more than four lines are hard to read.
    rows = _wrapped_rows([table.headers, *table.rows], width)[1:]
    tallest = max((len(lines) for cells in rows for lines in cells), default=1)
    if _width(wrapped) <= width and tallest <= 4:
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
    """The table of header and rows; where it is wider than ``width``, its widest columns are wrapped; ``headers`` (k,),
    ``rows`` (k,)."""
    wrapped = _wrapped_rows([headers, *rows], width)
    widths = [max(len(line) for lines in column for line in lines) for column in zip(*wrapped, strict=True)]
    rows_of_text = [_row(cells, widths, text_columns) for cells in wrapped]
    if rule:
        rows_of_text.insert(1, GAP.join("-" * size for size in widths))
    return "\n".join(rows_of_text)


def _grid(table: Table, width: int | None = None) -> str:
    return text_table(table.headers, table.rows, table.text_columns, width)


def _width(text: str) -> int:
    return max(map(len, text.splitlines()), default=0)


def _wrapped_rows(table: Sequence[Sequence[str]], width: int | None) -> list[list[list[str]]]:
    """The lines of every cell, cut between words."""
    bounds = _bounds(list(zip(*table, strict=True)), width)
    wrap = partial(textwrap.wrap, break_long_words=False, break_on_hyphens=False)
    return [
        [[cell] if len(cell) <= size else wrap(cell, size) or [""] for cell, size in row]
        for row in (list(zip(cells, bounds, strict=True)) for cells in table)
    ]


def _groups(table: Table, width: int) -> list[Table]:
    first = min(table.text_columns, 1)
    groups: list[list[int]] = [[]]
    for k in range(first, len(table.headers)):
        if groups[-1] and _width(_grid(_columns(table, [*range(first), *groups[-1], k]))) > width:
            groups.append([])
        groups[-1].append(k)
    return [_columns(table, [*range(first), *group]) for group in groups]


def _columns(table: Table, kept: Sequence[int]) -> Table:
    words = sum(k < table.text_columns for k in kept)
    return Table(tuple(table.headers[k] for k in kept), tuple(tuple(row[k] for k in kept) for row in table.rows), words)


def _bounds(columns: Sequence[Sequence[str]], width: int | None) -> list[int]:
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


def _row(cells: Sequence[Sequence[str]], widths: Sequence[int], text_columns: int) -> str:
    lines = []
    for parts in zip_longest(*cells, fillvalue=""):
        aligned = [
            part.ljust(size) if k < text_columns else part.rjust(size)
            for k, (part, size) in enumerate(zip(parts, widths, strict=True))
        ]
        lines.append(GAP.join(aligned).rstrip())
    return "\n".join(lines)
