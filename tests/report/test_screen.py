"""One screen of a report: what each block says in brief, cut until it fits, and what was left out."""

from __future__ import annotations

from typing import Any

import pytest

from posture_opt.report.text.blocks import Block, Document, Table
from posture_opt.report.text.screen import SCREEN, on_a_screen
from posture_opt.report.text.text import render, text_table
from posture_opt.statements import state

LONG = "This sentence is as long as those that a report begins with, and takes more than one line of a hundred columns."
NUMBERS = Table(("no.", "x [mm]"), tuple((str(k), f"{k}.0") for k in range(100)), 0)


def said(text: str) -> tuple[Any, ...]:
    return (state("calibration.data-warning", text=text),)


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


# --- Tables as plain text: aligned, within the width, no word broken --------------------------------------------------

HEADERS = ("joint", "value [deg]", "left to the nearer limit [deg]")
ROWS = [("shoulder_lift", "-124.77", "235.2"), ("elbow", "8.9", "")]
PLAIN = """\
joint          value [deg]  left to the nearer limit [deg]
-------------  -----------  ------------------------------
shoulder_lift      -124.77                           235.2
elbow                  8.9"""


def test_words_left_numbers_right():
    assert text_table(HEADERS, ROWS) == PLAIN
    assert text_table(HEADERS, ROWS, width=100) == PLAIN


@pytest.mark.parametrize("width", range(60))
def test_no_word_is_broken(width):
    text = text_table(HEADERS, ROWS, width=width)
    assert {word for row in (HEADERS, *ROWS) for cell in row for word in cell.split()} <= set(text.split())
    assert max(map(len, text.splitlines())) <= max(width, len("shoulder_lift") + len("-124.77") + len("nearer") + 4)
