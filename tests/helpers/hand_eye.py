"""OpenCV's hand-eye calibrations on simulated pictures, the arm held: where they put markers of other pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import posture_opt as po
from posture_opt.measurements.kinds import MarkerPixels
from posture_opt.measurements.rotations import turned_by
from tests.helpers.cameras import TOOL_SCENE, Scene, camera_postures, camera_problem, camera_table, grid
from tests.helpers.instruments import JOINTS, TrueArm

SMALL = grid(3, 4, 0.05)
SCENES = {"cell": replace(Scene(), corners=SMALL), "tool": replace(TOOL_SCENE, corners=SMALL)}
METHODS = ("Shah", "Li", "Tsai", "Park", "Horaud", "Andreff", "Daniilidis")


def rigid(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.ravel(t)
    return T


def points_seen(scene: Scene, camera: np.ndarray, board: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """(n, k, 3) corners in the frame of the camera at poses (n, 4, 4) of the tool."""
    carried = np.linalg.inv(pose) if scene.on_tool else pose
    T = np.linalg.inv(camera) @ carried @ board
    return np.einsum("nij,kj->nki", T[:, :3, :3], scene.corners) + T[:, None, :3, 3]


def errors_of(cv2: Any, where: str, folder: Path, seed: int) -> tuple[float, float, tuple[float, ...]]:
    """RMS error [m] of corners in 40 other pictures: calibrated, with the arm held, and by each of OpenCV's methods.

    30 pictures with a noise of 0.2 px; an arm with errors of 0.5 mm and 0.5 mrad.
    """
    scene, rng = SCENES[where], np.random.default_rng(seed)
    true, nominal = TrueArm.drawn(rng), TrueArm()
    table = camera_table(true, rng, 30, 0.2, scene)
    text = camera_problem(folder, scene)
    text["data"]["markers"]["board"]["chessboard"] = {"rows": 3, "columns": 4, "square": "50 mm"}  # type: ignore[index]
    given = po.problem_from_dict(text, folder)
    found = po.calibrate(given, po.read_measurements(table, given), plan=False)
    q, side = camera_postures(true, rng, 40, scene)
    truth = points_seen(scene, scene.camera.pose, scene.board, true.pose(q, side))

    def error(camera: np.ndarray, board: np.ndarray, pose: np.ndarray) -> float:
        off = points_seen(scene, camera, board, pose) - truth
        return float(np.sqrt(np.mean(np.sum(off**2, axis=2))))

    taught = np.stack([np.asarray(table[f"{name} [rad]"])[:: len(SMALL)] for name in JOINTS], axis=1)
    pixels = np.stack([table["u [px]"], table["v [px]"]], axis=1).reshape(30, -1, 2)  # type: ignore[call-overload]
    theirs = [error(*way, nominal.pose(q)) for way in opencv_ways(cv2, scene, nominal.pose(taught), pixels)]
    kind, residuals = found.residuals.data.kind, found.residuals
    assert isinstance(kind, MarkerPixels)

    def places(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        camera, board = residuals.places(x)
        own, frame = kind.camera_frames[0], kind.body_frames[0]
        return (
            rigid(own[:3, :3] @ turned_by(camera[None, 3:6])[0], own[:3, 3] + camera[:3]),
            rigid(frame[:3, :3] @ turned_by(board[None, 16:19])[0], frame[:3, 3] + board[13:16]),
        )

    held = error(*places(found.x_nominal), nominal.pose(q))
    arm = residuals.of_data(replace(residuals.data.take(np.zeros(len(q), dtype=int)), q=q))
    reached = arm.walk(found.x)
    R = np.stack([np.stack(list(column), axis=1) for column in reached.columns], axis=2)
    calibrated = np.array([rigid(r, t) for r, t in zip(R, np.stack(list(reached.position), axis=1), strict=True)])
    ours = error(*places(found.x), calibrated)
    return ours, held, tuple(theirs)


def opencv_ways(cv2: Any, scene: Scene, pose: np.ndarray, pixels: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses of camera and board by each of OpenCV's methods."""
    (fx, fy), (cx, cy) = scene.camera.focal, scene.camera.centre
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    seen = []
    for shown in pixels:
        _, turn, shift = cv2.solvePnP(scene.corners, shown, K, np.array(scene.camera.k))
        seen.append(rigid(cv2.Rodrigues(turn)[0], shift))
    A, B = np.array(seen), np.linalg.inv(pose) if scene.on_tool else pose  # T_camera_board, T_mount_carrier
    found = []
    for method in (0, 1):  # Shah, Li
        R_m, t_m, R_w, t_w = cv2.calibrateRobotWorldHandEye(
            A[:, :3, :3], A[:, :3, 3], B[:, :3, :3], B[:, :3, 3], method=method
        )
        # A X = Z B: X from carrier to board, Z from mount to camera
        found.append((np.linalg.inv(rigid(R_w, t_w)), np.linalg.inv(rigid(R_m, t_m))))
    for method in (0, 1, 2, 3, 4):  # Tsai, Park, Horaud, Andreff, Daniilidis
        back = np.linalg.inv(B)
        R, t = cv2.calibrateHandEye(back[:, :3, :3], back[:, :3, 3], A[:, :3, :3], A[:, :3, 3], method=method)
        camera = rigid(R, t)  # of the camera in its mount
        board = np.median(back @ camera @ A, axis=0)
        U, _, V = np.linalg.svd(board[:3, :3])
        found.append((camera, rigid(U @ V, board[:3, 3])))
    return found
