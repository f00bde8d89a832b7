"""Columns of a table and their cells, as numbers and codes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from posture_opt.csv_text import unguarded
from posture_opt.errors import BadValueError
from posture_opt.limits import MOST_CELLS
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.faults import Faults
from posture_opt.measurements.kinds import KINDS
from posture_opt.measurements.kinds.pose_columns import ORIENTATIONS
from posture_opt.measurements.kinds.position import COORDINATES
from posture_opt.measurements.number_text import NumberText
from posture_opt.measurements.table import RowBlock
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot
from posture_opt.texts import text_fault

AXES = COORDINATES
"""Columns of the measured tool point."""
_NAMES_OF_KINDS = tuple(name for kind in KINDS for name in (kind.label, kind.second_label) if name)
LABELS = ("pose", "goal", "target", "robot", "instrument", *_NAMES_OF_KINDS)
"""Columns whose cells name groups of rows."""
LEAST_INPUTS: dict[str, tuple[float, str, str]] = {
    "payload": (0.0, "a payload is not negative", "write 0 or more"),
    "temperature": (-273.15, "a temperature is not below absolute zero", "is the unit of the column right?"),
}
"""Column -> its least value [kg, degC], what is wrong below, and how to fix it."""

CellKind = Literal["number", "label", "side"]
"""A number with a unit, a name, or a side of approach (−1, +1 or nothing)."""
_MAX_MAGNITUDE = 1e15
"""Largest number of a cell, in its unit and in SI units; squares of larger ones leave the range of floats."""


@dataclass(frozen=True)
class Column:
    """One column: a value is ``factor * cell + offset``, in SI units, radians or degC.

    Args:
        name: the known name of the column, without its unit.
        index: place in the row, from 0.
        kind: how its cells are read.
        factor, offset: from the unit of the column.
        unit: as written.
    """

    name: str
    index: int
    kind: CellKind
    factor: float = 1.0
    offset: float = 0.0
    unit: str = ""


@dataclass
class Cells:
    """The columns read so far, block by block.

    Args:
        lines: of each block the line of every row.
        numbers: column -> of each block (N,) values in SI units, radians or degC.
        codes: column -> of each block (N,) codes, counted in the order of first appearance.
        texts: column -> text -> its code.
        marks: how its numbers are written.
    """

    lines: list[Codes] = field(default_factory=list)
    numbers: dict[str, list[Array]] = field(default_factory=dict)
    codes: dict[str, list[Codes]] = field(default_factory=dict)
    texts: dict[str, dict[str, int]] = field(default_factory=dict)
    marks: NumberText = field(default_factory=NumberText)

    @property
    def line(self) -> Codes:
        """(N,) the line of each row in the file."""
        return np.concatenate(self.lines) if self.lines else np.zeros(0, dtype=np.intp)

    def number(self, name: str) -> Array | None:
        """(N,) the values of a column in SI units; ``None`` where there is none."""
        return np.concatenate(self.numbers[name]) if name in self.numbers else None

    def code(self, name: str) -> tuple[Codes, tuple[str, ...]] | None:
        """(N,) codes in the order of first appearance, and their texts; ``None`` where there is no such column."""
        return (np.concatenate(self.codes[name]), tuple(self.texts[name])) if name in self.codes else None


def read_cells(
    blocks: Iterable[RowBlock],
    columns: Iterable[Column],
    faults: Faults,
    spec: DataSpec | None = None,
    joints: Iterable[str] = (),
) -> Cells:
    """All rows of the known columns; cells that cannot be used join ``faults``, each with its line.

    Args:
        blocks: the rows, run through once.
        columns: which columns to read, and how.
        faults: of the file.
        spec: may state decimal mark and mark of thousands; else the first rows decide.
        joints: their columns are of every row, whatever their names.

    Raises:
        InputError: more cells than are accepted.
    """
    cells, known, marks, count = Cells(), list(columns), None, 0
    own = columns_of_kinds(spec or DataSpec()) - {*joints}
    for block in blocks:
        count += len(block.lines) * len(known)
        if count > MOST_CELLS.most:
            faults.stop(MOST_CELLS.beyond, MOST_CELLS.hint)
        mixed = any(column.name == "instrument" for column in known)
        cells.marks = marks = marks or _number_marks(block, known, faults, spec or DataSpec())
        cells.lines.append(np.asarray(block.lines, dtype=np.intp))
        for column in known:
            texts = block.cells[column.index]
            sparse = mixed and column.name in own
            if column.kind == "label":
                names = cells.texts.setdefault(column.name, {})
                codes = _label_codes(texts, block.lines, column, names, faults, sparse)
                cells.codes.setdefault(column.name, []).append(codes)
                continue
            values = _column_numbers(texts, block.lines, column, marks, faults, sparse) * column.factor + column.offset
            cells.numbers.setdefault(column.name, []).append(values)
    return cells


def without_unmeasured(
    blocks: Iterable[RowBlock], columns: dict[str, Column], own: set[str], left_out: list[int]
) -> Iterator[RowBlock]:
    """The blocks without rows of which nothing was measured, as of a hidden marker; their lines join ``left_out``.

    Args:
        columns: of the file; own: those of numbers that hold what was measured.
    """
    measured = [c.index for name, c in columns.items() if name in own and c.kind == "number"]
    for block in blocks:
        texts = [block.cells[i] for i in measured]
        if not texts or any(isinstance(cells, np.ndarray) for cells in texts):
            yield block
            continue
        kept = [r for r, row in enumerate(zip(*texts, strict=True)) if any(cell.strip() for cell in row)]
        if len(kept) < len(block.lines):
            left_out += sorted({*block.lines} - {block.lines[r] for r in kept})
            block = RowBlock([block.lines[r] for r in kept], [[cells[r] for r in kept] for cells in block.cells])
        if block.lines:
            yield block


def columns_of_kinds(spec: DataSpec) -> set[str]:
    """Columns that rows of one kind have and those of another leave empty, where a file mixes them."""
    return {*_NAMES_OF_KINDS, *ORIENTATIONS, *(name for kind in KINDS for name in kind.columns_in(spec))}


def check_inputs(cells: Cells, robot: Robot, faults: Faults) -> None:
    """A fault for each payload and temperature that nothing can have, by `LEAST_INPUTS` and the mass of the arm."""
    payload = cells.number("payload")
    payload = np.zeros(0) if payload is None else payload
    for row in np.flatnonzero(payload > robot.most_payload):
        message, hint = f"no arm like this one carries {payload[row]:g} kg", "is the unit of the column right?"
        faults.add(message, "payload", payload[row], hint, int(cells.line[row]))
    for name, (least, message, hint) in LEAST_INPUTS.items():
        values = cells.number(name)
        if values is not None:
            for row in np.flatnonzero(values < least):
                faults.add(message, name, values[row], hint, int(cells.line[row]))


def _number_marks(block: RowBlock, columns: Sequence[Column], faults: Faults, spec: DataSpec) -> NumberText:
    """How numbers are written, by the cells of the first rows.

    Raises:
        InputError: they could be read in two ways.
    """

    def texts() -> Iterator[str]:
        for column in columns:
            cells = block.cells[column.index]
            if column.kind != "label" and not isinstance(cells, np.ndarray):
                yield from cells

    try:
        return NumberText.of(texts(), spec.decimal, spec.thousands)
    except BadValueError as error:
        faults.stop(error.message, error.hint)


def _label_codes(
    texts: Sequence[Any], lines: Sequence[int], column: Column, names: dict[str, int], faults: Faults,
    sparse: bool = False,
) -> Codes:  # fmt: skip
    """(N,) codes of the words of a column; an empty cell is a fault, unless the column is ``sparse``.

    ``names`` gains the words that are new.
    """
    words = [unguarded(_cell_text(text)) for text in texts]
    for word, line in zip(words, lines, strict=True) if "" in words and not sparse else ():
        if not word:
            faults.add("the cell is empty", column.name, hint="name it, or leave out the column", line=line)
    for word in {*words} - {*names}:
        if fault := text_fault(word):
            faults.add(fault[0], column.name, word, fault[1], int(lines[words.index(word)]))
    return np.fromiter((names.setdefault(word, len(names)) for word in words), dtype=np.intp, count=len(words))


def _cell_text(cell: Any) -> str:
    """A cell as text without blanks around it; a float that is whole without its ``.0``, NaN as an empty text."""
    if isinstance(cell, str):
        return cell.strip()
    if isinstance(cell, float | np.floating):
        return "" if math.isnan(cell) else repr(float(cell)).removesuffix(".0")
    return "" if cell is None else str(cell)


def _column_numbers(
    given: Sequence[Any], lines: Sequence[int], column: Column, marks: NumberText, faults: Faults, sparse: bool = False
) -> Array:
    """(N,) floats in the unit of the column; NaN in a column of sides, or a ``sparse`` one: the row does not say.

    All cells are converted at once; only those that fail are looked at one by one.
    """
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
    bad = np.flatnonzero(~(np.abs(values) < _MAX_MAGNITUDE / min(column.factor, 1.0)))
    for row in map(int, bad):
        if sparse and _cell_text(given[row]).lower() in ("", "nan"):
            values[row] = math.nan
        else:
            values[row] = _cell_number(given[row], int(lines[row]), column, optional, marks, faults)
    if optional:
        for row in map(int, np.flatnonzero(~np.isin(values, (-1.0, 1.0)) & ~np.isnan(values))):
            faults.add(f"{texts[row]} is no side", column.name, texts[row], "write 1 or -1", int(lines[row]))
    return values


def _cell_number(cell: Any, line: int, column: Column, optional: bool, marks: NumberText, faults: Faults) -> float:
    """The number in one cell, found the slow way; 0 with a fault where there is none, NaN in a column of sides."""
    text = _cell_text(cell)
    if not text or (optional and text.lower() == "nan"):
        if not optional:
            said = "is NaN" if isinstance(cell, float | np.floating) else "is empty"
            faults.add(f"the cell {said}", column.name, cell, "give a number, or leave out the row", line)
        return math.nan if optional else 0.0
    try:
        if "_" in text or isinstance(cell, bool | np.bool_):
            raise ValueError
        value = float(marks.to_plain(text))
        if abs(value) < _MAX_MAGNITUDE / min(column.factor, 1.0):
            return value
        message = f"{text[:40]} is {'larger than anything measured' if math.isfinite(value) else 'not a finite number'}"
    except ValueError:
        message = f"'{text[:40]}' is not a number"
    hint = "leave out the row"
    if optional:  # a side
        faults.add(f"'{text[:40]}' is no side", column.name, cell, "write 1 or -1", line)
        return math.nan
    if text[:1].isdigit() or text[:1] in "+-.":
        hint = _mark_hint(text, marks)
    faults.add(message, column.name, cell, hint, line)
    return 0.0


def _mark_hint(text: str, marks: NumberText) -> str:
    """What to write in place of a text that begins like a number."""
    if "." in text and marks.decimal == ",":
        return "write a decimal comma as in the other rows, or say data: {thousands: '.'} in the problem file"
    if "," in text:
        return "write a decimal point"
    return "the unit is in the header, the cell is a plain number"
