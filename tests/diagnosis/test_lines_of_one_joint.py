"""Several lines of one joint are one cause."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

NOISE = 2e-5  # m


def measured(folder: Path, q: np.ndarray, error: np.ndarray, rng: np.random.Generator) -> po.Measurements:
    write(folder / "data.csv", q, position(q + error) + rng.normal(0, NOISE, q.shape))
    return po.read_measurements(folder / "data.csv", po.problem_from_dict(PROBLEM))


def test_lines_of_one_joint_are_one_cause_led_by_the_largest(tmp_path: Path) -> None:
    rng = np.random.default_rng(73)
    q = rng.uniform(-2.5, 2.5, (200, 2))
    wheel = sum(a * np.sin(n * 40 * q[:, 0] + n) for n, a in ((1, 2e-4), (2, 1.5e-4), (4, 1e-4)))
    data = measured(tmp_path, q, np.stack([wheel, 0 * wheel], axis=1), rng)
    found = po.diagnose(po.problem_from_dict(PROBLEM), data, plan=False)
    (gear,) = [f for f in found.effects if f.kind == "cyclic_error"]
    assert gear.effect.cycles == pytest.approx(40, abs=0.1)
    assert "of 3 lines (40.0, 80.0 and 160.0 cycles per revolution)" in gear.cause.words
    together, each = gear.cause.sizes(gear.sizes)
    assert "(harmonic 2)" in each.text
    assert "(harmonic 4)" in each.text
    assert "what comes 40.0 times" in found.to_json()["effects"][0]["inspect"]
    # Waves of 0.2, 0.15 and 0.1 mrad: sqrt((0.2² + 0.15² + 0.1²) / 2) = 0.190 mrad.
    assert together.text.startswith("0.19")
    assert found.errors["extended"].rms < 1.15 * np.sqrt(2) * NOISE
    # The file holds all lines, and does the same to the data.
    again = found.extended.effects[0]
    assert again.lines == pytest.approx(gear.effect.lines)
    assert found.to_json()["residual_rms"]["delivered"] < 1.05 * np.sqrt(2) * NOISE
