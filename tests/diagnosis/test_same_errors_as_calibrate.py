"""``calibrate`` and ``diagnose`` state one RMS for the calibrated arm, on their data and on a test file."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.scores.candidates import linearise_calibration
from tests.helpers.real_arms import DATA, long_on_real_arms
from tests.helpers.shipped import PROBLEMS
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
    asked = po.load_problem(problem)
    data, test = (po.read_measurements(PROBLEMS / f"{n}.csv", asked) if n else None for n in (file, other))
    assert data is not None
    assert_same(asked, data, test)


@long_on_real_arms
def test_a_real_arm_whose_estimate_leans_on_a_prior() -> None:
    problem = po.load_problem(DATA / "jacobi_wam" / "problem.yaml")
    data, test = (po.read_measurements(DATA / "jacobi_wam" / f"{name}.csv", problem) for name in ("grid", "test"))
    assert_same(problem, data, test)


# --- Known distances between touched points: rows of the same residual vector, in the fit and in the search -----------


@long_on_real_arms
def test_known_distances_count_in_the_search_as_in_the_fit() -> None:
    folder = DATA / "mukca_sockets"
    problem = po.load_problem(folder / "problem_panda_4.yaml")
    data = po.read_measurements(folder / "panda_4.csv", problem)
    found = po.diagnose(problem, data, plan=False)
    residuals = linearise_calibration(found.calibration, flips=0).sensitivities.residuals
    assert len(residuals.distances) > 0
    linearised = linearise_calibration(found.calibration, flips=0)
    assert len(linearised.r) == residuals.measured + len(residuals.distances)
    np.testing.assert_allclose(linearised.r, residuals.whitened(found.calibration.x))
    rms = found.to_json()["residual_rms"]
    # Without the distances the size of the arm explained all of the residuals, and the noise was stated 1e12 times.
    assert "stated_sigma" not in [effect.kind for effect in found.effects]
    assert 2.5e-4 < rms["calibrated"] < 2.7e-4  # m; geometry leaves 0.261 mm by an analysis of its own
    assert rms["extended"] < 2.33e-4  # m; with gravity it leaves 0.233


# --- Which causes are told apart where a model leaves structure: half of equal causes must not be refuted by chance ---


@long_on_real_arms
def test_two_series_of_one_arm_agree_on_what_its_sag_could_be() -> None:
    """Series B names the shoulder's compliance with that of the column as a rival; by the criterion D refuted it."""
    problem = po.load_problem(DATA / "ipa_ur10" / "problem.yaml")
    data = po.read_measurements(DATA / "ipa_ur10" / "series_d.csv", problem)
    found = po.diagnose(problem, data, plan=False)
    (sag,) = [f for f in found.effects if f.kind == "joint_compliance"]
    assert ("link_bending", "shoulder_pan") in {(c.kind, c.target) for c in sag.confounded_with}
    # Structure is left: regions of what the training rows leave held 0.84 of the held-out rows.
    assert min(found.to_json()["coverage95"].values()) > 0.9
