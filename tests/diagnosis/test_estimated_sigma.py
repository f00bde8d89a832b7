"""A σ that was itself estimated, from repeats, is not refuted by its own error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.noise.noise_candidates import score_stated_sigma
from posture_opt.diagnosis.noise.uneven_noise import NoiseSample, find_uneven_noise
from posture_opt.model.effects import Rows
from tests.helpers.planar_files import PROBLEM

REPEATS, FREE, DRAWS = 30, 150, 4000


def alarms(level: float, estimated: int | None) -> float:
    """Share of false alarms where the true σ is 1 and the stated one has the error of an estimate."""
    rng = np.random.default_rng(5)
    stated = rng.chisquare(REPEATS, DRAWS) / REPEATS
    seen = rng.chisquare(FREE, DRAWS) / FREE / stated
    return float(np.mean([score_stated_sigma(float(v), FREE, 0.0, estimated).p_value < level for v in seen]))


@pytest.mark.parametrize("level", [0.05, 0.01])
def test_the_level_holds_for_an_estimated_sigma(level: float) -> None:
    # The logarithm of a chi-squared variable is not quite Gaussian; 4000 draws tell 0.01 to 0.0016.
    assert alarms(level, REPEATS) == pytest.approx(level, abs=0.6 * level)
    assert alarms(level, None) > 5 * level


def test_the_level_holds_in_both_tails_of_few_repeats() -> None:
    # The logarithm of a variance has its longer tail below: as if it were Gaussian, 12 repeats alarm 8 times too often.
    freedom = 12
    seen = np.random.default_rng(6).chisquare(freedom, DRAWS) / freedom
    wrong = np.array([score_stated_sigma(float(v), freedom, 0.0).p_value < 0.02 for v in seen])
    for side in (seen < 1, seen > 1):
        assert np.mean(wrong & side) == pytest.approx(0.01, abs=0.005)


# --- A joint scatters at all postures: where one of them alone says so, a reading there is wrong ----------------------

SIGMA, REACH = 5e-5, 2.0  # m
ROWS, REPEATED = 200, 40
JOINT = 6e-5  # rad, of the first joint: at full reach 2.4 σ


def sample(rng: np.random.Generator, rows: int, joint: float) -> NoiseSample:
    """Rows in units of the stated σ; the first joint moves them along y, by up to its whole reach."""
    levers = np.zeros((2, rows, 3))
    levers[0, :, 1] = rng.uniform(0.1, REACH, rows) / SIGMA
    e = rng.normal(size=(rows, 3)) + joint * rng.normal(size=(rows, 1)) * levers[0]
    return NoiseSample(e, Rows(po.problem_from_dict(PROBLEM).robot, levers, None, SIGMA))


def repeats(rng: np.random.Generator, joint: float) -> NoiseSample:
    """Two differences at each of twenty postures."""
    found = sample(rng, REPEATED, joint)
    return replace(found, posture=np.repeat(np.arange(REPEATED // 2), 2))


def with_a_wrong_reading(found: NoiseSample) -> NoiseSample:
    """The first reading of the posture that the joint moves most is off along its lever: both differences have it."""
    e: np.ndarray = found.e.copy()
    own = found.rows.levers[0, :, 1].reshape(-1, 2).sum(axis=1).argmax()
    e[2 * own : 2 * own + 2, 1] = 7.0, 5.0
    return replace(found, e=e)


@pytest.mark.parametrize("seed", range(2))
def test_a_wrong_reading_is_no_scatter_of_a_joint(seed: int) -> None:
    rng = np.random.default_rng(seed)
    everything = sample(rng, ROWS, JOINT)
    named, uneven = find_uneven_noise(everything, with_a_wrong_reading(repeats(rng, 0.0)), seed)
    assert not named
    assert [one.effect.target for one in uneven] == ["joint1"]


@pytest.mark.parametrize("seed", range(2))
def test_scatter_at_all_postures_is(seed: int) -> None:
    rng = np.random.default_rng(seed)
    named, _ = find_uneven_noise(sample(rng, ROWS, JOINT), repeats(rng, JOINT), seed)
    assert [(one.effect.kind, one.effect.target) for one in named] == [("joint_noise", "joint1")]
