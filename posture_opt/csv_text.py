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
_QUOTED = re.compile(r"[\",;]")
_GUARDED = re.compile(r"\s*'(?='*[=+\-@])")


def csv_line(cells: Iterable[str], separator: str = ", ") -> str:
    """One row, without its end: numbers as they are, texts so that spreadsheets and `csv.reader` take them as texts.

    Behind a comma there is no blank before a quoted cell, as the quotes would be part of it then.

    Example:
        >>> csv_line(["=cmd()", "-1.5", "pin 1", "a, b"])
        '\\'=cmd(), -1.5, pin 1,"a, b"'
    """
    line = ""
    for k, cell in enumerate(map(_csv_cell, cells)):
        before = separator.rstrip() if cell.startswith('"') else separator
        line += (before if k else "") + cell
    return line


def _csv_cell(cell: str) -> str:
    """A cell with its apostrophe and its quotes, where it needs them."""
    text = one_line(cell)
    if _FORMULA.match(text) and not _NUMBER.fullmatch(text):
        text = "'" + text
    return '"' + text.replace('"', '""') + '"' if _QUOTED.search(text) else text


def unguarded(cell: str) -> str:
    """A text as it was before `csv_line` put an apostrophe before it.

    Example:
        >>> unguarded("'=cmd()"), unguarded("'quoted'")
        ('=cmd()', "'quoted'")
    """
    return _GUARDED.sub("", cell, count=1)
