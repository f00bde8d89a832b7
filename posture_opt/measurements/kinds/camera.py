"""Pictures of markers: a camera in the cell that looks at the tool, or one on the tool that looks at the cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from posture_opt.errors import BadValueError, listed
from posture_opt.measurements.camera_section import INTRINSICS, Bodies, CameraSpec, Picture, projected
from posture_opt.measurements.hand_eye import Pictures, first_frames
from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, Vector, dot, tool_pose
from posture_opt.measurements.rotations import FRAME_UNKNOWNS, FreeFrame, described_pose, turned_by
from posture_opt.numerics import Array, Codes, Json, Mask

_FOCAL_NOTE = (
    "the focal length of camera {} is not known better than {}: pictures from one distance trade it for the distance, "
    "and with it the scale; add one known length (intrinsics from a calibration of the camera, a board at a measured "
    "distance) or pictures from other distances"
)
# Where in a row of unknowns the intrinsics of cameras begin, behind their pose, and then those of boards and markers
_INTRINSICS, _BODY = 6, 13


@dataclass(frozen=True, eq=False)
class MarkerPixels(Kind):
    """``h = π(K, D, T_camera_world x)``, the pixels of a marker at x; π is OpenCV's ``projectPoints``.

    ``x = p + R m`` for a camera in the cell, with m the marker on the tool. On the tool a camera sees ``Rᵀ (M − p)`` of
    a marker M in the cell. Unknown are the pose of every camera, the poses of boards, the places of markers that are on
    no known board, and such intrinsics as are free. Poses count from those that suit the nominal arm: ``T = T₀ (Rz Ry
    Rx, d)``. Errors in pixels are converted to lengths at the marker, see ``levers``.
    """

    kind: ClassVar[str] = "camera"
    noun: ClassVar[str] = "pictures of markers"
    unit: ClassVar[str] = "px"
    columns: ClassVar[Mapping[str, str]] = {"u": "pixel", "v": "pixel"}
    label: ClassVar[str] = "camera"
    second_label: ClassVar[str] = "marker"
    example: ClassVar[str] = "u [px], v [px], marker and camera for pictures"
    sigma_key: ClassVar[str] = "pixel"
    settings: ClassVar[str] = "cameras"
    width: ClassVar[int] = _BODY + 6
    error_words: ClassVar[str] = "image error at the marker"
    number_words: ClassVar[str] = "image coordinate, at the marker"
    axis_names: ClassVar[tuple[str, ...]] = ("u", "v")
    remedy: ClassVar[str] = (
        "add one known length: markers on a board of known size under data.markers, or the measured value of a link"
    )

    bodies: Bodies = field(default_factory=Bodies)  # the boards and free markers
    intrinsics: Array = field(default_factory=lambda: np.zeros((0, 9)))  # (C, 9) `Intrinsics.row` of the cameras
    mounts: Mask = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (C,) whether the arm carries the camera
    # (C, 4, 4) T₀ of cameras, in the world or on the tool
    camera_frames: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))
    body_frames: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))  # (B, 4, 4) of bodies

    @classmethod
    def of(cls, data: object, names: Sequence[str], seconds: Sequence[str] = ()) -> MarkerPixels:
        stated: Mapping[str, CameraSpec] = data.cameras  # type: ignore[attr-defined]
        if missing := [name for name in names if name not in stated]:
            hint = f"add data: {{cameras: {{{missing[0]}: {{mount: cell, intrinsics: {missing[0]}.yaml}}}}}}"
            raise BadValueError(f"the problem file says nothing of the camera {listed(missing)}", hint)
        mounts = np.array([stated[name].mount == "tool" for name in names])
        bodies = Bodies.of(data.markers, seconds, mounts)  # type: ignore[attr-defined]
        rows = np.array([stated[name].found.row for name in names])
        return cls(stated, tuple(names), bodies, rows, mounts)

    @property
    def fixes_size(self) -> bool:
        return bool(self.bodies.rigid.any())

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> MarkerPixels:
        found = [self.stated[name].found for name in self.names]
        codes = (seen.place, seen.second)
        pictures = Pictures.of(self.bodies, found, self.mounts[seen.place], tool_pose(seen), seen.reading[:, :2], codes)
        cameras, bodies = first_frames(pictures, len(self.names))
        return replace(self, camera_frames=cameras, body_frames=bodies)

    def places(self, names: Sequence[str]) -> Sequence[str]:
        return (*names, *self.bodies.names)

    def second_place(self, seconds: Codes) -> Codes:
        """(N,) the board, or the free marker, of each row, by the codes of their markers."""
        return len(self.names) + self.bodies.body[seconds]

    @property
    def place_noun(self) -> str:
        return "boards" if self.mounts.all() else "cameras"

    def parameter(self, place: str, name: str) -> str:
        return f"{self.label if place in self.names else self.second_label}[{place}].{name}"

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        if place in self.names:
            return (*FRAME_UNKNOWNS, *((INTRINSICS[slot], "1") for slot in self.stated[place].slots))
        return FRAME_UNKNOWNS if self.bodies.rigid[self.bodies.names.index(place)] else FRAME_UNKNOWNS[:3]

    def slots(self, place: str) -> Sequence[int]:
        if place in self.names:
            return (*range(_INTRINSICS), *(_INTRINSICS + slot for slot in self.stated[place].slots))
        return range(_BODY, _BODY + len(self.unknowns(place)))

    def prior_sigma(self, place: str, name: str) -> float:
        if place not in self.names or name not in INTRINSICS:
            return 0.0
        camera: CameraSpec = self.stated[place]
        return camera.sigma_of(INTRINSICS.index(name))

    def open_notes(self, errors: Mapping[str, float]) -> tuple[str, ...]:
        return tuple(
            _FOCAL_NOTE.format(name, f"to ±{1e2 * error:.2g} %" if error < 1 else "by these data")
            for name in self.names
            if (error := errors.get(self.parameter(name, INTRINSICS[0]), 0.0)) > 1e-3  # 1 mm of 1 m, as arms err
        )

    def error(self, seen: Seen) -> Slots:
        shown = _seen_markers(self, seen).picture.pixels
        return tuple(shown[:, i] - seen.reading[:, i] for i in range(2))

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """``g·v + (a × g)·ω`` with g the gradient by the marker, seen from the tool point at a."""
        shown = _seen_markers(self, seen)
        return tuple(dot(shown.gradient[:, i].T, shift) + dot(shown.moment[:, i].T, turn) for i in range(2))

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        shown = _seen_markers(self, seen)
        if _INTRINSICS <= axis < _BODY:
            return tuple(shown.picture.by_intrinsics[:, :, axis - _INTRINSICS].T)
        k = axis if axis < _INTRINSICS else axis - _BODY
        by_place, values, frames, points = shown.camera if axis < _INTRINSICS else shown.body
        if k < 3:
            return tuple(by_place[:, :, k].T)
        moved = frames @ turned_by(values, k - 3)
        turned = np.einsum("nji,nj->ni" if axis < _BODY else "nij,nj->ni", moved, points)
        by_point = shown.picture.by_point if axis < _BODY else by_place
        return tuple(np.einsum("nij,nj->ni", by_point, turned).T)

    def levers(self, seen: Seen) -> Array:
        """(N,) ``z / f``: how far a marker moves across the line of sight for one pixel, at the nominal arm [m/px]."""
        return np.asarray(np.abs(_seen_markers(self, seen).depth) / self.intrinsics[seen.place, :2].mean(axis=1))

    def aspect(self, seen: Seen) -> Array:
        """Cosine of the line of sight to the board's normal, distance along the camera's axis [m], and pixels."""
        shown, (start, end) = _seen_markers(self, seen), self.sight(seen)
        along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
        facing = np.where(self.bodies.rigid[self.bodies.body[seen.second]], np.sum(along * shown.normal, axis=1), 1.0)
        return np.column_stack([facing, shown.depth, shown.picture.pixels])

    def bounds(self, place: int, given: Array) -> tuple[Array, Array]:
        """Angles and distances of the given pictures, and the frame of the picture where its size is stated."""
        low, high = super().bounds(place, given)
        size = np.array(self.stated[self.names[place]].found.size, dtype=float)
        if size.all():
            low[2:], high[2:] = 0.02 * size, 0.98 * size  # planned points keep to the edge of the picture
        return low, high

    def sight(self, seen: Seen) -> tuple[Array, Array]:
        """(N, 3) the centres of the cameras, and (N, 3) the markers, world [m]."""
        return _seen_markers(self, seen).sight

    def described(self, place: str, values: Array) -> dict[str, Json]:
        """Pose in the world or on the tool [m, rad], and for a camera the intrinsics that were found [px, 1]."""
        if place in self.names:
            k = self.names.index(place)
            frame, own = self.camera_frames[k], values[:_INTRINSICS]
        else:
            k = self.bodies.names.index(place)
            frame, own = self.body_frames[k], values[_BODY:]
        if place not in self.names and not self.bodies.rigid[k]:
            return dict(zip("xyz", map(float, frame[:3, 3] + own[:3]), strict=True))
        found = described_pose(FreeFrame(frame).pose(own))
        if place in self.names and self.stated[place].slots:
            now = self.stated[place].found.changed(values[_INTRINSICS:_BODY])
            found |= {"focal_length": list(now.focal), "principal_point": list(now.centre)}
            found["distortion"] = list(now.distortion)
        return found


@dataclass(frozen=True, eq=False)
class _SeenMarkers:
    """Pictures of all rows with their derivatives."""

    picture: Picture  # by the marker in the camera's frame
    depth: Array  # (N,) of it [m]
    gradient: Array  # (N, 2, 3) by a shift of the tool point, world [px/m]
    moment: Array  # (N, 2, 3) by its turn [px/rad]
    sight: tuple[Array, Array]  # (N, 3) the centre of the camera and (N, 3) the marker
    normal: Array  # (N, 3) of the board; all in the world
    # camera, body: of their poses: (N, 2, 3) by the place, (N, 3) turns, (N, 3, 3) reference, (N, 3) what it turns
    camera: tuple[Array, Array, Array, Array]
    body: tuple[Array, Array, Array, Array]


@lru_cache(maxsize=2)
def _seen_markers(kind: MarkerPixels, seen: Seen) -> _SeenMarkers:
    rows, (R, p) = seen.values, tool_pose(seen)
    body = kind.bodies.body[seen.second]
    frame, turns = kind.body_frames[body], rows[:, _BODY + 3 : _BODY + 6]
    known = kind.bodies.points[seen.second]
    board = frame[:, :3, :3] @ turned_by(turns)
    marker = np.einsum("nij,nj->ni", board, known) + frame[:, :3, 3] + rows[:, _BODY : _BODY + 3]
    carried = kind.mounts[seen.place]
    arm = np.where(carried[:, None], marker - p, np.einsum("nij,nj->ni", R, marker))
    placed = np.where(carried[:, None], np.einsum("nji,nj->ni", R, marker - p), p + arm)
    reference, own_turns = kind.camera_frames[seen.place], rows[:, 3:6]
    looking = reference[:, :3, :3] @ turned_by(own_turns)
    at, on_tool = reference[:, :3, 3] + rows[:, :3], carried[:, None]
    apart, centre = placed - at, np.where(on_tool, p + np.einsum("nij,nj->ni", R, at), at)
    point = np.einsum("nji,nj->ni", looking, apart)
    picture = projected(point, kind.intrinsics[seen.place], rows[:, _INTRINSICS:_BODY])
    by_placed = picture.by_point @ np.swapaxes(looking, 1, 2)
    turned = np.where(carried[:, None, None], np.swapaxes(R, 1, 2), R)
    by_marker = by_placed @ turned
    gradient = np.where(carried[:, None, None], -by_marker, by_placed)
    return _SeenMarkers(
        picture, point[:, 2], gradient, np.cross(arm[:, None, :], gradient),
        (centre, np.where(on_tool, marker, p + arm)),
        np.where(on_tool, board[:, :, 2], np.einsum("nij,nj->ni", R, board[:, :, 2])),
        (-by_placed, own_turns, reference[:, :3, :3], apart),
        (by_marker, turns, frame[:, :3, :3], known),
    )  # fmt: skip
