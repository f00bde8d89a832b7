"""Measurements that do not suffice, or that do not belong to the arm: each its own message, and what to do."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.assumptions.frames import arm_and_data
from posture_opt.calibration.data_checks import check_kept
from tests.helpers.free_arms import BASE, SIX, TOOL, hidden_errors, problem_of, rows, simulated_points

NOISE = 2e-5  # m


def measured(q: np.ndarray, rng: np.random.Generator, errors: dict[str, float], base: np.ndarray = BASE) -> np.ndarray:
    return simulated_points(SIX, q, base, TOOL, errors) + rng.normal(0, NOISE, (len(q), 3))


@pytest.fixture
def setting() -> tuple[Any, np.ndarray, np.random.Generator, dict[str, float]]:
    rng = np.random.default_rng(1)
    errors = hidden_errors(SIX, rng, ("j2",))
    return problem_of(SIX), rng.uniform(-2.5, 2.5, (80, 6)), rng, errors


def test_poses_that_are_practically_one_are_alike(setting: Any) -> None:
    problem, q, rng, errors = setting
    near = q[[0] * 40] + rng.normal(0, 1e-4, (40, 6))
    with pytest.raises(po.errors.InsufficientDataError, match="all rows are alike"):
        po.calibrate(problem, rows(problem, near, measured(near, rng, errors)))


def test_a_set_that_moves_one_joint_tells_nothing_of_the_arm_and_names_the_others(setting: Any) -> None:
    problem, q, rng, errors = setting
    one = np.tile(q[0], (80, 1))
    one[:, 0] = q[:, 0]
    still = math.degrees(q[0, 2])
    with pytest.raises(po.errors.InsufficientDataError, match=f"no parameter of the arm itself.*j3 at {still:.4g} deg"):
        po.calibrate(problem, rows(problem, one, measured(one, rng, errors)))


def test_a_constant_joint_is_named_and_the_rest_is_found(setting: Any) -> None:
    problem, q, rng, errors = setting
    q[:, 2] = 0.5
    result = po.calibrate(problem, rows(problem, q, measured(q, rng, errors)))
    assert any("stood still: j3 at 28.65 deg" in note for note in result.notes)
    assert result.calibrated.rms < 3 * NOISE < result.nominal.rms
    full = problem_of(SIX)
    moving = setting[2].uniform(-2.5, 2.5, (80, 6))
    assert po.calibrate(full, rows(full, moving, measured(moving, rng, errors))).fixed.sum() > result.fixed.sum()


def test_another_robots_file_is_refused(setting: Any) -> None:
    _, q, rng, errors = setting
    table = [("j1", 0.0, 0.1273, 0.0, np.pi / 2), ("j2", 0.0, 0.0, -0.612, 0.0), ("j3", 0.0, 0.0, -0.5723, 0.0)]
    table += [("j4", 0.0, 0.1639, 0.0, np.pi / 2), ("j5", 0.0, 0.1157, 0.0, -np.pi / 2), ("j6", 0.0, 0.0922, 0.0, 0.0)]
    other = problem_of(table)
    with pytest.raises(po.errors.InputError, match=r"even calibrated, the arm misses.*another robot's file"):
        po.calibrate(other, rows(other, q, measured(q, rng, errors)))


def test_a_zero_that_is_far_off_is_found_for_all_that_parts_are_better_made(setting: Any) -> None:
    problem, q, rng, errors = setting
    off = q + np.array([0, 0, 0, 0.6, 0, 0])  # what was commanded reads 34 deg more than where the joint stood
    result = po.calibrate(problem, rows(problem, off, measured(q, rng, errors)))
    i = [p.name for p in result.parameters].index("j4.theta")
    assert abs(result.x[i] - errors["j4.theta"] + 0.6) < 4 * result.std[i]
    assert list(result.implausible) == ["j4.theta"]
    assert "calibration.implausible-deviation" in {s["id"] for s in result.to_json()["statements"]}
    assert result.calibrated.rms < 3 * NOISE


def test_rows_that_outliers_leave_in_one_group_alone_are_told(setting: Any) -> None:
    problem, q, rng, errors = setting
    residuals, _ = arm_and_data(problem, rows(problem, q, measured(q, rng, errors)))
    groups, kept = np.arange(80), np.ones(80, dtype=bool)
    kept[2:] = False
    check_kept(residuals, groups, kept)
    kept[1] = False
    with pytest.raises(
        po.errors.InsufficientDataError, match="79 of 80 rows are outliers, and the rest belongs to one group"
    ):
        check_kept(residuals, groups, kept)


def touching(lengths: list[str]) -> tuple[Any, po.Measurements]:
    """An arm in the plane whose tool touches two points, 30 times."""
    joints = [{"name": f"j{i}", "type": "revolute", "a": length} for i, length in enumerate(lengths)]
    problem = po.problem_from_dict({"robot": {"kind": "dh", "joints": joints}})
    q = np.random.default_rng(5).uniform(-180, 180, (30, len(lengths)))
    heads = {f"j{i} [deg]": column for i, column in enumerate(q.T)}
    return problem, po.read_measurements({**heads, "point": ["a", "b"] * 15}, problem)


def test_an_arm_without_lengths_does_not_tell_its_size_by_touching() -> None:
    problem, data = touching(["0 m", "0 m"])
    with pytest.raises(po.errors.InsufficientDataError, match=r"size of this arm.*distances: \[\[a, b, 50 mm\]\]"):
        po.calibrate(problem, data)


def test_touched_points_do_not_tell_how_the_sizes_of_robots_vary() -> None:
    problem, data = touching(["1 m", "1 m"])
    robots = replace(data, robot=np.repeat([0, 1, 2], 10), robot_names=("A", "B", "C"))
    with pytest.raises(
        po.errors.InsufficientDataError, match="how sizes vary from one to the next: state a known distance"
    ):
        po.calibrate_batch(problem, robots)


@pytest.mark.long
def test_touches_that_a_tool_point_at_rest_meets_exactly_are_refused() -> None:
    """One joint stands still, and a free tool fits all touches by lying on the axis of the other one."""
    shipped = po.load_problem("insert_planar_2r_measured").to_dict()
    free = {**shipped, "robot": {**shipped["robot"], "base": "free", "tool": "free"}}
    problem = po.problem_from_dict({**free, "uncertainty": {"measurement": {"plane": "0.1 mm"}}})
    q2 = np.random.default_rng(3).uniform(-150, 150, 20)
    table = {"joint1 [deg]": [30.0] * 20, "joint2 [deg]": q2.tolist(), "plane": [f"p{k % 3}" for k in range(20)]}
    with pytest.raises(po.errors.InsufficientDataError, match="holds its tool point where no joint moves it"):
        po.calibrate(problem, po.read_measurements(table, problem), folds=2)
