"""Cells of CSV files as text: quoted where a comma needs it, and nothing that a spreadsheet would compute.

A text that begins with ``=``, ``+``, ``-`` or ``@`` is a formula to a spreadsheet; behind an apostrophe it is a text.
Source: RFC 4180, section 2; OWASP, "CSV Injection".
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from posture_opt.texts import one_line

_FORMULA = re.compile(r"\s*'*[=+\-@]")
_NUMBER = re.compile(r"\s*[-+]?[\d.,'\s]*\d[\d.,'\s]*(?:[eE][-+]?\d+)?\s*|\s*[-+]?(?:nan|inf)\s*", re.IGNORECASE)
"""Digits and the marks between them: no formula, whatever sign it begins with."""
_GUARDED = re.compile(r"\s*'(?='*[=+\-@])")


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
    """A cell with its apostrophe, and with its quotes where it holds one of the characters ``quoted``."""
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
