"""Columns of a table and their cells: numbers with any marks, names, sides."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Literal

import numpy as np

from posture_opt.errors import BadValueError
from posture_opt.limits import MOST_CELLS
from posture_opt.measurements.data_section import NOTHING_STATED, DataSpec
from posture_opt.measurements.kinds import KINDS
from posture_opt.measurements.kinds.pose import ORIENTATIONS
from posture_opt.measurements.kinds.position import COORDINATES
from posture_opt.measurements.table import Faults, RowBlock
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot
from posture_opt.texts import text_fault, unguarded

_MARKED_NUMBER = re.compile(r"[-+]?[\d.,]*[.,][\d.,]*(?:[eE][-+]?\d+)?")  # A number with points or commas in it
# A number with blanks or apostrophes between groups of three digits
_SPACED_NUMBER = re.compile(r"[-+]?\d{1,3}(?:['’ \u00a0\u202f]\d{3})+(?:[.,]\d*)?")


def _grouped_digits(mark: str) -> re.Pattern[str]:
    return re.compile(rf"[-+]?[1-9]\d{{0,2}}(?:{re.escape(mark)}\d{{3}})+")


@dataclass(frozen=True)
class NumberText:
    """The decimal mark of a file, and the mark between thousands where it has one."""

    decimal: str = "."
    thousands: str = ""

    @classmethod
    def of(cls, cells: Iterable[str], decimal: str | None, thousands: str | None) -> NumberText:
        if decimal is not None:
            return cls(decimal, thousands or "")
        if thousands in (".", ","):
            return cls("," if thousands == "." else ".", thousands)
        sample = islice(cells, 2000)  # a file that changes its marks later has faults there
        marked = [text for cell in sample if _MARKED_NUMBER.fullmatch(text := cell.strip())]
        if not any("," in text for text in marked):
            return cls(".", thousands or "")
        return _by_commas(marked)

    @property
    def plain(self) -> bool:
        """Whether numbers are written as programs write them."""
        return self.decimal == "." and not self.thousands

    def to_plain(self, text: str) -> str:
        """The number as programs write it; the text itself where it is none in these marks."""
        text = text.strip()
        if _SPACED_NUMBER.fullmatch(text):
            text = re.sub(r"['’ \u00a0\u202f]", "", text)
        if self.thousands and self.thousands in text:
            whole, mark, rest = text.partition(self.decimal)
            if not _grouped_digits(self.thousands).fullmatch(whole):
                return text
            text = whole.replace(self.thousands, "") + mark + rest
        return text.replace(",", ".") if self.decimal == "," and "." not in text else text


def _by_commas(marked: list[str]) -> NumberText:
    both = [text for text in marked if "," in text and "." in text]
    if both:
        last = {"," if text.rfind(",") > text.rfind(".") else "." for text in both}
        if len(last) > 1:
            raise _ambiguous_marks(both[0], "points and commas mean different things in different rows")
        decimal = last.pop()
        return NumberText(decimal, "." if decimal == "," else ",")
    commas, points = [t for t in marked if "," in t], [t for t in marked if "." in t]
    fractions = [text for text in commas if not _grouped_digits(",").fullmatch(text)]
    broken = [text for text in points if not _grouped_digits(".").fullmatch(text)]
    if fractions and broken:
        raise _ambiguous_marks(broken[0], f"{fractions[0]} has a decimal comma, {broken[0]} a decimal point")
    if fractions:
        return NumberText(",")
    if broken:
        return NumberText(".", ",")
    raise _ambiguous_marks(
        commas[0], f"{commas[0]} may be {commas[0].replace(',', '.')} or {commas[0].replace(',', '')}"
    )


def _ambiguous_marks(text: str, why: str) -> BadValueError:
    return BadValueError(why, "say in the problem file which it is: data: {decimal: ','} or data: {decimal: '.'}")


AXES = COORDINATES  # Columns of the measured tool point
_NAMES_OF_KINDS = tuple(name for kind in KINDS for name in (kind.label, kind.second_label) if name)
LABELS = ("pose", "goal", "target", "robot", "instrument", *_NAMES_OF_KINDS)  # Columns whose cells name groups of rows
# Column -> its least value [kg, degC], what is wrong below, and how to fix it
LEAST_INPUTS: dict[str, tuple[float, str, str]] = {
    "payload": (0.0, "a payload is not negative", "write 0 or more"),
    "temperature": (-273.15, "a temperature is not below absolute zero", "is the unit of the column right?"),
}

CellKind = Literal["number", "label", "side"]  # A number with a unit, a name, or a side of approach (−1, +1 or nothing)
_MAX_MAGNITUDE = 1e15  # of a cell, in its unit and in SI units; squares of larger ones leave the range of floats


@dataclass(frozen=True)
class Column:
    """One column: a value is ``factor * cell + offset``, in SI units, radians or degC."""

    name: str  # the known name of the column, without its unit
    index: int  # place in the row, from 0
    kind: CellKind  # how its cells are read
    # factor, offset: from the unit of the column
    factor: float = 1.0
    offset: float = 0.0
    unit: str = ""  # as written


@dataclass
class Cells:
    """The columns read so far, block by block."""

    lines: list[Codes] = field(default_factory=list)  # of each block the line of every row
    # column -> of each block (N,) values in SI units, radians or degC
    numbers: dict[str, list[Array]] = field(default_factory=dict)
    # column -> of each block (N,) codes, counted in the order of first appearance
    codes: dict[str, list[Codes]] = field(default_factory=dict)
    texts: dict[str, dict[str, int]] = field(default_factory=dict)  # column -> text -> its code
    marks: NumberText = field(default_factory=NumberText)  # how its numbers are written

    @property
    def line(self) -> Codes:
        """(N,) the line of each row in the file."""
        return np.concatenate(self.lines) if self.lines else np.zeros(0, dtype=np.intp)

    def number(self, name: str) -> Array | None:
        """(N,) the values of a column in SI units; ``None`` where there is none."""
        return self.present(name) if name in self.numbers else None

    def present(self, name: str) -> Array:
        """(N,) the values of a column that the header was checked for, in SI units; NaN where a cell is empty."""
        return np.concatenate(self.numbers[name])

    def code(self, name: str) -> tuple[Codes, tuple[str, ...]]:
        """(N,) codes in the order of first appearance, and their texts; zeros and none where no such column is."""
        if name not in self.codes:
            return np.zeros(len(self.line), dtype=np.intp), ()
        return np.concatenate(self.codes[name]), tuple(self.texts[name])


def read_cells(
    blocks: Iterable[RowBlock],
    columns: Iterable[Column],
    faults: Faults,
    spec: DataSpec = NOTHING_STATED,
    joints: Iterable[str] = (),
) -> Cells:
    """All rows of the known columns; cells that cannot be used join ``faults``, each with its line."""
    cells, known, marks, count = Cells(), list(columns), None, 0
    own = columns_of_kinds(spec) - {*joints}
    for block in blocks:
        count += len(block.lines) * len(known)
        if count > MOST_CELLS.most:
            faults.stop(MOST_CELLS.beyond, MOST_CELLS.hint)
        mixed = any(column.name == "instrument" for column in known)
        if marks is None:
            numbers = (block.cells[column.index] for column in known if column.kind != "label")
            texts = (text for given in numbers if not isinstance(given, np.ndarray) for text in given)
            try:
                cells.marks = marks = NumberText.of(texts, spec.decimal, spec.thousands)
            except BadValueError as error:
                faults.stop(error.message, error.hint)
        cells.lines.append(np.asarray(block.lines, dtype=np.intp))
        for column in known:
            given = block.cells[column.index]
            sparse = mixed and column.name in own
            if column.kind == "label":
                names = cells.texts.setdefault(column.name, {})
                codes = _label_codes(given, block.lines, column, names, faults, sparse)
                cells.codes.setdefault(column.name, []).append(codes)
                continue
            values = _column_numbers(given, block.lines, column, marks, faults, sparse) * column.factor + column.offset
            cells.numbers.setdefault(column.name, []).append(values)
    return cells


def without_unmeasured(
    blocks: Iterable[RowBlock], columns: dict[str, Column], own: set[str], left_out: list[int]
) -> Iterator[RowBlock]:
    """The blocks without rows of which nothing was measured, as of a hidden marker; their lines join ``left_out``."""
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
    inputs = {name: values for name in LEAST_INPUTS if (values := cells.number(name)) is not None}
    payload = inputs.get("payload", np.zeros(0))
    for row in np.flatnonzero(payload > robot.most_payload):
        message, hint = f"no arm like this one carries {payload[row]:g} kg", "is the unit of the column right?"
        faults.add(message, "payload", payload[row], hint, int(cells.line[row]))
    for name, values in inputs.items():
        least, message, hint = LEAST_INPUTS[name]
        for row in np.flatnonzero(values < least):
            faults.add(message, name, values[row], hint, int(cells.line[row]))


def _label_codes(
    texts: Sequence[Any], lines: Sequence[int], column: Column, names: dict[str, int], faults: Faults,
    sparse: bool = False,
) -> Codes:  # fmt: skip
    """(N,) codes of the words of a column; an empty cell is a fault, unless the column is ``sparse``."""
    words = [unguarded(_cell_text(text)) for text in texts]
    for word, line in zip(words, lines, strict=True) if "" in words and not sparse else ():
        if not word:
            faults.add("the cell is empty", column.name, hint="name it, or leave out the column", line=line)
    for word in {*words} - {*names}:
        if fault := text_fault(word):
            faults.add(fault[0], column.name, word, fault[1], int(lines[words.index(word)]))
    return np.fromiter((names.setdefault(word, len(names)) for word in words), dtype=np.intp, count=len(words))


def _cell_text(cell: Any) -> str:
    if isinstance(cell, str):
        return cell.strip()
    if isinstance(cell, float | np.floating):
        return "" if math.isnan(cell) else repr(float(cell)).removesuffix(".0")
    return "" if cell is None else str(cell)


def _column_numbers(
    given: Sequence[Any], lines: Sequence[int], column: Column, marks: NumberText, faults: Faults, sparse: bool = False
) -> Array:
    """(N,) floats in the unit of the column; NaN in a column of sides, or a ``sparse`` one: the row does not say."""
    optional = column.kind == "side"
    texts = given if marks.plain or isinstance(given, np.ndarray) else [marks.to_plain(text) for text in given]
    try:
        if texts.dtype.kind not in "fiuU" if isinstance(texts, np.ndarray) else "_" in "".join(texts):
            raise ValueError  # float() would take 1_0 for ten
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
    if optional:  # a side
        faults.add(f"'{text[:40]}' is no side", column.name, cell, "write 1 or -1", line)
        return math.nan
    hint = "leave out the row"
    if (text[:1].isdigit() or text[:1] in "+-.") and "." in text and marks.decimal == ",":
        hint = "write a decimal comma as in the other rows, or say data: {thousands: '.'} in the problem file"
    elif text[:1].isdigit() or text[:1] in "+-.":
        plain = "the unit is in the header, the cell is a plain number"
        hint = "write a decimal point" if "," in text else plain
    faults.add(message, column.name, cell, hint, line)
    return 0.0
