"""Joint values that people read have the digits that the scatter supports; programs have more."""

from __future__ import annotations

import math

import numpy as np
import pytest

import posture_opt as po
from posture_opt.uncertainty.spread.joint_digits import joint_digits, readable_digits
from tests.helpers.factors import joint_jacobian, pose

KEYS = {"position": ["0.4 m", "0.1 m", "0.3 m"], "direction": [0, 0, -1]}


@pytest.mark.parametrize("name", ["ur5e", "panda", "scara"])
def test_rounding_adds_little_to_the_scatter_of_the_tool_point(name: str) -> None:
    """Drawn: postures within half a step of the last digit, beside J Σ Jᵀ; one digit less would be too few."""
    problem = po.problem_from_dict({
        "robot": {"kind": "preset", "name": name}, "uncertainty": {"repeatability": "0.03 mm"},
        "task": {"kind": "insert", **KEYS},
    })  # fmt: skip
    robot, rng = problem.robot, np.random.default_rng(1)
    q = rng.uniform(robot.lower, robot.upper)
    digits = readable_digits(problem, q)
    J = joint_jacobian(robot, q)
    scatter = np.sqrt(np.trace(J @ problem.sources.covariance @ J.T))

    def moved(coarser: int) -> float:
        steps = [
            10.0 ** (coarser - digits.decimals(j, u)) * u
            for j in robot.joints
            for u in [math.radians(1) if j.type == "revolute" else 1e-3]
        ]
        near = q + rng.uniform(-0.5, 0.5, (400, robot.n)) * steps
        return float(np.sqrt(np.mean([np.sum((pose(robot, p)[:3, 3] - pose(robot, q)[:3, 3]) ** 2) for p in near])))

    assert moved(0) < 1.1 * 0.3 * scatter
    assert moved(1) > 0.3 * scatter / 2
    assert joint_digits(problem, q).turn < digits.turn / 3
