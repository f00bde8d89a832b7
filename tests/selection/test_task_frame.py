"""A task in the robot's frame is the task that the arm has at its own base, wherever that stands in the world."""

from __future__ import annotations

from typing import Any

import pytest

import posture_opt as po
from tests.helpers.variants import conformance

TURNED = {"xyz": ["1.2 m", "-3 m", "0.4 m"], "rpy": ["10 deg", "20 deg", "50 deg"]}
SHIFTED = {"xyz": TURNED["xyz"]}
REGION = {"min": ["0.2 m", "0 m", "-50 mm"], "max": ["0.25 m", "0.1 m", "-50 mm"]}
TASKS: dict[str, dict[str, Any]] = {
    "position": {"kind": "insert", "direction": [0, 0.6, -0.8], "position": ["0.6 m", "0.2 m", "0.3 m"]},
    "features": {
        "kind": "insert",
        "features": [
            {"name": "a", "position": ["0.6 m", "0.2 m", "0.3 m"]},
            {"name": "b", "position": ["0.5 m", "0.2 m", "0.3 m"], "direction": [0, 1, -1]},
        ],
    },
    "points": {"kind": "trace", "points": [["0.5 m", "0.2 m", "0.3 m"], ["0.6 m", "0.25 m", "0.4 m"]]},
    "region": {"kind": "insert", "region": REGION},
    "workpiece": {
        "kind": "insert",
        "workpiece": {"x": ["0.2 m", "0.25 m"], "z": "-50 mm"},
        "features": [{"name": "a", "position": ["0 m", "0.1 m", "0 m"]}],
    },
}
RANGES = ("region", "workpiece")


def problem(task: dict[str, Any], base: dict[str, Any] | None = None, **further: Any) -> po.Problem:
    name = "scara" if {"region", "workpiece"} & set(task) else "ur10"
    robot = {"kind": "preset", "name": name, **({} if base is None else {"base": base})}
    stated = {"robot": robot, "uncertainty": {"repeatability": "0.05 mm"}, "cell": "none"}
    return po.problem_from_dict(stated | {"task": task | further})


@pytest.mark.parametrize("key", conformance(TASKS, [key for key in TASKS if key != "workpiece"]))
def test_the_answer_does_not_depend_on_where_the_base_stands(key: str) -> None:
    at_base = po.select_posture(problem(TASKS[key])).sigma_max
    base = SHIFTED if key in RANGES else TURNED
    assert po.select_posture(problem(TASKS[key], base, frame="robot")).sigma_max == pytest.approx(at_base, rel=1e-6)


@pytest.mark.parametrize("key", RANGES)
def test_a_range_along_axes_of_the_world_is_refused_by_name(key: str) -> None:
    with pytest.raises(po.errors.InputError, match=f"{key} is along the axes of the world"):
        problem(TASKS[key], TURNED, frame="robot")
