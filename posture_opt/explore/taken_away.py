"""``TakenAway``: what is written into the folder that the program was started in, and the command line of an answer."""

from __future__ import annotations

import shlex
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from posture_opt.errors import InputError
from posture_opt.files import content, problems_folder
from posture_opt.limits import MAX_YAML_BYTES
from posture_opt.numerics import Array
from posture_opt.output import write_file
from posture_opt.problem.problem import Problem
from posture_opt.problem.yaml_source import edited, parse_yaml
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.tasks.path_task import PathTask


class TakenAway:
    """Writes what is asked for."""

    def __init__(self, stated: Problem) -> None:
        self._stated = stated
        self.folder: Path = Path()
        file = stated.origin.file
        self._first = self._stem = f"{Path(file).stem if file else 'problem'}_explored"
        self._wrote: dict[Path, bytes] = {}

    def command(self, problem: Problem, changed: bool) -> str:
        """The command line that gives the answer to a problem; ``changed``: in more than its target."""
        file = Path(self._stated.origin.file or self._stated.name)
        named = file.stem if file.parent == problems_folder() else str(file)
        words = ["optimize-posture", "--problem", f"{self._stem}.yaml" if changed else named]
        place = position_of(problem)
        if place is not None and not changed:
            words += ["--position", ", ".join(millimetres(place))]
        return shlex.join(words) + ("   # once the problem is saved" if changed else "")

    def save(self, problem: Problem) -> str:
        """Writes a problem with what it needs; the comments of its file stay. Returns what to say of it."""
        try:
            for stem in self._stems():
                name, files = f"{stem}.yaml", problem.files(stem)
                kept = edited(self._text(), parse_yaml(files[name].decode()).data)
                files = files if kept is None else {**files, name: kept.encode()}
                if not any(self._is_anothers(name, content) for name, content in files.items()):
                    self._stem = stem
                    return self._written(files)
        except InputError as error:
            return str(error)
        return "There is no free name."

    def _stems(self) -> Iterator[str]:
        yield self._first
        yield from (f"{self._first}_{k}" for k in range(2, 1000))

    def _is_anothers(self, name: str, content_of_it: bytes) -> bool:
        """Whether a file says something that this page did not write: it was there before, or was changed since."""
        path = self.folder / name
        if not path.exists():
            return False
        try:
            return content(path, max(MAX_YAML_BYTES, len(content_of_it))) not in (content_of_it, self._wrote.get(path))
        except InputError:
            return True

    def report(self, found: Solution | None) -> str:
        """Writes the report of an answer into a folder, as ``--out`` does."""
        if found is None:
            return "There is no posture to report."
        try:
            found.save(self.folder / self._stem)
        except InputError as error:
            return str(error)
        return f"Report written to {(self.folder / self._stem).resolve()}"

    def picture(self, client: Any) -> str:
        """Writes what a browser shows of the scene."""
        if client is None:
            return "No browser asked for it."
        pixels = png(client.get_render(height=1000, width=1600))
        name = next((name for stem in self._stems() if not (self.folder / (name := f"{stem}.png")).exists()), "")
        return self._written({name: pixels}) if name else "There is no free name."

    def _text(self) -> str:
        """The file that the page was opened with, if it still says what it said; else nothing."""
        origin = self._stated.origin
        try:
            text = content(Path(origin.file), MAX_YAML_BYTES).decode("utf-8-sig") if origin.file else ""
            return text if text and parse_yaml(text).data == origin.data else ""
        except (InputError, UnicodeDecodeError):
            return ""

    def _written(self, files: dict[str, bytes]) -> str:
        try:
            for name, content_of_it in files.items():
                write_file(self.folder / name, content_of_it)
                self._wrote[self.folder / name] = content_of_it
        except InputError as error:
            return str(error)
        return f"{next(iter(files))} written to {self.folder.resolve()}"


def png(pixels: Array) -> bytes:
    """An image (h, w, 3) or (h, w, 4) of bytes as a PNG file (ISO 15948), rows unfiltered."""
    height, width, channels = pixels.shape
    rows = np.hstack([np.zeros((height, 1), np.uint8), pixels.astype(np.uint8).reshape(height, -1)])

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    chunks = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows.tobytes())) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


def position_of(problem: Problem) -> tuple[float, ...] | None:
    """Where the task asks the tool point for [m]; None where it may be anywhere."""
    return None if problem.task is None or problem.task.position is None else tuple(problem.task.position)


def places_of(problem: Problem) -> Array:
    """(k, 3) where the tool point is to go [m]: to the target, or along the path; none where it may be anywhere."""
    if isinstance(problem.task, PathTask):
        return np.array(problem.task.tool_points)
    return np.reshape(position_of(problem) or (), (-1, 3)).astype(float)


def millimetres(place: Sequence[float] | Array) -> list[str]:
    """A place [m] in tenths of a millimetre, as files write it."""
    return [f"{1e3 * v + 0.0:.1f} mm" for v in np.round(np.asarray(place, dtype=float), 4) + 0.0]
