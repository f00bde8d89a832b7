"""First rows that are farther off than the rest: found, with a level that holds for rows that err alike."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.start_up import start_up
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write
from tests.helpers.real_arms import DATA, needs_real_arms

ROWS = 400
UR5 = DATA / "jacobi_ur5"


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
    text = " ".join(found.report().split())
    assert "The first 20 rows" in text
    assert "measure them again on the warm arm before leaving any out" in text
    assert "at an end of the range" not in text  # these rows are spread as all others
    warming = "(the temperature that was logged changed by +3.4 K in them and by +0.5 K in all others)"
    assert (warming in text) is logged


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
    text = " ".join(found.report().split())
    assert "Left out, as the side from which joints came there is not known: line 2." in text


def test_an_arm_that_is_warm_says_nothing(tmp_path: Path) -> None:
    found = po.calibrate(po.problem_from_dict(PROBLEM), rows_of(tmp_path, 0, 1.0, 1), plan=False)
    assert found.start_up is None
    assert "start_up" not in found.to_json()


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


@needs_real_arms
@pytest.mark.conformance
def test_of_a_real_arm_the_first_fifty_rows_are_told() -> None:
    problem = po.load_problem(UR5 / "problem.yaml")
    found = po.diagnose(problem, po.read_measurements(UR5 / "grid.csv", problem), plan=False)
    assert found.start_up is not None
    assert found.start_up.rows == 49  # behind the first one, to which nobody knows from where a joint with play came
    assert found.start_up.rms == pytest.approx(0.088e-3, abs=0.006e-3)
    assert found.start_up.rest == pytest.approx(0.053e-3, abs=0.003e-3)
