"""What a problem file says of cameras, and of the boards that they see."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from posture_opt.errors import BadValueError
from posture_opt.measurements.pinhole import Intrinsics
from posture_opt.numerics import Array
from posture_opt.spec import Spec
from posture_opt.units import Length, Pixels

Freed = Literal["focal_length", "principal_point", "distortion"]
UNKNOWN_SLOTS: Mapping[str, tuple[int, ...]] = {
    "focal_length": (0,),
    "principal_point": (1, 2),
    "distortion": (3, 4, 5, 6),
}
"""Where in `INTRINSICS` what may be free is."""


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
        """The section as it is.

        Raises:
            BadValueError: two geometries.
        """
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
