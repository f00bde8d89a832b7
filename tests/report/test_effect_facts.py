"""Reports on an arm with effects say which, how large, and for which inputs the numbers hold."""

from __future__ import annotations

import json
from typing import Any, Literal, get_origin

import pytest

import posture_opt as po
from posture_opt.model.effects import CATALOGUE, EFFECTS
from posture_opt.problem.problem import Problem
from posture_opt.report.parts.parts import effect_facts, input_facts
from posture_opt.uncertainty.sources.sources import source_size, source_words
from posture_opt.units import DIMENSIONS, shown
from tests.helpers.command_line import invoke

EFFECTS_SECTION = [
    {"kind": "joint_compliance", "joint": "joint2", "estimate": {"compliance": "8 urad/(N m)"}},
    {"kind": "backlash", "joint": "joint1", "estimate": {"width": "0.1 mrad"}},
    {"kind": "backlash", "joint": "joint2", "estimate": {"width": "0.2 mrad"}},
    {"kind": "gear_eccentricity", "joint": "joint1", "estimate": {"sin": "0.3 mrad", "cos": "0.4 mrad"}},
    {"kind": "cyclic_error", "joint": "joint1", "cycles": 12, "estimate": {"sin": "0.03 mrad", "cos": "0.04 mrad"}},
    {"kind": "thermal_growth", "estimate": {"expansion": "12e-6 /K"}},
]


def problem(effects: list[dict[str, Any]], **task: Any) -> Problem:
    joints = [{"name": f"joint{i}", "a": "500 mm", "mass": "2 kg", "com": ["-250 mm", "0 mm", "0 mm"]} for i in (1, 2)]
    return po.problem_from_dict({
        "robot": {"kind": "dh", "gravity": [0, -9.81, 0], "joints": joints},
        "uncertainty": {"sigma": {"joint1.theta": "0.1 mrad"}},
        "effects": effects,
        "task": {"kind": "insert", "direction": [0, 1, 0], **task},
    })  # fmt: skip


def test_effects_and_their_inputs_are_told() -> None:
    arm = problem(EFFECTS_SECTION, payload="5 kg", approach={"joint1": -1}, temperature="28 degC")
    ((label, text),) = effect_facts(arm)
    assert label == "Effects"
    # 8e-6 rad for 1 N m: 125 kN m for a radian. The wave's size is that of both parts: 3, 4, 5.
    assert "joint compliance of joint2 8.00 µrad/(N m) (stiffness 125 kN m/rad)" in text
    assert "backlash of joint1 0.100 mrad" in text
    assert "gear eccentricity of joint1 0.500 mrad" in text
    assert "cyclic error of joint1 0.0500 mrad, 12.0 cycles per revolution" in text
    assert "thermal growth of all lengths 12.0 µm/(m K)" in text
    ((label, text),) = input_facts(arm)
    assert label == "Conditions"
    assert text == (
        "a payload of 5 kg, joint1 arriving with decreasing values, joint2 approached from either side, 28 degC"
    )
    assert effect_facts(problem([])) == []
    assert input_facts(problem([])) == []
    assert input_facts(problem(EFFECTS_SECTION[3:4])) == []  # it depends on the joint alone


def test_many_effects_are_counted() -> None:
    more = [{"kind": "joint_scale", "joint": f"joint{i}", "estimate": {"scale": 1e-4}} for i in (1, 2)]
    ((_, text),) = effect_facts(problem([*EFFECTS_SECTION, *more]))
    assert text.endswith("and 2 more")


def test_sources_of_effects_have_words_and_units() -> None:
    arm = problem(EFFECTS_SECTION).arm
    assert source_words("joint_compliance(joint2).compliance", arm) == "joint2 joint compliance"
    assert source_size("joint_compliance(joint2).compliance", 2e-7, arm) == "0.200 µrad/(N m)"
    assert source_words("gear_eccentricity(joint1).sin", arm) == "joint1 gear eccentricity, sin"
    assert source_words("joint1.side", arm) == "joint1 side of approach"
    assert source_words("joint1.theta", arm) == "joint1 angle"
    for name, dimension in arm.dimensions.items():
        assert source_size(name, 1e-5, arm) == shown(1e-5, dimension)


NEVER_ESTIMATED = {"mass", "temperature", "time", "torque", "velocity", "angular velocity", "pixel"}


@pytest.mark.parametrize("dimension", sorted({*DIMENSIONS, "ratio"} - NEVER_ESTIMATED))
def test_every_dimension_of_an_estimate_has_a_unit_that_suits_it(dimension: str) -> None:
    assert shown(1e-5, dimension).split()[1]


def test_every_effect_has_a_text() -> None:
    shapes: dict[str, Any] = {
        "joint": "joint1", "cycles": 7.0, "ratio": 101.0, "travel": "0.1 rad", "follows": "joint2", "of": "joint1",
        "moment": "60 s", "lsb": "0.001 rad", "constant": "600 s",
    }  # fmt: skip
    for cls in EFFECTS:
        of = cls.model_fields.get("of")
        own = shapes | ({"of": "base"} if of is not None and get_origin(of.annotation) is Literal else {})
        effect = cls(**{name: value for name, value in own.items() if name in cls.model_fields})
        text = effect.with_estimate([1e-4] * len(effect.dimensions)).stated_words
        assert text.startswith(effect.kind.replace("_", " "))


def test_noise_has_a_text() -> None:
    facts = effect_facts(problem([
        {"kind": "joint_noise", "joint": "joint2", "sigma": "0.1 mrad"},
        {"kind": "range_noise", "a": "15 um", "b": "6 um/m"},
        {"kind": "outliers", "share": 0.02},
    ]))  # fmt: skip
    assert facts == [
        (
            "Effects",
            "joint noise of joint2 (sigma 0.100 mrad), range noise of instrument (a 0.0150 mm, b 6.00 µm/m), "
            "outliers (share 2.00 %)",
        )
    ]


def test_the_report_tells_them(tmp_path: Any) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text(problem(EFFECTS_SECTION, payload="5 kg", temperature="28 degC").to_yaml())
    for words in (["uncertainty"], ["simulate", "--samples", "1000"]):
        result = invoke(*words, "--problem", str(file), "--posture", "20 deg, 40 deg", "--full")
        assert result.exit_code == 0, result.output
        assert "joint compliance of joint2" in result.output
        assert "a payload of 5 kg" in result.output


def test_list_shows_the_effects() -> None:
    result = invoke("list", "--json")
    rows = json.loads(result.output)["effects"]
    assert [row["kind"] for row in rows] == [cls.model_fields["kind"].default for cls in CATALOGUE]
    assert all(row["is"] for row in rows)
