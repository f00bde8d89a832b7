"""Pictures of boards: corners and circles found by OpenCV, as a table of measurements."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from posture_opt.errors import BadValueError, InputError, InsufficientDataError, Issue, one_of
from posture_opt.files import named_content
from posture_opt.limits import MOST_BOARD_POINTS, MOST_PIXELS
from posture_opt.measurements.camera_section import CharucoSpec, GridSpec
from posture_opt.measurements.table import open_table
from posture_opt.numerics import Array, Codes
from posture_opt.texts import csv_line, unguarded
from posture_opt.units import parse_quantity

INSTALL = "pip install 'posture_opt[camera]'"  # What brings OpenCV
EXAMPLES = "chessboard:8x6:25mm, charuco:5x7:30mm:22mm or grid:8x6:25mm"
DICTIONARY = "5X5_1000"  # Of ArUco marks, where none is named
_IMAGE_COLUMN = "image"


@dataclass(frozen=True)
class Board:
    """A board that pictures show."""

    kind: str  # ``chessboard`` (inner corners), ``charuco`` (squares) or ``grid`` (circles), as in the problem file
    # columns, rows: how many
    columns: int
    rows: int
    square: float  # side or distance [m]
    mark: float = 0.0  # side of an ArUco mark [m]
    dictionary: str = DICTIONARY  # of marks

    @classmethod
    def of(cls, text: str, dictionary: str = DICTIONARY) -> Board:
        kind, *parts = text.split(":")
        if kind not in _FINDERS or len(parts) != (3 if kind == "charuco" else 2):
            raise BadValueError(f"'{text}' is no board", f"write for example {EXAMPLES}")
        try:
            columns, rows = (int(n) for n in parts[0].lower().split("x"))
        except ValueError:
            raise BadValueError(f"'{parts[0]}' is no number of columns and rows", f"as in {EXAMPLES}") from None
        lengths = [parse_quantity(part, "length") for part in parts[1:]]
        spec = CharucoSpec if kind == "charuco" else GridSpec
        least = 3 if spec is CharucoSpec else 2
        if min(columns, rows) < least or min(lengths) <= 0 or lengths[-1] > lengths[0]:
            raise BadValueError(f"'{text}' is no board", f"at least {least} x {least}, and marks within their squares")
        MOST_BOARD_POINTS.check(columns * rows)
        return cls(kind, columns, rows, lengths[0], lengths[1] if len(lengths) > 1 else 0.0, dictionary)

    def found_in(self, picture: Array) -> tuple[Codes, Array]:
        """(n,) numbers and (n, 2) pixels of the points that a grey picture shows; none where the board is not found."""
        # The centre of the first pixel is (0, 0), as in OpenCV
        return _FINDERS[self.kind](opencv(), picture, self)


def opencv() -> Any:
    """The module ``cv2``."""
    try:
        return import_module("cv2")
    except ImportError:
        message = "pictures are searched with OpenCV, which is not installed"
        raise InputError(Issue(message, hint=f"install it: {INSTALL}")) from None


def _regular(cv2: Any, picture: Array, board: Board) -> tuple[Codes, Array]:
    """Inner corners of a chessboard, or centres of circles, counted row by row: all or none."""
    size = board.columns, board.rows
    if board.kind == "chessboard":
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
        found, corners = cv2.findChessboardCornersSB(picture, size, flags=flags)
    else:
        found, corners = cv2.findCirclesGrid(picture, size)
    points = np.asarray(corners, dtype=float).reshape(-1, 2) if found else np.zeros((0, 2))
    return np.arange(len(points)), points


def _charuco(cv2: Any, picture: Array, board: Board) -> tuple[Codes, Array]:
    name = f"DICT_{board.dictionary.upper().removeprefix('DICT_')}"
    if not hasattr(cv2.aruco, name):
        known = [key.removeprefix("DICT_") for key in dir(cv2.aruco) if key.startswith("DICT_")]
        raise BadValueError(f"OpenCV has no dictionary {board.dictionary}", one_of(board.dictionary, known, "known"))
    marks = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    needed, there = board.columns * board.rows // 2, len(marks.bytesList)
    if needed > there:
        message = f"a board of {board.columns} x {board.rows} squares has {needed} marks, and dictionary "
        raise BadValueError(f"{message}{board.dictionary} has {there}", "name the one that the board was printed with")
    printed = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, board.mark, marks)
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(printed).detectBoard(picture)
    if numbers is None or not len(numbers):
        return np.zeros(0, dtype=np.intp), np.zeros((0, 2))
    return np.asarray(numbers, dtype=np.intp).ravel(), np.asarray(corners, dtype=float).reshape(-1, 2)


_FINDERS = {"chessboard": _regular, "charuco": _charuco, "grid": _regular}


@dataclass(frozen=True)
class Detections:
    """A table of measurements from pictures."""

    text: str  # CSV
    found: Mapping[str, int]  # picture -> how many points; rows: all of them

    @property
    def rows(self) -> int:
        """How many points all pictures show."""
        return sum(self.found.values())


def detect_board(images: Sequence[Path], board: Board, joints: Path, camera: str, name: str = "board") -> Detections:
    """The pixels of a board's points in pictures, each with the joints that a table names for its picture."""
    titles, postures = _postures(joints)
    opencv()
    _check_names([image.name for image in images], postures, joints)
    lines, counts = [csv_line([*titles, "pose", "camera", "marker", "u [px]", "v [px]"])], dict[str, int]()
    for image in images:
        numbers, pixels = board.found_in(picture_of(named_content(image, 200_000_000), image))
        counts[image.name] = len(numbers)
        for number, (u, v) in zip(numbers, pixels, strict=True):
            place = [image.name, camera, f"{name}/{number}", f"{u:.4f}", f"{v:.4f}"]
            lines.append(csv_line([*postures[image.name], *place]))
    if not any(counts.values()):
        shown = f"in {images[0].name}" if len(images) == 1 else f"in any of {len(images)} pictures"
        hint = "does --board name its columns, rows and dictionary, and is all of it seen sharply?"
        raise InsufficientDataError(Issue(f"the board was not found {shown}", hint=hint))
    return Detections("\n".join([*lines, ""]), counts)


def _check_names(names: Sequence[str], known: Container[str], joints: Path) -> None:
    issues = [
        Issue(f"no row is of the picture {name}", ("column image",), name, "add one", str(joints))
        for name in names
        if name not in known
    ]
    issues += [
        Issue(f"{count} of the named pictures are called {name}", hint="name each once, and call none alike")
        for name, count in Counter(names).items()
        if count > 1
    ]
    if issues:
        raise InputError(issues)


def picture_of(data: bytes, image: Path) -> Array:
    """The grey values (height, width) of a picture; ``image`` names it in errors."""
    try:
        with Image.open(BytesIO(data)) as picture:
            width, height = picture.size
    except Image.DecompressionBombError:
        raise InputError(Issue(MOST_PIXELS.beyond, hint=MOST_PIXELS.hint, file=str(image))) from None
    except (OSError, ValueError, SyntaxError):
        raise _no_picture(image) from None
    if width * height > MOST_PIXELS.most:
        raise InputError(Issue(MOST_PIXELS.message(width * height), hint=MOST_PIXELS.hint, file=str(image)))
    cv2 = opencv()
    found: Any = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    if found is None:
        raise _no_picture(image)
    return np.asarray(found)


def _no_picture(image: Path) -> InputError:
    return InputError(Issue("this is no picture", hint="PNG, JPEG, TIFF and BMP are read", file=str(image)))


def _postures(path: Path) -> tuple[list[str], dict[str, list[str]]]:
    raw = open_table(path, (_IMAGE_COLUMN,))
    if _IMAGE_COLUMN not in raw.titles:
        raw.faults.stop(f"there is no column {_IMAGE_COLUMN}", "image, joint1 [deg], joint2 [deg], …", raw.line)
    at, found = raw.titles.index(_IMAGE_COLUMN), dict[str, list[str]]()
    for block in raw.blocks:
        for row, line in enumerate(block.lines):
            cells = [str(column[row]).strip() for column in block.cells]
            image = Path(unguarded(cells.pop(at))).name
            if image in found:
                raw.faults.add("the picture is named twice", _IMAGE_COLUMN, image, "keep one", int(line))
            found[image] = cells
    raw.faults.refuse()
    return [title for k, title in enumerate(raw.titles) if k != at], found
