"""Thinning of large files: rows from everywhere, whole postures, visits apart, one clock."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.measurements.measurements import inputs_of
from posture_opt.measurements.repeats import thin, thin_each_robot
from tests.helpers.free_arms import TWO, problem_of, rows


def table(poses: Any, **columns: Any) -> po.Measurements:
    """Rows of a planar arm that visits these poses, a posture each."""
    poses = np.asarray(poses)
    rng = np.random.default_rng(3)
    q = rng.uniform(-2, 2, (int(poses.max()) + 1, 2))[poses]
    data = rows(problem_of(TWO), q, rng.normal(size=(len(q), 3)) * [1, 1, 0])
    return replace(data, pose=poses, pose_given=True, **columns)


def test_one_posture_comes_from_every_block_and_brings_all_of_its_visits() -> None:
    poses = np.tile(np.arange(1000), 3)
    found = thin(table(poses), 300)
    assert 290 <= len(found.rows) <= 303
    chosen = np.unique(poses[found.rows])
    assert np.all(np.diff(chosen) <= 2 * found.block)  # no stretch of the session is left out
    assert len(found.rows) == 3 * len(chosen)
    assert np.array_equal(np.sort(np.r_[found.rows, found.rest]), np.arange(3000))


@pytest.mark.parametrize("timed", [False, True])
def test_the_rest_is_seen_by_the_clock_of_the_rows_that_were_used(timed: bool) -> None:
    order = np.random.default_rng(0).permutation(2000)
    data = table(np.arange(2000), time=(100.0 + order) if timed else None)
    found = thin(data, 100)
    robot = problem_of(TWO).robot
    whole, used = inputs_of(found.clocked, robot).time, inputs_of(found.used, robot).time
    np.testing.assert_allclose(np.asarray(whole)[found.rows], used, atol=1e-9)


def test_every_touched_point_and_every_robot_gives_rows() -> None:
    points = np.r_[np.zeros(1000), np.full(3, 1), np.full(1000, 2)].astype(np.intp)
    found = thin(table(np.arange(2003), point=points), 50)
    assert set(points[found.rows]) == {0, 1, 2}
    robots = np.r_[np.zeros(1000), np.ones(10), np.full(1000, 2)].astype(np.intp)
    data = table(np.arange(2010), robot=robots, robot_names=("a", "b", "c"))
    assert np.bincount(thin_each_robot(data, 300).robot).tolist() == [100, 10, 100]
