"""Arms with known errors, measured by plates and draw wires of a simulator of its own, and calibrated."""

from __future__ import annotations

import json

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.instruments import (
    ANCHORS,
    PLANES,
    TrueArm,
    deviations,
    distance_table,
    level_table,
    plane_table,
)
from tests.helpers.pairs import tool_at, ur10_problem

SIGMA = 2e-5  # m


def problem(tool: list[str], **more: object) -> po.Problem:
    return ur10_problem({"plane": "0.02 mm", "distance": "0.02 mm"}, tool_at(*tool), **more)


def test_planes_find_the_arm_from_a_tool_that_is_off_by_a_quarter_of_a_metre() -> None:
    rng = np.random.default_rng(5)
    arm = TrueArm.drawn(rng)
    given = problem(["0.2 m", "-0.2 m", "0 m"], data={"planes": {f"plate{k}": {"radius": "5 mm"} for k in range(3)}})
    found = po.calibrate(given, po.read_measurements(plane_table(arm, rng, 40, SIGMA), given), plan=False)
    z = deviations(found, arm)
    assert len(z) > 12
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.6
    assert found.calibrated.rms < 1.5 * SIGMA
    document = json.loads(json.dumps(found.to_json()["instruments"]))["plane"]
    assert (document["kind"], document["rows"], document["unit"]) == ("plane", 120, "m")
    assert document["rms"] == pytest.approx(found.calibrated.rms)
    for k, (normal, _) in enumerate(PLANES):
        toward = normal if k == 0 else -normal  # the base stands above the first plane and behind the others
        assert np.allclose(document["unknowns"][f"plate{k}"]["normal"], toward, atol=2e-3)


def test_distances_find_the_arm_its_size_and_the_anchors() -> None:
    rng, offset = np.random.default_rng(6), 0.05
    arm = TrueArm.drawn(rng)
    anchors = {f"bar{k}": {"offset": "free"} for k in range(4)}
    given = problem(["30 mm", "0 mm", "0.3 m"], data={"anchors": anchors})
    found = po.calibrate(given, po.read_measurements(distance_table(arm, rng, 30, SIGMA, offset), given), plan=False)
    z = deviations(found, arm)
    assert len(z) > 14
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.6
    assert "shoulder_lift.a" in [p.name for p, fixed in zip(found.parameters, found.fixed, strict=True) if fixed]
    unknowns = found.to_json()["instruments"]["distance"]["unknowns"]
    for k, anchor in enumerate(ANCHORS):
        place = unknowns[f"bar{k}"]
        assert np.hypot(*[place[a] - v for a, v in zip("xy", anchor, strict=False)]) < 3e-3
        assert abs(place["offset"] - offset) < 1e-3


def test_a_level_finds_the_angles_that_it_sees() -> None:
    rng = np.random.default_rng(9)
    arm = TrueArm.drawn(rng)
    text = {"robot": {"kind": "preset", "name": "ur10"}, "uncertainty": {"measurement": {"level": "0.002 deg"}}}
    given = po.problem_from_dict(text)
    found = po.calibrate(given, po.read_measurements(level_table(arm, rng, 60, np.radians(0.002)), given), plan=False)
    z = deviations(found, arm)
    assert len(z) > 6
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.6
    fixed = [p.name for p, known in zip(found.parameters, found.fixed, strict=True) if known and p.group == "geometry"]
    assert not [name for name in fixed if name.endswith((".a", ".d"))]  # no lengths
    assert "shoulder_pan.theta" not in fixed  # no turn about the vertical
    document = found.to_json()["instruments"]["level"]
    assert document["unit"] == "rad"
    assert document["sigma"] == pytest.approx(np.radians(0.002))
    assert "A level sees neither lengths nor a turn about the vertical" in " ".join(found.report().split())


def test_another_file_has_planes_of_its_own() -> None:
    rng = np.random.default_rng(7)
    arm = TrueArm.drawn(rng)
    given = problem(["30 mm", "-20 mm", "120 mm"])
    data, other = (po.read_measurements(plane_table(arm, rng, n, SIGMA), given) for n in (40, 12))
    found = po.calibrate(given, data, test=other, plan=False)
    assert found.test.models["calibrated"].rms < 2 * SIGMA < 0.2 * found.test.models["nominal"].rms
    wire = po.read_measurements(distance_table(arm, rng, 5, SIGMA), given)
    with pytest.raises(po.errors.InputError, match="the test file holds distances, the first file touches of planes"):
        po.calibrate(given, data, test=wire, plan=False)


def test_each_plane_counts_by_its_own_flatness() -> None:
    rng = np.random.default_rng(8)
    arm = TrueArm.drawn(rng)
    table = plane_table(arm, rng, 30, SIGMA)
    given = problem(["30 mm", "-20 mm", "120 mm"], data={"planes": {"plate1": {"flatness": "0.2 mm"}}})
    residuals = po.calibrate(given, po.read_measurements(table, given), plan=False).residuals
    sigma = dict(zip(table["plane"].tolist(), residuals.row_sigma.tolist(), strict=True))
    assert sigma == pytest.approx({"plate0": 2e-5, "plate1": np.hypot(2e-5, 2e-4), "plate2": 2e-5})


def test_zeros_set_by_hand_do_not_loosen_the_lengths() -> None:
    """Zeros off by 5 mrad beside lengths of 0.1 mm, as of real arms: one width for all would leave lengths open."""
    rng = np.random.default_rng(31)
    errors = rng.normal(0, 1, (6, 4)) * np.array([5e-3, 1e-4, 1e-4, 3e-4])
    arm = TrueArm(errors=errors)
    given = ur10_problem({"distance": "0.02 mm"})
    table = {k: v for k, v in distance_table(arm, rng, 15, 2e-5).items() if not k.endswith(".approach")}
    found = po.calibrate(given, po.read_measurements(table, given), folds=2, plan=False)
    width = dict(zip((p.name for p in found.parameters), found.prior.tolist(), strict=True))
    assert width["elbow.a"] < 0.4e-3
    assert width["elbow.theta"] > 2e-3
    assert any("lengths 0." in note and "zeros of joints" in note for note in found.notes)
