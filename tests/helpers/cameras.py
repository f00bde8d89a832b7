"""Simulated cameras at the arm of `instruments`: pictures of markers by formulas of their own."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tests.helpers.instruments import JOINTS, TrueArm, postures, table_of

OPENCV_FILE = """%YAML:1.0
---
image_width: {width}
image_height: {height}
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {fx}, 0., {cx}, 0., {fy}, {cy}, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ {k[0]}, {k[1]}, {k[2]}, {k[3]}, {k[4]} ]
"""


@dataclass
class TrueCamera:
    """A pinhole camera of 1280 × 1024 pixels with distortion, looking along the z of its pose (4, 4)."""

    pose: np.ndarray
    focal: tuple[float, float] = (1250.0, 1245.0)
    centre: tuple[float, float] = (652.0, 503.0)
    k: tuple[float, ...] = (-0.11, 0.06, 0.0007, -0.0005, 0.0)
    size: tuple[int, int] = (1280, 1024)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) pictures of points (N, 3) in the frame in which its pose is given; NaN behind the camera."""
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        x, y = (local[:, :2] / np.where(local[:, 2:] > 0.05, local[:, 2:], np.nan)).T
        r2 = x * x + y * y
        k1, k2, p1, p2, k3 = self.k
        bend = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        u = x * bend + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * bend + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([self.focal[0] * u + self.centre[0], self.focal[1] * v + self.centre[1]], axis=1)

    def seen(self, pixels: np.ndarray) -> np.ndarray:
        """(N,) which pictures are within the frame."""
        return np.all((pixels > 5) & (pixels < np.array(self.size) - 5), axis=1)

    def text(self) -> str:
        """Its intrinsics as OpenCV writes them."""
        (fx, fy), (cx, cy), (w, h) = self.focal, self.centre, self.size
        return OPENCV_FILE.format(fx=fx, fy=fy, cx=cx, cy=cy, k=self.k, width=w, height=h)


def frame(rotvec: list[float], at: list[float]) -> np.ndarray:
    """(4, 4) by a rotation vector and a place."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(rotvec).as_matrix(), at
    return T


def looking(at: list[float], toward: list[float]) -> np.ndarray:
    """(4, 4) pose of a camera at a place that looks toward a point, its y downward."""
    z = np.array(toward, dtype=float) - at
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), at
    return T


def grid(rows: int = 6, columns: int = 8, square: float = 0.025) -> np.ndarray:
    """(rows·columns, 3) inner corners of a chessboard, row by row."""
    return np.array([[c * square, r * square, 0.0] for r in range(rows) for c in range(columns)])


@dataclass
class Scene:
    """A camera in the cell or on the tool, a board on the other, and how many rows and corners it has."""

    camera: TrueCamera = field(default_factory=lambda: TrueCamera(looking([1.9, 0.1, 0.55], [0.85, 0.0, 0.45])))
    board: np.ndarray = field(default_factory=lambda: frame([0.1, 0.2, 0.3], [-0.08, -0.06, 0.02]))
    on_tool: bool = False
    corners: np.ndarray = field(default_factory=grid)
    depths: tuple[float, float] = (0.75, 1.25)
    tilt: float = 0.7

    def pixels(self, pose: np.ndarray) -> np.ndarray:
        """(corners, 2) in the picture at one pose (4, 4) of the tool."""
        points = self.corners @ self.board[:3, :3].T + self.board[:3, 3]
        inside = (points - pose[:3, 3]) @ pose[:3, :3]
        return self.camera.pixels(inside if self.on_tool else points @ pose[:3, :3].T + pose[:3, 3])


def carrying(pose: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(4, 4) pose of the tool's frame in the base that puts a carried frame ``at`` (4, 4) at ``pose`` (4, 4)."""
    return pose @ np.linalg.inv(at)


def reached(arm: TrueArm, q: np.ndarray, wanted: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, 6) joints that bring the tool to poses (n, 4, 4), by damped Newton steps from q, and (n,) where they do."""

    def error(q: np.ndarray) -> np.ndarray:
        T = arm.pose(q, side)
        turn = Rotation.from_matrix(wanted[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)).as_rotvec()
        return np.concatenate([wanted[:, :3, 3] - T[:, :3, 3], 0.5 * turn], axis=1)

    for _ in range(40):
        e = error(q)
        J = np.stack([(error(q + h) - e) / 1e-6 for h in 1e-6 * np.eye(6)], axis=2)
        normal = np.swapaxes(J, 1, 2) @ J + 1e-3 * np.linalg.norm(e, axis=1)[:, None, None] * np.eye(6)
        q = q - np.linalg.solve(normal, np.einsum("nji,nj->ni", J, e)[:, :, None])[:, :, 0].clip(-0.5, 0.5)
    return q, (np.linalg.norm(error(q), axis=1) < 1e-4) & np.all(np.abs(q) < 3.1, axis=1)


def wanted_pose(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """(4, 4) a pose of the tool's frame with the board before the camera, turned by up to 40 degrees or so."""
    depth = rng.uniform(*scene.depths)
    quarter = Rotation.from_euler("z", rng.integers(4) * np.pi / 2)
    seen = np.eye(4)  # the board in the camera, its back away from it
    seen[:3, :3] = (Rotation.from_rotvec(rng.uniform(-1, 1, 3) * scene.tilt) * quarter).as_matrix()
    shift = rng.uniform([-0.22, -0.16], [0.22, 0.16]) * depth
    seen[:3, 3] = np.array([*shift, depth]) - seen[:3, :3] @ scene.corners.mean(axis=0)
    if scene.on_tool:
        return carrying(scene.board @ np.linalg.inv(seen), scene.camera.pose)
    return carrying(scene.camera.pose @ seen, scene.board)


def camera_postures(arm: TrueArm, rng: np.random.Generator, n: int, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """(n, 6) postures in which the camera sees the whole board, and their sides of approach (n, 6)."""
    found, sides = np.zeros((0, 6)), np.zeros((0, 6))
    while len(found) < n:
        side = rng.choice([-1.0, 1.0], (3 * n, 6))
        q, good = reached(arm, postures(rng, 3 * n), np.array([wanted_pose(scene, rng) for _ in side]), side)
        q = np.round(q, 6)
        good &= [bool(scene.camera.seen(scene.pixels(T)).all()) for T in arm.pose(q, side)]
        found, sides = np.concatenate([found, q[good]]), np.concatenate([sides, side[good]])
    return found[:n], sides[:n]


def camera_table(
    arm: TrueArm, rng: np.random.Generator, n: int, sigma: float, scene: Scene | None = None, scatter: float = 0.0
) -> dict[str, object]:
    """Pictures of the whole board at n postures: pixels of all corners, with noise; sides of approach stated.

    ``scatter`` [rad] is that of every joint, anew at every posture.
    """
    scene = scene or Scene()
    q, side = camera_postures(arm, rng, n, scene)
    stood = q + rng.normal(0, scatter, q.shape) if scatter else q
    uv = np.concatenate([scene.pixels(T) for T in arm.pose(stood, side)])
    uv += rng.normal(0, sigma, uv.shape)
    each = len(scene.corners)
    q, side = np.repeat(q, each, axis=0), np.repeat(side, each, axis=0)
    markers = np.tile([f"board/{k}" for k in range(each)], n)
    return table_of(
        q, marker=markers, camera=np.array(["left"] * len(q)), **{"u [px]": uv[:, 0], "v [px]": uv[:, 1]},
        **{f"{joint}.approach": side[:, i] for i, joint in enumerate(JOINTS)},
    )  # fmt: skip


def board_table(
    arm: TrueArm, rng: np.random.Generator, n: int, sigmas: tuple[float, float], scene: Scene | None = None
) -> dict[str, object]:
    """Poses of the board in the camera at n postures, as rotation vectors; sides of approach stated.

    Args:
        sigmas: of a coordinate [m] and of a component of the rotation vector [rad], in the camera.
    """
    scene = scene or TOOL_SCENE
    q, side = camera_postures(arm, rng, n, scene)
    T = np.linalg.inv(arm.pose(q, side) @ scene.camera.pose) @ scene.board
    p = T[:, :3, 3] + rng.normal(0, sigmas[0], (n, 3))
    turn = Rotation.from_rotvec(rng.normal(0, sigmas[1], (n, 3))) * Rotation.from_matrix(T[:, :3, :3])
    columns = {f"{axis} [m]": p[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"r{axis} [rad]": turn.as_rotvec()[:, i] for i, axis in enumerate("xyz")}
    return table_of(q, **columns, **{f"{joint}.approach": side[:, i] for i, joint in enumerate(JOINTS)})


def camera_problem(
    folder: Path, scene: Scene | None = None, pixel: str = "0.2 px", known: bool = True, **camera: object
) -> dict[str, object]:
    """The plain data of a problem with the camera ``left``, whose intrinsics are written into the folder."""
    scene = scene or Scene()
    (folder / "left.yaml").write_text(scene.camera.text(), encoding="utf-8")
    tool = ["30 mm", "-20 mm", "120 mm"]
    mount, on = ("tool", "cell") if scene.on_tool else ("cell", "tool")
    board = {"chessboard": {"rows": 6, "columns": 8, "square": "25 mm"}} if known else {}
    return {
        "robot": {
            "kind": "preset",
            "name": "ur10",
            "tool": {"xyz": tool, "rpy": ["0 deg"] * 3},
        },
        "uncertainty": {"measurement": {"pixel": pixel}},
        "data": {
            "cameras": {"left": {"mount": mount, "intrinsics": "left.yaml", **camera}},
            "markers": {"board": {"on": on, **board}},
        },
    }


TOOL_SCENE = Scene(
    camera=TrueCamera(frame([0.2, -0.1, 0.5], [0.02, 0.05, -0.05])),
    board=frame([np.pi - 0.05, 0.1, 0.02], [0.75, -0.1, -0.35]),
    on_tool=True,
)
"""A camera on the tool, and a board on the table before the arm."""
