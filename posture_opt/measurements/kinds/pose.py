"""Poses of the tool, by a tracker or by a camera that reports a board, and how files write orientations."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from posture_opt.errors import BadValueError
from posture_opt.measurements.hand_eye import robot_world_hand_eye
from posture_opt.measurements.kinds.kind import Kind, MeasuredQuantity, Seen, Slots, Vector, stacked, tool_pose
from posture_opt.measurements.kinds.position import COORDINATES, Position
from posture_opt.measurements.rotations import (
    FRAME_UNKNOWNS,
    FreeFrame,
    described_pose,
    rigid,
    rotation_matrices,
    rotation_vectors,
    skew_part,
)
from posture_opt.numerics import Array, Json, Mask

QUATERNION = ("qw", "qx", "qy", "qz")  # Columns of a unit quaternion; either sign is one rotation
ANGLES = ("roll", "pitch", "yaw")  # Columns of angles about fixed axes: ``R = Rz(yaw) Ry(pitch) Rx(roll)``
VECTOR = ("rx", "ry", "rz")  # Columns of a rotation vector: unit axis times angle [rad]
# Columns that hold an orientation: KUKA's A, B, C and FANUC's W, P, R among them, and a matrix row by row
ORIENTATION_GROUPS: Mapping[str, tuple[str, ...]] = {
    "quaternion": QUATERNION,
    "angles": ANGLES,
    "vector": VECTOR,
    "abc": ("a", "b", "c"),
    "wpr": ("w", "p", "r"),
    "matrix": tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)),
}
# All columns that hold an orientation
ORIENTATIONS = tuple(name for group in ORIENTATION_GROUPS.values() for name in group)
# Rotation vector that turns the measured orientation into the model's, about the axes in which errors count
ORIENTATION = MeasuredQuantity("orientation", "rad", (3, 4, 5))
# Columns of a pose as it is kept -> dimension; empty of the quaternion, which has none
POSE_COLUMNS: Mapping[str, str] = {**dict.fromkeys("xyz", "length"), **dict.fromkeys(QUATERNION, "")}


@dataclass(frozen=True, eq=False)
class Pose(Position):
    """``(p, R) = T (m, Rₘ)``: the coordinates of the tool point, and the tool's orientation as a unit quaternion.

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
        return BoardPose() if getattr(data, "frame", None) == "camera" else cls()

    @classmethod
    def required(cls, data: object, there: Container[str]) -> frozenset[str]:
        turned = next((group for group in ORIENTATION_GROUPS.values() if any(name in there for name in group)), ())
        of_camera = getattr(data, "frame", None) == "camera"
        placed = frozenset(COORDINATES) if of_camera else Position.required(data, there)
        return placed | {*turned} if placed and turned else frozenset()

    @property
    def read_columns(self) -> Mapping[str, str]:
        return POSE_COLUMNS

    def orientations(self, seen: Seen) -> Array:
        """(N, 3, 3) ``R_T Rₘ``, in the world."""
        read = rotation_matrices(seen.reading[:, 3:7])
        return read if self.frame is None else self.frame.turn(seen.values) @ read

    def error(self, seen: Seen) -> Slots:
        """``(p − T m, log(R (R_T Rₘ)ᵀ))``."""
        turned = tool_pose(seen)[0] @ np.swapaxes(self.orientations(seen), -1, -2)
        return (*super().error(seen), *rotation_vectors(turned).T)

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        return (*shift, *turn)

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """``−∂(T m)``, and ``−ω`` with ``[ω] = ∂R_T R_Tᵀ``."""
        moved = super().unknown_slope(seen, axis)
        assert self.frame is not None, "a frame of its own"
        if axis < 3:
            return (*moved, 0.0, 0.0, 0.0)
        W = self.frame.turn(seen.values, axis - 3) @ np.swapaxes(self.frame.turn(seen.values), -1, -2)
        return (*moved, *(-w for w in skew_part(W)))


@dataclass(frozen=True, eq=False)
class CameraPose(Pose):
    """``h = (p, R)`` of a camera in the frame of a board: poses of the board in the camera, inverted.

    The camera measures ``t = −Rₘᵀ m``, whose noise an error of the orientation does not touch; inverting would add that
    error times the distance to m. So the error is that of the board, ``p + R t``, where the camera sees it.
    """

    def error(self, seen: Seen) -> Slots:
        """``(p − R Rₘᵀ m, log(R Rₘᵀ))``."""
        return (*(tool_pose(seen)[1] - self._carried(seen)).T, *super().error(seen)[3:])

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """``v − ω × R Rₘᵀ m`` and ``ω``."""
        n = len(seen.place)
        return (*(stacked(shift, n) - np.cross(stacked(turn, n), self._carried(seen))).T, *turn)

    def _carried(self, seen: Seen) -> Array:
        """(N, 3) ``−R t``: from the board to the camera, as the model turns it [m]."""
        turned = tool_pose(seen)[0] @ np.swapaxes(self.orientations(seen), -1, -2)
        return np.asarray(np.einsum("nij,nj->ni", turned, seen.reading[:, :3]))


_FRAMES = ("camera", "board")


@dataclass(frozen=True, eq=False)
class BoardPose(Kind):
    """``T_camera_board = T_tool_camera⁻¹ T_world_tool⁻¹ T_world_board``: camera and board are where nobody measured.

    The error is that of the camera: the shift of the board, and the rotation vector that turns the measured orientation
    into the model's, both in the camera's axes. Beside other instruments, the tool point is what these measure.
    """

    kind: ClassVar[str] = "pose"
    noun: ClassVar[str] = "poses of a board"
    columns: ClassVar[Mapping[str, str]] = POSE_COLUMNS
    further: ClassVar[tuple[MeasuredQuantity, ...]] = (ORIENTATION,)
    width: ClassVar[int] = 12

    camera: FreeFrame = field(default_factory=FreeFrame)  # T_tool_camera
    board: FreeFrame = field(default_factory=FreeFrame)  # T_world_board; each about the one that suits the nominal arm

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> BoardPose:
        shown = np.concatenate([seen.reading, stacked(seen.position, len(seen.place))], axis=1)
        first = np.sort(np.unique(shown, axis=0, return_index=True)[1])
        if len(first) < 3:  # two turns about different axes decide two frames
            hint = "3 poses with the tool turned differently are the least"
            raise BadValueError(f"{len(first)} poses of a board do not say where camera and board are", hint)
        A = rigid(rotation_matrices(seen.reading[:, 3:7]), seen.reading[:, :3])[first]
        B = np.asarray(np.linalg.inv(rigid(*tool_pose(seen))[first]), dtype=float)
        camera, board = robot_world_hand_eye(A, B, 0.1 * np.eye(3), on_tool=True)  # a board of about 0.1 m
        return replace(self, camera=FreeFrame(np.asarray(np.linalg.inv(camera), dtype=float)), board=FreeFrame(board))

    @property
    def place_noun(self) -> str:
        return "boards"

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        """The pose of the camera on the tool, then that of the board in the world."""
        return tuple((f"{frame}.{name}", unit) for frame in _FRAMES for name, unit in FRAME_UNKNOWNS)

    def error(self, seen: Seen) -> Slots:
        """``(t − m, log(R Rₘᵀ))`` in the camera's axes."""
        found = _seen_board(self, seen)
        turned = found.R @ np.swapaxes(rotation_matrices(seen.reading[:, 3:7]), 1, 2)
        return (*(found.t - seen.reading[:, :3]).T, *rotation_vectors(turned).T)

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """``−R_cᵀ (v + ω × r)`` and ``−R_cᵀ ω``, r from the tool point to the board."""
        found, n = _seen_board(self, seen), len(seen.place)
        v, w = stacked(shift, n), stacked(turn, n)
        moved = np.einsum("nji,nj->ni", found.looking, v + np.cross(w, found.lever))
        return (*-moved.T, *-np.einsum("nji,nj->ni", found.looking, w).T)

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """By the shift and the turns of the camera (0 to 5), then of the board (6 to 11)."""
        found, none = _seen_board(self, seen), (0.0, 0.0, 0.0)
        if axis < 3:
            return (*-found.mounted[:, axis, :].T, *none)
        if axis < 6:
            W = np.swapaxes(self.camera.turn(seen.values, axis - 3), 1, 2) @ found.mounted
            return (*np.einsum("nij,nj->ni", W, found.t).T, *skew_part(W))
        if axis < 9:
            return (*found.looking[:, axis - 6, :].T, *none)
        turned = self.board.turn(seen.values[:, 6:], axis - 9)
        return (*none, *skew_part(np.swapaxes(found.looking, 1, 2) @ turned @ np.swapaxes(found.R, 1, 2)))

    def aspect(self, seen: Seen) -> Array:
        """Cosine of the line of sight to the board's normal, distance along the camera's axis [m], and direction."""
        found = _seen_board(self, seen)
        far = np.linalg.norm(found.t, axis=1)
        facing = np.sum(found.t * found.R[:, :, 2], axis=1) / far
        return np.column_stack([facing, found.t[:, 2], found.t[:, :2] / far[:, None]])

    def sight(self, seen: Seen) -> tuple[Array, Array]:
        """(N, 3) the camera, and (N, 3) the board, world [m]."""
        found = _seen_board(self, seen)
        there = found.lever + stacked(seen.position, len(seen.place))
        return there - np.einsum("nij,nj->ni", found.looking, found.t), there

    def expected(self, seen: Seen) -> Array:
        """The board in the camera [m], its orientation left out: no slope depends on it."""
        return np.column_stack([_seen_board(self, seen).t, np.tile([1.0, 0.0, 0.0, 0.0], (len(seen.place), 1))])

    def described(self, place: str, values: Array) -> dict[str, Json]:
        """Pose of the camera on the tool, and of the board in the world [m, rad]."""
        own = zip(_FRAMES, (self.camera, self.board), np.split(values[: self.width], 2), strict=True)
        return {name: described_pose(frame.pose(pose)) for name, frame, pose in own}


@dataclass(frozen=True, eq=False)
class _SeenBoard:
    """The board as the model sees it, at N rows."""

    # t, R: (N, 3), (N, 3, 3) T_camera_board
    t: Array
    R: Array
    looking: Array  # (N, 3, 3) R_world_camera
    mounted: Array  # (N, 3, 3) R_tool_camera
    lever: Array  # (N, 3) from the tool point to the board, world [m]


@lru_cache(maxsize=2)
def _seen_board(kind: BoardPose, seen: Seen) -> _SeenBoard:
    (R, p), values = tool_pose(seen), seen.values
    mounted = kind.camera.turn(values)
    looking = R @ mounted
    lever = kind.board.reference[:3, 3] + values[:, 6:9] - p
    at = np.einsum("nij,nj->ni", R, kind.camera.reference[:3, 3] + values[:, :3])
    t = np.einsum("nji,nj->ni", looking, lever - at)
    return _SeenBoard(t, np.swapaxes(looking, 1, 2) @ kind.board.turn(values[:, 6:]), looking, mounted, lever)
