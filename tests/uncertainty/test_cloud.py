"""The Monte Carlo cloud: its sampling errors, its coverage of the closed form, its document and messages."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posture_opt as po
from posture_opt.uncertainty.simulation.sampler import Sampler, adaptive
from tests.helpers.factors import pose
from tests.helpers.moments import errors_of, planar
from tests.helpers.shipped import preset_robot
from tests.helpers.stated import stated

BENT = np.radians((90, -135))
Q6 = (0.3, -1.1, 1.2, -0.5, 0.7, 0.2)


def spatial(angle=0.01, length=0.002):
    robot = preset_robot("ur5")
    return stated(robot=robot, sources=errors_of(robot, angle, length, ("theta", "a")))


def test_every_sample_is_the_full_forward_model():
    problem = spatial(0.2, 0.05)
    spread = po.propagate(problem, Q6)
    draw = Sampler.of(spread)
    shift, rotation = draw(np.random.default_rng(3), 5)
    # the same errors again, in the sampler's order of sources, through the plain product of the factors
    p = np.random.default_rng(3).standard_normal((5, len(draw.names))) @ draw.root.T
    for row in range(5):
        T = pose(problem.robot, Q6, dict(zip(draw.names, p[row], strict=True)))
        turn = Rotation.from_matrix(T[:3, :3] @ pose(problem.robot, Q6)[:3, :3].T).as_rotvec()
        np.testing.assert_allclose(shift[row] + spread.position, T[:3, 3], atol=1e-14)
        np.testing.assert_allclose(rotation[row], turn, atol=1e-13)


@pytest.mark.campaign
def test_intervals_hold_the_truth_as_often_as_they_say():
    # 300 clouds of 400; the closed form is exact. Two-sided tail of a true 95 % interval below 1e-4: 0.90 .. 0.985;
    # the intervals are asymptotic, at n = 400 they lose about a percent.
    problem, trials = planar(1, 3), 300
    entries = np.zeros((2, 2))
    eigen = np.zeros(2)
    coverage = 0
    for seed in range(trials):
        cloud = po.simulate(problem, BENT, n=400, seed=seed)
        low, high = np.moveaxis(cloud.covariance_interval, -1, 0)
        exact = cloud.spread.covariance
        entries += ((low <= exact) & (exact <= high))[:2, :2]
        truth = cloud.spread.ellipse.semi_axes**2
        eigen += (cloud.eigenvalue_intervals[:, 0] <= truth) & (truth <= cloud.eigenvalue_intervals[:, 1])
        low95, high95 = cloud.coverage95_interval
        coverage += low95 <= 0.95 <= high95
    for held in (*entries.ravel(), *eigen, coverage):
        assert 0.90 <= held / trials <= 0.985


# Coverage of the nominal 95 % ellipse of the exact covariance where the errors are far too large for a straight line,
# lengths good to 10 mm, by sampling with another program: between .926 and .951.
@pytest.mark.parametrize(("t2", "sigma"), [(-90, 5), (-90, 20), (-10, 20), (-180, 5), (-180, 20)])
def test_the_exact_ellipse_holds_about_95_percent_even_where_the_cloud_is_bent(t2, sigma):
    cloud = po.simulate(planar(sigma, sigma), np.radians((90, t2)), n=50_000, seed=4)
    # one in the last printed digit, and three standard errors of 50 000 trials
    assert 0.925 - 0.003 <= cloud.coverage95 <= 0.952 + 0.003


def test_adaptive_draws_until_the_digits_stand():
    cloud = po.simulate(planar(1, 3), BENT, adaptive=True, digits=2, seed=3)
    found = cloud.adaptive
    assert found is not None
    assert found.stable
    assert cloud.n == found.n >= 100_000
    # the cloud is the very sample that was found stable
    np.testing.assert_allclose(cloud.ellipse.covariance, found.covariance, rtol=1e-9)
    np.testing.assert_allclose(
        np.sqrt(np.diag(found.covariance)), np.sqrt(np.diag(cloud.spread.covariance)[:2]), rtol=0.01
    )
    assert any("stable in 2 significant digits" in note for note in cloud.notes)
    assert cloud.to_json()["adaptive"]["stable"] is True


@pytest.mark.parametrize(("arguments", "words"), [
    ({"n": 1}, "1 samples have no covariance"),
    ({"n": 10**9}, "1000000000 samples are more than the 100000000"),
    ({"n": 2.5}, "the number of samples is 2.5"),
    ({"n": True}, "the number of samples is True"),
    ({"seed": -1}, "the seed is -1"),
    ({"n": 0, "seed": -1}, "the seed is -1"),
    ({"adaptive": True, "digits": 0}, "digit"),
])  # fmt: skip
def test_what_cannot_be_drawn_is_refused(arguments, words):
    with pytest.raises(po.errors.InputError, match=words):
        po.simulate(planar(), BENT, **arguments)


# --- The adaptive Monte Carlo procedure: its rules by hand, its promise on models whose answer is known ---------------


def additive(rng, n):
    """Y1 = X1 + X3, Y2 = X2 + X3 with standard normal X: variances 2, correlation 0.5 (JCGM 102:2011, 9.2.2)."""
    x = rng.standard_normal((n, 3))
    return x[:, :2] + x[:, 2:]


def draw_additive(n, rng):
    return additive(rng, n)


def test_a_gaussian_model_is_stable_at_once_and_agrees_with_the_closed_form():
    found = adaptive(draw_additive, seed=1)
    assert found.stable
    assert (found.blocks, found.n) == (10, 100_000)
    error = 4 / math.sqrt(found.n)
    np.testing.assert_allclose(found.mean, 0, atol=error * math.sqrt(2))
    np.testing.assert_allclose(found.covariance, [[2, 1], [1, 2]], atol=error * 2 * math.sqrt(2))
    np.testing.assert_allclose(found.uncertainty, math.sqrt(2), rtol=error)
    assert found.kp == pytest.approx(2.4477, abs=0.02)  # the quantile of 1e5 trials: its standard error is 0.006
    np.testing.assert_array_equal(found.tolerances.mean, 0.05)  # u = 1.4: half a unit of the second digit
    assert found.tolerances.coverage_factor == 0.05
    assert found.reached.within(found.tolerances)


@pytest.mark.campaign
def test_the_errors_reached_are_the_true_ones():
    runs = [adaptive(draw_additive, seed=seed) for seed in range(25)]
    scatter = 2 * np.std([run.mean for run in runs] - np.zeros(2), axis=0, ddof=1)
    reached = np.mean([run.reached.mean for run in runs], axis=0)
    np.testing.assert_allclose(scatter, reached, rtol=0.5)  # a deviation of 25 runs is known to 14 %
    kp = 2 * np.std([run.kp for run in runs], ddof=1)
    assert kp == pytest.approx(np.mean([run.reached.coverage_factor for run in runs]), rel=0.5)


@pytest.mark.parametrize(
    "call",
    [
        lambda: adaptive(draw_additive, p=1.0),
        lambda: adaptive(draw_additive, digits=0),
        lambda: adaptive(draw_additive, max_blocks=3),
        lambda: adaptive(lambda n, rng: np.zeros(n)),
        lambda: adaptive(lambda n, rng: np.zeros((n - 1, 2))),
        lambda: adaptive(lambda n, rng: np.full((n, 2), math.nan)),
    ],
)
def test_impossible_input_is_refused(call):
    with pytest.raises(po.errors.InputError):
        call()
