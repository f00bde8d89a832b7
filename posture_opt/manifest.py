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
"""Name of the manifest in the folder; ``sha256sum --check .files.sha256`` reads it."""

_MAX_MANIFEST_BYTES = 1_000_000
"""A longer manifest is not ours: a folder has some dozen files of 80 characters each."""
_MAX_FILE_BYTES = 1_000_000_000
"""Files above it count as foreign without being read."""


@dataclass(frozen=True)
class Manifest:
    """Pairs of a file's name and the SHA-256 of its content; two of one name while one report replaces another.

    Example:
        >>> Manifest.listing({"a.txt": b""}).text[:12]
        'e3b0c44298fc'
    """

    entries: frozenset[tuple[str, str]] = frozenset()

    @classmethod
    def of(cls, folder: Path) -> Manifest:
        """The manifest of a folder; empty where there is none. Lines that it could not have are skipped."""
        try:
            text = content(folder / MANIFEST, _MAX_MANIFEST_BYTES).decode("utf-8", errors="replace")
        except InputError:
            return cls()
        lines = [line.split("  ", 1) for line in text.splitlines()]
        return cls(frozenset((pair[1], pair[0]) for pair in lines if len(pair) == 2 and _is_plain_name(pair[1])))

    @classmethod
    def listing(cls, files: Mapping[str, bytes]) -> Manifest:
        """The manifest of files, name -> content."""
        return cls(frozenset((name, hashlib.sha256(data).hexdigest()) for name, data in files.items()))

    @property
    def names(self) -> frozenset[str]:
        """Names of the files."""
        return frozenset(name for name, _ in self.entries)

    @property
    def text(self) -> str:
        """The lines as ``sha256sum`` writes them, sorted by name."""
        return "".join(f"{digest}  {name}\n" for name, digest in sorted(self.entries))

    def of_names(self, names: Iterable[str]) -> Manifest:
        """The entries of some files."""
        wanted = frozenset(names)
        return Manifest(frozenset(entry for entry in self.entries if entry[0] in wanted))

    def joined(self, other: Manifest) -> Manifest:
        """The entries of both."""
        return Manifest(self.entries | other.entries)

    def lists(self, path: Path) -> bool:
        """Whether a file is as it was written: one that was changed since belongs to whoever changed it."""
        if path.name not in self.names or path.is_symlink():
            return False
        try:
            return (path.name, hashlib.sha256(content(path, _MAX_FILE_BYTES)).hexdigest()) in self.entries
        except InputError:
            return False

    def foreign(self, folder: Path, names: Iterable[str]) -> list[str]:
        """Those of some names under which the folder has something that is not as it was written, sorted."""
        return sorted(name for name in names if os.path.lexists(folder / name) and not self.lists(folder / name))


def _is_plain_name(name: str) -> bool:
    """Whether a name is that of a file right in the folder: no path leads out of it."""
    return bool(name) and name == os.path.basename(name) and name not in (".", "..")
