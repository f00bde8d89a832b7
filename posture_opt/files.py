"""Files that users name: found, or refused with the mend, and never read beyond a limit."""

from __future__ import annotations

import stat
from pathlib import Path

from posture_opt.errors import InputError, Issue, nearest


def located(folder: Path, name: str) -> Path:
    """The path of ``name``, relative to ``folder``; ``~`` is the home folder.

    Raises:
        InputError: no path can have this name.
    """
    try:
        name.encode("utf-8")
        return folder / Path(name).expanduser()
    except UnicodeEncodeError:
        raise InputError(Issue("the file name holds characters that no text has", value=name)) from None
    except RuntimeError:
        user = name.split("/")[0]
        raise InputError(Issue(f"there is no home folder {user}", value=name, mend="write the whole path")) from None


def content(path: Path, most: int) -> bytes:
    """The bytes of a regular file of at most ``most`` bytes; devices and pipes, which may have no end, are not opened.

    Raises:
        InputError: no such file, no regular file, too large, or not readable; the message leaves out the path.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device or a pipe"
            raise InputError(Issue(f"this is {kind}, not a file", mend="name a file"))
        with path.open("rb") as stream:
            found = stream.read(most + 1)
    except FileNotFoundError:
        near = Path(nearest_file(path)).name
        mend = f"did you mean {near} in the same folder?" if near else ""
        raise InputError(Issue("no such file", mend=mend)) from None
    except ValueError:
        raise InputError(Issue("the file name holds a character that no file name has")) from None
    except OSError as error:
        raise InputError(Issue(f"the file cannot be read ({error.strerror or error})")) from None
    if len(found) > most:
        raise InputError(Issue(f"the file is larger than {most / 1e6:g} MB"))
    return found


def nearest_file(path: Path) -> str:
    """The path beside ``path`` whose name is written most like its name; empty where none is like it."""
    try:
        names = {entry.stem: entry.name for entry in path.parent.iterdir()}
    except (OSError, ValueError):
        return ""
    # Without their endings: '.csv' alone makes any two names alike.
    stem = nearest(path.stem, names)
    return str(path.parent / names[stem]) if stem else ""
