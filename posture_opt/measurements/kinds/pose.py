"""Pose of the tool, as a tracker with a six-degree-of-freedom target or a camera with a board measures it."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from posture_opt.measurements.kinds.board_pose import BoardPose
from posture_opt.measurements.kinds.kind import Kind, MeasuredQuantity, Seen, Slots, Vector, stacked
from posture_opt.measurements.kinds.pose_columns import ORIENTATION, ORIENTATION_GROUPS, POSE_COLUMNS
from posture_opt.measurements.kinds.position import COORDINATES, FramedPosition, Position
from posture_opt.measurements.rotations import rotation_matrices, rotation_vectors, turned_by
from posture_opt.numerics import Array


@dataclass(frozen=True, eq=False)
class Pose(Position):
    """``h = (p, R)``: the coordinates of the tool point, and the orientation of the tool as a unit quaternion.

    The error of the orientation is the rotation vector that turns the measured one into the model's, in the world.
    Errors of the arm count in positions.
    """

    kind: ClassVar[str] = "pose"
    noun: ClassVar[str] = "poses"
    example: ClassVar[str] = "qw, qx, qy, qz beside these for poses"
    further: ClassVar[tuple[MeasuredQuantity, ...]] = (ORIENTATION,)
    oriented: ClassVar[bool] = True

    @classmethod
    def of(cls, data: object, names: Sequence[str], seconds: Sequence[str] = ()) -> Kind:
        """Poses in the world, or those of a board where the file says that a camera on the tool reports them."""
        return BoardPose() if _of_camera(data) else cls()

    @classmethod
    def required(cls, data: object, there: Container[str]) -> frozenset[str]:
        """The coordinates that are there, and one way to write the orientation; nothing without either."""
        turned = next((group for group in ORIENTATION_GROUPS.values() if any(name in there for name in group)), ())
        placed = frozenset(COORDINATES) if _of_camera(data) else Position.required(data, there)
        return placed | {*turned} if placed and turned else frozenset()

    @property
    def read_columns(self) -> Mapping[str, str]:
        """The coordinates and the quaternion."""
        return POSE_COLUMNS

    def in_own_frame(self) -> FramedPose:
        """Poses in the frame of a tracker."""
        return FramedPose()

    def orientations(self, seen: Seen) -> Array:
        """(N, 3, 3) as it was read."""
        return rotation_matrices(seen.reading[:, 3:7])

    def error(self, seen: Seen) -> Slots:
        """``(p − m, log(R Rₘᵀ))``."""
        return (*super().error(seen), *_turn_between(seen, self.orientations(seen)))

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """The twist itself: errors of the orientation are small."""
        return (*shift, *turn)


@dataclass(frozen=True, eq=False)
class FramedPose(FramedPosition):
    """``(p, R) = T (m, Rₘ)``: poses that a tracker measures in a frame T of its own, beside other readings."""

    kind: ClassVar[str] = "pose"
    noun: ClassVar[str] = "poses"
    further: ClassVar[tuple[MeasuredQuantity, ...]] = (ORIENTATION,)
    oriented: ClassVar[bool] = True

    @property
    def read_columns(self) -> Mapping[str, str]:
        """The coordinates and the quaternion."""
        return POSE_COLUMNS

    def orientations(self, seen: Seen) -> Array:
        """(N, 3, 3) as it was read, turned into the world."""
        return self._turn(seen) @ rotation_matrices(seen.reading[:, 3:7])

    def error(self, seen: Seen) -> Slots:
        """``(p − T m, log(R (R_T Rₘ)ᵀ))``."""
        return (*super().error(seen), *_turn_between(seen, self.orientations(seen)))

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """The twist itself: errors of the orientation are small."""
        return (*shift, *turn)

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """``−∂(T m)``, and the turn of T about axes of the world, negative."""
        return (*super().unknown_slope(seen, axis), *_turn_by(self, seen, axis))

    def _turn(self, seen: Seen, by: int | None = None) -> Array:
        """(N, 3, 3) R_T, or its derivative by one of the three turns."""
        return np.asarray(self.frame.reference[:3, :3] @ turned_by(seen.values[:, 3:6], by))


def _of_camera(data: object) -> bool:
    """Whether the section ``data`` says that poses are those of a board, by a camera."""
    return getattr(data, "frame", None) == "camera"


def _turn_between(seen: Seen, measured: Array) -> Array:
    """(3, N) rotation vectors [rad] in the world that turn measured orientations (N, 3, 3) into the model's."""
    R = np.stack([stacked(column, len(seen.place)) for column in seen.columns], axis=-1)
    return rotation_vectors(R @ np.swapaxes(measured, -1, -2)).T


@lru_cache(maxsize=16)
def _turn_by(kind: FramedPose, seen: Seen, axis: int) -> Slots:
    """Change of the rotation vector with one of the unknowns of the frame: ``−ω`` with ``[ω] = ∂R_T R_Tᵀ``."""
    if axis < 3:
        return (0.0, 0.0, 0.0)
    W = kind._turn(seen, axis - 3) @ np.swapaxes(kind._turn(seen), -1, -2)
    return (W[:, 1, 2], W[:, 2, 0], W[:, 0, 1])
