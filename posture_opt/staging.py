"""Folders that others see whole or not at all: prepared next to the target, put there in one step, cleared if left."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

if sys.platform != "win32":
    import fcntl

PREFIX = ".posture_opt-"
"""Beginning of the names of folders that are being prepared."""
_LEFTOVER_AGE_S = 86_400.0
"""Age [s] from which a folder counts as left behind where files cannot be locked: longer than any run writes."""
_AT_FDCWD = -100
"""Paths relative to the working folder, as of ``<fcntl.h>``."""
_RENAME_EXCHANGE = 2
"""Flag of ``renameat2``, as of ``<linux/fs.h>``."""


@contextmanager
def staging(beside: Path) -> Iterator[Path]:
    """A new folder in ``beside``, removed at the end; a lock shows other processes that its owner is alive.

    What a killed process left in ``beside`` is cleared first.

    Raises:
        OSError: no folder can be made there.
    """
    clear_leftovers(beside)
    folder, lock = _locked_folder(beside)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if lock is not None:
            os.close(lock)


@contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Waits until no other process is in such a block for this folder; where folders cannot be locked it does not."""
    descriptor = None
    if sys.platform != "win32":
        with contextlib.suppress(OSError):
            descriptor = os.open(folder, os.O_RDONLY)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def clear_leftovers(folder: Path) -> None:
    """Remove what processes that are no more have prepared in ``folder``."""
    try:
        found = [folder / name for name in os.listdir(folder) if name.startswith(PREFIX)]
    except OSError:
        return
    for path in found:
        lock = _lock_folder(path)
        if lock is not None or _is_old(path):
            shutil.rmtree(path, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def exchanged(one: Path, other: Path) -> bool:
    """Give two folders each other's name in one step, ``renameat2(…, RENAME_EXCHANGE)``.

    Linux has it since 3.15, on most file systems.

    Returns:
        Whether it was done; False on other systems and file systems, with nothing changed.
    """
    if sys.platform != "linux":
        return False
    try:
        rename = ctypes.CDLL(None).renameat2
    except (OSError, AttributeError):
        return False
    return bool(rename(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE) == 0)


def write_through(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files, name -> content, into a folder, and wait until they are on the disk."""
    for name, content in files.items():
        (folder / name).write_bytes(content)
    # All at once: a file system that waits for each in turn takes forty times as long.
    waiting = [Thread(target=settle, args=(path,)) for path in (*(folder / name for name in files), folder)]
    for thread in waiting:
        thread.start()
    for thread in waiting:
        thread.join()


def settle(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk (``fsync``); errors are ignored."""
    with contextlib.suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _locked_folder(beside: Path) -> tuple[Path, int | None]:
    """A new folder and the descriptor of its lock; None for the lock where folders cannot be locked."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=beside))
        lock = _lock_folder(folder)
        if lock is not None or folder.exists():
            return folder, lock
        # Another process took it for a leftover before it was locked.


def _lock_folder(path: Path) -> int | None:
    """The open, locked folder; None where its owner lives, it is gone, or nothing can be locked here."""
    if sys.platform == "win32":
        return None
    descriptor = None
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(descriptor), os.stat(path)):
            return descriptor
    except OSError:
        pass
    if descriptor is not None:
        os.close(descriptor)
    return None


def _is_old(path: Path) -> bool:
    """Whether a folder was left behind, where no lock can show it: by its age."""
    try:
        return not _can_lock(path.parent) and time.time() - path.stat().st_mtime > _LEFTOVER_AGE_S
    except OSError:
        return False


def _can_lock(folder: Path) -> bool:
    """Whether folders can be locked in this file system."""
    if sys.platform == "win32":
        return False
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True
