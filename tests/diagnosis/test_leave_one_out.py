"""Gains against least squares by hand: each fold fitted again without a cause, everything else with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import posture_opt as po
from posture_opt.calibration.estimation.error_statistics import folds_of, groups_of
from posture_opt.diagnosis import explained
from posture_opt.diagnosis.causes.predictive_effects import PredictiveModel
from posture_opt.diagnosis.search.nested_selection import NestedSelections
from posture_opt.diagnosis.search.search import SearchResult
from posture_opt.model.effects.gear_eccentricity import GearEccentricity
from posture_opt.model.effects.gear_second_harmonic import GearSecondHarmonic
from posture_opt.model.effects.slip import Slip
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write

NOISE = 5e-5  # m
EFFECTS = [GearEccentricity(joint="joint1"), GearSecondHarmonic(joint="joint1"), GearEccentricity(joint="joint2")]
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


def measured(folder: Path, z: np.ndarray) -> tuple[po.Problem, po.Measurements, list[np.ndarray]]:
    """90 rows, and five folds of them."""
    rng = np.random.default_rng(11)
    q = rng.uniform(-2.5, 2.5, (90, 2))
    write(folder / "data.csv", q, points(q, z) + rng.normal(0, NOISE, q.shape))
    problem = po.problem_from_dict(PROBLEM)
    data = po.read_measurements(folder / "data.csv", problem)
    return problem, data, list(folds_of(groups_of(data, "pose", 5), 5, "pose"))


def test_an_effect_gains_what_refitting_everything_else_loses(tmp_path: Path) -> None:
    """Two gears whose sines lean on offsets and lengths; beside them a harmonic that is not there, and goes."""
    truth = np.array([1e-4, -2e-4, 3e-4, -1e-4, 4e-4, 2e-4, 1e-4, -3e-4])
    problem, data, folds = measured(tmp_path, truth)
    found = PredictiveModel.of(po.calibrate(problem, data), EFFECTS, folds)
    assert found.kept == (0, 2)
    seen = np.asarray(data.position)[:, :2]
    whole = held_out_rms(data.q, seen, folds, [*OFFSETS, *LENGTHS, *FIRST, *SECOND])
    for gain, other in zip(found.left_out.gains, (SECOND, FIRST), strict=True):
        assert gain == pytest.approx(
            1 - whole / held_out_rms(data.q, seen, folds, [*OFFSETS, *LENGTHS, *other]), abs=1e-3
        )


def test_what_only_the_rows_left_out_show_is_not_predicted(tmp_path: Path) -> None:
    """A joint slips before the last block of rows: the fold that leaves this block out does not know of it."""
    rng, h = np.random.default_rng(11), 5e-4
    q = rng.uniform(-2.5, 2.5, (90, 2))
    blocks, after = np.split(np.arange(90), 5), np.arange(90) >= 72
    seen = points(q + np.stack([h * after, 0 * after], axis=1), np.zeros(8)) + rng.normal(0, NOISE, q.shape)
    write(tmp_path / "data.csv", q, seen, time=("s", np.arange(90.0)))
    problem = po.problem_from_dict(PROBLEM)
    data = po.read_measurements(tmp_path / "data.csv", problem)
    found = PredictiveModel.of(po.calibrate(problem, data), [Slip(of="joint1", moment="72 s")], blocks)

    def errors(left: np.ndarray, *, slips: bool) -> np.ndarray:
        learn = np.setdiff1d(np.arange(90), left)

        def at(x: np.ndarray, rows: np.ndarray) -> np.ndarray:
            turned = q[rows] + np.stack([x[4] * slips * after[rows], 0 * rows], axis=1)
            return points(turned, np.r_[x[:4], np.zeros(4)]) - seen[rows]

        x = least_squares(lambda x: at(x, learn).ravel(), np.zeros(5), x_scale=1e-4, xtol=1e-14, ftol=1e-14).x
        return at(x, left)

    whole, without = (np.concatenate([errors(left, slips=slips) for left in blocks]) for slips in (True, False))
    rms = [float(np.sqrt(np.mean(np.sum(e**2, axis=1)))) for e in (whole, without)]
    assert found.left_out.gains == pytest.approx([1 - rms[0] / rms[1]], abs=1e-3)
    assert rms[0] > 0.3 * h


def test_every_geometric_cause_has_a_gain_of_its_own(tmp_path: Path) -> None:
    """Two lengths off by very different amounts: one calibration, two gains."""
    problem, data, folds = measured(tmp_path, np.array([0, 0, 4e-4, -0.8e-4, 0, 0, 0, 0]))
    found = po.diagnose(problem, data, flips=49, plan=False)
    gains = {finding.target: finding.gain for finding in found.effects}
    seen = np.asarray(data.position)[:, :2]
    whole = held_out_rms(data.q, seen, folds, LENGTHS)
    for joint, other in (("joint1", 3), ("joint2", 2)):
        expected = 1 - whole / held_out_rms(data.q, seen, folds, [other])
        assert gains[joint] == pytest.approx(expected, abs=1e-3)
    assert gains["joint2"] < 0.5 < gains["joint1"]


def test_effects_that_predict_rows_left_out_worse_are_all_taken_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A gear of joint1 is found; then sets chosen anew in each fold predict by 1 % worse than the geometry alone."""
    problem, data, _ = measured(tmp_path, np.array([1e-4, -2e-4, 3e-4, -1e-4, 4e-4, 2e-4, 0, 0]))
    search = explained._search_effects

    def searched(*args: Any) -> tuple[Any, Any, SearchResult]:
        calibration, linearised, found = search(*args)
        assert [s.kind for s in found.chosen] == ["gear_eccentricity"]
        way = found.nested.each[0]
        losses = np.concatenate([way.losses[:1], 1.01**2 * np.repeat(way.losses[:1], len(way.losses) - 1, 0)])
        return calibration, linearised, replace(found, nested=NestedSelections((replace(way, losses=losses),)))

    monkeypatch.setattr(explained, "_search_effects", searched)
    gone = po.diagnose(problem, data, flips=49, plan=False)
    assert not [f for f in gone.effects if f.effect]
    assert (gone.verdict, gone.delivery.model) == ("unexplained", "calibrated")
    assert gone.errors["extended"].rms == gone.errors["calibrated"].rms == gone.errors["delivered"].rms
    assert not gone.extended.effects
