"""Stated errors of effects: rows that tell the same thing ten times make nothing ten times as sure."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.search.linearised_data import linearise_calibration
from posture_opt.model.effects.gear_eccentricity import GearEccentricity

LENGTHS = (0.5, 0.4)
JOINTS = [{"name": f"joint{i + 1}", "a": f"{length} m"} for i, length in enumerate(LENGTHS)]
INSTRUMENT = 2e-5  # m
SIN, COS = 2e-4, 1e-4  # rad, of the wheel of joint 1
HEAPS, COPIES = 64, 10


def fitted(seed: int, copies: int) -> Fit:
    """Geometry and eccentricity from heaps of rows; the error of joint 1 that has no name is one number per heap."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.5, 2.5, (HEAPS, 2))
    nameless = rng.normal(0, 3e-4, HEAPS)
    q, nameless = np.repeat(q, copies, axis=0), np.repeat(nameless, copies)
    first = q[:, 0] + SIN * np.sin(q[:, 0]) + COS * np.cos(q[:, 0]) + nameless
    both = first + q[:, 1]
    a, b = LENGTHS
    p = np.stack([a * np.cos(first) + b * np.cos(both), a * np.sin(first) + b * np.sin(both)], axis=1)
    p += rng.normal(0, INSTRUMENT, p.shape)
    problem = po.problem_from_dict({
        "robot": {"kind": "dh", "joints": JOINTS}, "uncertainty": {"measurement": {"position": f"{INSTRUMENT} m"}},
        "task": {"kind": "insert", "direction": [0, 1, 0], "position": ["0.5 m", "0.4 m", "0 m"]},
    })  # fmt: skip
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": p[:, 0], "y [m]": p[:, 1]}
    calibration = po.calibrate(problem, po.read_measurements(table, problem), folds=2)
    sensitivities = linearise_calibration(calibration, flips=0).sensitivities
    return calibration.fit_effects(sensitivities.residuals, [GearEccentricity(joint="joint1")])


def test_errors_of_effects_know_that_neighbouring_postures_err_alike() -> None:
    pairs = [(fitted(seed, COPIES), fitted(seed, 1)) for seed in range(5)]
    assert min(many.design for many, _ in pairs) > COPIES / 3
    ratio = np.mean([many.std[many.sizes] / once.std[once.sizes] for many, once in pairs])
    # As if rows were independent, ten copies would claim errors √10 times as small; sums over 32 blocks scatter.
    assert 0.75 < ratio < 1.35
    z = np.concatenate([(many.x[many.sizes] - [SIN, COS]) / many.std[many.sizes] for many, _ in pairs])
    # Ten numbers: 1 ± 0.2, and 3 by independent rows.
    assert np.sqrt(np.mean(z**2)) < 1.6


@pytest.mark.parametrize("seed", [1, 2])
def test_errors_of_independent_rows_are_those_of_least_squares(seed: int) -> None:
    model = fitted(seed, 1)
    residuals = model.residuals
    J = residuals.residuals_and_jacobian(model.x)[1]
    A = J @ model.directions
    assert model.design == 1
    expected = model.directions @ (model.variance * np.linalg.inv(A.T @ A)) @ model.directions.T
    np.testing.assert_allclose(model.std, np.sqrt(np.diag(expected)), rtol=1e-6, atol=1e-15)
