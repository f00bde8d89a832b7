"""Reports as plain text: at most 100 columns, fit to be pasted into a mail."""

from __future__ import annotations

import textwrap

from posture_opt.report.blocks import Block, Facts, Report, Summary, Table
from posture_opt.report.text_table import text_table

WIDTH = 100


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
    return f"{block.title}\n{'-' * len(block.title)}\n{body}"


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
