"""First rows that are farther off than the rest: found, with a level that holds for rows that err alike."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.calibration.start_up import scatter_change, start_up
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, SHORT, write

ROWS = 400


def rows_of(folder: Path, first: int, times: float, seed: int, logged: bool = False) -> po.Measurements:
    """An arm whose first rows scatter several times as much."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.5, 2.5, (ROWS, 2))
    noise = 2e-5 * np.where(np.arange(ROWS) < first, times, 1.0)[:, None]
    warm = 20.0 + 4.0 * (1 - np.exp(-np.arange(ROWS) / 10))
    more = {"time": ("s", 30.0 * np.arange(ROWS)), "temperature": ("degC", warm)} if logged else {}
    write(folder / "data.csv", q, position(q) + noise * rng.normal(size=(ROWS, 2)), **more)
    return po.read_measurements(folder / "data.csv", po.problem_from_dict(PROBLEM))


@pytest.mark.parametrize("logged", [False, True])
def test_a_cold_arm_is_told_with_what_to_do(logged: bool, tmp_path: Path) -> None:
    problem = po.problem_from_dict(PROBLEM)
    found = po.calibrate(problem, rows_of(tmp_path, 20, 2.5, 1, logged), plan=False)
    said = found.to_json()["start_up"]
    assert said["rows"] == 20
    assert said["seconds"] == (19 * 30.0 if logged else None)
    assert said["residual_rms"]["first"] > 1.8 * said["residual_rms"]["rest"]
    said = {s["id"] for s in found.to_json()["statements"]}
    assert ("calibration.start-up-temperature" in said) is logged


def test_a_first_row_that_a_joint_with_play_came_to_from_nobody_knows_where_is_no_cold_arm(tmp_path: Path) -> None:
    """Play of 0.8 mrad: the first row is off by half of it, 25 times the noise, all others are predicted."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.5, 2.5, (200, 2))
    side = np.sign(np.diff(q[:, 1], prepend=q[0, 1] - 1.0))
    reached = q - np.outer(0.4e-3 * side, [0, 1])
    write(tmp_path / "data.csv", q, position(reached) + rng.normal(0, 2e-5, q.shape))
    problem = po.problem_from_dict(PROBLEM)
    found = po.diagnose(problem, po.read_measurements(tmp_path / "data.csv", problem), plan=False)
    assert [(f.kind, f.target) for f in found.effects] == [("backlash", "joint2")]
    assert found.start_up is None
    assert "diagnosis.rows-without-side" in {s["id"] for s in found.to_json()["statements"]}


@pytest.mark.parametrize("length", [1, 6])
def test_false_alarms_are_rare_where_neighbours_err_alike(length: int) -> None:
    """Errors in runs of so many rows of one size, log-normal: at most as many alarms as the level says, 1 %."""
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


# --- Errors that are larger from some row on: found where they are, and not where all rows scatter alike --------------

ROWS_CHANGE = 120


def rows(**more: Any) -> po.Measurements:
    q = np.random.default_rng(0).uniform(-2, 2, (ROWS_CHANGE, 2))
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1]}
    return po.read_measurements(table | (more or {"x [m]": q[:, 0], "y [m]": q[:, 1]}), problem())


def problem() -> po.Problem:
    return po.problem_from_dict(yaml.safe_load(SHORT))


@pytest.mark.parametrize(("times", "found"), [(3.0, True), (1 / 3, True), (1.2, False)])
def test_the_row_from_which_errors_are_of_another_size_is_found(times: float, found: bool) -> None:
    rng = np.random.default_rng(4)
    size = np.where(np.arange(ROWS_CHANGE) < 80, 1e-4, times * 1e-4)
    change = scatter_change(size[:, None] * rng.normal(size=(ROWS_CHANGE, 2)), rows())
    assert (change is not None) is found
    if change is not None:
        assert abs(change.line - 81) <= 5
        assert change.after / change.before == pytest.approx(times, rel=0.25)
        assert change.to_json()["points"] == []


def test_rows_that_scatter_alike_hardly_ever_change() -> None:
    """One in a thousand is expected; heavy tails make it no worse."""
    rng, data = np.random.default_rng(6), rows()
    sets = [rng.standard_t(5, (ROWS_CHANGE, 2)) if i % 2 else rng.normal(size=(ROWS_CHANGE, 2)) for i in range(200)]
    assert sum(scatter_change(1e-4 * e, data) is not None for e in sets) <= 2
