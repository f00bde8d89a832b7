"""What is written for the user: JSON text, and folders whose files appear whole or not at all."""

from __future__ import annotations

import contextlib
import json
import math
import os
import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from posture_opt import __version__
from posture_opt.errors import InputError, Issue, KeyPath
from posture_opt.errors import listed as in_words
from posture_opt.interrupts import undisturbed
from posture_opt.manifest import MANIFEST, Manifest
from posture_opt.staging import PREFIX, clear_leftovers, exchanged, one_at_a_time, settle, staging, write_through

if TYPE_CHECKING:
    from posture_opt.numerics import Json


def json_text(document: Mapping[str, Json]) -> str:
    """A document as JSON text with the version of the program in front; numbers that JSON lacks become null.

    Example:
        >>> json_text({"sigma": math.nan}).splitlines()[-2]
        '  "sigma": null'
    """
    return json.dumps(
        {"posture_opt": __version__, **finite_document(document)}, indent=2, ensure_ascii=False, allow_nan=False
    )


def finite_document(document: Mapping[str, Json]) -> dict[str, Json]:
    """The same document with null in place of NaN and infinity."""
    return {str(key): finite(entry) for key, entry in document.items()}


def finite(value: Json) -> Json:
    """The same nested data with null in place of NaN and infinity; keys become texts, tuples lists."""
    if isinstance(value, dict):
        return finite_document(value)
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_folder(
    out: Path, files: Mapping[str, bytes], key: KeyPath = (), replaces: Collection[str] = frozenset()
) -> tuple[Path, ...]:
    """Writes files, by name, into a folder: all of them in one step, or none.

    The whole folder is prepared next to ``out`` and takes its place at once, other files of the folder included: a
    reader finds what was there before or what is there now, also after a power cut. Where a folder cannot be exchanged
    (it has folders inside, is the working folder, a mount point or another user's; another system than Linux), the
    files of ``replaces`` go first and the new ones come then, so that at no time two reports are there together.

    Args:
        out: the folder; it and its parents are made where they are missing.
        files: name -> content.
        key: what the user calls ``out``, for the message.
        replaces: names that, written by an earlier call and not changed since, are removed.

    Returns:
        The paths of the files, in their order.

    Raises:
        InputError: ``out`` cannot be written to, or has a file of such a name that this program did not write, or
            that was changed since. Nothing was touched then.
    """
    made = _missing_parents(out)
    try:
        with _os_errors_as_issues(out, key):
            place = Path(os.path.realpath(out))
            place.parent.mkdir(parents=True, exist_ok=True)
            with one_at_a_time(place.parent):
                _check_foreign(out, key, files)
                _put_files(place, files, replaces)
    finally:
        _remove_empty(made)
    return tuple(out / name for name in files)


def _put_files(place: Path, files: Mapping[str, bytes], replaces: Collection[str]) -> None:
    """Write files, name -> content, into a folder, as of `write_folder`; nobody else does so meanwhile."""
    known = Manifest.of(place)
    gone = {name for name in known.names & {*files, *replaces} if known.lists(place / name)}
    listed = known.of_names(known.names - gone).joined(Manifest.listing(files))
    whole = not place.exists() or _can_exchange(place)
    with staging(place.parent if whole else place) as prepared:
        write_through(prepared, {**files, MANIFEST: listed.text.encode()})
        with undisturbed():
            if not (whole and _put_in_place(prepared, place, gone)):
                _move_in(prepared, place, gone, known.joined(listed))
            settle(place.parent)


def write_file(path: Path, content: bytes, key: KeyPath = ()) -> None:
    """Writes one file, whole or not at all; one of this name is replaced.

    Args:
        path: of the file; its folder is made where it is missing.
        content: all of it.
        key: what the user calls ``path``, for the message.

    Raises:
        InputError: it cannot be written.
    """
    folder, made = path.absolute().parent, _missing_parents(path)
    try:
        with _os_errors_as_issues(path, key):
            folder.mkdir(parents=True, exist_ok=True)
            with staging(folder) as prepared:
                write_through(prepared, {"file": content})
                if path.is_dir():
                    raise IsADirectoryError(21, "this is a folder")
                (prepared / "file").replace(path)
                settle(folder)
    finally:
        _remove_empty(made)


@contextmanager
def writable_folder(out: Path, key: KeyPath = (), names: Collection[str] = frozenset()) -> Iterator[None]:
    """Makes sure that ``out`` can be written to before anything is computed; leaves nothing where nothing came of it.

    What a run that was killed has left there is cleared.

    Args:
        names: of files that may be written.

    Raises:
        InputError: it cannot, or holds such a file that this program did not write, or that was changed since.
    """
    made = _missing_parents(out)
    try:
        with _os_errors_as_issues(out, key):
            _check_foreign(out, key, names)
            place = Path(os.path.realpath(out))
            place.parent.mkdir(parents=True, exist_ok=True)
            if place.exists():
                clear_leftovers(place)
            with staging(place.parent if not place.exists() or _can_exchange(place) else place):
                pass
        yield
    finally:
        _remove_empty(made)


@contextmanager
def _os_errors_as_issues(out: Path, key: KeyPath) -> Iterator[None]:
    """Whatever the system refuses is reported as what it means for the user.

    Raises:
        InputError: for every OSError of the body.
    """
    try:
        yield
    except OSError as error:
        message = f"cannot write to {out}: {(error.strerror or str(error)).lower()}"
        raise InputError(Issue(message, key, str(out), "name a place with room that you may write to")) from None


def _check_foreign(out: Path, key: KeyPath, names: Collection[str]) -> None:
    """Refuses a folder that has files of these names that are not ours.

    Raises:
        NotADirectoryError: ``out`` is a file.
        InputError: files that this program did not write, or that were changed since.
    """
    if os.path.lexists(out) and not out.is_dir():
        raise NotADirectoryError(20, "this is a file, not a folder")
    foreign = Manifest.of(out).foreign(out, names)
    if foreign:
        was = "was" if len(foreign) == 1 else "were"
        files = f"{in_words(foreign, 5)} there {was} not written by this program, or changed since"
        raise InputError(
            Issue(
                f"cannot write to {out}: {files}",
                key,
                str(out),
                "name another folder, or move away what you want to keep",
            )
        )


def _can_exchange(place: Path) -> bool:
    """Whether another folder may take the place of this one without any process being left in the old one."""
    status = place.stat()
    mine = not hasattr(os, "geteuid") or status.st_uid == os.geteuid()
    apart = not os.path.ismount(place) and not os.path.samestat(status, os.stat(os.curdir))
    may = os.access(place.parent, os.W_OK | os.X_OK)
    return mine and apart and may and not any(path.is_dir() and not path.is_symlink() for path in place.iterdir())


def _put_in_place(prepared: Path, place: Path, gone: Collection[str]) -> bool:
    """Put the prepared folder into its place, with the other files of the place.

    Args:
        prepared: the new folder; place: where it belongs.
        gone: names that are not taken over.

    Returns:
        Whether it was done; False where links or the exchange are not possible, with nothing changed.
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


def _move_in(prepared: Path, place: Path, gone: Collection[str], either: Manifest) -> None:
    """Move the prepared files into a folder that stays: the old ones go first, the manifest knows both meanwhile."""
    (prepared / "either").write_text(either.text, encoding="utf-8")
    (prepared / "either").replace(place / MANIFEST)
    for name in sorted(gone):
        (place / name).unlink()
    for path in sorted(prepared.iterdir(), key=lambda path: path.name == MANIFEST):
        path.replace(place / path.name)


def _missing_parents(out: Path) -> list[Path]:
    """The folders above a path that do not exist yet, the nearest first."""
    return [folder for folder in out.absolute().parents if not folder.exists()]


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders that were made on the way where nothing was written into them, the innermost first."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return
