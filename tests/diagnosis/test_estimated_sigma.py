"""A σ that was itself estimated, from repeats, is not refuted by its own error."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.noise.noise_candidates import score_stated_sigma
from posture_opt.problem.measured_robot import problem_of_measured_robot

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


@pytest.mark.parametrize("freedom", [12, 60])
def test_the_level_holds_in_both_tails_of_few_repeats(freedom: int) -> None:
    # The logarithm of a variance has its longer tail below: as if it were Gaussian, 12 repeats alarm 8 times too often.
    seen = np.random.default_rng(6).chisquare(freedom, DRAWS) / freedom
    wrong = np.array([score_stated_sigma(float(v), freedom, 0.0).p_value < 0.02 for v in seen])
    for side in (seen < 1, seen > 1):
        assert np.mean(wrong & side) == pytest.approx(0.01, abs=0.005)


def test_repeats_bring_their_degrees_of_freedom() -> None:
    rng, rows = np.random.default_rng(2), []
    robot = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}})
    for pose in range(12):
        q = rng.uniform(-1, 1, 6)
        place = np.asarray(robot.arm.pose(q), dtype=float)[:3, 3]
        rows += [[*q, *(place + rng.normal(0, 1e-4, 3)), pose] for _ in range(2)]
    names = [*(f"{name} [rad]" for name in robot.robot.joint_names), "x [m]", "y [m]", "z [m]", "pose"]
    table = dict(zip(names, np.array(rows).T, strict=True))
    found = problem_of_measured_robot({"kind": "preset", "name": "ur10"}, table)
    assert found.measurement is not None
    assert found.measurement.degrees_of_freedom == 36
