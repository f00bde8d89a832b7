"""Known distances between touched points: rows of the same residual vector, in the fit and in the search."""

from __future__ import annotations

import numpy as np

import posture_opt as po
from posture_opt.diagnosis.scores.candidates import linearise_calibration
from tests.helpers.real_arms import DATA, long_on_real_arms


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
