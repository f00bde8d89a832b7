"""DH arms with hidden errors on a base and with a tool that nobody has measured: their problems and measurements."""

from __future__ import annotations

from typing import Any

import numpy as np

import posture_opt as po
from tests.helpers.simulated_arm import SimulatedArm, shift, turn

# name, theta, d, a, alpha: a 6R arm with a spherical wrist, three axes of it parallel or meeting
SIX = [
    ("j1", 0.0, 0.40, 0.10, np.pi / 2), ("j2", 0.0, 0.0, 0.50, 0.0), ("j3", 0.0, 0.0, 0.05, np.pi / 2),
    ("j4", 0.0, 0.45, 0.0, -np.pi / 2), ("j5", 0.0, 0.0, 0.0, np.pi / 2), ("j6", 0.0, 0.10, 0.0, 0.0),
]  # fmt: skip
TWO = [("j1", 0.0, 0.0, 1.0, 0.0), ("j2", 0.0, 0.0, 0.8, 0.0)]
BASE = shift(1.2, -0.4, 0.3) @ turn(2, 0.7) @ turn(1, -0.3) @ turn(0, 0.2)
TOOL = shift(0.03, -0.05, 0.12)


def simulated_poses(
    table: list[Any], q: np.ndarray, base: np.ndarray, tool: np.ndarray, errors: dict[str, float]
) -> np.ndarray:
    """(N, 4, 4) T_world_tool of an arm with hidden errors."""
    rows = tuple((name, "revolute", *lengths) for name, *lengths in table)
    return SimulatedArm(rows, errors, base=base, tool=tool).poses(q)


def simulated_points(*arm: Any) -> np.ndarray:
    """(N, 3) tool points of the same."""
    return simulated_poses(*arm)[:, :3, 3]


def hidden_errors(table: list[Any], rng: np.random.Generator, beta: tuple[str, ...] = ()) -> dict[str, float]:
    errors = {f"{n}.{k}": rng.normal(0, 5e-4) for n, *_ in table for k in ("theta", "d", "a", "alpha")}
    return errors | {f"{n}.beta": rng.normal(0, 5e-4) for n in beta}


def problem_of(table: list[Any], **sections: Any) -> Any:
    joints = [
        {"name": n, "type": "revolute", "theta": f"{t} rad", "d": f"{d} m", "a": f"{a} m", "alpha": f"{al} rad"}
        for n, t, d, a, al in table
    ]
    robot = {"kind": "dh", "joints": joints, "base": "free", "tool": "free", **sections.pop("robot", {})}
    robot = {key: value for key, value in robot.items() if value is not None}
    uncertainty = {"measurement": {"position": "0.02 mm"}, **sections.pop("uncertainty", {})}
    return po.problem_from_dict({"robot": robot, "uncertainty": uncertainty, **sections})


def rows(problem: Any, q: np.ndarray, points: np.ndarray, **more: Any) -> po.Measurements:
    columns = {f"{name} [rad]": q[:, i] for i, name in enumerate(problem.robot.joint_names)}
    columns |= {f"{axis} [m]": points[:, i] for i, axis in enumerate("xyz"[: points.shape[1]])}
    return po.read_measurements({**columns, **more}, problem)


def quaternion(R: np.ndarray) -> np.ndarray:
    """(4,) w, x, y, z by the eigenvector of Bar-Itzhack's matrix (2000), another way than the reader's."""
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[2, 0] + R[0, 2], R[2, 1] - R[1, 2]],
            [R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2], R[0, 2] - R[2, 0]],
            [R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], np.trace(R)],
        ]
    )
    x, y, z, w = np.linalg.eigh(K / 3)[1][:, -1]
    return np.array([w, x, y, z]) * (1 if w >= 0 else -1)
