"""Tolerances of parts as data ask for them: against densities of samples, and at an arm whose zeros are far off."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import posture_opt as po
from posture_opt.calibration.estimation import tolerances
from tests.helpers.instruments import TrueArm, distance_table


def test_widths_are_those_of_the_density_of_the_measurements() -> None:
    """Measurements ``y = A x + noise`` are normal with covariance ``1 + A T Aᵀ``: no minimum of anything."""
    rng = np.random.default_rng(4)
    A, y = rng.normal(size=(12, 5)), rng.normal(size=12) * 3
    mine = np.array([True, True, True, False, False])
    others, known = 0.7, tolerances.Tolerance("lengths", 0.5, 0.8)
    at = rng.normal(size=5)  # any place of the fit will do
    seen = tolerances._Evidence(A.T @ A, A.T @ (A @ at - y), np.eye(5), at)
    typical, uncertain = tolerances._width(seen, known, mine, np.full(5, others))
    t = np.linspace(-4, 4, 400)
    squares = known.median**2 * np.exp(2 * known.spread * t)
    density = np.array(
        [multivariate_normal.pdf(y, cov=np.eye(12) + A @ np.diag(np.where(mine, s, others)) @ A.T) for s in squares]
    ) * np.exp(-(t**2) / 2)
    density /= density.sum()
    assert uncertain == pytest.approx(float(np.sqrt(density @ squares)), rel=1e-3)
    assert typical == pytest.approx(float(np.exp(density @ np.log(squares) / 2)), rel=1e-3)


def test_zeros_set_by_hand_do_not_loosen_the_lengths() -> None:
    """Zeros off by 5 mrad beside lengths of 0.1 mm, as of real arms: one width for all would leave lengths open."""
    rng = np.random.default_rng(31)
    errors = rng.normal(0, 1, (6, 4)) * np.array([5e-3, 1e-4, 1e-4, 3e-4])
    arm = TrueArm(errors=errors)
    tool = {"xyz": ["30 mm", "-20 mm", "120 mm"], "rpy": ["0 deg"] * 3, "free": True}
    given = po.problem_from_dict(
        {
            "robot": {"kind": "preset", "name": "ur10", "tool": tool},
            "uncertainty": {"measurement": {"distance": "0.02 mm"}},
        }
    )
    table = {k: v for k, v in distance_table(arm, rng, 15, 2e-5).items() if not k.endswith(".approach")}
    found = po.calibrate(given, po.read_measurements(table, given), folds=2, plan=False)
    width = dict(zip((p.name for p in found.parameters), found.prior.tolist(), strict=True))
    assert width["elbow.a"] < 0.4e-3
    assert width["elbow.theta"] > 2e-3
    assert any("lengths 0." in note and "zeros of joints" in note for note in found.notes)
