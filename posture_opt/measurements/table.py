"""Rows and columns of a text file or of a table in memory, block by block."""

from __future__ import annotations

import codecs
import csv
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import TextIOWrapper
from itertools import chain, islice
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.files import naming, opened
from posture_opt.limits import MAX_TABLE_BYTES
from posture_opt.measurements.data_section import NOTHING_STATED, DataSpec
from posture_opt.measurements.layout import BLANKS, Layout, TextLine, is_number, split_cells

LINE_INDEX = "line"  # Name of a DataFrame's index that holds the lines of a file
WINDOWS_ENCODING = "cp1252"  # What a text that is not UTF-8 is read as: a superset of Latin-1's printable characters
MAX_LINE_CHARACTERS = 100_000  # 20 joints with 20 digits each have 1000
# The path of a text file, a pandas DataFrame, or a mapping from column header to values
TableLike = str | PathLike[str] | Mapping[str, Any] | Any


@dataclass(frozen=True)
class RowBlock:
    """Some consecutive rows."""

    lines: Sequence[int]  # (N,) their lines in the file
    cells: Sequence[Sequence[Any]]  # of each column (N,): texts, or an array of numbers


@dataclass(frozen=True)
class RawTable:
    """A table whose cells are not read yet."""

    titles: tuple[str, ...]  # the column headers
    line: int  # of the header; 0 for a table in memory
    blocks: Iterator[RowBlock]  # the rows behind it; can be run through once
    faults: Faults  # of the file, which grow while the blocks are read
    notes: tuple[str, ...] = ()  # what was taken for granted of the text
    separator: str = ","  # of its cells


def open_table(source: TableLike, known: Collection[str] = (), spec: DataSpec = NOTHING_STATED) -> RawTable:
    """The table in a text file, a pandas DataFrame or a mapping from column header to values."""
    if isinstance(source, str | PathLike):
        return _text_table(Path(fspath(source)), known, spec)
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


def _memory_table(columns: Any, lines: Sequence[int] | None = None, file: str | None = None) -> RawTable:
    titled, faults = list(columns), Faults(file or "table")
    sizes = {np.shape(values) for _, values in titled}
    if len(sizes) != 1 or len(next(iter(sizes))) != 1:
        faults.stop("the columns of the table have different lengths" if sizes else "the table is empty")
    (size,) = next(iter(sizes))
    blocks = [RowBlock(lines or range(1, size + 1), [values for _, values in titled])] if size else []
    return RawTable(tuple(title for title, _ in titled), 0, iter(blocks), faults)


def _text_table(path: Path, known: Collection[str], spec: DataSpec) -> RawTable:
    faults = Faults(str(path))
    try:
        encoding = encoding_of(path, faults)
    except InputError as error:
        raise naming(path, error) from None
    lines = (line for line in lines_of(path, encoding, faults) if line.text.strip())
    sample = list(islice(lines, 200))  # the header is among them
    if not sample:
        faults.stop("the file is empty", "the first line names the columns, for example: joint1 [deg], x [mm], y [mm]")
    titles = {str(title) for title in spec.columns.values() if isinstance(title, str)}
    layout = Layout.of(sample, {*known, *titles}, bool(spec.columns) and not titles)
    if not all(title.strip().isprintable() for title in layout.titles):
        faults.stop("the header is no plain text", "is it a CSV file, with its quotes closed?", layout.line)
    rest = (line for line in chain(sample, lines) if line.number > layout.last)
    blocks = _row_blocks(_cell_rows(rest, layout, faults), len(layout.titles), faults)
    notes = ["the file is not UTF-8 and was read as Windows-1252 (Latin-1)"] * (encoding == WINDOWS_ENCODING)
    if layout.skipped:
        notes.append(f"{layout.skipped} {'line' if layout.skipped == 1 else 'lines'} before the header were skipped")
    return RawTable(layout.titles, layout.line, blocks, faults, tuple(notes), layout.separator)


def _cell_rows(lines: Iterator[TextLine], layout: Layout, faults: Faults) -> Iterator[tuple[int, list[str]]]:
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
    lines: list[int] = []
    kept: list[list[str]] = []
    for line, row in rows:
        while len(row) > width and not row[-1].strip():  # some instruments end their rows with a separator
            row.pop()
        if len(row) != width:
            hint = "put a cell with a comma in quotes"
            if len(row) < width:
                hint = "a row that broke off? fill in what is missing, or leave it out"
            elif len(row) <= 2 * width and all(map(is_number, row)):
                hint = "decimal commas? then separate the columns by semicolons"
            cells = "1 cell" if len(row) == 1 else f"{len(row)} cells"
            faults.add(f"{cells} in the row, {width} columns in the header", hint=hint, line=line)
            continue
        lines.append(line)
        kept.append(row)
        if len(kept) == 8192:  # rows held as texts at a time
            yield RowBlock(lines, list(zip(*kept, strict=True)))
            lines, kept = [], []
    if kept:
        yield RowBlock(lines, list(zip(*kept, strict=True)))


class Faults:
    """Issues of one file: of those of one column with one hint the first are kept, all are counted."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.count: int = 0
        self._kept: dict[tuple[str, str], list[Issue]] = {}
        self._more: dict[tuple[str, str], list[int]] = {}

    def add(self, message: str, column: str = "", value: object = None, hint: str = "", line: int = 0,
            id: str = "input.invalid") -> None:  # fmt: skip
        """Add one fault."""
        self.count += 1
        alike = (column, hint or message)
        kept = self._kept.setdefault(alike, [])
        if len(kept) < 3 or not line:
            kept.append(Issue(message, (column,) if column else (), value, hint, self.file, line, id))
        else:
            self._more.setdefault(alike, []).append(line)

    def refuse(self) -> None:
        """Ends the reading where anything was wrong."""
        if not self.count:
            return
        issues = sorted((issue for kept in self._kept.values() for issue in kept), key=lambda issue: issue.line)
        rest = []
        for (column, _), lines in self._more.items():
            rows = "1 more row like these (line" if len(lines) == 1 else f"{len(lines)} more rows like these (lines"
            where = f"{lines[0]}" if len(lines) == 1 else f"{min(lines)} to {max(lines)}"
            rest.append(Issue(f"{rows} {where})", (column,) if column else (), file=self.file))
        left = len(issues) - 20  # a file of another kind has a fault in every cell: the first ones show what is wrong
        if left > 0:
            rest.append(Issue(f"{left} more {'fault' if left == 1 else 'faults'}", file=self.file))
        raise InputError([*issues[:20], *rest])

    def stop(self, message: str, hint: str = "", line: int = 0) -> NoReturn:
        """Add a fault behind which nothing more can be read."""
        self.add(message, hint=hint, line=line)
        self.refuse()
        raise AssertionError("a fault was added")


# The longer ones first
_BYTE_ORDER_MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}


def encoding_of(path: Path, faults: Faults) -> str:
    """How the text of a file is encoded: by its byte order mark, else UTF-8 where it is that, else Windows-1252."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    with opened(path, MAX_TABLE_BYTES) as stream:
        start = chunk = stream.read(1 << 20)
        if found := next((name for mark, name in _BYTE_ORDER_MARKS.items() if start.startswith(mark)), ""):
            return found
        if b"\0" in start:  # UTF-16 without its mark has a zero byte in nearly every other place
            even, odd = start[0::2].count(0), start[1::2].count(0)
            if max(even, odd) < len(start) / 4 or min(even, odd) > len(start) / 40:
                faults.stop("the header is no plain text", "is it a CSV file?", 1)
            return "utf-16-le" if odd > even else "utf-16-be"
        try:
            while chunk:
                decoder.decode(chunk)
                chunk = stream.read(1 << 20)
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            return WINDOWS_ENCODING
    return "utf-8-sig"


def lines_of(path: Path, encoding: str, faults: Faults) -> Iterator[TextLine]:
    """The lines of a file, counted from 1, none so long that it fills the memory."""
    with opened(path, MAX_TABLE_BYTES) as stream, TextIOWrapper(stream, encoding) as lines:
        try:
            for number, text in enumerate(iter(lambda: lines.readline(MAX_LINE_CHARACTERS), ""), 1):
                if len(text) == MAX_LINE_CHARACTERS:
                    faults.stop(f"the line has more than {MAX_LINE_CHARACTERS} characters", "is it a CSV file?", number)
                yield TextLine(number, text.rstrip("\n"))
        except UnicodeDecodeError as error:
            faults.stop(f"not UTF-8 text (byte 0x{error.object[error.start]:02x})", "save the file as UTF-8")
