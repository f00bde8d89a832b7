"""The regions of rows that were left out, where rows are few: 95 % of such rows lie inside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.cross_validation import held_out
from posture_opt.calibration.estimation.effects_fit import fit_with_effects
from posture_opt.calibration.estimation.error_statistics import folds_of
from posture_opt.calibration.estimation.linear_model import LinearModel
from posture_opt.diagnosis.search.linearised_data import linearise_calibration
from tests.helpers.planar_2r import position

ROWS, DRAWS, NOISE = 12, 150, 2e-5  # m
PROBLEM = {
    "robot": {"kind": "dh", "joints": [{"name": "joint1", "a": "1 m"}, {"name": "joint2", "a": "1 m"}]},
    "uncertainty": {"measurement": {"position": "0.02 mm"}},
}


@pytest.mark.campaign
def test_regions_of_a_planar_arm_hold_what_they_say_with_few_rows() -> None:
    """Noise drawn anew each time: twelve rows of two coordinates, and five parameters or so fitted to them."""
    rng = np.random.default_rng(1)
    q = rng.uniform(-2.5, 2.5, (ROWS, 2))
    p = position(q, (1.0002, 0.9999)) + rng.normal(0, NOISE, q.shape)
    problem = po.problem_from_dict(PROBLEM)
    table = dict(zip(["joint1 [rad]", "joint2 [rad]", "x [m]", "y [m]"], np.hstack([q, p]).T, strict=True))
    calibration = po.calibrate(problem, po.read_measurements(table, problem), folds=3)
    residuals = linearise_calibration(calibration, 0).sensitivities.residuals
    model = fit_with_effects(residuals, calibration.x, calibration.identifiability.directions, [])
    linear, folds = LinearModel.of(model), folds_of(np.arange(ROWS), 4, "pose")
    assert linear.U.shape[1] >= 4
    inside = []
    for _ in range(DRAWS):
        noise = rng.normal(size=len(linear.r))
        drawn = replace(linear, r=noise - linear.U @ (linear.U.T @ noise))
        inside.append(held_out(model, folds, about=drawn).inside.mean())
    # 1800 rows, some in the same data: 95 ± 0.7 %
    assert 0.93 < np.mean(inside) < 0.97
