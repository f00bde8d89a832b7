"""First rows that are farther off than the rest: found, with a level that holds for rows that err alike."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.calibration.start_up import scatter_change, start_up
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import SHORT, planar_rows
from tests.helpers.real_arms import DATA, needs_real_arms

ROWS = 400
UR5 = DATA / "jacobi_ur5"


def rows_of(first: int, times: float, seed: int, logged: bool = False) -> tuple[po.Problem, po.Measurements]:
    """An arm whose first rows scatter several times as much."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.5, 2.5, (ROWS, 2))
    noise = 2e-5 * np.where(np.arange(ROWS) < first, times, 1.0)[:, None]
    warm = 20.0 + 4.0 * (1 - np.exp(-np.arange(ROWS) / 10))
    more = {"time": ("s", 30.0 * np.arange(ROWS)), "temperature": ("degC", warm)} if logged else {}
    return planar_rows(q, position(q) + noise * rng.normal(size=(ROWS, 2)), **more)


def test_a_cold_arm_is_told_with_what_to_do() -> None:
    found = po.calibrate(*rows_of(20, 2.5, 1, logged=True), plan=False)
    said = found.to_json()["start_up"]
    assert said["rows"] == 20
    assert said["seconds"] == 19 * 30.0
    assert said["residual_rms"]["first"] > 1.8 * said["residual_rms"]["rest"]
    said = {s["id"] for s in found.to_json()["statements"]}
    assert "calibration.start-up-temperature" in said


def test_a_first_row_that_a_joint_with_play_came_to_from_nobody_knows_where_is_no_cold_arm() -> None:
    """Play of 0.8 mrad: the first row is off by half of it, 25 times the noise, all others are predicted."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.5, 2.5, (200, 2))
    side = np.sign(np.diff(q[:, 1], prepend=q[0, 1] - 1.0))
    reached = q - np.outer(0.4e-3 * side, [0, 1])
    found = po.diagnose(*planar_rows(q, position(reached) + rng.normal(0, 2e-5, q.shape)), plan=False)
    assert [(f.kind, f.target) for f in found.effects] == [("backlash", "joint2")]
    assert found.start_up is None
    assert "diagnosis.rows-without-side" in {s["id"] for s in found.to_json()["statements"]}


def test_an_arm_that_is_warm_says_nothing() -> None:
    found = po.calibrate(*rows_of(0, 1.0, 1), plan=False)
    assert found.start_up is None
    assert "start_up" not in found.to_json()


def test_false_alarms_are_rare_where_neighbours_err_alike() -> None:
    """Errors in runs of so many rows of one size, log-normal: at most as many alarms as the level says, 1 %."""
    length = 6
    rng = np.random.default_rng(length)
    data = SimpleNamespace(
        position=np.zeros((ROWS, 3)), time=None, temperature=None, order=np.arange(ROWS), q=np.zeros((ROWS, 2))
    )
    draws = 1000
    alarms = 0
    for _ in range(draws):
        size = np.repeat(np.exp(0.4 * rng.normal(size=-(-ROWS // length))), length)[:ROWS]
        alarms += start_up(size[:, None] * rng.normal(size=(ROWS, 3)), data) is not None
    assert alarms <= draws * 0.01 + 3 * np.sqrt(draws * 0.01)


@needs_real_arms
@pytest.mark.conformance
def test_of_a_real_arm_the_first_fifty_rows_are_told() -> None:
    problem = po.load_problem(UR5 / "problem.yaml")
    found = po.diagnose(problem, po.read_measurements(UR5 / "grid.csv", problem), plan=False)
    assert found.start_up.rows == 49  # behind the first one, to which nobody knows from where a joint with play came
    assert found.start_up.rms == pytest.approx(0.088e-3, abs=0.006e-3)
    assert found.start_up.rest == pytest.approx(0.053e-3, abs=0.003e-3)


CHANGED = 120


def two_joints(**more: Any) -> po.Measurements:
    q = np.random.default_rng(0).uniform(-2, 2, (CHANGED, 2))
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1]}
    return po.read_measurements(table | (more or {"x [m]": q[:, 0], "y [m]": q[:, 1]}), short_arm())


def short_arm() -> po.Problem:
    return po.problem_from_dict(yaml.safe_load(SHORT))


@pytest.mark.parametrize(("times", "found"), [(3.0, True), (1 / 3, True), (1.2, False)])
def test_the_row_from_which_errors_are_of_another_size_is_found(times: float, found: bool) -> None:
    rng = np.random.default_rng(4)
    size = np.where(np.arange(CHANGED) < 80, 1e-4, times * 1e-4)
    change = scatter_change(size[:, None] * rng.normal(size=(CHANGED, 2)), two_joints())
    assert (change is not None) is found
    if change is not None:
        assert abs(change.line - 81) <= 5
        assert change.after / change.before == pytest.approx(times, rel=0.25)
        assert change.to_json()["points"] == []


def test_rows_that_scatter_alike_hardly_ever_change() -> None:
    """One in a thousand is expected; heavy tails make it no worse."""
    rng, data = np.random.default_rng(6), two_joints()
    sets = [rng.standard_t(5, (CHANGED, 2)) if i % 2 else rng.normal(size=(CHANGED, 2)) for i in range(200)]
    assert sum(scatter_change(1e-4 * e, data) is not None for e in sets) <= 2
