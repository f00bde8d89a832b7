"""``Checkpoint``: what is done is kept in a file, so that a computation that was ended goes on where it was.

The first line says what was asked; every further line is one part that is done: its round, its number and its result,
with a digest before it, whose key is the first line. A line counts when it is whole, so the file, which only grows, is
sound at any instant. What a line holds is compared with what the part returns before it is used.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, overload

from posture_opt import __version__
from posture_opt.errors import InputError, Issue
from posture_opt.workers import Part, R, S, T, Workers
from posture_opt.workers.record_pattern import is_result, matches

if TYPE_CHECKING:
    from posture_opt.numerics import Json

_FILE_FORMAT = "posture_opt checkpoint 2"


class Checkpoint(Workers):
    """Have other workers do only the parts that a file does not hold yet, and keep there what they do.

    Rounds are numbered: the results of round k in the file belong to the k-th round of the computation.
    """

    def __init__(self, path: Path, asked: Mapping[str, Json], workers: Workers) -> None:
        self._workers, self._rounds, self._path = workers, 0, path
        first_line = json.loads(json.dumps({"format": _FILE_FORMAT, "version": __version__, **asked}))
        self._key = _json_bytes(first_line)
        with _write_issues(path):
            self._file = _locked_file(path)
            try:
                self._done, whole = _read_records(path, self._file, first_line)
                self._file.truncate(whole)  # empty as long as nothing is done
                self._file.seek(whole)
            except BaseException:
                self._file.close()
                raise

    def run(self, part: Part[S, T, R], shared: S, items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """As of `Workers`, what is kept comes first."""
        self._rounds += 1
        return self._run_round(self._rounds, part, shared, items)

    def _run_round(self, number: int, part: Part[S, T, R], shared: S, items: Sequence[T]) -> Iterator[tuple[int, R]]:
        known = self._done.pop(number, {})
        left = [k for k in range(len(items)) if k not in known]
        for k, result in known.items():
            if not (k < len(items) and is_result(part, shared, items[k], result)):
                raise _foreign(self._path, f"round {number}, part {k}")
            yield k, result
        for i, result in self._workers.run(part, shared, Chosen(items, left)):
            with _write_issues(self._path):
                if not self._file.tell():
                    self._file.write(_line(self._key, b""))
                self._file.write(_line(_json_bytes([number, left[i], result]), self._key))
                self._file.flush()
                os.fsync(self._file.fileno())
            yield left[i], result

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
    try:
        there = path.exists()
    except ValueError:
        text = "the file name holds a character that no file name has"
        raise InputError(Issue(text, ("--checkpoint",), str(path))) from None
    if there and not path.is_file():
        raise _refused(path, "this is no file", "name a file")
    stream = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "r+b")
    try:
        import fcntl
    except ImportError:  # not on Windows
        return stream
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        stream.close()
        raise _refused(path, "another run uses this file", "wait for it, or name another file") from None
    return stream


def _read_records(
    path: Path, stream: BinaryIO, first_line: Mapping[str, Json]
) -> tuple[dict[int, dict[int, Any]], int]:
    """Round -> number of a part -> its result, and how many bytes of the file are whole."""
    line, key = stream.readline(1 << 16), _json_bytes(first_line)  # a longer first line is not ours
    first = _record_of(line, b"")
    if first is None:
        if not _line(key, b"").startswith(line):  # empty, or the beginning of that line
            raise _refused(path, "this is no checkpoint", "name a new file, or one that --checkpoint made")
        return {}, 0
    if not isinstance(first, dict) or first.get("format") != _FILE_FORMAT:
        raise _refused(path, "this is no checkpoint", "name a new file")
    other = [
        f"{k} ({_value_text(first.get(k))} there, {_value_text(first_line.get(k))} here)"
        for k in {**first_line, **first}
        if first.get(k) != first_line.get(k)
    ]
    if other:
        what = f"this checkpoint was made for another {', another '.join(other)}"
        raise _refused(path, what, "name a new file, or ask for the same")
    done: dict[int, dict[int, Any]] = {}
    whole = len(line)
    for at, line in enumerate(stream, start=2):
        record = _record_of(line, key)
        if record is None:
            break  # the run was ended while it wrote this; what follows cannot be trusted
        if not (matches(record, (int, int, object)) and min(record[:2]) >= 0):
            raise _foreign(path, f"line {at}")
        number, k, result = record
        done.setdefault(number, {})[k] = result
        whole += len(line)
    return done, whole


def _record_of(line: bytes, key: bytes) -> Any:
    """What a line holds; None where it is not whole, or no JSON that could be written by this program."""
    text = line.partition(b" ")[2]
    if not line.endswith(b"\n") or line != _line(text[:-1], key):
        return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _value_text(value: Json) -> str:
    return "none" if value is None else str(value)


def _refused(path: Path, what: str, hint: str) -> InputError:
    return InputError(Issue(what, ("--checkpoint",), str(path), hint, str(path)))


def _foreign(path: Path, where: str) -> InputError:
    hint = "name a new file, and keep this one from other programs"
    return _refused(path, f"{where} holds no result of this computation", hint)


@contextmanager
def _write_issues(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        what = f"the checkpoint cannot be written ({error.strerror or error})"
        raise _refused(path, what, "what it holds is kept; go on by the same command") from error


def _json_bytes(value: object) -> bytes:
    return json.dumps(value, separators=(",", ":")).encode()


def _line(text: bytes, key: bytes) -> bytes:
    """A text with the first 16 hexadecimal digits of its keyed SHA-256 (RFC 2104): they find a line that is cut off."""
    return hmac.new(key, text, hashlib.sha256).hexdigest()[:16].encode() + b" " + text + b"\n"
