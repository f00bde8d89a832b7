"""Touches show no length: what only moves the places or the tool must not pass for growth of the arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.estimation.residuals import Residuals
from tests.helpers.real_arms import DATA, long_on_real_arms

PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.fixture(scope="module")
def touches() -> Residuals:
    problem = po.load_problem(PROBLEMS / "kuka_iiwa14_sockets.yaml")
    data = po.read_measurements(PROBLEMS / "kuka_iiwa14_sockets.csv", problem)
    found = po.calibrate(problem, data).residuals
    # a known distance would hold the size, and the arm would not be compared with itself
    return replace(found, distances=())


def test_a_higher_column_under_higher_places_changes_nothing(touches: Residuals) -> None:
    """811 m of column once made every error of a real arm vanish."""
    zero = np.zeros(len(touches.parameters))
    height = 5.0  # m
    moved = [p.name == "joint_a1.d" or (p.group == "place" and p.axis == 2) for p in touches.parameters]
    higher = np.where(moved, height, zero)
    places = touches.places(zero)
    assert touches.places(higher)[:, 2] == pytest.approx(places[:, 2] + height)
    assert touches.whitened(higher) == pytest.approx(touches.whitened(zero), abs=1e-6)


def test_a_larger_arm_in_a_larger_world_errs_no_less(touches: Residuals) -> None:
    zero = np.zeros(len(touches.parameters))
    larger = np.array([0.5 * p.nominal if p.unit == "m" else 0.0 for p in touches.parameters])
    assert touches.whitened(larger) == pytest.approx(touches.whitened(zero), rel=1e-9)


@long_on_real_arms
def test_no_length_of_a_real_arm_is_off_by_more_than_a_decimetre() -> None:
    folder = DATA / "mukca_sockets"
    problem = po.load_problem(folder / "problem_panda.yaml")
    found = po.diagnose(problem, po.read_measurements(folder / "panda_3.csv", problem))
    geometry = [finding for finding in found.effects if finding.effect is None and finding.noise is None]
    sizes = [value for finding in geometry for value, _, unit in finding.estimate.values() if unit == "m"]
    assert geometry
    assert all(abs(size) < 0.1 for size in sizes)
