"""Reports and tables as plain text: at most 100 columns, fit to be pasted into a mail."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from itertools import zip_longest

from posture_opt.report.blocks import Block, Facts, Report, Summary, Table

WIDTH = 100
GAP = "  "


def render(report: Report) -> str:
    """A report as text, every line at most 100 columns wide."""
    title = textwrap.wrap(report.title, WIDTH) or ["Report"]
    parts = ["\n".join([*title, "=" * max(map(len, title))])]
    if report.lead:
        parts.append("\n".join(map(paragraph, report.lead)))
    parts += [_block(block) for block in report.blocks]
    return "\n\n".join(parts) + "\n"


def render_summary(summary: Summary) -> str:
    """A summary as text: its title, and a fact a line."""
    facts = textwrap.indent(_facts(Facts(summary.facts), WIDTH - 2), "  ")
    return f"{textwrap.shorten(summary.title, WIDTH)}\n{facts}"


def paragraph(text: str, indent: str = "") -> str:
    """Wrapped text."""
    return textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)


def _block(block: Block) -> str:
    texts = [_item(item) for item in block.items]
    # Sentences and facts stand close together, a table keeps a blank line on both sides.
    body = texts[0] if texts else ""
    for before, item, text in zip(block.items, block.items[1:], texts[1:], strict=False):
        apart = isinstance(item, Table) or isinstance(before, Table)
        body += ("\n\n" if apart else "\n") + text
    return f"{block.title}\n{'-' * len(block.title)}\n{body}" if block.title else body


def _item(item: str | Facts | Table) -> str:
    if isinstance(item, str):
        return paragraph(item)
    return _facts(item) if isinstance(item, Facts) else _table(item)


def _facts(facts: Facts, width: int = WIDTH) -> str:
    column = max((len(label) for label, _ in facts.rows), default=0) + 2
    lines = []
    for label, value in facts.rows:
        wrapped = textwrap.wrap(value, width - column, break_on_hyphens=False) or [""]
        lines += [f"{label:<{column}}{wrapped[0]}", *(" " * column + line for line in wrapped[1:])]
    return "\n".join(lines)


def _table(table: Table) -> str:
    text = _grid(table)
    if _width(text) <= WIDTH:
        return text
    turned = _grid(table.transposed())
    return turned if _width(turned) <= WIDTH else _grid(table, WIDTH)


def _grid(table: Table, width: int | None = None) -> str:
    return text_table(table.headers, table.rows, table.text_columns, width)


def _width(text: str) -> int:
    return max(map(len, text.splitlines()), default=0)


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
