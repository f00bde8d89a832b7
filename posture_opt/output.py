"""What is written for the user: folders whose files appear whole or not at all."""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

from posture_opt.errors import InputError, Issue, KeyPath
from posture_opt.errors import listed as in_words
from posture_opt.files import content
from posture_opt.interrupts import undisturbed

if sys.platform != "win32":
    import fcntl

PREFIX = ".posture_opt-"  # begins the names of folders that are being prepared
MANIFEST = ".files.sha256"  # the program's own files with their digests; `sha256sum --check .files.sha256` reads it
# Pairs of a file's name and the SHA-256 of its content; two of one name while one report replaces another.
Manifest = frozenset[tuple[str, str]]


def write_folder(
    out: Path, files: Mapping[str, bytes], key: KeyPath = (), replaces: Collection[str] = frozenset()
) -> tuple[Path, ...]:
    """Write files, by name, into a folder: all of them in one step, or none.

    The whole folder is prepared beside ``out`` and takes its place at once, other files of the folder included: a
    reader finds either the old or the new one, also after a power cut. Where a folder cannot be exchanged (it has
    folders inside, is the working folder, a mount point or another user's; another system than Linux), the files of
    ``replaces`` go first and the new ones come then, so that two reports are never there together.

    Args:
        key: what the user calls ``out``, for the message.
        replaces: names that, written by an earlier call and not changed since, are removed.

    Raises:
        InputError: ``out`` cannot be written to, or has a file of such a name that this program did not write, or
            that was changed since. Nothing was touched then.
    """
    with _parents_kept_if_filled(out), _os_errors_as_issues(out, key):
        place = Path(os.path.realpath(out))
        place.parent.mkdir(parents=True, exist_ok=True)
        with _one_at_a_time(place.parent):
            _check_foreign(out, key, files)
            _put_files(place, files, replaces)
    return tuple(out / name for name in files)


def _put_files(place: Path, files: Mapping[str, bytes], replaces: Collection[str]) -> None:
    known = manifest_of(place)
    gone = {name for name, _ in known if name in {*files, *replaces} and _is_as_written(place / name, known)}
    new = {(name, hashlib.sha256(data).hexdigest()) for name, data in files.items()}
    listed = frozenset({entry for entry in known if entry[0] not in gone} | new)
    whole = not place.exists() or _can_exchange(place)
    with staging(place.parent if whole else place) as prepared:
        _write_through(prepared, {**files, MANIFEST: _manifest_text(listed)})
        with undisturbed():
            if not (whole and _put_in_place(prepared, place, gone)):
                _move_in(prepared, place, gone, known | listed)
            settle(place.parent)


def write_file(path: Path, content: bytes, key: KeyPath = ()) -> None:
    """Write one file, whole or not at all, in place of one of this name.

    Raises:
        InputError: it cannot be written.
    """
    folder = path.absolute().parent
    with _parents_kept_if_filled(path), _os_errors_as_issues(path, key):
        folder.mkdir(parents=True, exist_ok=True)
        with staging(folder) as prepared:
            _write_through(prepared, {"file": content})
            if path.is_dir():
                raise IsADirectoryError(21, "this is a folder")
            (prepared / "file").replace(path)
            settle(folder)


@contextmanager
def writable_folder(out: Path, key: KeyPath = (), names: Collection[str] = frozenset()) -> Iterator[None]:
    """Make sure that ``out`` can take files of these names before anything is computed; leave no empty folder.

    Raises:
        InputError: it cannot, or holds such a file that this program did not write, or that was changed since.
    """
    with _parents_kept_if_filled(out):
        with _os_errors_as_issues(out, key):
            _check_foreign(out, key, names)
            place = Path(os.path.realpath(out))
            place.parent.mkdir(parents=True, exist_ok=True)
            if place.exists():
                _clear_leftovers(place)
            with staging(place.parent if not place.exists() or _can_exchange(place) else place):
                pass
        yield


@contextmanager
def _parents_kept_if_filled(out: Path) -> Iterator[None]:
    """Remove folders above ``out`` that were made on the way and hold nothing, the innermost first."""
    missing = [folder for folder in out.absolute().parents if not folder.exists()]
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            for folder in missing:
                folder.rmdir()


@contextmanager
def _os_errors_as_issues(out: Path, key: KeyPath) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        message = f"cannot write to {out}: {(error.strerror or str(error)).lower()}"
        raise InputError(Issue(message, key, str(out), "name a place with room that you may write to")) from None


# The manifest: which files of a folder this program wrote, and what was in them.


def manifest_of(folder: Path) -> Manifest:
    """The manifest of a folder, of its plain names; empty where there is none."""
    try:
        text = content(folder / MANIFEST, 1_000_000).decode("utf-8", errors="replace")  # a longer one is not ours
    except InputError:
        return frozenset()
    lines = [line.partition("  ") for line in text.splitlines()]
    plain = (line for line in lines if line[2] not in ("", ".", "..") and line[2] == os.path.basename(line[2]))
    return frozenset((name, digest) for digest, _, name in plain)


def _manifest_text(entries: Manifest) -> bytes:
    return "".join(f"{digest}  {name}\n" for name, digest in sorted(entries)).encode()


def _is_as_written(path: Path, known: Manifest) -> bool:
    """Whether the program wrote this file; one that was changed since belongs to whoever changed it."""
    if path.is_symlink() or all(name != path.name for name, _ in known):
        return False
    try:  # larger files are foreign without being read
        return (path.name, hashlib.sha256(content(path, 1_000_000_000)).hexdigest()) in known
    except InputError:
        return False


def _check_foreign(out: Path, key: KeyPath, names: Collection[str]) -> None:
    """Refuse a file as ``out``, and a folder with files of these names that are not as the program wrote them."""
    if os.path.lexists(out) and not out.is_dir():
        raise NotADirectoryError(20, "this is a file, not a folder")
    known = manifest_of(out)
    foreign = sorted(n for n in names if os.path.lexists(out / n) and not _is_as_written(out / n, known))
    if foreign:
        was = "was" if len(foreign) == 1 else "were"
        files = f"{in_words(foreign, 5)} there {was} not written by this program, or changed since"
        hint = "name another folder, or move away what you want to keep"
        raise InputError(Issue(f"cannot write to {out}: {files}", key, str(out), hint))


# Folders that others see whole or not at all: prepared beside their place, and put there in one step.


@contextmanager
def staging(beside: Path) -> Iterator[Path]:
    """A new folder in ``beside``, removed at the end; a lock shows other processes that its owner is alive.

    What a killed process left in ``beside`` is cleared first.
    """
    _clear_leftovers(beside)
    while True:
        folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=beside))
        lock = _lock_folder(folder)
        if lock is not None or folder.exists():
            break  # else another process took it for a leftover before it was locked
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def settle(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk (``fsync``); errors are ignored."""
    with contextlib.suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _write_through(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files, name -> content, and wait until they are on the disk."""
    for name, data in files.items():
        (folder / name).write_bytes(data)
    # All at once: a file system that waits for each in turn takes forty times as long.
    waiting = [Thread(target=settle, args=(path,)) for path in (*(folder / name for name in files), folder)]
    for thread in waiting:
        thread.start()
    for thread in waiting:
        thread.join()


def _can_exchange(place: Path) -> bool:
    """Whether another folder may take the place of this one without any process being left in the old one."""
    status = place.stat()
    mine = not hasattr(os, "geteuid") or status.st_uid == os.geteuid()
    apart = not os.path.ismount(place) and not os.path.samestat(status, os.stat(os.curdir))
    may = os.access(place.parent, os.W_OK | os.X_OK)
    return mine and apart and may and not any(path.is_dir() and not path.is_symlink() for path in place.iterdir())


def _put_in_place(prepared: Path, place: Path, gone: Collection[str]) -> bool:
    """Put the prepared folder into its place, with the files of the place that are not ``gone``.

    False, with nothing changed, where links or the exchange are not possible.
    """
    if not place.exists():
        umask = os.umask(0)
        os.umask(umask)
        prepared.chmod(0o777 & ~umask)  # a temporary folder is private, the result is not
        prepared.rename(place)
        return True
    try:
        for path in place.iterdir():
            if path.name not in {*gone, MANIFEST} and not path.name.startswith(PREFIX):
                os.link(path, prepared / path.name, follow_symlinks=False)
        shutil.copymode(place, prepared)
    except (OSError, NotImplementedError):
        return False
    if not exchanged(prepared, place):
        return False
    with contextlib.suppress(OSError):
        for path in prepared.iterdir():  # now the old folder: what came in the meantime moves over
            if path.name not in gone and not os.path.lexists(place / path.name):
                path.rename(place / path.name)
    return True


def exchanged(one: Path, other: Path) -> bool:
    """Give two folders each other's name in one step; False, with nothing changed, where the system cannot.

    Source: ``renameat2`` of Linux 3.15; AT_FDCWD is −100 (``<fcntl.h>``), RENAME_EXCHANGE 2 (``<linux/fs.h>``).
    """
    try:
        rename = ctypes.CDLL(None).renameat2 if sys.platform == "linux" else None
    except (OSError, AttributeError):
        return False
    return rename is not None and bool(rename(-100, os.fsencode(one), -100, os.fsencode(other), 2) == 0)


def _move_in(prepared: Path, place: Path, gone: Collection[str], either: Manifest) -> None:
    """Move the prepared files into a folder that stays: the old ones go first, the manifest knows both meanwhile."""
    (prepared / "either").write_bytes(_manifest_text(either))
    (prepared / "either").replace(place / MANIFEST)
    for name in sorted(gone):
        (place / name).unlink()
    for path in sorted(prepared.iterdir(), key=lambda path: path.name == MANIFEST):
        path.replace(place / path.name)


@contextmanager
def _one_at_a_time(folder: Path) -> Iterator[None]:
    """Wait until no other process is in such a block for this folder; without waiting where it cannot be locked."""
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


def _clear_leftovers(folder: Path) -> None:
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
    """Whether a folder was left behind where no lock can show it: no run writes for a day."""
    try:
        return not _can_lock(path.parent) and time.time() - path.stat().st_mtime > 86_400.0
    except OSError:
        return False


def _can_lock(folder: Path) -> bool:
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
