"""Pictures of markers: a camera in the cell that looks at the tool, or one on the tool that looks at the cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from posture_opt.errors import BadValueError, listed
from posture_opt.measurements.camera_places import Bodies, Pictures, first_frames
from posture_opt.measurements.camera_section import CameraSpec
from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, Vector, dot, stacked
from posture_opt.measurements.pinhole import INTRINSICS, Picture, projected
from posture_opt.measurements.rotations import roll_pitch_yaw, turned_by
from posture_opt.numerics import Array, Codes, Json, Mask

_POSE = (("x", "m"), ("y", "m"), ("z", "m"), ("roll", "rad"), ("pitch", "rad"), ("yaw", "rad"))
_SURE_FOCAL = 1e-3
"""Relative error of a focal length: of 1 m it makes 1 mm, as much as arms err."""
_FOCAL_NOTE = (
    "the focal length of camera {} is not known better than {}: pictures from one distance trade it for the distance, "
    "and with it the scale; add one known length (intrinsics from a calibration of the camera, a board at a measured "
    "distance) or pictures from other distances"
)
_EDGE_SHARE = 0.02
"""Of the picture, that planned points keep to its edge."""
_BODY = len(_POSE) + len(INTRINSICS)
"""Where in a row of unknowns those of boards and markers begin: behind the pose and the intrinsics of cameras."""


@dataclass(frozen=True, eq=False)
class MarkerPixels(Kind):
    """``h = π(K, D, T_camera_world x)``, the pixels of a marker at x; π is OpenCV's ``projectPoints``.

    ``x = p + R m`` for a camera in the cell, with m the marker on the tool. On the tool a camera sees
    ``Rᵀ (M − p)`` of a marker M in the cell. Unknown are the pose of every camera, the poses of boards, the places of
    markers that are on no known board, and such intrinsics as are free. Poses count from those that suit the nominal
    arm: ``T = T₀ (Rz Ry Rx, d)``. Errors in pixels are converted to lengths at the marker, see ``levers``.

    Args:
        bodies: the boards and free markers; intrinsics: (C, 9) `Intrinsics.row` of the cameras.
        mounts: (C,) whether the arm carries the camera.
        camera_frames: (C, 4, 4) T₀ of cameras, in the world or on the tool; body_frames: (B, 4, 4) of bodies.
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
    width: ClassVar[int] = _BODY + len(_POSE)
    error_words: ClassVar[str] = "image error at the marker"
    number_words: ClassVar[str] = "image coordinate, at the marker"
    axis_names: ClassVar[tuple[str, ...]] = ("u", "v")
    remedy: ClassVar[str] = (
        "add one known length: markers on a board of known size under data.markers, or the measured value of a link"
    )

    bodies: Bodies = field(default_factory=Bodies)
    intrinsics: Array = field(default_factory=lambda: np.zeros((0, 9)))
    mounts: Mask = field(default_factory=lambda: np.zeros(0, dtype=bool))
    camera_frames: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))
    body_frames: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))

    @classmethod
    def of(cls, data: object, names: Sequence[str], seconds: Sequence[str] = ()) -> MarkerPixels:
        """The cameras ``names`` and the markers ``seconds`` with what the section ``data`` says of them.

        Raises:
            BadValueError: a camera of which nothing is said, or a marker that no board has.
        """
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
        """Whether the size of a board is known: without any, an arm of half the size takes the same pictures."""
        return bool(self.bodies.rigid.any())

    def axes(self, measured: Mask) -> Codes:
        """Both coordinates of the picture."""
        return np.arange(2)

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> MarkerPixels:
        """Poses of cameras and boards, and places of markers, that suit the nominal arm, in closed form.

        Raises:
            BadValueError: pictures show too little to say where a camera or a marker is.
        """
        found = [self.stated[name].found for name in self.names]
        codes = (seen.place, seen.second)
        pictures = Pictures.of(self.bodies, found, self.mounts[seen.place], _pose(seen), seen.reading[:, :2], codes)
        cameras, bodies = first_frames(pictures, len(self.names))
        return replace(self, camera_frames=cameras, body_frames=bodies)

    def places(self, names: Sequence[str]) -> Sequence[str]:
        """The cameras, then boards and free markers."""
        return (*names, *self.bodies.names)

    def second_place(self, seconds: Codes) -> Codes:
        """(N,) the board, or the free marker, of each row, by the codes of their markers."""
        return len(self.names) + self.bodies.body[seconds]

    @property
    def place_noun(self) -> str:
        """What stands in the cell: cameras, or the boards that a camera on the tool sees."""
        return "boards" if self.mounts.all() else "cameras"

    def parameter(self, place: str, name: str) -> str:
        """``camera[left].x``, ``marker[board].x``."""
        return f"{self.label if place in self.names else self.second_label}[{place}].{name}"

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        """The pose, of a free marker the place only; of a camera what is unknown of its intrinsics too."""
        if place in self.names:
            return (*_POSE, *((INTRINSICS[slot], "1") for slot in self.stated[place].slots))
        return _POSE if self.bodies.rigid[self.bodies.names.index(place)] else _POSE[:3]

    def slots(self, place: str) -> Sequence[int]:
        """Cameras first, bodies behind them, so that a row has room for one of each."""
        if place in self.names:
            return (*range(len(_POSE)), *(len(_POSE) + slot for slot in self.stated[place].slots))
        return range(_BODY, _BODY + len(self.unknowns(place)))

    def prior_sigma(self, place: str, name: str) -> float:
        """What the file states of intrinsics that are known roughly."""
        if place not in self.names or name not in INTRINSICS:
            return 0.0
        camera: CameraSpec = self.stated[place]
        return camera.sigma_of(INTRINSICS.index(name))

    def open_notes(self, errors: Mapping[str, float]) -> tuple[str, ...]:
        """A free focal length that pictures from one distance do not tell from the distance."""
        return tuple(
            _FOCAL_NOTE.format(name, f"to ±{1e2 * error:.2g} %" if error < 1 else "by these data")
            for name in self.names
            if (error := errors.get(self.parameter(name, INTRINSICS[0]), 0.0)) > _SURE_FOCAL
        )

    def start(self, seen: Seen, places: int) -> Array:
        """Zeros: the references suit the nominal arm."""
        return np.zeros((places, self.width))

    def error(self, seen: Seen) -> Slots:
        """The modelled pixels minus the seen ones."""
        shown = _seen_markers(self, seen).picture.pixels
        return tuple(shown[:, i] - seen.reading[:, i] for i in range(2))

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """``g·v + (a × g)·ω`` with g the gradient by the marker, seen from the tool point at a."""
        shown = _seen_markers(self, seen)
        return tuple(dot(shown.gradient[:, i].T, shift) + dot(shown.moment[:, i].T, turn) for i in range(2))

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """By the pose of the camera, its intrinsics, or the pose of the board."""
        shown = _seen_markers(self, seen)
        if len(_POSE) <= axis < _BODY:
            by_intrinsics = shown.picture.by_intrinsics[:, :, axis - len(_POSE)]
            return by_intrinsics[:, 0], by_intrinsics[:, 1]
        own, k = (shown.camera, axis) if axis < len(_POSE) else (shown.body, axis - _BODY)
        by_place, values, frames, points = own
        if k < 3:
            return by_place[:, 0, k], by_place[:, 1, k]
        moved = frames @ turned_by(values, k - 3)
        turned = np.einsum("nji,nj->ni" if axis < _BODY else "nij,nj->ni", moved, points)
        by_point = shown.picture.by_point if axis < _BODY else by_place
        both = np.einsum("nij,nj->ni", by_point, turned)
        return both[:, 0], both[:, 1]

    def levers(self, seen: Seen) -> Array:
        """(N,) ``z / f``: how far a marker moves across the line of sight for one pixel, at the nominal arm [m/px]."""
        depth = np.abs(_seen_markers(self, seen).depth)
        return np.asarray(depth / self.intrinsics[seen.place, :2].mean(axis=1))

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
            low[2:], high[2:] = _EDGE_SHARE * size, (1 - _EDGE_SHARE) * size
        return low, high

    def sight(self, seen: Seen) -> tuple[Array, Array]:
        """(N, 3) the centres of the cameras, and (N, 3) the markers, world [m]."""
        return _seen_markers(self, seen).sight

    def described(self, place: str, values: Array) -> dict[str, Json]:
        """Pose in the world or on the tool [m, rad], and for a camera the intrinsics that were found [px, 1]."""
        if place in self.names:
            k = self.names.index(place)
            frame, own = self.camera_frames[k], values[: len(_POSE)]
        else:
            k = self.bodies.names.index(place)
            frame, own = self.body_frames[k], values[_BODY:]
        found: dict[str, Json] = dict(zip("xyz", map(float, frame[:3, 3] + own[:3]), strict=True))
        if place not in self.names and not self.bodies.rigid[k]:
            return found
        found |= roll_pitch_yaw((frame[:3, :3] @ turned_by(own[None, 3:]))[0])
        if place in self.names and self.stated[place].slots:
            now = self.stated[place].found.changed(values[len(_POSE) : _BODY])
            found |= {"focal_length": list(now.focal), "principal_point": list(now.centre)}
            found |= {"distortion": list(now.distortion)}
        return found


def _pose(seen: Seen) -> tuple[Array, Array]:
    """R (N, 3, 3) and p (N, 3) of the tool in the world."""
    n = len(seen.place)
    return np.stack([stacked(column, n) for column in seen.columns], axis=2), stacked(seen.position, n)


@dataclass(frozen=True, eq=False)
class _SeenMarkers:
    """Pictures of all rows with their derivatives.

    Args:
        picture: by the marker in the camera's frame; depth: (N,) of it [m].
        gradient: (N, 2, 3) by a shift of the tool point, world [px/m]; moment: (N, 2, 3) by its turn [px/rad].
        sight: (N, 3) the centre of the camera and (N, 3) the marker; normal: (N, 3) of the board; all in the world.
        camera, body: of their poses: (N, 2, 3) by the place, (N, 3) turns, (N, 3, 3) reference, (N, 3) what it turns.
    """

    picture: Picture
    depth: Array
    gradient: Array
    moment: Array
    sight: tuple[Array, Array]
    normal: Array
    camera: tuple[Array, Array, Array, Array]
    body: tuple[Array, Array, Array, Array]


@lru_cache(maxsize=2)
def _seen_markers(kind: MarkerPixels, seen: Seen) -> _SeenMarkers:
    """What all derivatives at one arm state share."""
    rows, (R, p) = seen.values, _pose(seen)
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
    picture = projected(point, kind.intrinsics[seen.place], rows[:, len(_POSE) : _BODY])
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
