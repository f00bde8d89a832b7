"""What a problem file says of cameras and of the boards that they see, and where a point is in a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from posture_opt.errors import BadValueError, did_you_mean
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.spec import Spec
from posture_opt.units import Length, Pixels

# What of a camera can be unknown beside its pose: the share by which its focal lengths are longer [1], the shift of
# its principal point in focal lengths [1], and what is added to its distortion [1]
INTRINSICS = ("focal_length", "c_x", "c_y", "k1", "k2", "p1", "p2")


@dataclass(frozen=True)
class Intrinsics:
    """What a calibration of a camera says: OpenCV's camera matrix and distortion coefficients."""

    focal: tuple[float, float]  # f_x, f_y [px]
    centre: tuple[float, float]  # c_x, c_y [px]
    distortion: tuple[float, ...] = (0.0,) * 5  # k1, k2, p1, p2, k3 [1]
    size: tuple[int, int] = (0, 0)  # width and height of the picture [px]; zeros where they are not known

    @property
    def row(self) -> Array:
        """(9,) f_x, f_y, c_x, c_y, k1, k2, p1, p2, k3."""
        return np.array([*self.focal, *self.centre, *self.distortion])

    def rays(self, pixels: Array) -> Array:
        """(N, 2) the points ``(x', y')`` at a depth of one whose pictures are the pixels (N, 2), by iteration."""
        distorted = (pixels - self.centre) / self.focal
        found = distorted.copy()
        for _ in range(30):  # some ten suffice at usual lenses
            radial, tangential, _ = _distortion(found, np.array(self.distortion)[:, None])
            found = (distorted - tangential) / radial[:, None]
        return np.asarray(found)

    def changed(self, unknowns: Array) -> Intrinsics:
        """The intrinsics with the values of `INTRINSICS` (7,) that a fit found."""
        k = tuple(float(d + e) for d, e in zip(self.distortion, [*unknowns[3:], 0.0], strict=True))
        fx, fy = (f * (1 + float(unknowns[0])) for f in self.focal)
        cx, cy = (c + f * float(u) for c, f, u in zip(self.centre, self.focal, unknowns[1:3], strict=True))
        return Intrinsics((fx, fy), (cx, cy), k, self.size)


@dataclass(frozen=True, eq=False)
class Picture:
    """Where points are in their pictures, and how that changes."""

    pixels: Array  # (N, 2) [px]
    by_point: Array  # (N, 2, 3) their derivatives by the points in the camera's frame [px/m]
    by_intrinsics: Array  # (N, 2, 7) by the unknowns of `INTRINSICS` [px]


def projected(points: Array, rows: Array, unknowns: Array) -> Picture:
    """The pictures of points by ``u = f_x x'' + c_x`` with the distorted ``x''``; OpenCV's ``projectPoints``."""
    # ``x' = x/z``, ``x'' = x' (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x'y' + p2 (r² + 2x'²)``, likewise ``y''``
    # points: (N, 3) in the frame of the camera [m], z along its axis; rows: (N, 9) of `Intrinsics.row`; unknowns: (N,
    # 7) of `INTRINSICS`
    depth = np.where(np.abs(points[:, 2]) < 1e-6, 1e-6, points[:, 2])  # nearer, a point has no picture
    flat = points[:, :2] / depth[:, None]
    f0, k = rows[:, :2], rows[:, 4:].T.copy()
    k[:4] += unknowns[:, 3:].T
    f = f0 * (1 + unknowns[:, :1])
    radial, tangential, slope = _distortion(flat, k)
    bent = flat * radial[:, None] + tangential
    by_flat = f[:, :, None] * slope
    last = -np.einsum("nij,nj->ni", by_flat, flat) / depth[:, None]
    by_point = np.concatenate([by_flat / depth[:, None, None], last[:, :, None]], axis=2)
    pixels = f * bent + rows[:, 2:4] + f0 * unknowns[:, 1:3]
    # By the focal length, the principal point, k1, k2, p1 and p2
    (x, y), square = flat.T, np.sum(flat**2, axis=1)
    by_intrinsics = np.zeros((len(flat), 2, len(INTRINSICS)))
    by_intrinsics[:, :, 0] = f0 * bent
    by_intrinsics[:, 0, 1], by_intrinsics[:, 1, 2] = f0.T
    by_intrinsics[:, :, 3] = f * flat * square[:, None]
    by_intrinsics[:, :, 4] = f * flat * square[:, None] ** 2
    by_intrinsics[:, :, 5] = f * np.stack([2 * x * y, square + 2 * y**2], axis=1)
    by_intrinsics[:, :, 6] = f * np.stack([square + 2 * x**2, 2 * x * y], axis=1)
    return Picture(pixels, by_point, by_intrinsics)


def _distortion(flat: Array, k: Array) -> tuple[Array, Array, Array]:
    """The radial factor (N,), the tangential shift (N, 2), and the derivative (N, 2, 2) of the distorted points."""
    # flat: (N, 2) x', y'; k: (5, N) or (5, 1) coefficients
    x, y = flat.T
    square = x**2 + y**2
    k1, k2, p1, p2, k3 = k
    radial: Any = 1 + square * (k1 + square * (k2 + square * k3))
    tangential = np.stack(
        [2 * p1 * x * y + p2 * (square + 2 * x**2), p1 * (square + 2 * y**2) + 2 * p2 * x * y], axis=1
    )
    growth = 2 * (k1 + square * (2 * k2 + 3 * square * k3))
    slope = np.empty((len(flat), 2, 2))
    slope[:, 0, 0] = radial + growth * x**2 + 2 * p1 * y + 6 * p2 * x
    slope[:, 1, 1] = radial + growth * y**2 + 6 * p1 * y + 2 * p2 * x
    slope[:, 0, 1] = slope[:, 1, 0] = growth * x * y + 2 * p1 * x + 2 * p2 * y
    return radial, tangential, slope


Freed = Literal["focal_length", "principal_point", "distortion"]
# Where in `INTRINSICS` what may be free is
UNKNOWN_SLOTS: Mapping[str, tuple[int, ...]] = {
    "focal_length": (0,),
    "principal_point": (1, 2),
    "distortion": (3, 4, 5, 6),
}


class IntrinsicsSigma(Spec):
    """How well the intrinsics of a file are known."""

    focal_length: Pixels = Field(0.0, ge=0, description="standard deviation of both focal lengths together")
    principal_point: Pixels = Field(0.0, ge=0, description="standard deviation of each of its coordinates")


class CameraSpec(Spec):
    """What is known of a camera beforehand; its pose never is."""

    mount: Literal["cell", "tool"] = Field(description="cell: it stands still; tool: the arm carries it")
    intrinsics: str = Field(
        min_length=1, description="file of OpenCV (camera_matrix, distortion_coefficients) or a ROS camera_info",
        examples=["left.yaml"],
    )  # fmt: skip
    free: tuple[Freed, ...] = Field((), description="what of the intrinsics is unknown too")
    sigma: IntrinsicsSigma = Field(IntrinsicsSigma(), description="of intrinsics that are known roughly")

    _found: Intrinsics | None = PrivateAttr(None)

    @property
    def found(self) -> Intrinsics:
        """What the file of the intrinsics says."""
        assert self._found is not None, "the problem reads it"
        return self._found

    def with_intrinsics(self, found: Intrinsics) -> CameraSpec:
        """The camera with what its file says."""
        copy = self.model_copy()
        copy._found = found
        return copy

    @property
    def slots(self) -> tuple[int, ...]:
        """Which of `INTRINSICS` are unknown: those that are free, and those of which a σ is stated."""
        rough = [name for name in ("focal_length", "principal_point") if getattr(self.sigma, name)]
        return tuple(sorted({slot for name in (*self.free, *rough) for slot in UNKNOWN_SLOTS[name]}))

    def sigma_of(self, slot: int) -> float:
        """The stated σ of one of `INTRINSICS` [1]; 0 where it is free."""
        of = next(name for name, slots in UNKNOWN_SLOTS.items() if slot in slots)
        stated = 0.0 if of in self.free else float(getattr(self.sigma, of, 0.0))
        return stated / self.found.focal[slot == 2]


class GridSpec(Spec):
    """Corners, or centres of circles, at the crossings of a square grid, counted row by row."""

    rows: int = Field(ge=2, le=200, description="points in a column")
    columns: int = Field(ge=2, le=200, description="points in a row")
    square: Length = Field(gt=0, description="distance of neighbouring points")

    @property
    def points(self) -> dict[str, tuple[float, float, float]]:
        """Number of a point -> its place on the board [m]."""
        return {
            str(r * self.columns + c): (c * self.square, r * self.square, 0.0)
            for r in range(self.rows)
            for c in range(self.columns)
        }


class CharucoSpec(Spec):
    """A ChArUco board: squares with an ArUco mark in every other one; its points are the inner corners, row by row."""

    rows: int = Field(ge=3, le=200, description="squares in a column")
    columns: int = Field(ge=3, le=200, description="squares in a row")
    square: Length = Field(gt=0, description="side of a square")
    mark: Length | None = Field(None, gt=0, description="side of a mark; only to find it in pictures")

    @property
    def points(self) -> dict[str, tuple[float, float, float]]:
        """Number of an inner corner -> its place on the board [m]."""
        return GridSpec(rows=self.rows - 1, columns=self.columns - 1, square=self.square).points


class MarkersSpec(Spec):
    """Where markers are known to be on a board; without any, each of them is unknown."""

    on: Literal["tool", "cell"] = Field(description="tool: the arm carries them; cell: they stand still")
    chessboard: GridSpec | None = Field(None, description="inner corners of a chessboard")
    charuco: CharucoSpec | None = Field(None, description="inner corners of a ChArUco board")
    grid: GridSpec | None = Field(None, description="centres of the circles of a square grid")
    points: str | None = Field(
        None, min_length=1, description="CSV file: marker, x [mm], y [mm], z [mm]", examples=["board.csv"]
    )

    _read: Mapping[str, tuple[float, float, float]] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _one_of_them(self) -> MarkersSpec:
        given = [name for name in ("chessboard", "charuco", "grid", "points") if getattr(self, name) is not None]
        if len(given) > 1:
            raise BadValueError(f"both {given[0]} and {given[1]} are given", "a board has one of them: keep one")
        return self

    def with_points(self, read: Mapping[str, tuple[float, float, float]]) -> MarkersSpec:
        """The board with what its file of points says."""
        copy = self.model_copy()
        copy._read = read
        return copy

    @property
    def known(self) -> Mapping[str, tuple[float, float, float]]:
        """Marker -> where it is on the board [m]; empty where nothing is known."""
        board = self.chessboard or self.charuco or self.grid
        return board.points if board is not None else self._read


def flat(points: Array) -> bool:
    """Whether points (N, 3) lie in a plane, to a thousandth of their extent."""
    size = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(size[2] < 1e-3 * size[0]) if len(size) == 3 else True


@dataclass(frozen=True, eq=False)
class Bodies:
    """What is seen: boards of known geometry, rigid, and markers of which only their own place is to be found."""

    names: tuple[str, ...] = ()  # (B,)
    rigid: Mask = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (B,) whether it is a board of known geometry
    body: Codes = field(default_factory=lambda: np.zeros(0, dtype=np.intp))  # (L,) the body of each marker
    # (L, 3) its place on it [m]; zeros of a free marker
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @classmethod
    def of(cls, stated: Mapping[str, MarkersSpec], markers: Sequence[str], mounts: Mask) -> Bodies:
        for name, board in stated.items():
            if any((board.on == "tool") == tool for tool in mounts):
                hint = "a camera in the cell sees boards on the tool, one on the tool boards in the cell"
                raise BadValueError(f"the board '{name}' and a camera are both on the {board.on}", hint)
        codes, points, rigid = [], [], dict[str, bool]()
        for marker in markers:
            name, place = _on_board(stated, marker)
            rigid.setdefault(name, place is not None)
            codes.append(list(rigid).index(name))
            points.append(place or (0.0, 0.0, 0.0))
        names = tuple(rigid)
        return cls(names, np.array(list(rigid.values())), np.array(codes, dtype=np.intp), np.array(points))


def _on_board(stated: Mapping[str, MarkersSpec], marker: str) -> tuple[str, tuple[float, float, float] | None]:
    board, slash, point = marker.partition("/")
    if slash and board in stated:
        known = stated[board].known
        if known and point not in known:
            raise BadValueError(f"the board '{board}' has no point '{point}'", did_you_mean(point, known))
        return (board, known[point]) if known else (marker, None)
    having = [name for name, spec in stated.items() if marker in spec.known]
    if len(having) > 1:
        raise BadValueError(f"several boards have a point '{marker}'", f"write {having[0]}/{marker}")
    return (having[0], stated[having[0]].known[marker]) if having else (marker, None)
