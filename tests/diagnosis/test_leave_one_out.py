"""Gains against least squares by hand: each fold fitted again without a cause, everything else with it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.optimize import least_squares

import posture_opt as po
from posture_opt.calibration.estimation.error_statistics import folds_of, groups_of
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import planar_rows

NOISE = 5e-5  # m
OFFSETS, LENGTHS, FIRST, SECOND = (0, 1), (2, 3), (4, 5), (6, 7)


def points(q: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Points (N, 2) [m] of two links of 1 m with offsets and lengths off by z, and two eccentric gears."""
    wave = np.stack([z[k] * np.sin(q[:, i]) + z[k + 1] * np.cos(q[:, i]) for i, k in enumerate((4, 6))], axis=1)
    return position(q + z[:2] + wave, 1 + z[2:4])


def held_out_rms(q: np.ndarray, measured: np.ndarray, folds: Sequence[np.ndarray], free: Sequence[int]) -> float:
    """RMS [m] of rows left out, ``free`` entries of z fitted to the others, the rest zero."""
    errors = np.zeros_like(measured)
    for left in folds:
        learn = np.setdiff1d(np.arange(len(q)), left)
        z = np.zeros(8)

        def off(x: np.ndarray, z: np.ndarray = z, learn: np.ndarray = learn) -> np.ndarray:
            z[list(free)] = x
            return (points(q[learn], z) - measured[learn]).ravel()

        z[list(free)] = least_squares(off, np.zeros(len(free)), x_scale=1e-4, xtol=1e-14, ftol=1e-14).x
        errors[left] = points(q[left], z) - measured[left]
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


def measured(z: np.ndarray) -> tuple[po.Problem, po.Measurements, list[np.ndarray]]:
    """90 rows, and five folds of them."""
    rng = np.random.default_rng(11)
    q = rng.uniform(-2.5, 2.5, (90, 2))
    problem, data = planar_rows(q, points(q, z) + rng.normal(0, NOISE, q.shape))
    return problem, data, list(folds_of(groups_of(data, "pose", 5), 5, "pose"))


def test_an_effect_gains_what_refitting_everything_else_loses() -> None:
    """Two gears whose sines lean on offsets and lengths."""
    truth = np.array([1e-4, -2e-4, 3e-4, -1e-4, 4e-4, 2e-4, 1e-4, -3e-4])
    problem, data, folds = measured(truth)
    found = po.diagnose(problem, data, flips=49, plan=False)
    gains = {finding.target: finding.gain for finding in found.effects if finding.kind == "gear_eccentricity"}
    seen = np.asarray(data.position)[:, :2]
    whole = held_out_rms(data.q, seen, folds, [*OFFSETS, *LENGTHS, *FIRST, *SECOND])
    for joint, other in (("joint1", SECOND), ("joint2", FIRST)):
        expected = 1 - whole / held_out_rms(data.q, seen, folds, [*OFFSETS, *LENGTHS, *other])
        assert gains[joint] == pytest.approx(expected, abs=1e-3)


def test_every_geometric_cause_has_a_gain_of_its_own() -> None:
    """Two lengths off by very different amounts: one calibration, two gains."""
    problem, data, folds = measured(np.array([0, 0, 4e-4, -0.8e-4, 0, 0, 0, 0]))
    found = po.diagnose(problem, data, flips=49, plan=False)
    gains = {finding.target: finding.gain for finding in found.effects}
    seen = np.asarray(data.position)[:, :2]
    whole = held_out_rms(data.q, seen, folds, LENGTHS)
    for joint, other in (("joint1", 3), ("joint2", 2)):
        expected = 1 - whole / held_out_rms(data.q, seen, folds, [other])
        assert gains[joint] == pytest.approx(expected, abs=1e-3)
    assert gains["joint2"] < 0.5 < gains["joint1"]
