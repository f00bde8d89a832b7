"""Poses of a board that a camera on the tool reports: the arm is found as from a tracker."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posture_opt as po
from tests.helpers.cameras import TOOL_SCENE, camera_postures
from tests.helpers.instruments import TrueArm, table_of

TEXT = {
    "robot": {"kind": "preset", "name": "ur10", "base": "free", "tool": "free"},
    "uncertainty": {"measurement": {"position": "0.05 mm", "orientation": "0.002 deg"}},
    "data": {"frame": "camera"},
}


def table(n: int) -> dict[str, object]:
    """Poses of the board in the camera at n postures, with noise."""
    rng = np.random.default_rng(1)
    arm = TrueArm.drawn(rng)
    q, side = camera_postures(arm, rng, n, TOOL_SCENE)
    T = np.linalg.inv(arm.pose(q, side) @ TOOL_SCENE.camera.pose) @ TOOL_SCENE.board
    p = T[:, :3, 3] + rng.normal(0, 5e-5, (n, 3))
    turn = Rotation.from_rotvec(rng.normal(0, np.radians(0.002), (n, 3))) * Rotation.from_matrix(T[:, :3, :3])
    rx, ry, rz = turn.as_rotvec().T
    turns = {"rx [rad]": rx, "ry [rad]": ry, "rz [rad]": rz}
    return table_of(q, **{f"{axis} [m]": p[:, i] for i, axis in enumerate("xyz")}, **turns)


def test_poses_are_turned_into_the_frame_of_the_board() -> None:
    given = po.problem_from_dict(TEXT)
    data = po.read_measurements(table(6), given)
    assert data.position is not None
    seen = table(6)
    T = np.broadcast_to(np.eye(4), (6, 4, 4)).copy()
    turn = np.stack([seen[f"r{a} [rad]"] for a in "xyz"], axis=1)  # type: ignore[call-overload]
    T[:, :3, :3] = Rotation.from_rotvec(turn).as_matrix()
    T[:, :3, 3] = np.stack([seen[f"{a} [m]"] for a in "xyz"], axis=1)  # type: ignore[call-overload]
    assert np.allclose(data.position, np.linalg.inv(T)[:, :3, 3], atol=1e-9)
    again = po.read_measurements(data.to_dataframe(), given)
    assert np.allclose(again.position, data.position, atol=1e-12)


def test_what_is_missing_is_said() -> None:
    bare = {key: column for key, column in table(3).items() if not key.startswith("r")}
    with pytest.raises(po.errors.InputError, match="poses of a board have x, y, z and an orientation"):
        po.read_measurements(bare, po.problem_from_dict(TEXT))
    held = po.problem_from_dict({**TEXT, "robot": {"kind": "preset", "name": "ur10"}})
    with pytest.raises(po.errors.InputError, match="write base: free and tool: free"):
        po.read_measurements(table(3), held)
