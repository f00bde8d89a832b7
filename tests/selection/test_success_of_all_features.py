"""The greatest probability that all features succeed, against combinations of elbows and placements tried one by one.

The arm is a SCARA seen from above, with its own kinematics here; probabilities are counted over drawn errors.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import posture_opt as po

DRAWS = 20_000
LINKS = 0.22, 0.13  # m, of the preset
LIMITS = math.radians(140), math.radians(142)
MIXED_ELBOWS = {"joint1.theta": 0.2e-3, "joint2.theta": 0.2e-3, "joint1.a": 20e-6, "joint2.a": 30e-6,
                "base.x": 20e-6, "base.yaw": 0.1e-3}  # fmt: skip


def scara(holes: list[list[float]], workpiece: dict[str, Any], clearance: float, stays: dict[str, float],
          scatter: dict[str, float]) -> po.Problem:  # fmt: skip
    units = {name: "m" if name.endswith((".a", ".x")) else "rad" for name in {**stays, **scatter}}
    features = [{"name": f"{k}", "position": [f"{v} m" for v in (*hole, 0.0)]} for k, hole in enumerate(holes)]
    return po.problem_from_dict(
        {
            "robot": {"kind": "preset", "name": "scara"},
            "cell": "none",
            "uncertainty": {
                "sigma": {name: f"{v} {units[name]}" for name, v in stays.items()},
                "scatter": {name: f"{v} {units[name]}" for name, v in scatter.items()},
            },
            "task": {
                "kind": "insert",
                "clearance": f"{clearance} m",
                "combine": "success",
                "features": features,
                "workpiece": {"z": "-80 mm", **workpiece},
            },
        }
    )


@dataclass(frozen=True)
class Counted:
    """P(all) by counting, for postures given as elbows at holes of a workpiece at (x, y, yaw)."""

    holes: np.ndarray
    clearance: float
    stays: dict[str, np.ndarray]
    scatter: list[dict[str, np.ndarray]]

    @classmethod
    def of(cls, holes: Any, clearance: float, stays: dict[str, float], scatter: dict[str, float]) -> Counted:
        rng = np.random.default_rng(41)
        drawn = [{name: v * rng.standard_normal(DRAWS) for name, v in scatter.items()} for _ in holes]
        kept = {name: v * rng.standard_normal(DRAWS) for name, v in stays.items()}
        return cls(np.array(holes), clearance, kept, drawn)

    def points(self, q: np.ndarray, errors: dict[str, np.ndarray]) -> np.ndarray:
        (a1, a2), e = LINKS, dict.fromkeys(("base.x", "base.yaw", "joint1.a", "joint2.a"), 0.0) | errors
        first = e["base.yaw"] + q[0] + e.get("joint1.theta", 0.0)
        second = first + q[1] + e.get("joint2.theta", 0.0)
        x = e["base.x"] + (a1 + e["joint1.a"]) * np.cos(first) + (a2 + e["joint2.a"]) * np.cos(second)
        return np.array([x, (a1 + e["joint1.a"]) * np.sin(first) + (a2 + e["joint2.a"]) * np.sin(second)])

    def hit(self, k: int, q: np.ndarray) -> np.ndarray:
        names = {*self.stays, *self.scatter[k]}
        errors = {name: self.stays.get(name, 0.0) + self.scatter[k].get(name, 0.0) for name in names}
        off = self.points(q, errors) - np.reshape(self.points(q, {}), (2, 1))
        return np.hypot(*off) <= self.clearance

    def elbows(self, point: np.ndarray) -> list[np.ndarray]:
        (a1, a2), c = LINKS, (point @ point - LINKS[0] ** 2 - LINKS[1] ** 2) / (2 * LINKS[0] * LINKS[1])
        if abs(c) > 1:
            return []
        found = []
        for q2 in (math.acos(c), -math.acos(c)):
            q1 = math.atan2(point[1], point[0]) - math.atan2(a2 * math.sin(q2), a1 + a2 * math.cos(q2))
            q1 = math.remainder(q1, 2 * math.pi)
            if abs(q1) <= LIMITS[0] and abs(q2) <= LIMITS[1]:
                found.append(np.array([q1, q2]))
        return found

    def best(self, x: float, y: float, yaw: float) -> float:
        """The best combination of elbows there, zero where a hole is out of reach."""
        turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        hits = [[self.hit(k, q) for q in self.elbows(turn @ hole + (x, y))] for k, hole in enumerate(self.holes)]
        return max((np.logical_and.reduce(one).mean() for one in itertools.product(*hits)), default=0.0)

    def of_answer(self, found: po.Solution) -> float:
        return float(np.logical_and.reduce([self.hit(k, q) for k, q in enumerate(found.postures)]).mean())


def test_elbows_are_alike_where_that_is_what_succeeds() -> None:
    holes = [[0.03, 0.02], [-0.03, 0.02], [0.03, -0.02], [-0.03, -0.02]]
    problem = scara(holes, {"x": "0.2 m", "y": "0 m"}, 60e-6, MIXED_ELBOWS, {})
    found = po.select_posture(problem)
    counted = Counted.of(holes, 60e-6, MIXED_ELBOWS, {})
    best, error = counted.best(0.2, 0.0, 0.0), 0.5 / math.sqrt(DRAWS)
    assert counted.of_answer(found) > best - 4 * error
    assert found.success.probability == pytest.approx(best, abs=4 * error)
    assert len(set(np.sign(found.postures[:, 1]))) == 1
    assert found.success.probability > found.success.product + 0.3


@pytest.mark.conformance  # always: one elbow for all, above
def test_no_placement_and_no_elbows_succeed_more_often() -> None:
    holes, scatter = [[0.06, 0.04], [-0.05, 0.03], [0.02, -0.06]], {"joint1.theta": 0.05e-3, "joint2.theta": 0.1e-3}
    ranges = {"x": ["0.12 m", "0.24 m"], "y": "0.03 m", "yaw": ["-180 deg", "180 deg"]}
    found = po.select_posture(scara(holes, ranges, 70e-6, MIXED_ELBOWS, scatter))
    counted, error = Counted.of(holes, 70e-6, MIXED_ELBOWS, scatter), 0.5 / math.sqrt(DRAWS)
    mine = counted.of_answer(found)
    assert found.success.probability == pytest.approx(mine, abs=4 * error)
    rng = np.random.default_rng(5)
    far = np.column_stack([rng.uniform(0.12, 0.24, 60), rng.uniform(-math.pi, math.pi, 60)])
    near = found.w[[0, 3]] + rng.uniform(-1, 1, (20, 2)) * (0.01, 0.2)
    near[:, 0] = np.clip(near[:, 0], 0.12, 0.24)
    assert max(counted.best(x, 0.03, yaw) for x, yaw in np.vstack([far, near])) < mine + 4 * error
