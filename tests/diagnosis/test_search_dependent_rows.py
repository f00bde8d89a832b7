"""Neighbouring postures that err alike: a few hundred rows of them tell less than as many independent ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write
from tests.helpers.real_arms import DATA, long_on_real_arms
from tests.helpers.simulated_session import SimulatedSession, beyond_geometry
from tests.helpers.variants import conformance
from tests.hidden.designs import Plan
from tests.hidden.effects import Effect
from tests.hidden.noise import SIGMA

NOISE = 2e-5  # m
UR10 = DATA / "ipa_ur10"


def measured(folder: Path, name: str, q: np.ndarray, error: np.ndarray, rng: np.random.Generator) -> po.Measurements:
    write(folder / name, q, position(q + error) + rng.normal(0, NOISE, q.shape))
    return po.read_measurements(folder / name, po.problem_from_dict(PROBLEM))


def test_what_is_alone_in_independent_rows_is_found_alone(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    q = rng.uniform(-2.8, 2.8, (150, 2))
    # So much that the geometry alone leaves neighbours alike; once it is taken away they are not.
    error = np.stack([np.zeros(150), 1e-3 * np.sin(q[:, 1] + 0.5)], axis=1)
    data = measured(tmp_path, "data.csv", q, error, rng)
    found = po.diagnose(po.problem_from_dict(PROBLEM), data, plan=False)
    assert [f.kind for f in found.effects] == ["gear_eccentricity"]


def test_another_session_stands_in_another_frame(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    sessions = []
    for name, turn in (("data.csv", 0.0), ("other.csv", 2.0)):
        q = rng.uniform(-2.8, 2.8, (120, 2))
        error = np.stack([turn + 5e-4 * np.cos(q[:, 0]), 1e-3 * np.sin(q[:, 1])], axis=1)
        sessions.append(measured(tmp_path, name, q, error, rng))
    found = po.diagnose(po.problem_from_dict(PROBLEM), sessions[0], test=sessions[1], refit_frames=True)
    assert found.test is not None
    # Along the axes of the first session's world the effects would make it worse; noise is 0.02 mm times the root of 2.
    assert found.test.models["extended"].rms < 1.2 * np.sqrt(2) * NOISE
    assert found.test.models["calibrated"].rms > 10 * NOISE


@long_on_real_arms
def test_ur10_lines_of_one_session_improve_another() -> None:
    problem = po.load_problem(UR10 / "problem.yaml")
    first, second = (po.read_measurements(UR10 / f"series_{name}.csv", problem) for name in "ab")
    # Every 24th place of the first session, with all postures of the wrist about each, for time.
    places = np.unique(np.round(first.q[:, :3] / 0.02), axis=0, return_inverse=True)[1].ravel()
    learnt = first.take(np.flatnonzero(places % 24 == 0))
    found = po.diagnose(problem, learnt, test=second, refit_frames=True, flips=49)
    assert found.test is not None
    assert found.errors["extended"].rms < 0.5 * found.errors["calibrated"].rms
    assert found.test.gain.low > 0.05
    assert {f.target for f in found.effects if f.kind == "cyclic_error"} >= {"shoulder_pan", "shoulder_lift", "elbow"}


# --- An effect of usual size beside one ten times as large, which must not hide it by what it does to the null --------


@pytest.mark.parametrize("seed", conformance([601, 602, 603], [601]))
def test_a_joint_that_turns_with_heat_is_found_beside_a_joint_whose_scale_is_off(seed: int) -> None:
    case = SimulatedSession(seed, "ur10", Plan(logged=True))
    large = Effect("joint_scale", "joint3", {"c": 4e-4})
    small = Effect("thermal_offset", "joint2", {"c": 12e-6})
    document, points = case.document(), case.points(large, small)
    table = case.table(points) | {"temperature [degC]": case.session.temperature}
    found = case.diagnosis(table, document)
    assert beyond_geometry(found) == [("joint_scale", "joint3"), ("thermal_offset", "joint2")]
    assert found.verdict == "effects_found"
    # Noise of three coordinates, and what 25 parameters cost beside 450 of them.
    assert found.errors["extended"].rms < 1.2 * 3**0.5 * SIGMA


def test_nothing_is_found_beside_a_large_effect_where_nothing_is() -> None:
    case = SimulatedSession(604, "ur10", Plan(logged=True))
    points = case.points(Effect("joint_scale", "joint3", {"c": 8e-4}))
    table = case.table(points) | {"temperature [degC]": case.session.temperature}
    assert beyond_geometry(case.diagnosis(table)) == [("joint_scale", "joint3")]
