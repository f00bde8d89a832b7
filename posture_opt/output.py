"""What leaves the program: JSON text, and folders whose files appear whole or not at all."""

from __future__ import annotations

import json
import math
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from posture_opt import __version__
from posture_opt.errors import InputError, Issue, KeyPath


def json_text(document: dict[str, Any]) -> str:
    """A document as JSON text with the version of the program in front; numbers that JSON lacks become null."""
    return json.dumps({"posture_opt": __version__, **finite(document)}, indent=2, ensure_ascii=False, allow_nan=False)


def finite(value: Any) -> Any:
    """The same nested data with null in place of NaN and infinity."""
    if isinstance(value, dict):
        return {str(key): finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def staged_folder(out: Path, key: KeyPath = ()) -> Iterator[Path]:
    """A folder to write into, whose files move to ``out`` when all went well and vanish when anything did not.

    Args:
        key: what the user calls ``out``, for the message.

    Raises:
        InputError: ``out`` cannot be written to; this is known at once.
    """
    made = _missing_parents(out)
    staging = _staging(out, key)
    try:
        yield staging
        _move_into_place(staging, out)
    except OSError as error:
        if error.filename is None or str(staging) not in str(error.filename):
            raise
        raise InputError(Issue(f"cannot write to {out}: {error.strerror}", key)) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        _remove_empty(made)


@contextmanager
def writable_folder(out: Path, key: KeyPath = ()) -> Iterator[None]:
    """Makes sure that ``out`` can be written to before anything is computed; leaves nothing where nothing came of it.

    Raises:
        InputError: it cannot.
    """
    made = _missing_parents(out)
    shutil.rmtree(_staging(out, key), ignore_errors=True)
    try:
        yield
    finally:
        _remove_empty(made)


def _missing_parents(out: Path) -> list[Path]:
    return [folder for folder in out.absolute().parents if not folder.exists()]


def _staging(out: Path, key: KeyPath) -> Path:
    """A new folder in the file system of ``out``: inside it where it exists, else beside it."""
    try:
        if out.exists() and not out.is_dir():
            raise NotADirectoryError(20, "this is a file, not a folder")
        if not out.exists():
            out.absolute().parent.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(prefix=".posture_opt-", dir=out if out.exists() else out.absolute().parent))
    except OSError as error:
        message = f"cannot write to {out}: {(error.strerror or str(error)).lower()}"
        raise InputError(Issue(message, key, str(out), "name a folder that you may write to")) from None


def _move_into_place(staging: Path, out: Path) -> None:
    if not out.exists():
        umask = os.umask(0)
        os.umask(umask)
        staging.chmod(0o777 & ~umask)  # a temporary folder is private, the result is not
        staging.rename(out)
        return
    for file in sorted(path for path in staging.rglob("*") if path.is_file()):
        target = out / file.relative_to(staging)
        target.parent.mkdir(parents=True, exist_ok=True)
        file.replace(target)


def _remove_empty(folders: list[Path]) -> None:
    """Folders that were made on the way are removed where nothing came of it."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return
