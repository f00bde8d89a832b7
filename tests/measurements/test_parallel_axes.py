"""Camera and board at an arm that turns about the vertical only: how high both are is open, and must not be far off."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posture_opt.measurements.hand_eye import robot_world_hand_eye


def frame(rotvec: list[float], at: list[float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(rotvec).as_matrix(), at
    return T


@pytest.mark.parametrize("on_tool", [True, False])
def test_what_the_tool_carries_is_near_it(on_tool: bool) -> None:
    """Errors of the arm and noise tilt poses by half a milliradian, which is no turn to find a height by."""
    rng, n = np.random.default_rng(1), 20
    on_arm, in_cell = frame([0.1, -0.2, 0.4], [0.05, 0.03, 0.02]), frame([3.0, 0.1, 0.0], [0.4, 0.1, -0.5])
    T = np.array([frame([0, 0, rng.uniform(-2, 2)], [*rng.uniform(-0.4, 0.4, 2), 0.0]) for _ in range(n)])
    tilted = np.array([one @ frame([*rng.normal(0, 5e-4, 2), 0.0], [0.0] * 3) for one in T])
    tool = T if on_tool else np.linalg.inv(T)
    A = np.linalg.inv(tilted @ on_arm) @ in_cell if on_tool else np.linalg.inv(in_cell) @ tilted @ on_arm
    A[:, :3, :3] = A[:, :3, :3] @ Rotation.from_rotvec(rng.normal(0, 5e-4, (n, 3))).as_matrix()
    A[:, :3, 3] += rng.normal(0, 5e-4, (n, 3))
    Z, W = robot_world_hand_eye(A, np.linalg.inv(tool), 0.1 * np.eye(3), on_tool)
    carried, stands = (np.linalg.inv(Z), W) if on_tool else (W, np.linalg.inv(Z))
    assert np.linalg.norm(carried[:3, 3] - on_arm[:3, 3]) < 0.1
    assert np.linalg.norm(stands[:2, 3] - in_cell[:2, 3]) < 5e-3
    assert np.allclose(carried[:3, :3], on_arm[:3, :3], atol=5e-3)
