"""Starter files: each loads and solves as it is, and so does every suggestion in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import posture_opt as po
from posture_opt.problem.starter import starter_text
from posture_opt.problem.yaml_source import parse_yaml
from tests.helpers import factors
from tests.helpers.variants import STRUCTURES, conformance

SUGGESTIONS = ("region", "tool_axis", "tilt", "clearance", "criterion")


def started(preset: str, *suggestions: str) -> po.Problem:
    """The problem of a starter file with some of its suggestions taken up."""
    text = starter_text(preset).replace("starts: 32", "starts: 4")
    for word in suggestions:
        assert f"\n  # {word}:" in text
        text = text.replace(f"\n  # {word}:", f"\n  {word}:")
        if word == "region":  # stands in place of the position
            text = text.replace("\n  position:", "\n  # position:")
    return po.problem_from_dict(parse_yaml(text).data)


@pytest.mark.parametrize("preset", conformance(STRUCTURES, ["planar_2r", "ur10"]))
def test_starter_gives_a_posture_that_the_arm_could_stand_in(preset: str) -> None:
    problem = started(preset)
    robot, solution = problem.robot, po.select_posture(problem)
    assert solution.status == "optimal"
    turning = [k for k, joint in enumerate(robot.joints) if joint.type == "revolute"]
    room = np.minimum(solution.q - robot.lower, np.array(robot.upper) - solution.q)
    assert np.degrees(room[turning]).min() >= 5 - 1e-3  # the solver's tolerance
    assert all(room > 0.01)
    links = [replace(robot, links=robot.links[: k + 1], tool=()) for k in range(robot.n)]
    ends = np.array([factors.pose(part, solution.q)[:3, 3] for part in links])
    if robot.n > 4:
        assert ends[2:, 2].min() >= 0.05 - 1e-6, "elbow and wrist stand above the table"
    reach = sum(abs(factor.nominal) for factor in robot.factors if factor.kind == "translate")
    assert np.linalg.norm(ends[-1, :2]) > 0.4 * reach, "the target lies away from the base axis"


def test_starter_solves_in_the_box_that_it_suggests() -> None:
    assert po.select_posture(started("scara", "region")).status in ("optimal", "feasible")


@pytest.mark.parametrize("suggestion", SUGGESTIONS)
def test_suggestions_are_valid(suggestion: str) -> None:
    for preset in ("planar_2r", "scara", "ur10e"):
        task = started(preset, suggestion).task
        assert suggestion in task.model_fields_set
