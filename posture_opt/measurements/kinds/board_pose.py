"""Pose of a board that a camera on the tool reports, as solvePnP or AprilTag find it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from posture_opt.errors import BadValueError
from posture_opt.measurements.hand_eye import robot_world_hand_eye
from posture_opt.measurements.kinds.free_frame import FRAME_UNKNOWNS, FreeFrame, described_pose
from posture_opt.measurements.kinds.kind import Kind, MeasuredQuantity, Seen, Slots, Vector, stacked
from posture_opt.measurements.kinds.pose_columns import ORIENTATION, POSE_COLUMNS
from posture_opt.measurements.rotations import rotation_matrices, rotation_vectors, skew_part, turned_by
from posture_opt.numerics import Array, Codes, Json, Mask

_FRAMES = ("camera", "board")
_TURNS = len(FRAME_UNKNOWNS) // 2
_LEAST_POSES = 3
"""Poses of a board from which two frames follow: two turns about different axes."""
_SIZE_M = 0.1
"""Of the board, by points of which the start compares two solutions."""


@dataclass(frozen=True, eq=False)
class BoardPose(Kind):
    """``T_camera_board = T_tool_camera⁻¹ T_world_tool⁻¹ T_world_board``: camera and board are where nobody measured.

    The error is that of the camera: the shift of the board, and the rotation vector that turns the measured orientation
    into the model's, both in the camera's axes. Beside other instruments, the tool point is what these measure.

    Args:
        camera: T_tool_camera; board: T_world_board; each about the one that suits the nominal arm.
    """

    kind: ClassVar[str] = "pose"
    noun: ClassVar[str] = "poses of a board"
    further: ClassVar[tuple[MeasuredQuantity, ...]] = (ORIENTATION,)
    width: ClassVar[int] = 2 * len(FRAME_UNKNOWNS)

    camera: FreeFrame = field(default_factory=FreeFrame)
    board: FreeFrame = field(default_factory=FreeFrame)

    @property
    def read_columns(self) -> Mapping[str, str]:
        """The coordinates and the quaternion."""
        return POSE_COLUMNS

    def axes(self, measured: Mask) -> Codes:
        """All three coordinates."""
        return np.arange(3)

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> BoardPose:
        """Camera and board that suit the nominal arm, in closed form.

        Raises:
            BadValueError: fewer poses than two frames need.
        """
        shown = np.concatenate([seen.reading, stacked(seen.position, len(seen.place))], axis=1)
        first = np.sort(np.unique(shown, axis=0, return_index=True)[1])
        if len(first) < _LEAST_POSES:
            hint = f"{_LEAST_POSES} poses with the tool turned differently are the least"
            raise BadValueError(f"{len(first)} poses of a board do not say where camera and board are", hint)
        R, p = _tool(seen)
        A = _rigid(rotation_matrices(seen.reading[:, 3:7]), seen.reading[:, :3])[first]
        B = np.asarray(np.linalg.inv(_rigid(R, p)[first]), dtype=float)
        camera, board = robot_world_hand_eye(A, B, _SIZE_M * np.eye(3), on_tool=True)
        return replace(self, camera=FreeFrame(np.asarray(np.linalg.inv(camera), dtype=float)), board=FreeFrame(board))

    @property
    def place_noun(self) -> str:
        """What stands in the cell."""
        return "boards"

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        """The pose of the camera on the tool, then that of the board in the world."""
        return tuple((f"{frame}.{name}", unit) for frame in _FRAMES for name, unit in FRAME_UNKNOWNS)

    def start(self, seen: Seen, places: int) -> Array:
        """Zeros: the references suit the nominal arm."""
        return np.zeros((places, self.width))

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
        """By the pose of the camera, or of the board."""
        found, (frame, k) = _seen_board(self, seen), divmod(axis, len(FRAME_UNKNOWNS))
        none = (0.0, 0.0, 0.0)
        if frame == 0 and k < _TURNS:
            return (*-found.mounted[:, k, :].T, *none)
        if frame == 0:
            back = np.swapaxes(self.camera.reference[:3, :3] @ turned_by(seen.values[:, 3:6], k - _TURNS), 1, 2)
            W = back @ found.mounted
            return (*np.einsum("nij,nj->ni", W, found.t).T, *skew_part(W))
        if k < _TURNS:
            return (*found.looking[:, k, :].T, *none)
        back = self.board.reference[:3, :3] @ turned_by(seen.values[:, 9:12], k - _TURNS)
        W = np.swapaxes(found.looking, 1, 2) @ back @ np.swapaxes(found.R, 1, 2)
        return (*none, *skew_part(W))

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
    """The board as the model sees it, at N rows.

    Args:
        t, R: (N, 3), (N, 3, 3) T_camera_board; looking: (N, 3, 3) R_world_camera; mounted: (N, 3, 3) R_tool_camera.
        lever: (N, 3) from the tool point to the board, world [m].
    """

    t: Array
    R: Array
    looking: Array
    mounted: Array
    lever: Array


@lru_cache(maxsize=2)
def _seen_board(kind: BoardPose, seen: Seen) -> _SeenBoard:
    """What all derivatives at one arm state share."""
    (R, p), values = _tool(seen), seen.values
    mounted = kind.camera.reference[:3, :3] @ turned_by(values[:, 3:6])
    looking = R @ mounted
    lever = kind.board.reference[:3, 3] + values[:, 6:9] - p
    at = np.einsum("nij,nj->ni", R, kind.camera.reference[:3, 3] + values[:, :3])
    t = np.einsum("nji,nj->ni", looking, lever - at)
    board = kind.board.reference[:3, :3] @ turned_by(values[:, 9:12])
    return _SeenBoard(t, np.swapaxes(looking, 1, 2) @ board, looking, mounted, lever)


def _tool(seen: Seen) -> tuple[Array, Array]:
    """R (N, 3, 3) and p (N, 3) of the tool in the world."""
    n = len(seen.place)
    return np.stack([stacked(column, n) for column in seen.columns], axis=2), stacked(seen.position, n)


def _rigid(R: Array, p: Array) -> Array:
    """(N, 4, 4) of rotations and shifts."""
    T = np.broadcast_to(np.eye(4), (len(p), 4, 4)).copy()
    T[:, :3, :3], T[:, :3, 3] = R, p
    return T
