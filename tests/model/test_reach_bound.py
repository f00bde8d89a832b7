"""The spheres that bound an arm's reach hold every posture, and hold it closely where the arm can stretch and fold."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.model.chain import Shell

LONG_TOOL = {"xyz": ["1 m", "1 m", "1 m"], "rpy": ["0 deg", "0 deg", "-45 deg"]}


def two_links() -> dict[str, object]:
    joint = {"type": "revolute", "alpha": "0 deg", "d": "0 m", "theta": "0 deg", "limits": ["-180 deg", "180 deg"]}
    joints = [{"name": "j1", "a": "1 m", **joint}, {"name": "j2", "a": "0.4 m", **joint}]
    return {"kind": "dh", "joints": joints}


@pytest.mark.parametrize("name", ["panda", "ur10", "scara", "irb120", "planar_2r"])
@pytest.mark.parametrize("tool", [None, LONG_TOOL])
def test_no_posture_leaves_the_spheres(name: str, tool: dict[str, object] | None) -> None:
    robot = {"kind": "preset", "name": name} | ({"tool": tool} if tool else {})
    arm = po.Arm.from_problem(po.problem_from_dict({"robot": robot}))
    shell = Shell.of(arm.robot)
    Q = np.random.default_rng(3).uniform(arm.robot.lower, arm.robot.upper, (300, arm.robot.n))
    found = np.linalg.norm([np.asarray(arm.pose(q), dtype=float)[:3, 3] - shell.centre for q in Q], axis=1)
    assert shell.least - 1e-12 <= found.min()
    assert found.max() <= shell.most + 1e-12


@pytest.mark.parametrize("x", ["0.3 m", "1.7 m"])
def test_a_target_beyond_the_spheres_is_refused_without_a_random_start(x: str) -> None:
    task = {"kind": "insert", "direction": [0, -1, 0], "position": [x, "0 m", "0 m"]}
    asked = {"robot": two_links(), "uncertainty": {"sigma": {"j1.theta": "1 deg"}}, "task": task}
    with pytest.raises(po.errors.NoSolutionError, match="the target is out of reach by 300 mm") as caught:
        po.select_posture(po.problem_from_dict(asked))
    assert caught.value.solution is not None
    assert caught.value.solution.to_json()["solver"]["starts"] == 0
