"""The lines of a text file that an instrument wrote: its encoding, and its comments."""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path

from posture_opt.files import opened
from posture_opt.measurements.faults import Faults

COMMENTS = ("#", "%", "//")
"""What a comment begins with."""
MAX_BYTES = 2_000_000_000
"""Largest file: ten million rows of 200 characters."""
MAX_LINE_CHARACTERS = 100_000
"""Characters of a line; 20 joints with 20 digits each have 1000."""
_CHUNK_BYTES = 1 << 20
"""Bytes that are read at a time while the encoding is found."""
_BYTE_ORDER_MARKS = (  # the longer ones first
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
WINDOWS_ENCODING = "cp1252"
"""What a text that is not UTF-8 is read as: a superset of Latin-1's printable characters."""


@dataclass(frozen=True)
class TextLine:
    """One line without its end, and its number in the file."""

    number: int
    text: str

    @property
    def comment(self) -> str | None:
        """What a comment says behind its mark; ``None`` for other lines."""
        text = self.text.lstrip()
        mark = next((mark for mark in COMMENTS if text.startswith(mark)), None)
        return None if mark is None else text[len(mark) :].strip()


def encoding_of(path: Path, faults: Faults) -> str:
    """How the text of a file is encoded: by its byte order mark, else UTF-8 where it is that, else Windows-1252.

    Raises:
        InputError: no such file, too large, or no text at all.
    """
    decoder = codecs.getincrementaldecoder("utf-8")()
    with opened(path, MAX_BYTES) as stream:
        start = stream.read(_CHUNK_BYTES)
        found = next((name for mark, name in _BYTE_ORDER_MARKS if start.startswith(mark)), "")
        if found:
            return found
        if b"\0" in start:
            return _with_zeros(start, faults)
        try:
            chunk = start
            while chunk:
                decoder.decode(chunk)
                chunk = stream.read(_CHUNK_BYTES)
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            return WINDOWS_ENCODING
    return "utf-8-sig"


def _with_zeros(start: bytes, faults: Faults) -> str:
    """The encoding of a text with zero bytes: UTF-16 without its mark has one in nearly every other place.

    Raises:
        InputError: zero bytes in other places.
    """
    even, odd = start[0::2].count(0), start[1::2].count(0)
    if max(even, odd) < len(start) / 4 or min(even, odd) > len(start) / 40:
        faults.stop("the header is no plain text", "is it a CSV file?", 1)
    return "utf-16-le" if odd > even else "utf-16-be"


def lines_of(path: Path, encoding: str, faults: Faults) -> Iterator[TextLine]:
    """The lines of a file, counted from 1, none so long that it fills the memory.

    Raises:
        InputError: a line of more than `MAX_LINE_CHARACTERS`.
        UnicodeDecodeError: bytes that are no text in that encoding.
    """
    with opened(path, MAX_BYTES) as stream, TextIOWrapper(stream, encoding) as lines:
        number = 0
        while text := lines.readline(MAX_LINE_CHARACTERS):
            number += 1
            if len(text) == MAX_LINE_CHARACTERS:
                faults.stop(f"the line has more than {MAX_LINE_CHARACTERS} characters", "is it a CSV file?", number)
            yield TextLine(number, text.rstrip("\n"))
