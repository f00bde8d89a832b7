"""An arm that was calibrated from a few rows, measured again with many: its file is off by what it says of itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

NOISE = 2e-5  # m
FEW, MANY = 12, 300


def measured(file: Path, rng: np.random.Generator, rows: int, moved: float = 0.0) -> Path:
    """Rows of an arm whose first joint has an offset of 1 mrad, and the second one of ``moved`` [rad] since."""
    q = rng.uniform(-2.5, 2.5, (rows, 2))
    points = position(q + np.array([1e-3, moved]))
    write(file, q, points + rng.normal(0, NOISE, points.shape))
    return file


def diagnosed(problem: po.Problem, file: Path) -> po.Diagnosis:
    return po.diagnose(problem, po.read_measurements(file, problem), flips=99, plan=False)


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The problem file of the calibrated arm, with the covariance of what was estimated."""
    folder = tmp_path_factory.mktemp("again")
    rng = np.random.default_rng(0)
    problem = po.problem_from_dict(PROBLEM)
    data = po.read_measurements(measured(folder / "few.csv", rng, FEW), problem)
    po.calibrate(problem, data, plan=False).save(folder, figures=False)
    return folder / "calibrated.yaml"


def test_what_a_calibration_left_open_is_no_cause(calibrated: Path) -> None:
    fresh = measured(calibrated.parent / "fresh.csv", np.random.default_rng(100), MANY)
    assert diagnosed(po.load_problem(calibrated), fresh).effects == ()
    without = yaml.safe_load(calibrated.read_text())
    del without["uncertainty"]["covariance"]
    exact = diagnosed(po.problem_from_dict(without), fresh)
    assert exact.effects, "without what the file says of its errors they are deviations"


def test_what_moved_since_then_is_one(calibrated: Path) -> None:
    since = measured(calibrated.parent / "since.csv", np.random.default_rng(200), MANY, moved=2e-4)
    (found,) = diagnosed(po.load_problem(calibrated), since).effects
    assert (found.kind, found.target) == ("joint_offset", "joint2")
    value, std, _ = found.estimate["theta"]
    assert abs(value - 2e-4) < 4 * std + 4e-5  # the file's own error of that zero: NOISE over 12 rows and a link of 1 m
