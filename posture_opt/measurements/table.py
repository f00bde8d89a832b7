"""Rows and columns of a CSV file or of a table in memory, block by block."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NoReturn, TextIO

import numpy as np

from posture_opt.errors import InputError, Issue, KeyPath
from posture_opt.files import nearest_file

_LISTED = 20  # a column of texts has a fault in every row; what is wrong is seen from the first ones
_BLOCK = 8192  # rows held as texts at a time
_LONGEST = 100_000  # characters of a line; 20 joints with 20 digits each have 1000
TableLike = str | PathLike[str] | Mapping[str, Any] | Any
"""The path of a CSV file, a pandas DataFrame, or a mapping from column head to values."""


class Faults:
    """Issues of one file: the first ones are kept, all are counted."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.count: int = 0
        self._kept: list[Issue] = []

    def add(self, message: str, column: str = "", value: Any = None, mend: str = "", line: int = 0) -> None:
        """One more fault; ``column`` is the key of the message."""
        self.count += 1
        if len(self._kept) < _LISTED:
            key: KeyPath = (column,) if column else ()
            self._kept.append(Issue(message, key, value, mend, self.file, line))

    def refuse(self) -> None:
        """Ends the reading where anything was wrong.

        Raises:
            InputError: the issues in the order of their lines, and how many more there are.
        """
        if not self.count:
            return
        issues = sorted(self._kept, key=lambda issue: issue.line)
        if more := self.count - len(issues):
            issues.append(Issue(f"{more} more {'fault' if more == 1 else 'faults'} of this kind", file=self.file))
        raise InputError(issues)

    def stop(self, message: str, mend: str = "", line: int = 0) -> NoReturn:
        """A fault behind which nothing more can be read."""
        self.add(message, mend=mend, line=line)
        self.refuse()
        raise AssertionError("a fault was added")


@dataclass(frozen=True)
class RowBlock:
    """Some consecutive rows: their lines and, for each column, their cells (texts, or an array of numbers)."""

    lines: Sequence[int]
    cells: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class RawTable:
    """The heads of the columns, their line, and the rows behind them; ``blocks`` can be run through once."""

    heads: tuple[str, ...]
    line: int
    blocks: Iterator[RowBlock]
    faults: Faults


def open_table(source: TableLike) -> RawTable:
    """The table in a CSV file, a pandas DataFrame or a mapping from head to values.

    Raises:
        InputError: no such file, not readable, empty, or nothing of the three. Ragged rows join ``faults``.
    """
    if isinstance(source, str | PathLike):
        return _csv_table(Path(fspath(source)))
    if isinstance(source, Mapping):
        return _memory_table({str(head): np.asarray(values) for head, values in source.items()}.items())
    if hasattr(source, "iloc") and hasattr(source, "columns"):
        heads = [str(head) for head in source.columns]
        return _memory_table((head, np.asarray(source.iloc[:, i])) for i, head in enumerate(heads))
    kind = type(source).__name__
    raise InputError(Issue(f"measurements are a CSV file or a pandas DataFrame, not {kind}", mend="give the path"))


def _memory_table(columns: Any) -> RawTable:
    heads, cells = [], []
    for head, values in columns:
        heads.append(head)
        cells.append(values)
    faults = Faults("table")
    sizes = {np.shape(values) for values in cells}
    if len(sizes) != 1 or len(next(iter(sizes))) != 1:
        faults.stop("the columns of the table have different lengths" if sizes else "the table is empty")
    (size,) = next(iter(sizes))
    return RawTable(tuple(heads), 0, iter([RowBlock(range(1, size + 1), cells)] if size else []), faults)


def _csv_table(path: Path) -> RawTable:
    faults = Faults(str(path))
    rows = _rows(path, faults)
    line, heads = next(rows, (0, []))
    if not heads:
        faults.stop("the file is empty", "the first line names the columns, for example: joint1 [deg], x [mm], y [mm]")
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(heads) == 1 and mark in heads[0]:
            faults.stop(f"the columns are separated by {name}", "separate them by commas, with decimal points", line)
    if not all(head.strip().isprintable() for head in heads):
        faults.stop("the header is no plain text", "is it a CSV file, with its quotes closed?", line)
    return RawTable(tuple(heads), line, _blocks(rows, len(heads), faults), faults)


def _rows(path: Path, faults: Faults) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of every row that is not blank."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(_lines(stream, faults))
            for row in reader:
                if any(map(str.strip, row)):
                    yield reader.line_num, row
    except FileNotFoundError:
        near = nearest_file(path)
        raise InputError(Issue(f"no such file: {path}", mend=f"did you mean {near}?" if near else "")) from None
    except UnicodeDecodeError as error:
        faults.stop(f"not UTF-8 text (byte 0x{error.object[error.start]:02x})", "save the file as UTF-8")
    except csv.Error as error:
        faults.stop(f"no CSV: {error}", line=reader.line_num)
    except OSError as error:
        faults.stop(f"cannot read the file: {error.strerror}")


def _lines(stream: TextIO, faults: Faults) -> Iterator[str]:
    """The lines of a file, none so long that it fills the memory."""
    number = 0
    while text := stream.readline(_LONGEST):
        number += 1
        if len(text) == _LONGEST:
            faults.stop(f"the line has more than {_LONGEST} characters", "is it a CSV file?", number)
        yield text


def _blocks(rows: Iterator[tuple[int, list[str]]], width: int, faults: Faults) -> Iterator[RowBlock]:
    lines: list[int] = []
    kept: list[list[str]] = []
    for line, row in rows:
        if len(row) != width:
            cells = "1 cell" if len(row) == 1 else f"{len(row)} cells"
            faults.add(f"{cells} in the row, {width} columns in the header", line=line)
            continue
        lines.append(line)
        kept.append(row)
        if len(kept) == _BLOCK:
            yield RowBlock(lines, list(zip(*kept, strict=True)))
            lines, kept = [], []
    if kept:
        yield RowBlock(lines, list(zip(*kept, strict=True)))
