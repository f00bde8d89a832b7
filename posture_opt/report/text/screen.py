"""A report on one screen: what each block says in brief, long tables cut, and in the last line what was left out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from posture_opt.errors import enumerated
from posture_opt.report.text.blocks import Block, Document, Item, Table
from posture_opt.report.text.text import render

SCREEN = 45
"""Lines of the report, the last of which says what else there is."""
_MAX_NAMED_SECTIONS = 3  # sections that the last line names


def on_a_screen(report: Document, width: int, saved: Sequence[str]) -> Document:
    """The report in at most ``SCREEN`` lines of ``width`` columns: its title, its lead, and what fits of its blocks.

    Too long, its last long table is cut first, then blocks are left out from the end; title, lead and blocks that are
    to stay are whole, beyond the screen if need be.

    Args:
        saved: what ``--out`` writes next to the report, for the last line.
    """
    kept = [_Shown.of(block.short) for block in report.blocks if block.short.items]
    while _lines(short := _ended(report, kept, saved), width) > SCREEN and kept:
        excess = _lines(short, width) - SCREEN
        place = next((k for k in reversed(range(len(kept))) if kept[k].rows > kept[k].least), None)
        if place is None:
            # The last block that is so long that the rest fits without it, else the last that may go.
            blocks = {k: shown.block for k, shown in enumerate(kept) if not shown.whole.stays}
            sizes = {k: _lines(Document("", (), (block,)), width) - 1 for k, block in blocks.items()}
            if not sizes:
                break
            kept.pop(max((k for k, size in sizes.items() if size >= excess), default=max(sizes)))
        else:
            kept[place] = replace(kept[place], rows=max(kept[place].least, kept[place].rows - excess))
    return short


@dataclass(frozen=True)
class _Shown:
    """A block with so many ``rows`` of its longest table; ``least`` of them stay however long the rest is."""

    whole: Block
    rows: int
    least: int

    @classmethod
    def of(cls, whole: Block) -> _Shown:
        tables = (item for item in whole.items if isinstance(item, Table))
        table = max(tables, key=lambda table: len(table.rows), default=None)
        return cls(whole, 0, 0) if table is None else cls(whole, len(table.rows), table.least)

    @property
    def block(self) -> Block:
        """The block, and behind a table that is cut how many more rows there are."""
        items: list[Item] = []
        longest = _Shown.of(self.whole).rows
        for item in self.whole.items:
            cut = isinstance(item, Table) and len(item.rows) == longest > self.rows
            items += _cut(item, self.rows) if cut and isinstance(item, Table) else (item,)
        return replace(self.whole, items=tuple(items))


def _cut(table: Table, rows: int) -> tuple[Table, str]:
    short = table.cut(rows)
    left = [row[0] for row in table.rows if row not in short.rows]
    # Up to eight rows left out are named.
    named = table.text_columns > 0 and len(left) <= 8 and all(left)
    return short, f"… {len(table.rows) - rows} more{f': {enumerated(left)}' if named else ''}"


def _ended(report: Document, kept: Sequence[_Shown], saved: Sequence[str]) -> Document:
    blocks = tuple(shown.block for shown in kept)
    shown = {block.title for block in blocks}
    left = [block.title for block in report.blocks if block.title not in shown]
    whole = not left and all(block in report.blocks for block in blocks)
    return replace(report, blocks=(*blocks, Block("", (more_words([] if whole else left, whole, saved),))))


def more_words(left: Iterable[str], whole: bool, saved: Sequence[str]) -> str:
    """What ``--full`` and ``--out`` would show."""
    # Inside a sentence; abbreviations keep their capitals.
    titles = [title if title[1:2].isupper() else title[:1].lower() + title[1:] for title in left]
    more = [f"{len(titles) - _MAX_NAMED_SECTIONS} more sections"] if len(titles) > _MAX_NAMED_SECTIONS + 1 else []
    named = [*titles[:_MAX_NAMED_SECTIONS], *more] if more else titles
    what = f"all details, with {enumerated(named)}" if named else "all details"
    full = "" if whole else f"--full prints {what}. "
    return f"{full}--out DIR writes {enumerated(['report.html with figures', *saved])}."


def _lines(report: Document, width: int) -> int:
    return render(report, width).rstrip("\n").count("\n") + 1
