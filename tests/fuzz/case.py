"""``Case``: the files and the words of one call of the program."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Link:
    """A symbolic link in place of a file."""

    target: str


@dataclass(frozen=True)
class Folder:
    """An empty folder in place of a file."""


@dataclass(frozen=True)
class Pipe:
    """A named pipe that nobody writes into."""


Entry = bytes | Link | Folder | Pipe


Row = tuple[float, float, float]


@dataclass(frozen=True)
class Similarity:
    """Where the tool point of a second answer lies: ``x' = scale · turn · x + shift``."""

    scale: float = 1.0
    turn: tuple[Row, Row, Row] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    shift: Row = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Case:
    """One call: ``words`` after the program's name, in a folder that holds ``files``.

    Args:
        out: what it may make.
        kept: what may be there however it ends: a checkpoint.
        twin: another call, whose answer must be this one's by ``similarity``.
    """

    kind: str
    number: int
    words: tuple[str, ...]
    files: dict[str, Entry] = field(default_factory=dict)
    out: tuple[str, ...] = ()
    kept: tuple[str, ...] = ()
    twin: Case | None = None
    similarity: Similarity = Similarity()

    @property
    def name(self) -> str:
        """What calls it again: ``python -m tests.fuzz --case NAME``."""
        return f"{self.kind}:{self.number}"

    @property
    def texts(self) -> str:
        """Everything that stands in its input."""
        held = [entry.decode("utf-8", "replace") for entry in self.files.values() if isinstance(entry, bytes)]
        return "\n".join([*self.words, *self.files, *held])

    def write(self, folder: Path) -> None:
        """Makes its files in ``folder``."""
        for name, entry in self.files.items():
            path = folder / name
            if isinstance(entry, bytes):
                path.write_bytes(entry)
            elif isinstance(entry, Link):
                path.symlink_to(entry.target)
            elif isinstance(entry, Folder):
                path.mkdir()
            else:
                os.mkfifo(path)
