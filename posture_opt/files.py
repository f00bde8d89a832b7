"""Every file that is read is opened here: found, or refused with a hint, and never read beyond a limit."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import BinaryIO

from posture_opt.errors import InputError, Issue, nearest


def located(folder: Path, name: str) -> Path:
    """The path of ``name``, relative to ``folder``; ``~`` is the home folder. Whether there is a file is not asked."""
    _check_name(name)
    try:
        return folder / Path(name).expanduser()
    except RuntimeError:
        user = name.split("/")[0]
        raise InputError(Issue(f"there is no home folder {user}", value=name, hint="write the whole path")) from None


def _check_name(name: str) -> None:
    if "\0" in name:
        raise InputError(Issue("the file name holds a character that no file name has", value=name))
    try:
        os.fsencode(name).decode("utf-8")
    except UnicodeError:
        raise InputError(Issue("the file name is not UTF-8", value=name, hint="rename the file")) from None


def is_there(path: Path) -> bool:
    """Whether something has this path; False also for names that no file can have."""
    return _status_or_none(path) is not None


def is_file(path: Path) -> bool:
    """Whether this is the path of a regular file; links are followed."""
    status = _status_or_none(path)
    return status is not None and stat.S_ISREG(status.st_mode)


def _status_or_none(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except (OSError, ValueError):
        return None


@contextmanager
def opened(path: Path, most: int) -> Iterator[BinaryIO]:
    """A regular file of at most ``most`` bytes, open to be read; devices and pipes may have no end, and are refused."""
    _check_name(str(path))
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device or a pipe"
            raise InputError(Issue(f"this is {kind}, not a file", hint="name a file"))
        if status.st_size > most:
            raise InputError(Issue(f"the file is larger than {most / 1e6:g} MB"))
        with path.open("rb") as stream:
            yield stream
    except FileNotFoundError:
        near = Path(nearest_file(path)).name
        hint = f"did you mean {near} in the same folder?" if near else ""
        raise InputError(Issue("no such file", hint=hint)) from None
    except OSError as error:
        raise InputError(Issue(f"the file cannot be read ({error.strerror or error})")) from None


def content(path: Path, most: int) -> bytes:
    """The bytes of a regular file of at most ``most`` bytes."""
    with opened(path, most) as stream:
        found = stream.read(most + 1)
    if len(found) > most:  # files of /proc have size 0
        raise InputError(Issue(f"the file is larger than {most / 1e6:g} MB"))
    return found


def naming(path: Path, error: InputError) -> InputError:
    """The same error, with the path that ``opened`` leaves out; what knows its file and line needs none."""
    return InputError([i if i.file else replace(i, message=f"{i.message}: {path}") for i in error.issues])


def named_content(path: Path, most: int) -> bytes:
    """The `content` of a file; errors name its path."""
    try:
        return content(path, most)
    except InputError as error:
        raise naming(path, error) from None


def nearest_file(path: Path) -> str:
    """The path in the folder of ``path`` whose name is written most like its name; empty where none is like it."""
    try:
        names = {entry.stem: entry.name for entry in path.parent.iterdir()}
    except (OSError, ValueError):
        return ""
    # Without their endings: '.csv' alone makes any two names alike.
    stem = nearest(path.stem, names)
    return str(path.parent / names[stem]) if stem else ""


@cache
def problems_folder() -> Path:
    """The folder of the built-in problems: inside the installed package, or beside it in a source tree."""
    inside = Path(str(files("posture_opt"))) / "problems"
    return inside if inside.is_dir() else inside.parents[1] / "problems"


def preset_names() -> tuple[str, ...]:
    """The names of all presets of robots, sorted."""
    folder = files("posture_opt").joinpath("robot", "presets")
    return tuple(sorted(item.name.removesuffix(".yaml") for item in folder.iterdir() if item.name.endswith(".yaml")))


def builtin_names() -> tuple[str, ...]:
    """The names of the problems that travel with the package, sorted."""
    return tuple(sorted(path.stem for path in problems_folder().glob("*.yaml")))


def packaged(package: str, *parts: str) -> str:
    """A text that is part of the package: ``packaged("posture_opt.robot", "presets", "ur10.yaml")``."""
    return files(package).joinpath(*parts).read_text(encoding="utf-8")
