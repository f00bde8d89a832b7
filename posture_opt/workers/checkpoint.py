"""``Checkpoint``: what is done is kept in a file, so that a computation that was ended goes on where it was.

The first line says what was asked; every further line is one part that is done: its round, its number and its result,
with a digest before it. A line counts when it is whole, so the file is sound at any instant; it only grows.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

from posture_opt import __version__
from posture_opt.errors import InputError, Issue
from posture_opt.workers.workers import Part, Workers

_FORMAT = "posture_opt checkpoint 1"
_DIGITS = 16  # of a digest, before each line
_MOST_HEAD = 1 << 16  # bytes of the first line
_OPTION = ("--checkpoint",)


class Checkpoint(Workers):
    """Has other workers do only those parts that a file does not hold yet, and keeps there what they do.

    The rounds are numbered, so whoever asks the same gets the same: results that a file holds are those of the rounds
    of the same computation.

    Args:
        path: made where there is none.
        asked: all that the answer depends on, as JSON has it; a file that was made for anything else is refused.
        workers: they do the work; closed with this.

    Raises:
        InputError: the file is no checkpoint, was made for something else or is used by another run; or it cannot be
            written.
    """

    def __init__(self, path: Path, asked: Mapping[str, Any], workers: Workers) -> None:
        self._workers, self._rounds, self._path = workers, 0, path
        head = json.loads(json.dumps({"format": _FORMAT, "version": __version__, **asked}))
        try:
            self._file = _opened(path)
        except OSError as error:
            raise _unwritable(path, error) from error
        try:
            self._done = self._begun(head)
        except BaseException as error:
            self._file.close()
            if isinstance(error, OSError):
                raise _unwritable(path, error) from error
            raise

    def _begun(self, head: Mapping[str, Any]) -> dict[int, dict[int, Any]]:
        done, whole = _read(self._path, self._file, head)
        self._file.truncate(whole)
        self._file.seek(whole)
        if not whole:
            self._write(head)
        return done

    def run(self, part: Part, shared: Any, items: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """As of `Workers`, what is kept at first.

        Raises:
            InputError: the file cannot be written; what it holds stays.
        """
        self._rounds += 1
        return self._run(self._rounds, part, shared, items)

    def _run(self, number: int, part: Part, shared: Any, items: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        known = self._done.pop(number, {})
        left = [k for k in range(len(items)) if k not in known]
        yield from known.items()
        for i, result in self._workers.run(part, shared, Chosen(items, left)):
            try:
                self._write([number, left[i], result])
            except OSError as error:
                raise _unwritable(self._path, error) from error
            yield left[i], result

    def _write(self, record: Any) -> None:
        text = json.dumps(record, separators=(",", ":")).encode()
        self._file.write(_digest(text) + b" " + text + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file, which stays, and the workers."""
        self._file.close()
        self._workers.close()


class Chosen(Sequence[Any]):
    """Some of many items, taken when they are asked for."""

    def __init__(self, items: Sequence[Any], chosen: Sequence[int]) -> None:
        self._items, self._chosen = items, chosen

    def __len__(self) -> int:
        return len(self._chosen)

    def __getitem__(self, k: Any) -> Any:
        return self._items[self._chosen[k]]


def _opened(path: Path) -> BinaryIO:
    """The file, for reading and for writing at its end, by no other run at the same time."""
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


def _read(path: Path, stream: BinaryIO, head: Mapping[str, Any]) -> tuple[dict[int, dict[int, Any]], int]:
    """Round -> number of a part -> its result, and how many bytes of the file are whole.

    Raises:
        InputError: it was made for something else.
    """
    line = stream.readline(_MOST_HEAD)
    first = _record(line)
    if first is None:
        _check_begun(path, line, head)
        return {}, 0
    _check_head(path, first, head)
    done: dict[int, dict[int, Any]] = {}
    whole = len(line)
    for line in stream:
        record = _record(line)
        if record is None:
            break  # the run was ended while it wrote this; what follows cannot be trusted
        number, k, result = record
        done.setdefault(number, {})[k] = result
        whole += len(line)
    return done, whole


def _record(line: bytes) -> Any:
    """What a line says; None where it is not whole."""
    digest, _, text = line.partition(b" ")
    if not line.endswith(b"\n") or digest != _digest(text[:-1]):
        return None
    return json.loads(text)


def _check_begun(path: Path, content: bytes, head: Mapping[str, Any]) -> None:
    """A file without a whole first line is empty, or the beginning of that line."""
    text = json.dumps(head, separators=(",", ":")).encode()
    if not (_digest(text) + b" " + text + b"\n").startswith(content):
        hint = "name a new file, or one that --checkpoint made"
        raise InputError(Issue("this is no checkpoint", _OPTION, str(path), hint, str(path)))


def _check_head(path: Path, found: Any, head: Mapping[str, Any]) -> None:
    if not isinstance(found, dict) or found.get("format") != _FORMAT:
        raise InputError(Issue("this is no checkpoint", _OPTION, str(path), "name a new file", str(path)))
    other = [key for key in {**head, **found} if found.get(key) != head.get(key)]
    if other:
        told = [f"{key} ({_told(found.get(key))} there, {_told(head.get(key))} here)" for key in other]
        what = f"this checkpoint was made for another {', another '.join(told)}"
        raise InputError(Issue(what, _OPTION, str(path), "name a new file, or ask for the same", str(path)))


def _told(value: Any) -> str:
    return "none" if value is None else str(value)


def _unwritable(path: Path, error: OSError) -> InputError:
    what = f"the checkpoint cannot be written ({error.strerror or error})"
    return InputError(Issue(what, _OPTION, str(path), "what it holds is kept; go on by the same command", str(path)))


def _digest(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest()[:_DIGITS].encode()
