"""Correlated errors of spatial arms: exact given shared factors, and mixed over nodes for these."""

from __future__ import annotations

import numpy as np
import pytest

from posture_opt.problem.load import problem_from_dict
from posture_opt.robot.preset import load_preset
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.spread import propagate
from tests.helpers.moments import correlated, errors_of, scaled
from tests.helpers.sampled import sampled_pose
from tests.helpers.stated import stated

Q6 = (0.3, -1.1, 1.2, -0.5, 0.7, 0.2)
STRETCHED = (0.3, -1.0, 0.0, -0.6, 0.0, 0.2)


def with_correlations(sources, R):
    return Sources(sources.names, R * np.outer(sources.sigma, sources.sigma))


def joints(robot="ur10", R=None):
    """One radian at every joint, with the correlations R or none."""
    sources = errors_of(load_preset(robot), 1.0, 0.1, ("theta",))
    return sources if R is None else with_correlations(sources, R)


def pairs(k, *entries):
    R = np.eye(k)
    for i, j, rho in entries:
        R[i, j] = R[j, i] = rho
    return R


def equal(k, rho):
    return np.full((k, k), rho) + (1 - rho) * np.eye(k)


def lengths_and_angles():
    """Joint angles, link lengths and offsets of a UR10 all correlated: 1 rad, 0.5 m."""
    return correlated(errors_of(load_preset("ur10"), 1.0, 0.5, ("theta", "a")), seed=3)


def stanford():
    """An arm with a prismatic third joint: Scheinman's, with a wrist that is offset by 50 mm."""
    d, a, alpha = (0.4, 0.15, 0, 0, 0, 0.25), (0, 0, 0, 0, 0, 0.05), (-90, 90, 0, -90, 90, 0)
    rows = [
        {"name": f"j{k + 1}", "type": "prismatic" if k == 2 else "revolute", "d": f"{d[k]} m", "a": f"{a[k]} m"}
        | {"alpha": f"{alpha[k]} deg", "theta": "-90 deg" if k == 2 else "0 deg"}
        | {"limits": ["0 m", "0.8 m"] if k == 2 else ["-170 deg", "170 deg"]}
        for k in range(6)
    ]
    content = {"name": "Stanford arm", "robot": {"kind": "dh", "joints": rows}, "task": {"kind": "insert"}}
    return problem_from_dict(content).robot


def arm_of(name):
    return stanford() if name == "stanford" else load_preset(name)


def stage_and_angles():
    """The stage (0.3 m a radian) of the Stanford arm and five angles, dense correlations."""
    robot = stanford()
    sigma = {robot.factors[i].parameter: 0.3 if robot.factors[i].kind == "translate" else 1.0 for i in robot.driven}
    return correlated(Sources.independent(sigma), seed=5)


def stages_alone():
    """Lengths that vary together, and angles that do not: two nodes a factor, whatever the size."""
    sources = errors_of(load_preset("ur10"), 1.0, 0.5, ("theta", "a"))
    lengths = [k for k, name in enumerate(sources.names) if name.endswith(".a")]
    return with_correlations(sources, pairs(12, (lengths[1], lengths[2], 0.9), (lengths[0], lengths[5], -0.4)))


CASES = {
    "one pair": ("ur10", lambda: joints(R=pairs(6, (1, 2, 0.8)))),
    "one pair, against each other": ("ur10", lambda: joints(R=pairs(6, (0, 4, -0.8)))),
    "three pairs that overlap": ("ur10", lambda: joints(R=pairs(6, (0, 3, 0.8), (1, 4, 0.6), (2, 5, -0.7)))),
    "three pairs in a row": ("ur10", lambda: joints(R=pairs(6, (0, 1, 0.8), (2, 3, 0.6), (4, 5, -0.7)))),
    "equal": ("ur10", lambda: joints(R=equal(6, 0.8))),
    "one shaft": ("ur10", lambda: joints(R=equal(6, 1.0))),
    "dense": ("ur10", lambda: correlated(joints(), seed=7)),
    "rank two": ("ur10", lambda: correlated(joints(), seed=7, dof=2)),
    "lengths and angles": ("ur10", lengths_and_angles),
    "a prismatic joint": ("stanford", stage_and_angles),
    "lengths alone": ("ur10", stages_alone),
    "seven joints, equal": ("panda", lambda: joints("panda", equal(7, 0.5))),
}
"""Arm and sources with σ = 1 rad."""


def spread_of(case, sigma, q):
    robot, sources = CASES[case]
    robot = arm_of(robot)
    return propagate(stated(robot=robot, sources=scaled(sources(), np.radians(sigma))), (*q, 0.4)[: robot.n])


@pytest.mark.parametrize("q", [Q6, STRETCHED], ids=["bent", "stretched"])
@pytest.mark.parametrize("sigma", [0.01, 1, 5, 20, 30])
@pytest.mark.parametrize("case", CASES)
def test_moments_are_those_of_samples(case, sigma, q):
    spread = spread_of(case, sigma, q)
    sources = spread.problem.sources
    mean, C, of_mean, of_C = sampled_pose(spread.robot, spread.q, sources.names, sources.covariance, 200_000)
    # Five standard errors: missed once in a million entries by a right formula, a thousand are compared; of 40 blocks
    # the standard error itself is known to a tenth. Beside it, the error that the integration states of itself.
    size = np.sqrt(np.outer(np.diag(C), np.diag(C)))
    stated_error = spread.integration.relative_error * size[:3, :3]
    assert (np.abs(spread.covariance - C[:3, :3]) <= 5.5 * of_C[:3, :3] + stated_error).all()
    assert (np.abs(spread.bias - mean[:3]) <= 5.5 * of_mean[:3] + 1e-15).all()
    assert spread.method == "exact given shared factors, integrated over them"
    assert spread.integration.relative_error < (1e-2 if case == "lengths and angles" else 1e-5)
