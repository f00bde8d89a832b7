"""Touches show no length: what only moves the places or the tool must not pass for growth of the arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.estimation.effect_sensitivities import case_of
from posture_opt.calibration.estimation.effects_fit import fit_with_effects
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.model.effects import InstrumentField, JointCompliance
from posture_opt.report.measured_parts.contradictions import doubts_lead
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


def test_what_geometry_can_pass_for_is_that_of_the_arm_without_its_effects(touches: Residuals) -> None:
    """Beside a compliance, geometry that does nothing else moves its lever: then all of it seemed to be geometry."""
    zero = np.zeros(len(touches.parameters))
    fit = fit_with_effects(
        touches, zero, np.eye(len(zero)), [JointCompliance(joint="joint_a2", loads="points", points=("tool",))]
    )
    assert fit.x[fit.sizes] != 0
    plain = touches.residuals_and_jacobian(fit.x[: len(zero)])[1]
    G = plain @ fit.directions[: len(zero)][:, fit.geometry]
    rank = np.linalg.matrix_rank(G / np.maximum(np.linalg.norm(G, axis=0), 1e-300), tol=1e-6)
    assert fit.imitating.shape == (len(G), rank)
    assert fit.imitating @ (fit.imitating.T @ G) == pytest.approx(G, rel=1e-6, abs=1e-3)


def test_touches_have_no_instrument_whose_field_could_err(touches: Residuals) -> None:
    assert not InstrumentField.candidates(case_of(touches.data, touches.robot))


def planar_touches(rng: np.random.Generator, stated: float) -> po.Calibration:
    """An arm of two links of 1 m touches three points twelve times each; one of their distances is stated wrongly."""
    places = {"a": (1.2, 0.3), "b": (0.4, 1.1), "c": (-0.9, 0.7)}
    rows: dict[str, list[float | str]] = {"point": [], "joint1 [rad]": [], "joint2 [rad]": []}
    for name, place in places.items():
        for k in range(12):
            x, y = np.array(place) + rng.normal(0, 5e-5, 2)
            bend = (-1) ** k * np.arccos((x * x + y * y - 2) / 2)
            rows["point"].append(name)
            rows["joint1 [rad]"].append(np.arctan2(y, x) - bend / 2)
            rows["joint2 [rad]"].append(bend)
    ab, bc = (float(np.linalg.norm(np.subtract(places[i], places[j]))) for i, j in (("a", "b"), ("b", "c")))
    problem = po.problem_from_dict({
        "robot": {"kind": "dh", "joints": [{"name": f"joint{i}", "a": "1 m"} for i in (1, 2)]},
        "uncertainty": {"measurement": {"position": "0.05 mm"}},
        "data": {"distances": [["a", "b", f"{ab + stated} m"], ["b", "c", f"{bc} m"]]},
    })  # fmt: skip
    return po.calibrate(problem, po.read_measurements(rows, problem))


def test_a_distance_that_is_stated_wrongly_is_doubted() -> None:
    wrong = planar_touches(np.random.default_rng(4), 2e-3)
    line = next(line for line in doubts_lead(wrong) if "distance" in line)
    assert line.startswith("The distance of a and b, stated as 1133.37 mm, comes out")
    assert "mm shorter" in line
    assert not any("distance" in line for line in doubts_lead(planar_touches(np.random.default_rng(4), 0.0)))


def test_what_a_tolerance_holds_is_not_determined_by_the_rows(touches: Residuals) -> None:
    held = planar_touches(np.random.default_rng(4), 0.0).fit.held_by_prior
    assert np.all(held >= 1 - 1e-9)
    problem = po.load_problem(PROBLEMS / "kuka_iiwa14_sockets.yaml")
    fit = po.calibrate(problem, po.read_measurements(PROBLEMS / "kuka_iiwa14_sockets.csv", problem)).fit
    ratio = dict(zip([p.name for p in fit.residuals.parameters], fit.held_by_prior, strict=True))
    assert ratio["joint_a1.d"] == np.inf  # the height of the column
    assert ratio["joint_a4.alpha"] < 3
