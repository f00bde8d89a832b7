"""A planar 2R arm (1 m and 0.8 m) whose joints scatter between repeats, as much as stated or so many times that."""

from __future__ import annotations

from typing import Any

import numpy as np

import posture_opt as po
from tests.helpers.planar_2r import position

SCATTER = np.array([1e-3, 2e-3])  # rad, from repeat to repeat
LENGTH = 1e-3  # m, of each link, the same at every visit
NOISE = 2e-5  # m, of each coordinate
KNOWN = {"base": {"xyz": ["0 m"] * 3}, "tool": {"xyz": ["0 m"] * 3}}
STATED = {"scatter": {"j1.theta": "1 mrad", "j2.theta": "2 mrad"}, "sigma": {"j1.a": "1 mm", "j2.a": "1 mm"}}


def arm(uncertainty: dict[str, Any], **robot: Any) -> Any:
    joints = [{"name": n, "type": "revolute", "a": a} for n, a in (("j1", "1 m"), ("j2", "0.8 m"))]
    measurement = {"position": "0.02 mm"}
    return po.problem_from_dict(
        {
            "robot": {"kind": "dh", "joints": joints, **KNOWN, **robot},
            "uncertainty": {"measurement": measurement, **uncertainty},
        }
    )


def table(q: np.ndarray, points: np.ndarray, **more: Any) -> dict[str, Any]:
    return {"j1 [rad]": q[:, 0], "j2 [rad]": q[:, 1], "x [m]": points[:, 0], "y [m]": points[:, 1], **more}


def measured(
    rng: np.random.Generator, poses: int, visits: int = 1, times: float = 1.0, length: float = LENGTH
) -> tuple[np.ndarray, np.ndarray]:
    """Commands and measured points of an arm whose joints scatter ``times`` as much as stated."""
    q = rng.uniform(-2.5, 2.5, (poses, 2)).repeat(visits, axis=0)
    lengths = np.array([1.0, 0.8]) + length * rng.normal(size=2)
    reached = q + times * SCATTER * rng.normal(size=q.shape)
    return q, position(reached, lengths) + NOISE * rng.normal(size=q.shape)


def checked(problem: Any, q: np.ndarray, points: np.ndarray) -> po.SpreadCheck:
    data = po.read_measurements(table(q, points), problem)
    return po.check_spread(problem, data, po.calibrate(problem, data))
