"""``Manifest``: which files of a folder this program wrote, and what was in them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from posture_opt.errors import InputError
from posture_opt.files import content

MANIFEST = ".files.sha256"
"""Its name in the folder; ``sha256sum --check .files.sha256`` reads it."""

_MOST = 1_000_000  # bytes of a manifest
_LARGEST = 1_000_000_000  # bytes of a file of ours


@dataclass(frozen=True)
class Manifest:
    """Pairs of a file's name and the SHA-256 of its content; two of one name while one report replaces another."""

    entries: frozenset[tuple[str, str]] = frozenset()

    @classmethod
    def of(cls, folder: Path) -> Manifest:
        """That of a folder; empty where there is none."""
        try:
            text = content(folder / MANIFEST, _MOST).decode("utf-8", errors="replace")
        except InputError:
            return cls()
        lines = [line.split("  ", 1) for line in text.splitlines()]
        return cls(frozenset((pair[1], pair[0]) for pair in lines if len(pair) == 2 and _plain(pair[1])))

    @classmethod
    def listing(cls, files: Mapping[str, bytes]) -> Manifest:
        """That of files by name."""
        return cls(frozenset((name, hashlib.sha256(data).hexdigest()) for name, data in files.items()))

    @property
    def names(self) -> frozenset[str]:
        """Of the files."""
        return frozenset(name for name, _ in self.entries)

    @property
    def text(self) -> str:
        """As ``sha256sum`` writes it."""
        return "".join(f"{digest}  {name}\n" for name, digest in sorted(self.entries))

    def of_names(self, names: Iterable[str]) -> Manifest:
        """What it says of some files."""
        wanted = frozenset(names)
        return Manifest(frozenset(entry for entry in self.entries if entry[0] in wanted))

    def joined(self, other: Manifest) -> Manifest:
        """What either says."""
        return Manifest(self.entries | other.entries)

    def lists(self, path: Path) -> bool:
        """Whether a file is as it was written: one that was changed since belongs to who changed it."""
        if path.name not in self.names or path.is_symlink():
            return False
        try:
            return (path.name, hashlib.sha256(content(path, _LARGEST)).hexdigest()) in self.entries
        except InputError:
            return False

    def foreign(self, folder: Path, names: Iterable[str]) -> list[str]:
        """Those of some names under which the folder has something that is not as it was written."""
        return sorted(name for name in names if os.path.lexists(folder / name) and not self.lists(folder / name))


def _plain(name: str) -> bool:
    return bool(name) and name == os.path.basename(name) and name not in (".", "..")
