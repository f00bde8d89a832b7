"""Thinning of large files: rows from everywhere, whole postures, visits apart, one clock."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from posture_opt.measurements import repeats
from posture_opt.measurements.measurements import Measurements, inputs_of
from posture_opt.measurements.repeats import repeat_of_row
from posture_opt.measurements.thinning import thin, thin_each_robot
from tests.helpers.free_arms import TWO, problem_of, rows


def table(poses: Any, **columns: Any) -> Measurements:
    """Rows of a planar arm that visits these poses, a posture each."""
    poses = np.asarray(poses)
    rng = np.random.default_rng(3)
    q = rng.uniform(-2, 2, (int(poses.max()) + 1, 2))[poses]
    data = rows(problem_of(TWO), q, rng.normal(size=(len(q), 3)) * [1, 1, 0])
    return replace(data, pose=poses, pose_given=True, **columns)


def test_few_rows_stay_as_they_are() -> None:
    assert thin(table(np.arange(50)), 50) is None


def test_one_posture_comes_from_every_block_and_brings_all_of_its_visits() -> None:
    poses = np.tile(np.arange(1000), 3)
    found = thin(table(poses), 300)
    assert found is not None
    assert 290 <= len(found.rows) <= 303
    chosen = np.unique(poses[found.rows])
    assert np.all(np.diff(chosen) <= 2 * found.block)  # no stretch of the session is left out
    assert len(found.rows) == 3 * len(chosen)
    assert np.array_equal(np.sort(np.r_[found.rows, found.rest]), np.arange(3000))


def test_a_period_of_the_file_does_not_fall_in_step_with_the_choice() -> None:
    found = thin(table(np.arange(10_000)), 1000)
    assert found is not None
    assert np.bincount(found.rows % 10, minlength=10).min() > 50


def test_many_readings_of_few_postures_are_taken_from_all_of_their_time() -> None:
    poses = np.repeat(np.arange(20), 500)
    found = thin(table(poses), 400)
    assert found is not None
    assert np.array_equal(np.bincount(poses[found.rows]), np.full(20, 20))
    steps = np.diff(found.rows.reshape(20, 20), axis=1)
    assert steps.min() == steps.max() == 25


def test_two_visits_stay_two_though_what_lay_between_them_is_gone() -> None:
    poses = np.r_[np.arange(100), np.arange(100), np.full(3, 50)]
    found = thin(table(poses), 40)
    assert found is not None
    pairs = found.used.pose
    assert len(np.unique(repeat_of_row(found.used))) == len(pairs) - 2 * (50 in pairs)


@pytest.mark.parametrize("timed", [False, True])
def test_the_rest_is_seen_by_the_clock_of_the_rows_that_were_used(timed: bool) -> None:
    order = np.random.default_rng(0).permutation(2000)
    data = table(np.arange(2000), time=(100.0 + order) if timed else None)
    found = thin(data, 100)
    assert found is not None
    robot = problem_of(TWO).robot
    whole, used = inputs_of(found.clocked, robot).time, inputs_of(found.used, robot).time
    np.testing.assert_allclose(np.asarray(whole)[found.rows], used, atol=1e-9)


def test_every_touched_point_and_every_robot_gives_rows() -> None:
    points = np.r_[np.zeros(1000), np.full(3, 1), np.full(1000, 2)].astype(np.intp)
    found = thin(table(np.arange(2003), point=points), 50)
    assert found is not None
    assert set(points[found.rows]) == {0, 1, 2}
    robots = np.r_[np.zeros(1000), np.ones(10), np.full(1000, 2)].astype(np.intp)
    data = table(np.arange(2010), robot=robots, robot_names=("a", "b", "c"))
    assert np.bincount(thin_each_robot(data, 300).robot).tolist() == [100, 10, 100]


def test_many_readings_of_one_posture_are_linked_without_looking_at_all_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    poses = np.repeat(np.arange(40), 30)
    data = table(poses)
    data = replace(data, q=data.q + rng.normal(0, 1e-4, data.q.shape), pose=np.arange(len(poses)), pose_given=False)
    slides = np.zeros(2, dtype=bool)
    monkeypatch.setattr(repeats, "_MAX_PAIRED_ROWS", 100)
    found = repeats.repeat_groups(data, slides)
    assert len(np.unique(found)) == len(np.unique(np.column_stack([found, poses]), axis=0)) == 40
