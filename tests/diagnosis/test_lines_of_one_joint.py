"""Several lines of one joint are one cause."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis import diagnose as stages
from posture_opt.model.effects import CyclicError
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import planar_rows
from tests.helpers.same_problem import assert_same_numbers, written

NOISE = 2e-5  # m


def test_lines_of_one_joint_are_one_cause_led_by_the_largest() -> None:
    rng = np.random.default_rng(73)
    q = rng.uniform(-2.5, 2.5, (200, 2))
    wheel = sum(a * np.sin(n * 40 * q[:, 0] + n) for n, a in ((1, 2e-4), (2, 1.5e-4), (4, 1e-4)))
    points = position(q + np.stack([wheel, 0 * wheel], axis=1)) + rng.normal(0, NOISE, q.shape)
    found = po.diagnose(*planar_rows(q, points), plan=False)
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


# --- Lines of a joint that data leave open beside others that they determine: what is stated, and what the file
# holds

SLOW, FAST, FASTER = 4.5, 23.0, 40.0  # cycles per revolution


def open_slow_line(model: Fit, *_: object) -> np.ndarray:
    """What five folds could choose: they differ by thrice its size in the line of 4.5 cycles, and in nothing else."""
    deviations = np.zeros((1, 5, len(model.x)))
    (error,) = model.effects
    assert isinstance(error, CyclicError)
    first = model.slices[0].start + 2 * int(np.argmin(np.abs(np.array(error.lines) - SLOW)))
    deviations[0, :, first : first + 2] = np.outer([-1.0, 1.0, 0.0, 1.0, -1.0], 3 * np.abs(model.x[first : first + 2]))
    return deviations


@pytest.fixture(scope="module")
def found() -> po.Diagnosis:
    """Three lines of joint1, the slow one the largest: sure within the model, and open by the choices of the folds."""
    rng = np.random.default_rng(2)
    q = rng.uniform((-0.9, -2.5), (0.9, 2.5), (140, 2))
    turn = sum(a * np.sin(k * q[:, 0] + k) for k, a in ((SLOW, 3e-4), (FAST, 1.5e-4), (FASTER, 2e-4)))
    rows = planar_rows(q, position(q + np.outer(turn, [1, 0])) + rng.normal(0, NOISE, q.shape))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "choice_deviations", open_slow_line)
        return po.diagnose(*rows, flips=99, plan=False)


def test_the_sure_lines_have_their_size_and_the_open_one_has_none(found: po.Diagnosis) -> None:
    finding = next(f for f in found.effects if f.kind == "cyclic_error")
    assert finding.determined
    assert isinstance(finding.cause, CyclicError)
    assert finding.cause.lines == pytest.approx((FASTER, FAST), abs=0.1)
    together, _ = finding.sizes.rms or (0.0, 0.0)
    assert together == pytest.approx(np.sqrt((1.5e-4**2 + 2e-4**2) / 2), abs=0.02e-3)  # not over whole cycles
    entry = next(e for e in found.to_json()["effects"] if e["kind"] == "cyclic_error")
    assert entry["undetermined_lines"] == pytest.approx([SLOW], abs=0.1)
    assert set(entry["estimate"]) == {"sin", "cos", "sin 2", "cos 2", "cycles", "centre"}


def test_the_file_predicts_with_all_lines_and_marks_the_open_one(found: po.Diagnosis, tmp_path: Path) -> None:
    sure, other = found.extended.effects
    assert (sure.size_undetermined, other.size_undetermined) == (None, True)
    assert len(sure.spectral_lines) == 2
    assert other.spectral_lines == pytest.approx((SLOW,), abs=0.1)
    (error,) = found.model.effects
    amplitudes = {
        int(k + 0.1): np.hypot(*effect.values[2 * i : 2 * i + 2])
        for effect in (error, sure, other)
        for i, k in enumerate(effect.spectral_lines)
    }
    assert amplitudes == pytest.approx({4: 3e-4, 23: 1.5e-4, 40: 2e-4}, abs=0.2e-4)
    assert_same_numbers(written(found.extended, tmp_path), found.extended)
    assert [(e["kind"], e["target"]) for e in found.to_json()["delivered"]["together"]] == [("cyclic_error", "joint1")]
