"""Rows and columns of a text file or of a table in memory, block by block."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.files import naming
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.faults import Faults
from posture_opt.measurements.layout import BLANKS, Layout, is_number, split_cells
from posture_opt.measurements.text_lines import WINDOWS_ENCODING, TextLine, encoding_of, lines_of

_BLOCK_ROWS = 8192
"""Rows held as texts at a time."""
_SAMPLE_LINES = 200
"""Lines among which the header is looked for."""
TableLike = str | PathLike[str] | Mapping[str, Any] | Any
"""The path of a text file, a pandas DataFrame, or a mapping from column header to values."""


@dataclass(frozen=True)
class RowBlock:
    """Some consecutive rows.

    Args:
        lines: (N,) their lines in the file.
        cells: of each column (N,): texts, or an array of numbers.
    """

    lines: Sequence[int]
    cells: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class RawTable:
    """A table whose cells are not read yet.

    Args:
        titles: the column headers.
        line: of the header; 0 for a table in memory.
        blocks: the rows behind it; can be run through once.
        faults: of the file, which grow while the blocks are read.
        notes: what was taken for granted of the text.
        separator: of its cells.
    """

    titles: tuple[str, ...]
    line: int
    blocks: Iterator[RowBlock]
    faults: Faults
    notes: tuple[str, ...] = ()
    separator: str = ","


def open_table(source: TableLike, known: Collection[str] = (), spec: DataSpec | None = None) -> RawTable:
    """The table in a text file, a pandas DataFrame or a mapping from column header to values.

    Args:
        source: the path, or the table.
        known: names of columns, by which the header is found behind lines that an instrument writes before it.
        spec: what is known of such files.

    Raises:
        InputError: no such file, not readable, empty, or nothing of the three. Ragged rows join ``faults``.
    """
    if isinstance(source, str | PathLike):
        return _text_table(Path(fspath(source)), known, spec or DataSpec())
    if isinstance(source, Mapping):
        return _memory_table({str(title): np.asarray(values) for title, values in source.items()}.items())
    if hasattr(source, "iloc") and hasattr(source, "columns"):
        titles = [str(title) for title in source.columns]
        named = source.index.name == LINE_INDEX
        lines = [int(line) for line in source.index] if named else None
        file = source.attrs.get("file") if named else None
        return _memory_table(((title, np.asarray(source.iloc[:, i])) for i, title in enumerate(titles)), lines, file)
    kind = type(source).__name__
    raise InputError(Issue(f"measurements are a CSV file or a pandas DataFrame, not {kind}", hint="give the path"))


LINE_INDEX = "line"
"""Name of a DataFrame's index that holds the lines of a file."""


def _memory_table(columns: Any, lines: Sequence[int] | None = None, file: str | None = None) -> RawTable:
    """The table of columns (header, values); ``lines`` and ``file`` of one that was read from a file before.

    Raises:
        InputError: columns of different lengths, or none.
    """
    titles, cells = [], []
    for title, values in columns:
        titles.append(title)
        cells.append(values)
    faults = Faults(file or "table")
    sizes = {np.shape(values) for values in cells}
    if len(sizes) != 1 or len(next(iter(sizes))) != 1:
        faults.stop("the columns of the table have different lengths" if sizes else "the table is empty")
    (size,) = next(iter(sizes))
    blocks = [RowBlock(lines or range(1, size + 1), cells)] if size else []
    return RawTable(tuple(titles), 0, iter(blocks), faults)


def _text_table(path: Path, known: Collection[str], spec: DataSpec) -> RawTable:
    """The table in a text file, whose rows are read while its blocks are run through.

    Raises:
        InputError: no such file, empty, or no plain text.
    """
    faults = Faults(str(path))
    try:
        encoding = encoding_of(path, faults)
    except InputError as error:
        raise naming(path, error) from None
    lines = (line for line in _readable_lines(path, encoding, faults) if line.text.strip())
    sample = list(islice(lines, _SAMPLE_LINES))
    if not sample:
        faults.stop("the file is empty", "the first line names the columns, for example: joint1 [deg], x [mm], y [mm]")
    titles = {str(title) for title in spec.columns.values() if isinstance(title, str)}
    layout = Layout.of(sample, {*known, *titles}, bool(spec.columns) and not titles)
    if not all(title.strip().isprintable() for title in layout.titles):
        faults.stop("the header is no plain text", "is it a CSV file, with its quotes closed?", layout.line)
    rest = (line for line in chain(sample, lines) if line.number > layout.last)
    rows = _cell_rows(rest, layout, faults)
    blocks = _row_blocks(rows, len(layout.titles), faults)
    notes = _text_notes(encoding, layout)
    return RawTable(layout.titles, layout.line, blocks, faults, notes, layout.separator)


def _text_notes(encoding: str, layout: Layout) -> tuple[str, ...]:
    """What was taken for granted of the text."""
    notes = []
    if encoding == WINDOWS_ENCODING:
        notes.append("the file is not UTF-8 and was read as Windows-1252 (Latin-1)")
    if layout.skipped:
        notes.append(f"{layout.skipped} {'line' if layout.skipped == 1 else 'lines'} before the header were skipped")
    return tuple(notes)


def _readable_lines(path: Path, encoding: str, faults: Faults) -> Iterator[TextLine]:
    """The lines of a file.

    Raises:
        InputError: bytes that are no text in that encoding.
    """
    try:
        yield from lines_of(path, encoding, faults)
    except UnicodeDecodeError as error:
        faults.stop(f"not UTF-8 text (byte 0x{error.object[error.start]:02x})", "save the file as UTF-8")


def _cell_rows(lines: Iterator[TextLine], layout: Layout, faults: Faults) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of every row that is no comment."""
    at = [0]

    def texts() -> Iterator[str]:
        for line in lines:
            if line.comment is None:
                at[0] = line.number
                yield line.text + "\n"

    if layout.separator == BLANKS:
        yield from ((at[0], split_cells(text, BLANKS)) for text in texts())
        return
    try:
        for row in csv.reader(texts(), delimiter=layout.separator):
            if any(map(str.strip, row)):
                yield at[0], row
    except csv.Error as error:
        faults.stop(f"no CSV: {error}", line=at[0])


def _row_blocks(rows: Iterator[tuple[int, list[str]]], width: int, faults: Faults) -> Iterator[RowBlock]:
    """Blocks of rows of ``width`` cells; rows of another width are faults."""
    lines: list[int] = []
    kept: list[list[str]] = []
    for line, row in rows:
        if len(row) != width and not _fits_width(row, width):
            _ragged_fault(row, width, line, faults)
            continue
        lines.append(line)
        kept.append(row)
        if len(kept) == _BLOCK_ROWS:
            yield RowBlock(lines, list(zip(*kept, strict=True)))
            lines, kept = [], []
    if kept:
        yield RowBlock(lines, list(zip(*kept, strict=True)))


def _fits_width(row: list[str], width: int) -> bool:
    """Drops empty cells behind the last column, as some instruments end their rows; whether it fits then."""
    while len(row) > width and not row[-1].strip():
        row.pop()
    return len(row) == width


def _ragged_fault(row: list[str], width: int, line: int, faults: Faults) -> None:
    """The fault of a row of another width; decimal commas are the likely cause of up to twice as many cells."""
    cells = "1 cell" if len(row) == 1 else f"{len(row)} cells"
    halves = width < len(row) <= 2 * width and all(map(is_number, row))
    few = "a row that broke off? fill in what is missing, or leave it out"
    many = "decimal commas? then separate the columns by semicolons" if halves else "put a cell with a comma in quotes"
    hint = few if len(row) < width else many
    faults.add(f"{cells} in the row, {width} columns in the header", hint=hint, line=line)
