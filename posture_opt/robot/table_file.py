"""A Denavit-Hartenberg table in a text file: one row a joint, the keys of a joint as columns with their units."""

from __future__ import annotations

import csv
import re
from pathlib import Path

from posture_opt.errors import InputError, Issue
from posture_opt.files import content, located, naming

_MOST_BYTES = 1_000_000
_HEADER = re.compile(r"^\s*(?P<key>[A-Za-z_]+)\s*(?:\[(?P<unit>[^\]]*)\]|\((?P<braced>[^)]*)\))?\s*$")


def table_rows(folder: Path, file: str) -> list[dict[str, object]]:
    """What a section ``joints`` would state: columns ``name, type, a [mm], alpha [deg], d [mm], theta [deg], lower
    [deg], upper [deg]``, of which any but the name may be left out."""
    path = located(folder, file)
    try:
        text = content(path, _MOST_BYTES).decode("utf-8-sig", "replace")
    except InputError as error:
        raise naming(path, error) from None
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    separator = max(",;\t", key=(lines or [""])[0].count)
    header, *rows = [*csv.reader(lines, delimiter=separator)] or [[]]
    found = [_HEADER.match(title) for title in header]
    if not rows or not all(found) or any(len(row) != len(header) for row in rows):
        hint = "name, a [mm], alpha [deg], d [mm], theta [deg], lower [deg], upper [deg]"
        raise InputError(Issue("this is no table with one row a joint", hint=hint, file=str(path)))
    columns = [(match["key"].lower(), (match["unit"] or match["braced"] or "").strip()) for match in found if match]
    return [_joint(row, columns, number, separator) for number, row in enumerate(rows, 1)]


def _joint(row: list[str], columns: list[tuple[str, str]], number: int, separator: str) -> dict[str, object]:
    decimal = (lambda text: text.replace(",", ".")) if separator != "," else str
    stated: dict[str, object] = {"name": f"q{number}"}
    for (key, unit), cell in zip(columns, map(str.strip, row), strict=True):
        if cell:
            stated[key] = f"{decimal(cell)} {unit}" if unit else cell
    limits = [stated.pop(key) for key in ("lower", "upper") if key in stated]
    return {**stated, "limits": limits} if limits else stated
