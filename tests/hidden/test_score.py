"""The harness scores answers that are made up: right, ambiguous, wrong, and none."""

from __future__ import annotations

from typing import Any

import pytest

from tests.hidden.hunt import deal, options_of
from tests.hidden.score import score
from tests.hidden.table import interval, report


def truth(*effects: tuple[str, str], strength: float = 100.0, **more: Any) -> dict[str, Any]:
    listed = [
        {"kind": k, "target": t, "size": {"c": 2e-4}, "shape": {}, "lambda": strength, "rivals": []} for k, t in effects
    ]
    known = {"family": "full", "seed": 0, "index": 0, "arm": "ur10", "rms": 1e-4, "gross_rows": []}
    return known | {"effects": listed} | more


def answer(
    *effects: tuple[str, str], verdict: str = "effects_found", beside: Any = (), value: float = 2e-4
) -> dict[str, Any]:
    listed = [
        {
            "kind": k,
            "target": t,
            "estimate": {"scale": {"value": value, "std": 1e-5, "unit": "rad/rad"}, "shape": {"value": 1, "std": None}},
            "confounded_with": [{"kind": a, "target": b} for a, b in beside],
        }
        for k, t in effects
    ]
    return {"verdict": verdict, "effects": listed, "residual_rms": {"extended": 1.02e-4}}


SCALE, WAVE = ("joint_scale", "joint2"), ("gear_eccentricity", "joint2")
GEOMETRY = ("geometry", "all")


def test_a_right_answer_is_right_in_every_respect() -> None:
    found = score(truth(SCALE), answer(SCALE, GEOMETRY))
    assert all(found[key] for key in ("first", "exact", "inside", "all_named"))
    assert (found["sizes_held"], found["sizes"], found["extra"]) == (1, 1, 0)
    assert found["rms_ratio"] == pytest.approx(1.02)


def test_a_size_three_sigma_off_is_not_held() -> None:
    found = score(truth(SCALE), answer(SCALE, value=2.3e-4))
    assert (found["sizes_held"], found["sizes"]) == (0, 1)


def test_the_truth_in_the_ambiguity_set_is_inside_and_not_first() -> None:
    found = score(truth(SCALE), answer(WAVE, beside=[SCALE]))
    assert not found["first"]
    assert not found["exact"]
    assert found["inside"]
    assert not score(truth(SCALE), answer(WAVE))["inside"]
    assert not score(truth(SCALE), answer(WAVE, ("slip", "base"), beside=[("drift", "linear")]))["inside"]


def test_a_rival_that_the_data_cannot_part_is_marked() -> None:
    known = truth(SCALE)
    known["effects"][0]["rivals"] = [{"kind": WAVE[0], "target": WAVE[1], "lost": 1.0}]
    assert score(known, answer(WAVE))["excused"]
    assert not score(known, answer(SCALE))["excused"]


def test_an_extra_name_or_an_unexplained_rest_spoils_the_verdict_and_not_the_first_name() -> None:
    for wrong in (answer(SCALE, ("slip", "base")), answer(SCALE, verdict="unexplained")):
        found = score(truth(SCALE), wrong)
        assert found["first"]
        assert not found["exact"]
        assert not found["inside"]


def test_geometry_counts_where_it_is_the_truth_alone() -> None:
    length = ("link_length", "joint2")
    assert score(truth(length), answer(length, ("base_frame", "base")))["exact"]
    assert not score(truth(length), answer(GEOMETRY))["first"]
    assert score(truth(SCALE), answer(SCALE, length))["exact"]
    assert score(truth(), answer(GEOMETRY))["exact"]


def test_the_table_counts_alarms_unexplained_and_errors() -> None:
    records = [score(truth(SCALE), answer(SCALE)), score(truth(SCALE), None, 1.0, "Traceback\nValueError: no")]
    records += [score(truth(family="clean"), answer(SCALE)), score(truth(family="clean"), answer(GEOMETRY))]
    dent = truth(("dent", "joint1"), family="outside")
    records += [
        score(dent, answer(verdict="unexplained")),
        score(dent, answer(WAVE)),
        score(dent, answer(verdict="none_found")),
    ]
    lines = report(records).splitlines()
    assert any(line.startswith("full") and "100.0 %" in line for line in lines)
    assert any(line.startswith("clean") and "50.0 %" in line for line in lines)
    assert any(line.startswith("all") and line.count("33.3 %") == 3 for line in lines)
    assert any("ValueError: no" in line for line in lines)


def test_the_second_session_counts_what_holds_there_and_what_is_claimed() -> None:
    def tested(found: dict[str, Any], extended: float, low: float, gain: float | None = None) -> dict[str, Any]:
        rms = {"nominal": {"rms": 3e-4}, "calibrated": {"rms": 2e-4}, "extended": {"rms": extended}}
        for e in found["effects"][:1] if gain is not None else ():
            e["test_gain"] = {"value": gain, "interval95": [low, 1.0]}
        return found | {"test": {**rms, "gain": {"value": 1 - extended / 2e-4, "interval95": [low, 1.0]}}}

    records = [
        score(truth(SCALE), tested(answer(SCALE), 1e-4, 0.3, gain=0.5)),
        score(truth(SCALE), tested(answer(SCALE), 2.2e-4, -0.3, gain=-0.1)),
        score(truth(("slip", "base")), tested(answer(("slip", "base")), 2e-4, 0.0)),
        score(truth(family="clean"), tested(answer(GEOMETRY), 2e-4, 0.0)),
        score(truth(family="clean"), answer(GEOMETRY)),
    ]
    table = report(records).split("second session")[1].splitlines()
    rows = {line.split("  ")[0]: line for line in table[1:]}
    assert rows["hidden and rightly named"].count("50.0 %") == 3
    assert " 1  " in rows["of one session only, left out there"]
    assert rows["nothing hidden"].count("  0.0 %") == 2
    assert "second session" not in report(records[-1:])


def test_intervals_are_wilsons() -> None:
    # Newcombe (1998), Statistics in Medicine 17, 857: 81 of 263 has 0.2553 … 0.3662.
    assert interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)


def test_trials_are_dealt_over_the_families() -> None:
    assert deal(5, ["full", "clean"]) == [("full", 0), ("clean", 0), ("full", 1), ("clean", 1), ("full", 2)]
    assert options_of(["--family", "full", "--seed", "9"]).family == ["full"]
