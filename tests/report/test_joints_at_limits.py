"""Joints that an answer puts at their limits are told, and in its program."""

from __future__ import annotations

import numpy as np

import posture_opt as po
from posture_opt.export.robot_program import program_through
from posture_opt.robot.posture import joints_at_limits
from tests.helpers.said import said


def test_a_joint_at_its_limit_is_told_with_what_keeps_it_away() -> None:
    problem = po.load_problem("insert_panda")
    found = po.select_posture(problem, ordinary=0.0)
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


def test_held_joints_are_at_no_limit() -> None:
    robot = po.load_problem("insert_planar_2r").robot
    assert joints_at_limits(robot, np.array(robot.upper)) == list(robot.joint_names)
    assert joints_at_limits(robot, np.zeros(2)) == []
