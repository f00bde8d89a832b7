"""What cameras see: boards and free markers, and where they and the cameras are by the nominal arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from posture_opt.errors import BadValueError, did_you_mean
from posture_opt.measurements.camera_section import MarkersSpec
from posture_opt.measurements.hand_eye import (
    board_pose,
    camera_of_moving_points,
    mean_pose,
    robot_world_hand_eye,
    seen_marker,
)
from posture_opt.measurements.pinhole import Intrinsics
from posture_opt.numerics import Array, Codes, Mask

_MOST_PICTURES = 80
"""Of one board that a start uses: more do not improve it."""
_LEAST_PICTURES = 3
"""From which a hand-eye calibration has a solution."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """What is seen: boards of known geometry, rigid, and markers of which only their own place is to be found.

    Args:
        names: (B,); rigid: (B,) whether it is a board of known geometry.
        body: (L,) the body of each marker; points: (L, 3) its place on it [m]; zeros of a free marker.
    """

    names: tuple[str, ...] = ()
    rigid: Mask = field(default_factory=lambda: np.zeros(0, dtype=bool))
    body: Codes = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @classmethod
    def of(cls, stated: Mapping[str, MarkersSpec], markers: Sequence[str], mounts: Mask) -> Bodies:
        """The bodies of the ``markers`` of a file: ``board/12`` or, where one board has it, ``12``.

        Raises:
            BadValueError: a board that has no such point, or one that moves with the camera that looks at it.
        """
        for name, board in stated.items():
            if any((board.on == "tool") == tool for tool in mounts):
                hint = "a camera in the cell sees boards on the tool, one on the tool boards in the cell"
                raise BadValueError(f"the board '{name}' and a camera are both on the {board.on}", hint)
        found: dict[str, tuple[float, float, float]] = {}
        codes, points, rigid = [], [], dict[str, bool]()
        for marker in markers:
            name, place = _on_board(stated, marker)
            rigid.setdefault(name, place is not None)
            codes.append(list(rigid).index(name))
            points.append(place or (0.0, 0.0, 0.0))
            found[marker] = points[-1]
        names = tuple(rigid)
        return cls(names, np.array(list(rigid.values())), np.array(codes, dtype=np.intp), np.array(points))


def _on_board(stated: Mapping[str, MarkersSpec], marker: str) -> tuple[str, tuple[float, float, float] | None]:
    """The body of a marker, and its place on it; None where it is a body of its own."""
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


def first_frames(pictures: Pictures, cameras: int) -> tuple[Array, Array]:
    """T_mount_camera (C, 4, 4) of cameras and T_carrier_body (B, 4, 4) by the nominal arm, without any guess.

    Boards of known geometry first: the pose of each in every picture, then robot-world hand-eye calibration. Markers
    of which nothing is known are triangulated, or decide the camera where no board is seen.

    Raises:
        BadValueError: pictures show too little.
    """
    by_boards = {c: pictures.camera_by_boards(c) for c in range(cameras)}
    found = {c: pictures.camera_by_markers(c) if T is None else T for c, T in by_boards.items()}
    bodies = [pictures.body(b, found) for b in range(len(pictures.bodies.names))]
    return np.array([np.linalg.inv(found[c]) for c in range(cameras)]), np.array(bodies)


@dataclass(frozen=True, eq=False)
class Pictures:
    """What cameras saw, row by row, and where the nominal arm was.

    Args:
        R, p: (N, 3, 3), (N, 3) T_mount_carrier: the tool in the world, for a camera on the tool the world in the tool.
        rays: (N, 2) at a depth of one; camera, marker, pose: (N,) codes; on_tool: (N,) whether the arm has the camera.
    """

    bodies: Bodies
    R: Array
    p: Array
    rays: Array
    camera: Codes
    marker: Codes
    pose: Codes
    on_tool: Mask

    @classmethod
    def of(
        cls, bodies: Bodies, intrinsics: Sequence[Intrinsics], on_tool: Mask, pose: tuple[Array, Array],
        pixels: Array, codes: tuple[Codes, Codes],
    ) -> Pictures:  # fmt: skip
        """By the tool's ``pose`` (N, 3, 3), (N, 3) in the world, and the ``codes`` of cameras and markers.

        Args:
            on_tool: (N,) whether the arm carries the camera; pixels: (N, 2).
        """
        (R, p), (camera, marker) = pose, codes
        inverse = np.swapaxes(R, 1, 2)
        p = np.where(on_tool[:, None], -np.einsum("nij,nj->ni", inverse, p), p)
        R = np.where(on_tool[:, None, None], inverse, R)
        rays = np.zeros((len(p), 2))
        for c, one in enumerate(intrinsics):
            rays[camera == c] = one.rays(pixels[camera == c])
        rows = np.concatenate([R.reshape(len(p), 9), p], axis=1).round(12)
        poses = np.unique(rows, axis=0, return_inverse=True)[1].ravel().astype(np.intp)
        return cls(bodies, R, p, rays, camera, marker, poses, on_tool)

    def shown(self, camera: int, body: int) -> tuple[Array, Array]:
        """(n, 4, 4) T_camera_body and T_mount_carrier of the pictures of one board by one camera."""
        rows = np.flatnonzero((self.camera == camera) & (self.bodies.body[self.marker] == body))
        poses = np.unique(self.pose[rows])
        poses = poses[np.linspace(0, len(poses) - 1, min(len(poses), _MOST_PICTURES)).astype(int)]
        A, B = [], []
        for code in poses:
            own = rows[self.pose[rows] == code]
            if (T := board_pose(self.bodies.points[self.marker[own]], self.rays[own])) is not None:
                A.append(T)
                B.append(np.block([[self.R[own[0]], self.p[own[0]][:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]))
        return np.array(A).reshape(-1, 4, 4), np.array(B).reshape(-1, 4, 4)

    def camera_by_boards(self, camera: int) -> Array | None:
        """T_camera_mount by the board that most pictures show; None where none shows enough."""
        shown = [self.shown(camera, int(b)) for b in np.flatnonzero(self.bodies.rigid)]
        best = max(range(len(shown)), key=lambda k: len(shown[k][0]), default=-1)
        if best < 0 or len(shown[best][0]) < _LEAST_PICTURES:
            return None
        points = self.bodies.points[self.bodies.body == np.flatnonzero(self.bodies.rigid)[best]]
        on_tool = bool(self.on_tool[self.camera == camera].all())
        return robot_world_hand_eye(*shown[best], points, on_tool)[0]

    def camera_by_markers(self, camera: int) -> Array:
        """T_camera_mount by markers of which nothing is known.

        Raises:
            BadValueError: too few pictures of one marker.
        """
        rows = np.flatnonzero(self.camera == camera)
        codes = np.unique(self.marker[rows], return_inverse=True)[1].astype(np.intp)
        found = camera_of_moving_points(self.R[rows], self.p[rows], self.rays[rows], codes)
        if found is None:
            hint = "20 pictures of one marker, or 3 of four points of a known board (data.markers), are the least"
            raise BadValueError("too few pictures to say where the camera is", hint)
        return found[0]

    def body(self, body: int, cameras: Mapping[int, Array]) -> Array:
        """T_carrier_body (4, 4) by the cameras that see it.

        Raises:
            BadValueError: no picture shows enough of it.
        """
        if not self.bodies.rigid[body]:
            rows = np.flatnonzero(self.bodies.body[self.marker] == body)
            camera = int(np.argmax(np.bincount(self.camera[rows])))
            rows = rows[self.camera[rows] == camera]
            found = np.eye(4)
            found[:3, 3] = seen_marker(cameras[camera], self.R[rows], self.p[rows], self.rays[rows])
            return found
        shown = {c: self.shown(c, body) for c in cameras}
        most = max(shown, key=lambda c: len(shown[c][0]))
        A, B = shown[most]
        if not len(A):
            name = self.bodies.names[body]
            raise BadValueError(f"no picture shows four points of the board '{name}'", "leave out its rows")
        return mean_pose(np.linalg.inv(cameras[most] @ B) @ A)
