"""Meshes of a URDF: their files and faces, read through trimesh, which is optional."""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import Any
from xml.sax.saxutils import escape, unescape

import numpy as np

from posture_opt.errors import InputError, listed
from posture_opt.files import content, is_file
from posture_opt.numerics import Array

MAX_FACES = 100_000  # Faces of a mesh whose own surface is used; of a finer one the convex hull, which contains it
# What robots are described with; archives, of which a small one may unfold to anything, are not
_MESH_SUFFIXES = {".stl", ".obj", ".ply", ".off", ".dae"}


_MESH_FILE = re.compile(
    rb"""(?P<before><mesh\b[^>]*?\bfilename\s*=\s*(?P<quote>["']))(?P<name>.*?)(?P=quote)""", re.DOTALL
)
_QUOTES = {"&quot;": '"', "&apos;": "'"}


class UnreadMeshError(Exception):
    """A mesh that could not be read, and why: the shape of its link stays unknown."""


def located_mesh(name: str, urdf: Path) -> Path:
    """The file of a mesh name in a URDF: ``package://PACKAGE/…``, ``file://…``, absolute, or relative to the URDF. A
    ROS package lies in a folder of its name, or in one with a ``package.xml``, somewhere above the URDF or next to one
    of the folders above."""
    for path in _candidate_paths(name, urdf.absolute().parent):
        if is_file(path):
            return path
    raise UnreadMeshError(f"mesh {PurePosixPath(name).name} not found")


def with_whole_paths(data: bytes, urdf: Path) -> bytes:
    """A URDF whose meshes have whole paths where they are found from its own folder: it may then be put elsewhere."""

    def whole(match: re.Match[bytes]) -> bytes:
        try:
            path = located_mesh(unescape(match["name"].decode(), _QUOTES), urdf)
        except (UnreadMeshError, UnicodeDecodeError):
            return match[0]
        text = escape(path.resolve().as_posix(), {char: entity for entity, char in _QUOTES.items()})
        return match["before"] + text.encode() + match["quote"]

    return _MESH_FILE.sub(whole, data)


def _candidate_paths(name: str, folder: Path) -> list[Path]:
    if name.startswith(("package://", "model://")):
        package, _, rest = name.partition("://")[2].partition("/")
        above = [folder, *folder.parents]
        own = [parent / rest for parent in above if parent.name == package or is_file(parent / "package.xml")]
        return [*own, *(parent / package / rest for parent in above)]
    return [folder / name.removeprefix("file://")]


def read_triangles(path: Path) -> Array:
    """(f, 3, 3) corners of the faces of a mesh in the unit of its file; of a very fine one those of its hull."""
    mesh = load_mesh(path)
    if len(mesh.faces) > MAX_FACES:
        mesh = mesh.convex_hull
    triangles = np.asarray(mesh.triangles, dtype=float)
    if not len(triangles) or not usable(triangles) or not np.ptp(triangles.reshape(-1, 3), axis=0).max():
        raise UnreadMeshError(f"mesh {path.name} is empty or broken")
    return triangles


def usable(coordinates: Array) -> bool:
    # Largest coordinate of a mesh that is used, in m or in the unit of its file: a thousand kilometres in mm.
    return bool(np.all(np.abs(coordinates) < 1e9))  # NaN is below nothing


def load_mesh(path: Path) -> Any:
    """The mesh as trimesh has it, vertices (v, 3) and faces (f, 3)."""
    if path.suffix.lower() not in _MESH_SUFFIXES:
        raise UnreadMeshError(f"mesh {path.name} is none of {listed(sorted(_MESH_SUFFIXES))}")
    try:
        data = content(path, 50_000_000)  # largest mesh file that is read
        import trimesh
    except InputError as error:
        raise UnreadMeshError(f"mesh {path.name}: {error}") from None
    except ImportError:
        raise UnreadMeshError("meshes need a further package: pip install 'posture_opt[mesh]'") from None
    try:
        # From memory: other files that it names, as pictures and materials, are not opened.
        return trimesh.load(BytesIO(data), file_type=path.suffix.lower()[1:], force="mesh", process=False)
    except ImportError:
        kind = path.suffix.lower()
        needed = "pip install pycollada" if kind == ".dae" else "a library of that format"
        raise UnreadMeshError(f"{kind} meshes need a further package: {needed}") from None
    except Exception as error:  # of a dozen formats and their readers
        raise UnreadMeshError(f"mesh {path.name} cannot be read ({type(error).__name__})") from None
