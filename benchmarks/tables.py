"""The tables that benchmarks print."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from posture_opt.report.text.text import text_table


def table(headers: Sequence[str], rows: Iterable[Sequence[Any]], formats: Sequence[str]) -> str:
    """Rows as text; ``formats`` has the format specification of each column, for what is missing stands a dash."""
    cells = [
        ["–" if value is None else format(value, spec) for value, spec in zip(row, formats, strict=True)]
        for row in rows
    ]
    return text_table(headers, cells)
