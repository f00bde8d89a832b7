"""Noise of an instrument that grows with the distance: what repeats at some of the distances say of it."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.noise.uneven_noise import NoiseSample, find_uneven_noise
from posture_opt.model.effects import Rows
from tests.helpers.planar_files import PROBLEM

SIGMA, NEAR, FAR = 5e-5, 1.0, 4.0  # m
ROWS, REPEATED = 200, 150


def sample(rng: np.random.Generator, ranges: np.ndarray, growth: float) -> NoiseSample:
    """Rows whose σ grows by ``growth`` per metre in its logarithm, in units of the stated one; joints do nothing."""
    sigma = np.exp(growth * (ranges - ranges.mean()))
    robot = po.problem_from_dict(PROBLEM).robot
    rows = Rows(robot, np.zeros((2, len(ranges), 3)), ranges, SIGMA)
    return NoiseSample(rng.normal(size=(len(ranges), 3)) * sigma[:, None], rows)


@pytest.mark.parametrize("seed", range(3))
def test_repeats_at_half_of_the_distances_confirm_it(seed: int) -> None:
    """The growth over their own span is the half of that of all rows: compared as such, they seemed to refute it."""
    rng = np.random.default_rng(seed)
    everything = sample(rng, rng.uniform(NEAR, FAR, ROWS), 0.5)
    repeats = sample(rng, rng.uniform(NEAR, (NEAR + FAR) / 2, REPEATED), 0.5)
    named, uneven = find_uneven_noise(everything, repeats, seed)
    assert [(cause.effect.kind, cause.effect.target) for cause in named] == [("range_noise", "instrument")]
    assert not uneven


@pytest.mark.parametrize("seed", range(3))
def test_repeats_that_scatter_alike_at_all_distances_refute_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    everything = sample(rng, rng.uniform(NEAR, FAR, ROWS), 0.5)
    repeats = sample(rng, rng.uniform(NEAR, FAR, REPEATED), 0.0)
    named, (uneven,) = find_uneven_noise(everything, repeats, seed)
    assert not named
    assert uneven.effect.kind == "range_noise"
    assert uneven.refuted


def test_too_few_repeats_leave_it_open() -> None:
    rng = np.random.default_rng(1)
    everything = sample(rng, rng.uniform(NEAR, FAR, ROWS), 0.5)
    named, (uneven,) = find_uneven_noise(everything, everything.none, 1)
    assert not named
    assert not uneven.refuted
