"""Where the choice of the posture gains little, the first lines say what helps more."""

from __future__ import annotations

from typing import Any

import posture_opt as po
from tests.helpers.said import said


def solved(**uncertainty: Any) -> po.Solution:
    robot = {"kind": "preset", "name": "planar_2r"}
    task = {"kind": "insert", "direction": [0, -1, 0], "position": ["0.9 m", "0.4 m", "0 m"]}
    return po.select_posture(po.problem_from_dict({"robot": robot, "uncertainty": uncertainty, "task": task}))


def test_little_gain_names_the_greatest_help() -> None:
    """Both elbows scatter alike where the shoulder's error is all there is, and halving it halves the scatter."""
    solution = solved(sigma={"joint1.theta": "1 mrad"})
    assert abs(solution.gain_over(solution.statistics.typical)) < 0.05
    greatest = max(solution.improvements, key=lambda change: change.gain)
    assert greatest.gain >= 0.5 - 1e-9
    most = next(one for one in solution.statements if one.label == "Helps most")
    assert most.values["gain"].value == greatest.gain  # type: ignore[union-attr]
    assert {"selection.no-gain", "selection.small-gain"} & said(solution).keys()


def test_much_gain_does_not() -> None:
    solution = solved(sigma={"joint1.theta": "0.1 mrad", "joint1.a": "3 mm"})
    assert solution.gain_over(solution.statistics.typical) > 0.05
    assert not {"selection.no-gain", "selection.small-gain"} & said(solution).keys()
