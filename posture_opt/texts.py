"""Texts from outside, which reports, figures, programs and tables repeat: what they may hold, and cells of CSV files.

Source of the cells: RFC 4180, section 2; OWASP, "CSV Injection".
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any

from posture_opt.errors import Issue, KeyPath

# Control characters, halves of characters, and all that some language ends a line at.
_REFUSED = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff\ufffe\uffff]")
_LINE_ENDS = "\n\v\f\r\x1c\x1d\x1e\x85\u2028\u2029"
_BLANKS = f"\t{_LINE_ENDS}"


def text_fault(text: str) -> tuple[str, str] | None:
    r"""What is wrong with a text, and how to fix it; None where nothing is.

    Example:
        >>> text_fault("pin 1"), text_fault("pin\n1")
        (None, ('the text holds a line break (U+000A)', 'write it in one line'))
    """
    found = _REFUSED.search(text)
    if found is None:
        return None
    code = f"U+{ord(found[0]):04X}"
    if found[0] in _LINE_ENDS:
        return f"the text holds a line break ({code})", "write it in one line"
    if found[0] == "\t":
        return f"the text holds a tab ({code})", "write a blank"
    return f"the text holds the character {code}, which no text has", "remove it"


def one_line(text: str) -> str:
    r"""The text with a blank for each line break and tab, and ``?`` for what else no text may hold.

    Example:
        >>> one_line("a\nmovej()")
        'a movej()'
    """
    return _REFUSED.sub(lambda found: " " if found[0] in _BLANKS else "?", text)


def checked(data: Any, key: KeyPath = ()) -> tuple[Any, list[Issue]]:
    """Plain data with every text in `one_line`, and an issue for each text and name of a key that was not."""
    if isinstance(data, str):
        fault = text_fault(data)
        return (data, []) if fault is None else (one_line(data), [Issue(fault[0], key, None, fault[1])])
    issues: list[Issue] = []
    if isinstance(data, dict):
        entries = {}
        for name, entry in data.items():
            sound, found = checked(name, key)
            entries[sound], more = checked(entry, (*key, sound))
            issues += [*found, *more]
        return entries, issues
    if isinstance(data, list | tuple):
        rows = []
        for index, entry in enumerate(data):
            sound, found = checked(entry, (*key, index))
            rows.append(sound)
            issues += found
        return rows, issues
    return data, issues


_FORMULA = re.compile(r"\s*'*[=+\-@]")
# Digits and the marks between them: no formula, whatever sign it begins with.
_NUMBER = re.compile(r"\s*[-+]?[\d.,'\s]*\d[\d.,'\s]*(?:[eE][-+]?\d+)?\s*|\s*[-+]?(?:nan|inf)\s*", re.IGNORECASE)
_GUARDED = re.compile(r"\s*'(?='*[=+\-@])")


def number_or_nan(text: str) -> float:
    """The number that a text is; NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def csv_line(cells: Iterable[str], separator: str = ", ") -> str:
    """One row, without its end: numbers as they are, texts so that spreadsheets and `csv.reader` take them as texts.

    Between commas, semicolons are quoted too: in many countries spreadsheets take them for separators.

    Behind a comma there is no blank before a quoted cell, as the quotes would be part of it then.

    Example:
        >>> csv_line(["=cmd()", "-1.5", "pin 1", "a, b"])
        '\\'=cmd(), -1.5, pin 1,"a, b"'
    """
    line = ""
    quoted = ',;"' if separator.strip() == "," else f'{separator}"'
    for k, cell in enumerate(_csv_cell(cell, quoted) for cell in cells):
        before = (separator.rstrip() or separator) if cell.startswith('"') else separator
        line += (before if k else "") + cell
    return line


def _csv_cell(cell: str, quoted: str) -> str:
    text = one_line(cell)
    if _FORMULA.match(text) and not _NUMBER.fullmatch(text):
        text = "'" + text
    return '"' + text.replace('"', '""') + '"' if {*text} & {*quoted} else text


def unguarded(cell: str) -> str:
    """A text as it was before `csv_line` put an apostrophe before it.

    Example:
        >>> unguarded("'=cmd()"), unguarded("'quoted'")
        ('=cmd()', "'quoted'")
    """
    return _GUARDED.sub("", cell, count=1)
