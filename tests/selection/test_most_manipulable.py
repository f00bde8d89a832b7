"""The posture of greatest manipulability: where it is known, and against many random postures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.factors import joint_jacobian
from tests.helpers.variants import conformance

ARMS = {
    "ur10": {"position": ["0.6 m", "0.2 m", "0.2 m"]},
    "panda": {"position": ["0.5 m", "0.1 m", "0.2 m"]},
    "scara": {"region": {"min": ["0.1 m", "0.1 m", "-0.1 m"], "max": ["0.25 m", "0.2 m", "0 m"]}},
}


def solved(robot: str, **task: Any) -> Any:
    return po.select_posture(
        po.problem_from_dict(
            {
                "robot": {"kind": "preset", "name": robot},
                "uncertainty": {"repeatability": "0.05 mm"},
                "task": {"kind": "insert", **task},
            }
        )
    )


def test_the_planar_arm_is_most_manipulable_with_its_elbow_at_a_right_angle() -> None:
    """det J = a1 a2 sin θ2 (Yoshikawa 1985, section 4): θ2 = ±90°, wherever the hole may be placed."""
    found = solved("planar_2r", direction=[0, -1, 0]).most_manipulable
    assert abs(found.posture["joint2"]) == pytest.approx(np.pi / 2, abs=1e-3)
    assert found.manipulability == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize("robot", conformance(ARMS, ["panda"]))
def test_no_feasible_posture_of_the_search_is_more_manipulable(robot: str) -> None:
    solution = solved(robot, **ARMS[robot])
    found, arm = solution.most_manipulable, solution.problem.robot
    others = [np.linalg.svd(joint_jacobian(arm, q)[:3], compute_uv=False) for q in solution.feasible]
    # The term adds 1 % of the root mean square of the singular values where one of them is zero.
    assert found.manipulability >= max(np.prod(s[:3]) ** (1 / 3) for s in others) * (1 - 1e-4)
    assert found.sigma_max >= solution.critical.sigma_max * (1 - 1e-6)
    assert solution.to_json()["most_manipulable"]["sigma_max"] == found.sigma_max
    assert "posture of greatest manipulability" in solution.report()
