"""Neighbouring postures that err alike: a few hundred rows of them tell less than as many independent ones."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import planar_rows
from tests.helpers.real_arms import DATA, long_on_real_arms
from tests.helpers.simulated_session import SimulatedSession, beyond_geometry
from tests.hidden.designs import Plan
from tests.hidden.effects import Effect
from tests.hidden.noise import SIGMA

NOISE = 2e-5  # m
UR10 = DATA / "ipa_ur10"


def test_another_session_stands_in_another_frame() -> None:
    rng = np.random.default_rng(6)
    sessions = []
    for turn in (0.0, 2.0):
        q = rng.uniform(-2.8, 2.8, (120, 2))
        error = np.stack([turn + 5e-4 * np.cos(q[:, 0]), 1e-3 * np.sin(q[:, 1])], axis=1)
        sessions.append(planar_rows(q, position(q + error) + rng.normal(0, NOISE, q.shape)))
    found = po.diagnose(*sessions[0], test=sessions[1][1], refit_frames=True)
    # Along the axes of the first session's world the effects would make it worse; noise is 0.02 mm times the root of 2.
    assert found.test.models["extended"].rms < 1.2 * np.sqrt(2) * NOISE
    assert found.test.models["calibrated"].rms > 10 * NOISE
    assert any("fitted again" in note for note in found.test.notes)


@long_on_real_arms
def test_ur10_lines_of_one_session_improve_another() -> None:
    problem = po.load_problem(UR10 / "problem.yaml")
    first, second = (po.read_measurements(UR10 / f"series_{name}.csv", problem) for name in "ab")
    # Every 24th place of the first session, with all postures of the wrist about each, for time.
    places = np.unique(np.round(first.q[:, :3] / 0.02), axis=0, return_inverse=True)[1].ravel()
    learnt = first.take(np.flatnonzero(places % 24 == 0))
    found = po.diagnose(problem, learnt, test=second, refit_frames=True, flips=49)
    assert found.errors["extended"].rms < 0.5 * found.errors["calibrated"].rms
    assert found.test.gain.low > 0.05
    assert {f.target for f in found.effects if f.kind == "cyclic_error"} >= {"shoulder_pan", "shoulder_lift", "elbow"}


# --- An effect of usual size beside one ten times as large, which must not hide it by what it does to the null --------


@pytest.mark.long
def test_a_joint_that_turns_with_heat_is_found_beside_a_joint_whose_scale_is_off() -> None:
    case = SimulatedSession(601, "ur10", Plan(logged=True))
    large = Effect("joint_scale", "joint3", {"c": 4e-4})
    small = Effect("thermal_offset", "joint2", {"c": 12e-6})
    document, points = case.document(), case.points(large, small)
    table = case.table(points) | {"temperature [degC]": case.session.temperature}
    found = case.diagnosis(table, document)
    assert beyond_geometry(found) == [("joint_scale", "joint3"), ("thermal_offset", "joint2")]
    assert found.verdict == "effects_found"
    # Noise of three coordinates, and what 25 parameters cost beside 450 of them.
    assert found.errors["extended"].rms < 1.2 * 3**0.5 * SIGMA
