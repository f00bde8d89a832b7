"""Whether a problem that was written and read again is the same in numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.model.effects import Effect

EXACT = 1e-9  # relative; files hold lengths to 1e-11 m and angles to 2e-12 rad


def written(problem: po.Problem, folder: Path, stem: str = "again") -> po.Problem:
    """The problem as its files say it."""
    for name, content in problem.files(stem).items():
        (folder / name).write_bytes(content)
    return po.load_problem(folder / f"{stem}.yaml")


def assert_same_numbers(again: po.Problem, problem: po.Problem) -> None:
    """Parameters, frames, gravity, covariance, scatter, effects, task and inputs."""
    robot, other = problem.robot, again.robot
    assert again.name == problem.name
    assert list(other.parameters) == list(robot.parameters)
    for name, factor in robot.parameters.items():
        assert other.parameters[name].nominal == pytest.approx(factor.nominal, rel=EXACT, abs=1e-11), name
    assert (other.base_free, other.tool_free) == (robot.base_free, robot.tool_free)
    assert other.joints == robot.joints
    assert other.gravity == pytest.approx(robot.gravity)
    assert (other.skew, other.lift) == pytest.approx((robot.skew, robot.lift), rel=EXACT, abs=1e-10)
    assert again.corrections.keys() == {n for n, v in problem.corrections.items() if abs(v) > 1e-11}
    assert again.sources.names == problem.sources.names
    sigma = problem.sources.sigma
    scale = np.outer(*[np.where(sigma > 0, sigma, 1.0)] * 2)
    for matrix in ("covariance", "scatter"):
        found, expected = getattr(again.sources, matrix), getattr(problem.sources, matrix)
        np.testing.assert_allclose(found / scale, expected / scale, atol=EXACT, err_msg=matrix)
    assert [effect.name for effect in again.effects] == [effect.name for effect in problem.effects]
    for mine, theirs in zip(problem.effects, again.effects, strict=True):
        if isinstance(mine, Effect):
            assert isinstance(theirs, Effect)
            assert theirs.values == pytest.approx(mine.values, rel=EXACT)
        else:
            assert theirs == mine
    # The points of a path are in the task; its file is copied under another name.
    mine, theirs = (task and task.model_dump(exclude={"path"}) for task in (problem.task, again.task))
    assert theirs == mine
    assert again.cell == problem.cell
    assert again.measurement == problem.measurement
