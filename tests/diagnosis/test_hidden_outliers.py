"""Gross errors that the errors of an uncorrected effect hide: found beside the effect, and told by their lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

ROWS, NOISE = 120, 2e-5  # m
FIRST_LINE = 2  # of the file, behind its header


def diagnosed(folder: Path, seed: int, gross: list[int], size: float) -> po.Diagnosis:
    """An arm with one cycle per revolution of joint 1, 0.8 mrad, of which some rows are off by ``size`` [m]."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.5, 2.5, (ROWS, 2))
    points = position(q + np.stack([8e-4 * np.sin(3.7 * q[:, 0]), 0 * q[:, 0]], axis=1))
    points = points + rng.normal(0, NOISE, q.shape)
    points[gross] += size * np.array([0.6, -0.8])
    write(folder / "data.csv", q, points)
    problem = po.problem_from_dict(PROBLEM)
    return po.diagnose(problem, po.read_measurements(folder / "data.csv", problem), plan=False)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_rows_that_an_effect_hid_are_left_out_and_named(seed: int, tmp_path: Path) -> None:
    gross = [40, 41, 90]
    found = diagnosed(tmp_path, seed, gross, 1.2e-3)  # less than the effect itself does, 60 times the noise
    assert [line - FIRST_LINE for line in found.calibration.lines] == gross
    assert "calibration.outliers" in {s["id"] for s in found.to_json()["statements"]}
    assert found.verdict == "effects_found"
    assert {(f.kind, f.target) for f in found.effects if f.effect is not None} == {("cyclic_error", "joint1")}
    assert found.errors["extended"].rms < 3 * NOISE


def test_rows_of_an_event_are_no_outliers(tmp_path: Path) -> None:
    """Ten rows one after another that are off alike: something happened, and they stay."""
    found = diagnosed(tmp_path, 1, list(range(60, 70)), 1.2e-3)
    assert not set(range(60, 70)) & {line - FIRST_LINE for line in found.calibration.lines}
    assert found.verdict == "unexplained"
