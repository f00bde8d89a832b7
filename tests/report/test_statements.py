"""The statements of every result: the answer first, sentences filled."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.export.robot_program import program_through
from tests.helpers.said import said


def made(name: str, **keys: Any) -> po.Solution:
    """The answer to a shipped problem with other keys of its file."""
    problem = po.load_problem(name)
    return po.select_posture(problem.replace(**keys) if keys else problem)


def test_a_taught_position_is_the_condition_of_its_probability() -> None:
    """Repeatability says nothing of where the arm is in the world; stated errors that stay do."""
    task = {"kind": "insert", "direction": [0, -1, 0], "position": ["0.9 m", "0.4 m", "0 m"], "clearance": "50 mm"}
    ids = {}
    for name, errors in {
        "taught": {"repeatability": "0.1 mm"},
        "placed": {"sigma": {"joint1.theta": "1 mrad"}},
    }.items():
        robot = {"kind": "preset", "name": "planar_2r"}
        found = po.select_posture(po.problem_from_dict({"robot": robot, "uncertainty": errors, "task": task}))
        ids[name] = {one for one in said(found) if "success" in one}
        assert "> 99.9 %" in found.report()
    assert ids == {"taught": {"uncertainty.success-taught"}, "placed": {"uncertainty.success"}}


def test_a_joint_that_spins_the_tool_about_its_axis_is_free_and_any_value_as_good() -> None:
    found = made("insert_ur10")
    (name,) = said(found)["selection.free-joint"].values["joints"]  # type: ignore[misc, union-attr]
    at = found.problem.robot.joint_names.index(str(name))
    turned = np.array(found.q)
    turned[at] += 1.0
    assert found.sigma_at(found.target, turned) == pytest.approx(found.sigma_max, rel=1e-9)


# --- Joints that an answer puts at their limits are told, and in its program ------------------------------------------


def test_a_joint_at_its_limit_is_told_with_what_keeps_it_away() -> None:
    problem = po.load_problem("insert_panda").replace(task__ordinary=0.0)
    found = po.select_posture(problem)
    upper, lower = np.array(problem.robot.upper), np.array(problem.robot.lower)
    (k,) = np.flatnonzero(np.minimum(found.q - lower, upper - found.q) < 1e-4)
    name = problem.robot.joint_names[k]
    assert said(found)["selection.joint-at-limit"].values["joints"] == (name,)
    assert (
        f"At a limit, where controllers seldom let a joint go: {name}."
        in program_through(problem, "stops", found.q[None], [""]).notes
    )
    task = problem.to_dict()["task"]
    further = [*task.get("subject_to", []), {"kind": "limit_margin", "at_least": "2 deg"}]
    other = po.select_posture(problem.replace(task={**task, "subject_to": further}))
    assert "selection.joint-at-limit" not in said(other)
    assert np.minimum(other.q - lower, upper - other.q).min() > np.radians(1.99)


# --- Where the choice of the posture gains little, the first lines say what helps more --------------------------------


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
