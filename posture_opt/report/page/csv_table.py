"""Tables of targets and points as files of comma-separated values."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from posture_opt.csv_text import csv_line

if TYPE_CHECKING:
    from posture_opt.report.page.presenter import Columns


def map_csv(columns: Columns, joints: int, decimals_of_joints: int = 6) -> str:
    """The table of a map as a file: places to 0.1 µm, joints to so many decimals of deg or mm, the rest to six."""
    headers = list(columns)
    decimals = {
        **dict.fromkeys(headers[:3], 4),
        "feasible": 0,
        "listed": 0,
        **dict.fromkeys(headers[-joints:], decimals_of_joints),
    }
    cells = [[_cell(value, decimals.get(head)) for value in columns[head]] for head in headers]
    return "".join(csv_line(row) + "\n" for row in (headers, *zip(*cells, strict=True)))


def _cell(value: float, decimals: int | None) -> str:
    """A number to so many decimals, else to six digits; nothing where it is not known."""
    if math.isnan(value):
        return ""
    return f"{value + 0.0:.6g}" if decimals is None else f"{value + 0.0:.{decimals}f}"
