"""Two arms whose tools touch, of a simulator of its own: one held, or both calibrated together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.instruments import TrueArm, deviations, misplaced, postures
from tests.helpers.pairs import SECOND_BASE, pair_problem, pair_table, tool_at

SIGMA = 2e-5  # m, of each coordinate


def tool_error(found: po.Calibration, arm: TrueArm) -> float:
    """RMS error of the tool point at other postures, the base and the tool aligned [m]."""
    values = {p.name: p.nominal + v for p, v in zip(found.parameters, found.x, strict=True)}
    q = postures(np.random.default_rng(99), 60)
    return misplaced(values, q, arm.point(q), tool=True)


@pytest.mark.long
def test_a_held_arm_calibrates_the_other_one_from_a_tool_off_by_a_third_of_a_metre(tmp_path: Path) -> None:
    rng = np.random.default_rng(31)
    one, two = TrueArm.drawn(rng), TrueArm()
    held = tool_at("30 mm", "-20 mm", "120 mm", free=False)
    given = pair_problem(tmp_path, tool_at("230 mm", "-220 mm", "0 mm"), held, held=True)
    data = po.read_measurements(pair_table(one, two, rng, 40, SIGMA), given)
    assert np.array_equal(po.read_measurements(data.to_dataframe(), given).reading, data.reading)
    found = po.calibrate(given, data, plan=False)
    z = deviations(found, one)
    assert len(z) > 12
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.6
    assert tool_error(found, one) < 6e-5
    document = found.to_json()["instruments"]["pair"]
    assert (document["kind"], document["rows"], document["unit"], document["sigma"]) == ("pair", 40, "m", SIGMA)
    place = document["unknowns"]["right"]
    assert np.allclose([place[a] for a in "xyz"], SECOND_BASE[:3, 3], atol=3e-3)
    assert place["yaw"] == pytest.approx(2.6, abs=2e-3)
    report = " ".join(found.report().split())
    assert "Touches of two arms say nothing of shoulder_pan.theta and what lies before it" in report
    assert "it moves arm and the second arm together" in report
    assert "the size of the arm" not in report  # the lengths of the held arm determine it


@pytest.mark.conformance
def test_both_arms_are_found_and_no_scale(tmp_path: Path) -> None:
    distance, rng = 0.025, np.random.default_rng(32)
    one, two = TrueArm.drawn(rng), TrueArm.drawn(rng)
    roughly = tool_at("100 mm", "-100 mm", "60 mm")
    given = pair_problem(tmp_path, roughly, roughly, distance=f"{distance} m")
    table = pair_table(one, two, rng, 160, SIGMA, distance)
    found = po.calibrate(given, po.read_measurements(table, given), plan=False)
    own = zip(found.parameters, found.x, found.std, found.fixed, strict=True)
    z = np.array([(x - two.error_of(p.name[6:])) / s for p, x, s, fixed in own if p.group == "second_arm" and fixed])
    for errors in (z, deviations(found, one)):
        assert len(errors) > 12
        assert 0.5 < np.sqrt(np.mean(errors**2)) < 1.7
    assert 0.75 < found.variance < 1.3
    assert "Two arms that touch give no scale" in " ".join(found.report().split())
    for name, content in po.calibrated_problem(given, found).files("calibrated").items():
        (tmp_path / name).write_bytes(content)
    again = po.load_problem(tmp_path / "calibrated.yaml")
    assert again.to_dict()["data"]["pairs"]["right"]["problem"] == "calibrated_right.yaml"
    there = po.calibrate(again, po.read_measurements(table, again), plan=False)
    assert there.nominal.rms < 1.2 * found.calibrated.rms  # both files are the arms


def test_faulty_sections_are_named(tmp_path: Path) -> None:
    tool = tool_at("0 mm", "0 mm", "100 mm")
    table = pair_table(TrueArm(), TrueArm(), np.random.default_rng(0), 3, 0.0)
    given = pair_problem(tmp_path, tool, tool)
    with pytest.raises(po.errors.InputError, match=r"right\.elbow \[rad\]|right\.elbow"):
        po.read_measurements({k: v for k, v in table.items() if k != "right.elbow [rad]"}, given)
    bare = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}})
    with pytest.raises(po.errors.InputError, match="unknown"):
        po.read_measurements(table, bare)
    with pytest.raises(po.errors.InputError, match=r"no such file"):
        po.problem_from_dict(
            {"robot": {"kind": "preset", "name": "ur10"}, "data": {"pairs": {"left": {"problem": "left.yaml"}}}},
            folder=tmp_path,
        )
    wrong = {"robot": {"kind": "preset", "name": "ur99"}}
    (tmp_path / "wrong.yaml").write_text("robot: {kind: preset, name: ur99}\n")
    with pytest.raises(po.errors.InputError, match="ur99"):
        po.problem_from_dict({**wrong, "data": {"pairs": {"left": {"problem": "wrong.yaml"}}}}, folder=tmp_path)
    two = {"a": {"problem": "right.yaml"}, "right": {"problem": "right.yaml"}}
    several = po.problem_from_dict(
        {"robot": {"kind": "preset", "name": "ur10"}, "data": {"pairs": two}}, folder=tmp_path
    )
    more = {**table, **{k.replace("right", "a"): v for k, v in table.items() if k.startswith("right")}}
    with pytest.raises(po.errors.InputError, match="several second arms: a, right"):
        po.read_measurements(more, several)
