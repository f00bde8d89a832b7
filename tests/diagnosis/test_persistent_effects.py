"""The part of a fitted arm that outlasts its session: nothing of a drift gets into it, and it is as sure as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.fit import Fit, fit_with_effects
from posture_opt.diagnosis.causes import _estimate
from posture_opt.diagnosis.linearised_data import linearise
from posture_opt.diagnosis.sessions import persistent
from posture_opt.model.effects import Effect
from posture_opt.model.effects.drift import Drift
from posture_opt.model.effects.gear_eccentricity import GearEccentricity
from posture_opt.model.effects.slip import Slip
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PLANAR, write

NOISE = 2e-5  # m, of each measured coordinate
SINE, SHIFT, STEP = 1e-4, 1e-4, 3e-4  # rad of joint1's gear; m in x and y; rad of joint1
ECCENTRIC = GearEccentricity(joint="joint1")
TIMED = {"drift": Drift(course="exponential", constant="300 s"), "slip": Slip(of="joint1", moment="705 s")}
WAVE = np.array([0.55e-4, 0.23e-4, 20.3])  # rad, rad of joint1; cycles a turn
PROBLEM = PLANAR + "uncertainty: {measurement: {position: 0.02 mm}}\n"


def measured(folder: Path, case: str) -> tuple[po.Problem, po.Measurements]:
    """150 rows, one every 10 s, of an arm with an eccentric gear that drifts with 300 s, or slips after 705 s."""
    rng = np.random.default_rng(5)
    q, t = rng.uniform(-2.5, 2.5, (150, 2)), np.arange(150) * 10.0
    turned = q + np.stack([SINE * np.sin(q[:, 0]) + STEP * ((t > 705) & (case == "slip")), 0 * t], axis=1)
    drifted = SHIFT * (1 - np.exp(-t / 300)) * (case == "drift")
    write(folder / "data.csv", q, position(turned) + drifted[:, None] + rng.normal(0, NOISE, q.shape), time=("s", t))
    (folder / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    problem = po.load_problem(folder / "problem.yaml")
    return problem, po.read_measurements(folder / "data.csv", problem)


def first_of_effects(fit: Fit) -> int:
    return min(part.start for part in fit.slices)


def fitted(problem: po.Problem, data: po.Measurements, *effects: Effect) -> Fit:
    calibration = po.calibrate(problem, data, folds=2)
    sensitivities = linearise(calibration, flips=0).sensitivities
    directions = calibration.identifiability.directions
    return fit_with_effects(sensitivities.residuals, calibration.x, directions, effects)


def test_the_constant_of_a_drift_is_told_with_its_error(tmp_path: Path) -> None:
    model = fitted(*measured(tmp_path, "drift"), Drift(course="exponential", constant="500 s"), ECCENTRIC)
    value, std, _ = _estimate(model, 0)["constant"]
    t = np.arange(150) * 10.0
    by_shift, by_constant = 1 - np.exp(-t / value), SHIFT * t / value**2 * np.exp(-t / value)
    own = by_constant - by_shift * (by_shift @ by_constant) / (by_shift @ by_shift)
    assert std == pytest.approx(NOISE / np.linalg.norm(own) / np.sqrt(2), rel=0.4)  # in x and y; geometry leans on it
    assert abs(value - 300) < 4 * std


@pytest.mark.parametrize("case", list(TIMED))
def test_what_is_kept_is_the_arm_before_it_changed(case: str, tmp_path: Path) -> None:
    model = fitted(*measured(tmp_path, case), TIMED[case], ECCENTRIC)
    kept = persistent(model, np.zeros((first_of_effects(model), 0)))
    assert [e.name for e in kept.effects] == [ECCENTRIC.name]
    assert np.all(
        np.abs(kept.x[kept.sizes] - [SINE, 0.0]) < 4 * kept.std[kept.sizes]
    )  # fitted without it, the drift makes 0.1 mrad more
    assert np.all(kept.std[kept.sizes] < 6e-6)  # 150 rows of 20 µm at 1 m, and the geometry with them
    deviations = np.abs(kept.x[[p.name.endswith(".a") for p in kept.residuals.parameters]])
    assert np.all(deviations < 1e-5)  # m: of two links, 2 µm each; fitted without a drift they take up 25 µm
    np.testing.assert_allclose(kept.std[kept.sizes], model.std[model.slices[1]], rtol=1e-12)
    assert kept.variance == model.variance < 1.3
    assert persistent(model, np.zeros((first_of_effects(model), 0)), with_time=True) is model


def test_the_file_says_what_the_report_says(tmp_path: Path) -> None:
    problem, data = measured(tmp_path, "drift")
    found = po.diagnose(problem, data, flips=99)
    assert "drift" in [f.kind for f in found.effects]
    (effect,) = found.extended.effects
    (said,) = (f.estimate for f in found.effects if f.kind == "gear_eccentricity")
    # Of many drifts and slips that say nearly the same one is named; a refit without it gives 0.01 and 0.10 mrad.
    assert effect.values == pytest.approx([SINE, 0.0], abs=2e-5)
    assert effect.values == pytest.approx([said["sin"][0], said["cos"][0]], abs=1e-12)
    sigma = dict(zip(found.extended.sources.names, found.extended.sources.sigma, strict=True))
    assert sigma["gear_eccentricity(joint1).sin"] == pytest.approx(said["sin"][1], rel=1e-6)


def wavy(q: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Points (N, 2) of an arm with offsets of joints [rad] and links [m], sine, cosine and cycles ``z`` (7,)."""
    wave = z[4] * np.sin(z[6] * q[:, 0]) + z[5] * np.cos(z[6] * q[:, 0])
    return position(q + z[:2] + np.stack([wave, 0 * wave], axis=1), 1 + z[2:4])


def correction(q: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The gradients (N, 3) of a wave by sine, cosine and cycles."""
    s, c = np.sin(z[6] * q), np.cos(z[6] * q)
    return np.stack([s, c, q * (z[4] * c - z[5] * s)], axis=1)


def test_a_wave_is_exported_as_sure_as_it_is_with_its_cycles_held(tmp_path: Path) -> None:
    """Against the linear errors of all seven unknowns together, by differences of the arm by hand."""
    rng = np.random.default_rng(3)
    q = np.column_stack([rng.uniform(0.5, 2.5, 150), rng.uniform(-2.5, 2.5, 150)])
    z = np.r_[np.zeros(4), WAVE]
    steps = np.diag([1e-6] * 6 + [1e-4])
    J = np.stack([(wavy(q, z + h) - wavy(q, z - h)).ravel() / (2 * h.sum()) for h in steps], axis=1)
    C = NOISE**2 * np.linalg.inv(J.T @ J)[4:, 4:]
    write(tmp_path / "data.csv", q, wavy(q, z) + rng.normal(0, NOISE, q.shape))
    (tmp_path / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    problem = po.load_problem(tmp_path / "problem.yaml")
    found = po.diagnose(problem, po.read_measurements(tmp_path / "data.csv", problem), flips=49, folds=2)
    (effect,) = found.extended.effects
    assert effect.kind == "cyclic_error"
    own = [found.extended.sources.names.index(f"{effect.name}.{name}") for name in ("sin", "cos")]
    held = found.extended.sources.covariance[np.ix_(own, own)]

    def sigma(at: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        G = correction(at, z)[:, : len(covariance)]
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", G, covariance, G)))

    middle = np.linspace(1.2, 1.8, 13)  # at the edges the cycles' error is more than sine and cosine can say
    ratio = sigma(middle, held) / sigma(middle, C)
    assert np.all(np.abs(ratio - 1) < 0.25)  # residual variance of 300 numbers, and the amplitude's own error
    claimed, true = (np.linalg.norm(sigma(middle, part)) for part in (C[:2, :2], C))
    assert claimed > 1.8 * true  # by sine and cosine with the error of the cycles in them
