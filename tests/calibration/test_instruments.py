"""Arms with known errors, measured by plates and draw wires of a simulator of its own, and calibrated."""

from __future__ import annotations

import json

import numpy as np
import pytest

import posture_opt as po
from posture_opt.report.figures.residual_trends import plot_residuals_over_joints
from posture_opt.report.figures.residuals import Shown
from tests.helpers.instruments import (
    ANCHORS,
    PLANES,
    TrueArm,
    deviations,
    distance_table,
    level_table,
    plane_table,
)
from tests.helpers.variants import conformance

SIGMA = 2e-5  # m


def problem(tool: list[str], **more: object) -> po.Problem:
    return po.problem_from_dict(
        {
            "robot": {
                "kind": "preset",
                "name": "ur10",
                "tool": {"xyz": tool, "rpy": ["0 deg", "0 deg", "0 deg"], "free": True},
            },
            "uncertainty": {"measurement": {"plane": "0.02 mm", "distance": "0.02 mm"}},
            **more,
        }
    )


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


@pytest.mark.conformance
def test_lengths_of_a_wire_are_drawn() -> None:
    rng = np.random.default_rng(6)
    given = problem(["30 mm", "-20 mm", "120 mm"])
    data = po.read_measurements(distance_table(TrueArm.drawn(rng), rng, 15, SIGMA), given)
    figures = po.calibrate(given, data, plan=False).figures()
    assert set(figures) >= {"residual_joints", "residual_shape"}
    assert not {"residual_vectors", "residual_region"} & set(figures)  # of one number a row there is neither


@pytest.mark.parametrize("offset", conformance([0.0, 0.05], [0.05]))
def test_distances_find_the_arm_its_size_and_the_anchors(offset: float) -> None:
    rng = np.random.default_rng(6)
    arm = TrueArm.drawn(rng)
    anchors = {f"bar{k}": {"offset": "free"} for k in range(4)} if offset else {}
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
        assert ("offset" in place) is bool(offset)
        assert not offset or abs(place["offset"] - offset) < 1e-3


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
    drawn = plot_residuals_over_joints(Shown.of(found))
    joints = {axes.get_xlabel().partition(" ")[0] for axes in drawn.axes}
    assert "elbow" in joints
    assert "shoulder_pan" not in joints  # which turns about the vertical


def test_another_file_has_planes_of_its_own() -> None:
    rng = np.random.default_rng(7)
    arm = TrueArm.drawn(rng)
    given = problem(["30 mm", "-20 mm", "120 mm"])
    data, other = (po.read_measurements(plane_table(arm, rng, n, SIGMA), given) for n in (40, 12))
    found = po.calibrate(given, data, test=other, plan=False)
    assert found.test is not None
    assert found.test.models["calibrated"].rms < 2 * SIGMA < 0.2 * found.test.models["nominal"].rms
    wire = po.read_measurements(distance_table(arm, rng, 5, SIGMA), given)
    with pytest.raises(po.errors.InputError, match="the test file holds distances, the first file touches of planes"):
        po.calibrate(given, data, test=wire, plan=False)
