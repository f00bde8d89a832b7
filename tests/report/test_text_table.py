"""Tables as plain text: aligned, within the width, no word broken."""

from __future__ import annotations

import pytest

from posture_opt.report.text.text import text_table

HEADERS = ("joint", "value [deg]", "left to the nearer limit [deg]")
ROWS = [("shoulder_lift", "-124.77", "235.2"), ("elbow", "8.9", "")]
PLAIN = """\
joint          value [deg]  left to the nearer limit [deg]
-------------  -----------  ------------------------------
shoulder_lift      -124.77                           235.2
elbow                  8.9"""
NARROW = """\
joint          value [deg]   left to the
                            nearer limit
                                   [deg]
-------------  -----------  ------------
shoulder_lift      -124.77         235.2
elbow                  8.9"""


def test_words_left_numbers_right():
    assert text_table(HEADERS, ROWS) == PLAIN
    assert text_table(HEADERS, ROWS, width=100) == PLAIN


def test_the_widest_columns_are_wrapped_first():
    assert text_table(HEADERS, ROWS, width=40) == NARROW


@pytest.mark.parametrize("width", range(60))
def test_no_word_is_broken(width):
    text = text_table(HEADERS, ROWS, width=width)
    assert {word for row in (HEADERS, *ROWS) for cell in row for word in cell.split()} <= set(text.split())
    assert max(map(len, text.splitlines())) <= max(width, len("shoulder_lift") + len("-124.77") + len("nearer") + 4)


def test_no_rule_no_rows_and_characters_beyond_ascii():
    assert text_table(("σ", "is"), [("12 µm", "small")], 2, rule=False) == "σ      is\n12 µm  small"
    assert text_table(("a", "b"), []) == "a  b\n-  -"
