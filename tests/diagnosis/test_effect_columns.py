"""Columns of effects that add to joint values, against differences of the planar arm's formula."""

from __future__ import annotations

import numpy as np

import posture_opt as po
from posture_opt.diagnosis.search.linearised_data import linearise_calibration
from posture_opt.model.effects import CyclicError

LENGTHS, SIGMA = (0.5, 0.4), 2e-5  # m
JOINTS = [{"name": f"joint{i + 1}", "a": f"{length} m"} for i, length in enumerate(LENGTHS)]


def position(q: np.ndarray) -> np.ndarray:
    """Tool point (N, 2) [m] of joint values (N, 2) [rad]."""
    a, b = LENGTHS
    both = q[:, 0] + q[:, 1]
    return np.stack([a * np.cos(q[:, 0]) + b * np.cos(both), a * np.sin(q[:, 0]) + b * np.sin(both)], axis=1)


def test_columns_of_a_cyclic_error_are_what_a_sine_of_the_joint_does_to_the_point() -> None:
    q = np.random.default_rng(0).uniform(-2.5, 2.5, (30, 2))
    p = position(q)
    problem = po.problem_from_dict({
        "robot": {"kind": "dh", "joints": JOINTS}, "uncertainty": {"measurement": {"position": f"{SIGMA} m"}},
    })  # fmt: skip
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": p[:, 0], "y [m]": p[:, 1]}
    calibration = po.calibrate(problem, po.read_measurements(table, problem), folds=2)
    line = CyclicError(joint="joint2", cycles=7.3)
    found = linearise_calibration(calibration, flips=0).sensitivities.columns(line)
    for k, wave in enumerate((np.sin, np.cos)):
        moved = [q + step * np.outer(wave(7.3 * q[:, 1]), [0, 1]) for step in (1e-6, -1e-6)]
        slope = (position(moved[0]) - position(moved[1])) / 2e-6
        np.testing.assert_allclose(found[:, k] * SIGMA, slope.ravel(), atol=1e-7)
