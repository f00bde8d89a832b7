"""``calibrate`` and ``diagnose`` state one RMS for the calibrated arm, on their data and on a test file."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.calibrate import recount_rows
from posture_opt.calibration.calibration import Calibration
from posture_opt.problem.load import load_builtin, problems_folder
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM
from tests.helpers.real_arms import DATA, long_on_real_arms
from tests.helpers.variants import conformance

WRONG = 7  # the row that the instrument got wrong


def assert_same(problem: po.Problem, data: po.Measurements, other: po.Measurements | None = None) -> None:
    calibrated = po.calibrate(problem, data, test=other, plan=False)
    diagnosed = po.diagnose(problem, data, test=other, plan=False)
    assert diagnosed.calibration.outliers == calibrated.outliers
    for name in ("nominal", "calibrated"):
        own, theirs = getattr(calibrated, name), diagnosed.errors[name]
        assert theirs.rms == own.rms
        assert theirs.interval == own.interval
        if other is not None:
            assert diagnosed.test is not None
            assert diagnosed.test.models[name].rms == pytest.approx(calibrated.test.models[name].rms, rel=1e-9)
    assert diagnosed.held["calibrated"].inside.mean() == calibrated.coverage["calibrated"]


@pytest.mark.parametrize(
    ("problem", "file", "other"),
    conformance(
        [
            ("insert_planar_2r_measured", "planar_2r_measured", ""),
            ("insert_ur10_measured", "ur10_measured", "ur10_another_day"),
        ],
        [("insert_planar_2r_measured", "planar_2r_measured", "")],
    ),
)
def test_simulated_arms(problem: str, file: str, other: str) -> None:
    asked = load_builtin(problem)
    data, test = (po.read_measurements(problems_folder() / f"{n}.csv", asked) if n else None for n in (file, other))
    assert data is not None
    assert_same(asked, data, test)


@long_on_real_arms
def test_a_real_arm_whose_estimate_leans_on_a_prior() -> None:
    problem = po.load_problem(DATA / "jacobi_wam" / "problem.yaml")
    data, test = (po.read_measurements(DATA / "jacobi_wam" / f"{name}.csv", problem) for name in ("grid", "test"))
    assert_same(problem, data, test)


@pytest.fixture(scope="module")
def with_outlier() -> Calibration:
    rng = np.random.default_rng(11)
    q = rng.uniform(-2.5, 2.5, (40, 2))
    points = position(q, (1.0, 1.002)) + rng.normal(0, 2e-5, q.shape)
    points[WRONG, 0] += 1e-3
    problem = po.problem_from_dict(PROBLEM)
    table = dict(zip(["joint1 [rad]", "joint2 [rad]", "x [m]", "y [m]"], np.hstack([q, points]).T, strict=True))
    found = po.calibrate(problem, po.read_measurements(table, problem), plan=False)
    assert found.outliers == (WRONG,)
    return found


def test_rows_that_count_as_before_have_the_errors_that_they_had(with_outlier: Calibration) -> None:
    again = recount_rows(with_outlier, with_outlier.fit.kept)
    assert again.calibrated.rms == pytest.approx(with_outlier.calibrated.rms, rel=1e-6)
    assert again.nominal.rms == pytest.approx(with_outlier.nominal.rms, rel=1e-12)
    assert again.notes == with_outlier.notes


def test_an_outlier_that_counts_again_is_in_the_rms_and_is_told(with_outlier: Calibration) -> None:
    again = recount_rows(with_outlier, np.ones(40, dtype=bool))
    assert again.outliers == ()
    # One millimetre in forty rows, and what it pulls at the others; 28 µm are the noise of both coordinates.
    assert again.calibrated.rms == pytest.approx(np.sqrt(1e-3**2 / 40 + 2 * 2e-5**2), rel=0.15)
    own = with_outlier.calibrated.rms
    assert again.notes[-1].startswith("1 row that the calibration leaves out as an outlier counts here")
    assert f"(without it, {1e3 * own:.3g} mm calibrated)" in again.notes[-1]
