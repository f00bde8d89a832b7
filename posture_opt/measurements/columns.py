"""Columns of a table and their cells, as numbers and codes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from posture_opt.errors import BadValueError
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.faults import Faults
from posture_opt.measurements.number_text import NumberText
from posture_opt.measurements.table import RowBlock
from posture_opt.numerics import Array, Codes

AXES = ("x", "y", "z")
LABELS = ("pose", "goal", "target", "robot", "point")

Kind = Literal["number", "label", "side"]
_HUGE = 1e15  # in any unit; squares of larger numbers leave the range of floats sooner or later


@dataclass(frozen=True)
class Column:
    """One column: a value is ``factor * cell + offset``, in SI units, radians or degC."""

    name: str
    index: int
    kind: Kind
    factor: float = 1.0
    offset: float = 0.0
    unit: str = ""


@dataclass
class Cells:
    """The columns read so far: numbers (N,) in SI units, codes (N,) with the texts they stand for."""

    lines: list[Codes] = field(default_factory=list)
    numbers: dict[str, list[Array]] = field(default_factory=dict)
    codes: dict[str, list[Codes]] = field(default_factory=dict)
    texts: dict[str, dict[str, int]] = field(default_factory=dict)

    @property
    def line(self) -> Codes:
        """(N,) the line of each row."""
        return np.concatenate(self.lines) if self.lines else np.zeros(0, dtype=np.intp)

    def number(self, name: str) -> Array | None:
        """(N,) the values of a column; ``None`` where there is none."""
        return np.concatenate(self.numbers[name]) if name in self.numbers else None

    def code(self, name: str) -> tuple[Codes, tuple[str, ...]] | None:
        """(N,) codes in the order of first appearance, and their texts; ``None`` where there is no such column."""
        return (np.concatenate(self.codes[name]), tuple(self.texts[name])) if name in self.codes else None


def read_cells(
    blocks: Iterable[RowBlock], columns: Iterable[Column], faults: Faults, spec: DataSpec | None = None
) -> Cells:
    """All rows of the known columns; cells that cannot be used join ``faults``, each with its line.

    Args:
        spec: may state decimal mark and mark of thousands; else the first rows tell them.
    """
    cells, known, marks = Cells(), list(columns), None
    for block in blocks:
        marks = marks or _marks(block, known, faults, spec or DataSpec())
        cells.lines.append(np.asarray(block.lines, dtype=np.intp))
        for column in known:
            texts = block.cells[column.index]
            if column.kind == "label":
                names = cells.texts.setdefault(column.name, {})
                cells.codes.setdefault(column.name, []).append(_labels(texts, block.lines, column, names, faults))
                continue
            values = _numbers(texts, block.lines, column, marks, faults) * column.factor + column.offset
            cells.numbers.setdefault(column.name, []).append(values)
    return cells


def _marks(block: RowBlock, columns: Sequence[Column], faults: Faults, spec: DataSpec) -> NumberText:
    """How numbers are written, by the cells of the first rows."""

    def texts() -> Iterator[str]:
        for column in columns:
            cells = block.cells[column.index]
            if column.kind != "label" and not isinstance(cells, np.ndarray):
                yield from cells

    try:
        return NumberText.of(texts(), spec.decimal, spec.thousands)
    except BadValueError as error:
        faults.stop(error.message, error.hint)


def _labels(texts: Sequence[Any], lines: Sequence[int], column: Column, names: dict[str, int], faults: Faults) -> Codes:
    words = [_word(text) for text in texts]
    for word, line in zip(words, lines, strict=True) if "" in words else ():
        if not word:
            faults.add("the cell is empty", column.name, hint="name it, or leave out the column", line=line)
    return np.fromiter((names.setdefault(word, len(names)) for word in words), dtype=np.intp, count=len(words))


def _word(cell: Any) -> str:
    if isinstance(cell, str):
        return cell.strip()
    if isinstance(cell, float | np.floating):
        return "" if math.isnan(cell) else repr(float(cell)).removesuffix(".0")
    return "" if cell is None else str(cell)


def _numbers(given: Sequence[Any], lines: Sequence[int], column: Column, marks: NumberText, faults: Faults) -> Array:
    """(N,) floats; NaN in a column of sides means that the row does not say."""
    optional = column.kind == "side"
    texts = given if marks.plain or isinstance(given, np.ndarray) else [marks.to_plain(text) for text in given]
    try:
        if not isinstance(texts, np.ndarray) and "_" in "".join(texts):  # float() would take 1_0 for ten
            raise ValueError
        kind = texts.dtype.kind if isinstance(texts, np.ndarray) else "U"
        if kind not in "fiuU":
            raise ValueError
        values = np.fromiter(map(float, texts), dtype=float, count=len(texts))
    except (ValueError, TypeError):
        values = np.full(len(texts), math.nan)
    bad = np.flatnonzero(~(np.abs(values) < _HUGE))
    for row in map(int, bad):
        values[row] = _number(given[row], int(lines[row]), column, optional, marks, faults)
    if optional:
        for row in map(int, np.flatnonzero(~np.isin(values, (-1.0, 1.0)) & ~np.isnan(values))):
            faults.add(f"{texts[row]} is no side", column.name, texts[row], "write 1 or -1", int(lines[row]))
    return values


def _number(cell: Any, line: int, column: Column, optional: bool, marks: NumberText, faults: Faults) -> float:
    """The number in one cell, found the slow way; 0 with a fault where there is none."""
    text = _word(cell)
    if not text or (optional and text.lower() == "nan"):
        if not optional:
            said = "is NaN" if isinstance(cell, float | np.floating) else "is empty"
            faults.add(f"the cell {said}", column.name, cell, "give a number, or leave out the row", line)
        return math.nan if optional else 0.0
    try:
        if "_" in text or isinstance(cell, bool | np.bool_):
            raise ValueError
        value = float(marks.to_plain(text))
        if abs(value) < _HUGE:
            return value
        message = f"{text[:40]} is {'larger than anything measured' if math.isfinite(value) else 'not a finite number'}"
    except ValueError:
        message = f"'{text[:40]}' is not a number"
    hint = "leave out the row"
    if optional:  # a side
        faults.add(f"'{text[:40]}' is no side", column.name, cell, "write 1 or -1", line)
        return math.nan
    if text[:1].isdigit() or text[:1] in "+-.":
        hint = _hint(text, marks)
    faults.add(message, column.name, cell, hint, line)
    return 0.0


def _hint(text: str, marks: NumberText) -> str:
    if "." in text and marks.decimal == ",":
        return "write a decimal comma as in the other rows, or say data: {thousands: '.'} in the problem file"
    if "," in text:
        return "write a decimal point"
    return "the unit stands in the header, the cell is a plain number"
