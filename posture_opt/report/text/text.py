"""Reports as plain text, as wide as the terminal: nothing in a table is broken inside a word."""

from __future__ import annotations

import shutil
import textwrap

from posture_opt.report.text.blocks import Block, Document, Facts, Item, Summary, Table
from posture_opt.report.text.lead import WIDTH, written
from posture_opt.report.text.text_table import fitted_table

NARROWEST, WIDEST = 60, 140


def terminal_width() -> int:
    """Columns of the terminal (``COLUMNS`` overrules it), of which reports use 60 to 140; 100 without a terminal."""
    return min(max(shutil.get_terminal_size((WIDTH, 24)).columns, NARROWEST), WIDEST)


def render(report: Document, width: int = WIDTH) -> str:
    """A report as text, every line at most ``width`` columns wide: title and answer first, without a gap.

    A block is its title, a line of dashes, and its items; a blank line is between blocks.
    """
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
    """A block as text: sentences and facts follow each other closely, a table has a blank line on both sides."""
    texts = [_item(item, width) for item in block.items]
    # Sentences and facts follow each other, a table keeps a blank line on both sides.
    body = texts[0] if texts else ""
    for before, item, text in zip(block.items, block.items[1:], texts[1:], strict=False):
        apart = isinstance(item, Table) or isinstance(before, Table)
        body += ("\n\n" if apart else "\n") + text
    if not block.title:
        return body
    title = textwrap.wrap(block.title, width)
    return "\n".join([*title, "-" * max(map(len, title)), body])


def _item(item: Item, width: int) -> str:
    """A sentence, facts or a table as text."""
    if isinstance(item, str):
        return paragraph(item, width)
    return _facts(item, width) if isinstance(item, Facts) else fitted_table(item, width)


def _facts(facts: Facts, width: int) -> str:
    """Facts as two columns, labels and wrapped texts."""
    column = max((len(label) for label, _ in facts.rows), default=0) + 2
    lines = []
    for label, value in facts.rows:
        wrapped = textwrap.wrap(value, width - column, break_on_hyphens=False) or [""]
        lines += [f"{label:<{column}}{wrapped[0]}", *(" " * column + line for line in wrapped[1:])]
    return "\n".join(lines)
