"""One screen of a report: what each block says in brief, cut until it fits, and what was left out."""

from __future__ import annotations

import pytest

from posture_opt.report.text.blocks import Block, Document, Facts, Table
from posture_opt.report.text.screen import SCREEN, on_a_screen
from posture_opt.report.text.text import render
from posture_opt.statements import Statement, state

LONG = "This sentence is as long as those that a report begins with, and takes more than one line of a hundred columns."
NUMBERS = Table(("no.", "x [mm]"), tuple((str(k), f"{k}.0") for k in range(100)), 0)


def said(text: str) -> tuple[Statement, ...]:
    return (state("calibration.data-warning", text=text),)


def test_a_short_report_is_whole() -> None:
    report = Document("Arm", said("Calibrated."), (Block("Data", (Facts((("Rows", "12"),)),)),))
    short = on_a_screen(report, 100, ("map.csv",))
    assert short.blocks[:-1] == report.blocks
    assert render(short).endswith("\n\n--out DIR writes report.html with figures and map.csv.\n")


@pytest.mark.parametrize("width", [60, 80, 140])
def test_a_long_one_fits_and_says_what_is_missing(width: int) -> None:
    blocks = (
        Block("Data", (LONG,), brief=("Short.",)),
        Block("Numbers", (NUMBERS,)),
        Block("Scatter", (LONG,) * 10, brief=()),
        Block("ISO 9283", (LONG,) * 30),
    )
    text = render(on_a_screen(Document("Arm", said(LONG), blocks), width, ("map.csv",)), width)
    lines = text.rstrip().splitlines()
    assert len(lines) <= SCREEN
    assert max(map(len, lines)) <= width
    assert "Short." in lines
    assert "--full prints all details, with scatter and ISO 9283." in " ".join(text.split())


def test_a_long_table_is_cut_before_anything_is_dropped() -> None:
    blocks = Block("Numbers", (NUMBERS,)), Block("Last", ("Kept.",))
    short = on_a_screen(Document("Arm", (), blocks), 100, ())
    lines = render(short).rstrip().splitlines()
    shown = sum(line.endswith(".0") for line in lines)
    assert len(lines) in (SCREEN - 1, SCREEN)
    assert f"… {100 - shown} more" in lines
    assert "Kept." in lines


def test_rows_that_are_left_out_are_named_and_the_worst_one_stays() -> None:
    rows = tuple((f"cause {k}", str(k)) for k in range(50))
    table = Table(("cause", "size"), rows, views=tuple(f"view {k}" for k in range(50)), worst=45)
    (block, _) = on_a_screen(Document("Arm", (), (Block("Causes", (table,)),)), 100, ()).blocks
    cut, more = block.items
    assert isinstance(cut, Table)
    assert cut.rows[-1] == ("cause 45", "45")
    assert cut.views[-1] == "view 45"
    assert more == f"… {50 - len(cut.rows)} more"
    few = Table(("cause", "size"), rows[:7])
    stays = Block("", (LONG,) * 15, stays=True)
    (block, *_) = on_a_screen(Document("Arm", (), (Block("Causes", (few,)), stays)), 100, ()).blocks
    cut, more = block.items
    assert isinstance(cut, Table)
    assert more == f"… {7 - len(cut.rows)} more: {', '.join(r[0] for r in rows[len(cut.rows) : 6])} and cause 6"


def test_a_table_keeps_its_least_rows_and_other_blocks_go() -> None:
    table = Table(("cause", "size"), tuple((f"cause {k}", str(k)) for k in range(10)), least=10)
    blocks = Block("Causes", (table,)), Block("Rest", (LONG,) * 4)
    short = on_a_screen(Document("Arm", (), (Block("", (LONG,) * 12, stays=True), *blocks)), 100, ())
    assert [block.title for block in short.blocks] == ["", "Causes", ""]
    assert short.blocks[1].items == (table,)


def test_a_lead_keeps_its_limits_and_what_has_no_room_comes_next() -> None:
    """Dangers first, then the answer, then what limits it: eight lines, ninety words, and nothing is lost."""
    first = state("calibration.error-reduced", what="error", nominal="1 mm", calibrated="0.1 mm")
    danger, caution = state("calibration.frame-far", "base", far="9 m", origin="the points"), said(LONG)[0]
    report = Document("Arm", (caution, first, *(caution,) * 5, danger), (Block("Data", ("Kept.",)),)).whole
    assert [text for _, text in report.lines[:2]] == [first.text, danger.text]
    assert sum(len(f"{label} {text}".split()) for label, text in report.lines) <= 90
    lead = render(report).partition("\n\n")[0].splitlines()
    assert len(lead) <= 1 + 8
    assert report.blocks[0].title == "Also"
    assert render(report).count("takes more than one line") == 6
