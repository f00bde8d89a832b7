"""Covariance of the whole pose: shift and rotation vector, against samples in the same chart."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.moments import correlated, errors_of, scaled, with_correlations
from tests.helpers.sampled import sampled_pose
from tests.helpers.shipped import preset_robot
from tests.helpers.stated import stated
from tests.helpers.variants import conformance

Q6 = (0.3, -1.1, 1.2, -0.5, 0.7, 0.2)


def joints(correlation=None):
    sources = errors_of(preset_robot("ur10"), 1.0, 0.5, ("theta",))
    if correlation is None:
        return sources
    R = np.full((6, 6), correlation) + (1 - correlation) * np.eye(6)
    return with_correlations(sources, R)


CASES = {
    "independent joints": joints,
    "joints, equal": lambda: joints(0.8),
    "joints, dense": lambda: correlated(joints(), seed=7),
    "joints and lengths": lambda: correlated(errors_of(preset_robot("ur10"), 1.0, 0.5, ("theta", "a")), seed=2),
    "thirty independent": lambda: errors_of(preset_robot("ur10"), 0.4, 0.1),
}
"""Sources of a UR10 of about one radian."""


def spread_of(case, sigma):
    problem = stated(robot=preset_robot("ur10"), sources=scaled(CASES[case](), np.radians(sigma)))
    return po.propagate(problem, Q6)


@pytest.mark.parametrize(
    ("case", "sigma"),
    conformance(
        [*product(CASES, [1, 10]), ("independent joints", 20)],
        [("independent joints", 20), ("joints and lengths", 10), ("thirty independent", 1)],
    ),
)
def test_it_is_that_of_samples(case, sigma):
    spread = spread_of(case, sigma)
    sources = spread.problem.sources
    _, C, _, of_C = sampled_pose(spread.robot, Q6, sources.names, sources.covariance, 200_000, seed=4)
    units = np.sqrt(np.outer(np.diag(C), np.diag(C)))
    found = spread.pose
    # Five standard errors of 40 blocks, and the error that the integration states of itself.
    assert (np.abs(found.covariance - C) <= 5.5 * of_C + found.integration.relative_error * units).all()
    assert found.integration.relative_error < (2e-4 if sigma < 5 else 0.1)
    if sigma == 20:  # to first order it is wrong, and the samples are many enough to tell
        T = np.asarray(spread.tool_point.twists(Q6, spread.tool_point.walk(Q6)[0]), dtype=float)
        first = T @ spread.tool_point.covariance @ T.T
        assert (np.abs(first - C)[3:] > 5.5 * of_C[3:] + 0.01 * units[3:]).any()


def test_large_turns_are_said():
    assert spread_of("joints, equal", 5).pose.within_half_turn
    far = spread_of("joints, equal", 30)  # six joints that turn together by 30 degrees each
    assert not far.pose.within_half_turn
    assert far.to_json()["pose_covariance_within_half_turn"] is False
