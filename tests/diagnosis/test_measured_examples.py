"""The measured examples: their numbers are those of the simulators that are named, and what is planned hits there."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from tests.helpers import measured_planar_2r as shop
from tests.helpers import measured_ur10 as loaded
from tests.helpers.shipped import PROBLEMS

LOADED = "ur10_measured", "ur10_another_day"


def test_the_file_holds_what_the_simulator_measures() -> None:
    lines = (PROBLEMS / "planar_2r_measured.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == shop.HEAD
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    off = 1e-3 * table[:, 2:] - shop.reached(np.radians(table[:, :2]))
    # Scatter of joints at levers of 1 to 2 m and the instrument: 0.1 to 0.2 mm.
    assert len(table) == 60
    assert 0.05e-3 < np.sqrt(np.mean(off**2)) < 0.25e-3


def test_the_loaded_files_hold_what_the_simulator_measures() -> None:
    for name, count, seed in (("ur10_measured", 110, 3), ("ur10_another_day", 40, 4)):
        lines = (PROBLEMS / f"{name}.csv").read_text(encoding="utf-8").splitlines()
        table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
        assert lines[0] == loaded.HEAD
        assert np.allclose(table, loaded.rows(count, seed), rtol=0, atol=1e-3)  # µm, and thousandths of a degree


@pytest.mark.conformance
def test_what_is_hidden_in_the_loaded_arm_is_found_and_the_plan_with_it_hits() -> None:
    problem = po.load_problem("insert_ur10_measured")
    data, other = (po.read_measurements(PROBLEMS / f"{n}.csv", problem) for n in LOADED)
    found = po.diagnose(problem, data, test=other)
    assert [(e.kind, e.target) for e in found.effects] == [
        ("joint_compliance", "elbow"),
        ("backlash", "shoulder_pan"),
        ("geometry", "all"),
    ]
    for effect, hidden in zip(found.effects, (loaded.COMPLIANCE, loaded.PLAY), strict=False):
        value, std, _ = next(iter(effect.estimate.values()))
        assert abs(value - hidden) < 3 * std < 0.15 * hidden
    assert found.test.gain.low > 0.6
    assert not any("unit right" in note for note in found.extended.notes)
    chosen = po.select_posture(found.extended)
    off = loaded.reached(chosen.q, 5.0, 1.0)[:2] - (0.7, 0.2)  # across the direction
    assert np.linalg.norm(off) < 3.5 * chosen.critical.sigma_max
    # The arm as the file states it stands by half a millimetre elsewhere.
    old = loaded.reached(po.select_posture(problem).q, 5.0, 1.0)[:2] - (0.7, 0.2)
    assert np.linalg.norm(old) > 10 * np.linalg.norm(off)


@pytest.mark.conformance
def test_a_real_arm_comes_with_the_program() -> None:
    problem = po.load_problem("kuka_iiwa14_sockets")
    data = po.read_measurements(PROBLEMS / "kuka_iiwa14_sockets.csv", problem)
    found = po.diagnose(problem, data, plan=False)
    named = {(e.kind, e.target) for e in found.effects if e.kind != "geometry"}
    assert named == {("joint_compliance", f"joint_a{i}") for i in (2, 3, 4)}
    errors = found.to_json()["residual_rms"]
    assert errors["nominal"] == pytest.approx(0.566e-3, abs=0.01e-3)
    assert errors["calibrated"] == pytest.approx(0.271e-3, abs=0.01e-3)
    assert errors["extended"] == pytest.approx(0.163e-3, abs=0.01e-3)
    assert errors["delivered"] < errors["delivered_heldout"] == errors["extended"]
