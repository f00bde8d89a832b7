"""``calibrate`` and ``diagnose`` state one RMS for the calibrated arm, on their data and on a test file."""

from __future__ import annotations

import pytest

import posture_opt as po
from posture_opt.files import problems_folder
from posture_opt.problem.load import load_builtin
from tests.helpers.real_arms import DATA, long_on_real_arms
from tests.helpers.variants import conformance


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
