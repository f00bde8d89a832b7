"""``Checkpoint``: what is done is kept in a file, so that a computation that was ended goes on where it was.

The first line says what was asked; every further line is one part that is done: its round, its number and its result,
with a digest before it, whose key is the first line: no line counts in the file of another question. A line counts when
it is whole, so the file is sound at any instant; it only grows. What a line holds is compared with what the part
returns before it is used.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, overload

from posture_opt import __version__
from posture_opt.errors import InputError, Issue
from posture_opt.workers.record_pattern import is_result, matches
from posture_opt.workers.workers import Part, R, S, T, Workers

if TYPE_CHECKING:
    from posture_opt.numerics import Json

_FILE_FORMAT = "posture_opt checkpoint 2"
"""Name and version of the format, in the first line of a file."""
_DIGEST_DIGITS = 16
"""Hexadecimal digits of a digest, before each line: 64 bits find a line that was cut off."""
_MAX_FIRST_LINE_BYTES = 1 << 16
"""A longer first line is not ours."""
_OPTION = ("--checkpoint",)
"""The key of messages: the option of the command line."""


class Checkpoint(Workers):
    """Has other workers do only those parts that a file does not hold yet, and keeps there what they do.

    The rounds are numbered, so the same computation gets the same results back: those of round k in the file belong to
    the k-th round of the computation.

    Args:
        path: made where there is none.
        asked: all that the answer depends on, as JSON has it; a file that was made for anything else is refused.
        workers: they do the work; closed with this.

    Raises:
        InputError: the file is no checkpoint, was made for something else or is used by another run; or it cannot be
            written.
    """

    def __init__(self, path: Path, asked: Mapping[str, Json], workers: Workers) -> None:
        self._workers, self._rounds, self._path = workers, 0, path
        first_line = json.loads(json.dumps({"format": _FILE_FORMAT, "version": __version__, **asked}))
        self._key = _json_bytes(first_line)
        try:
            self._file = _locked_file(path)
        except OSError as error:
            raise _write_issue(path, error) from error
        try:
            self._done = self._read(first_line)
        except BaseException as error:
            self._file.close()
            if isinstance(error, OSError):
                raise _write_issue(path, error) from error
            raise

    def _read(self, first_line: Mapping[str, Json]) -> dict[int, dict[int, Any]]:
        """Round -> number of a part -> its result, of a file that is cut off behind its last whole line.

        An empty file stays empty until something is done: a request that is refused leaves it as it was.
        """
        done, whole = _read_records(self._path, self._file, first_line)
        self._file.truncate(whole)
        self._file.seek(whole)
        return done

    def run(self, part: Part[S, T, R], shared: S, items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """As of `Workers`, what is kept comes first.

        Raises:
            InputError: the file cannot be written; what it holds stays.
        """
        self._rounds += 1
        return self._run_round(self._rounds, part, shared, items)

    def _run_round(self, number: int, part: Part[S, T, R], shared: S, items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """The parts of one round: those of the file, then the others as they are done and written down."""
        known = self._done.pop(number, {})
        left = [k for k in range(len(items)) if k not in known]
        for k, result in known.items():
            if not (k < len(items) and is_result(part, shared, items[k], result)):
                raise _foreign_issue(self._path, f"round {number}, part {k}")
            yield k, result
        for i, result in self._workers.run(part, shared, Chosen(items, left)):
            try:
                self._write_line(_json_bytes([number, left[i], result]), self._key)
            except OSError as error:
                raise _write_issue(self._path, error) from error
            yield left[i], result

    def _write_line(self, text: bytes, key: bytes) -> None:
        """Append one line with its digest, behind the first line, and wait until it is on the disk."""
        if not self._file.tell():
            self._file.write(_line_digest(self._key, b"") + b" " + self._key + b"\n")
        self._file.write(_line_digest(text, key) + b" " + text + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file, which stays, and the workers."""
        self._file.close()
        self._workers.close()


class Chosen(Sequence[T]):
    """Some of many items, taken when they are asked for."""

    def __init__(self, items: Sequence[T], chosen: Sequence[int]) -> None:
        self._items, self._chosen = items, chosen

    def __len__(self) -> int:
        return len(self._chosen)

    @overload
    def __getitem__(self, k: int) -> T: ...
    @overload
    def __getitem__(self, k: slice) -> Sequence[T]: ...
    def __getitem__(self, k: int | slice) -> T | Sequence[T]:
        return Chosen(self._items, self._chosen[k]) if isinstance(k, slice) else self._items[self._chosen[k]]


def _locked_file(path: Path) -> BinaryIO:
    """The file, for reading and for writing at its end, by no other run at the same time.

    Raises:
        InputError: no file name, a folder, or a file that another run has locked.
        OSError: it cannot be opened.
    """
    try:
        there = path.exists()
    except ValueError:
        raise InputError(Issue("the file name holds a character that no file name has", _OPTION, str(path))) from None
    if there and not path.is_file():
        raise InputError(Issue("this is no file", _OPTION, str(path), "name a file", str(path)))
    stream = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "r+b")
    try:
        import fcntl
    except ImportError:  # not on Windows
        return stream
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        stream.close()
        hint = "wait for it, or name another file"
        raise InputError(Issue("another run uses this file", _OPTION, str(path), hint, str(path))) from None
    return stream


def _read_records(
    path: Path, stream: BinaryIO, first_line: Mapping[str, Json]
) -> tuple[dict[int, dict[int, Any]], int]:
    """Round -> number of a part -> its result, and how many bytes of the file are whole.

    Raises:
        InputError: it was made for something else.
    """
    line = stream.readline(_MAX_FIRST_LINE_BYTES)
    first = _record_of(line, b"")
    if first is None:
        _check_begun(path, line, first_line)
        return {}, 0
    _check_first_line(path, first, first_line)
    done: dict[int, dict[int, Any]] = {}
    whole, key = len(line), _json_bytes(first_line)
    for at, line in enumerate(stream, start=2):
        record = _record_of(line, key)
        if record is None:
            break  # the run was ended while it wrote this; what follows cannot be trusted
        if not (matches(record, (int, int, object)) and min(record[:2]) >= 0):
            raise _foreign_issue(path, f"line {at}")
        number, k, result = record
        done.setdefault(number, {})[k] = result
        whole += len(line)
    return done, whole


def _record_of(line: bytes, key: bytes) -> Any:
    """What a line holds; None where it is not whole, or no JSON that could be written by this program."""
    digest, _, text = line.partition(b" ")
    if not line.endswith(b"\n") or digest != _line_digest(text[:-1], key):
        return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _check_begun(path: Path, content: bytes, first_line: Mapping[str, Json]) -> None:
    """A file without a whole first line is empty, or the beginning of that line.

    Raises:
        InputError: it is anything else.
    """
    text = _json_bytes(first_line)
    if not (_line_digest(text, b"") + b" " + text + b"\n").startswith(content):
        hint = "name a new file, or one that --checkpoint made"
        raise InputError(Issue("this is no checkpoint", _OPTION, str(path), hint, str(path)))


def _check_first_line(path: Path, found: Json, first_line: Mapping[str, Json]) -> None:
    """Refuse a file that was made for something else.

    Raises:
        InputError: with everything that differs.
    """
    if not isinstance(found, dict) or found.get("format") != _FILE_FORMAT:
        raise InputError(Issue("this is no checkpoint", _OPTION, str(path), "name a new file", str(path)))
    other = [key for key in {**first_line, **found} if found.get(key) != first_line.get(key)]
    if other:
        differences = [
            f"{key} ({_value_text(found.get(key))} there, {_value_text(first_line.get(key))} here)" for key in other
        ]
        what = f"this checkpoint was made for another {', another '.join(differences)}"
        raise InputError(Issue(what, _OPTION, str(path), "name a new file, or ask for the same", str(path)))


def _value_text(value: Json) -> str:
    """A value of the first line in words."""
    return "none" if value is None else str(value)


def _write_issue(path: Path, error: OSError) -> InputError:
    """The error of a file that cannot be written."""
    what = f"the checkpoint cannot be written ({error.strerror or error})"
    return InputError(Issue(what, _OPTION, str(path), "what it holds is kept; go on by the same command", str(path)))


def _foreign_issue(path: Path, where: str) -> InputError:
    """The error of a record that this computation does not write."""
    hint = "name a new file, and keep this one from other programs"
    return InputError(Issue(f"{where} holds no result of this computation", _OPTION, str(path), hint, str(path)))


def _json_bytes(value: object) -> bytes:
    """JSON in one line, as this file has it."""
    return json.dumps(value, separators=(",", ":")).encode()


def _line_digest(text: bytes, key: bytes) -> bytes:
    """The first hexadecimal digits of the keyed SHA-256 of a text (RFC 2104)."""
    return hmac.new(key, text, hashlib.sha256).hexdigest()[:_DIGEST_DIGITS].encode()
