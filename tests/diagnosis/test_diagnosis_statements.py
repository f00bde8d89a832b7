"""What a diagnosis states: causes, what to do about them, whether the arm may work on, and what stays open."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.assumptions.contradictions import GeometricDeviation
from posture_opt.calibration.start_up import ScatterChange
from posture_opt.diagnosis.cause_statements import of_one_type
from posture_opt.diagnosis.causes.causes import Finding
from posture_opt.model.effects import (
    BaseCompliance,
    CyclicError,
    JointCompliance,
    JointScale,
    Slip,
)
from posture_opt.model.effects.base.cause import FittedSizes
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import planar_rows


@pytest.fixture(scope="module")
def found() -> po.Diagnosis:
    """A wheel of two lines at the first joint, seen by 0.02 mm of noise."""
    rng = np.random.default_rng(12)
    q = rng.uniform(-2.5, 2.5, (200, 2))
    wheel = 1e-4 * np.sin(40 * q[:, 0]) + 2e-4 * np.cos(73 * q[:, 0])
    return po.diagnose(
        *planar_rows(q, position(q + np.outer(wheel, [1, 0])) + rng.normal(0, 2e-5, q.shape)), plan=False
    )


def said(found: po.Diagnosis, *effects: Finding, **changes: Any) -> dict[str, Any]:
    """The statements of the same diagnosis with other causes, by their ids."""
    other = replace(found, effects=effects or found.effects, **changes)
    return {one.id.removeprefix("diagnosis."): one for one in other.statements}


def soft(joint: str, size: float = 1e-5, **more: Any) -> Finding:
    return Finding(JointCompliance(joint=joint), {"compliance": (size, 1e-6, "rad/(N m)")}, 1e-9, 0.1, **more)


def scale(joint: str, size: float) -> Finding:
    return Finding(JointScale(joint=joint), {"scale": (size, 1e-3, "1")}, 1e-9, 0.1)


def test_every_cause_is_a_row_of_the_first_screen_with_size_and_what_to_do(found: po.Diagnosis) -> None:
    text = found.report(full=False)
    (wheel,) = [f for f in found.effects if f.kind == "cyclic_error"]
    assert "1. cyclic error (joint1)" in text
    assert wheel.size_text in text
    (entry,) = found.to_json()["effects"]
    assert entry["action"] == "compensate"
    assert entry["reason"] == "size_of_catalogues"
    assert said(found)["size-of-catalogues"].values["numbers"] == ("1",)
    assert said(found)["causes-explain"].severity == "result"
    assert found.statements[0].id == "diagnosis.error-effects-instrument"


def test_an_arm_can_work_on_unless_something_gave_way(found: po.Diagnosis) -> None:
    (wheel,) = [f for f in found.effects if f.kind == "cyclic_error"]
    assert said(found)["may-work"].severity == "result"
    slip = Finding(Slip(of="joint2", moment="5 s"), {"step": (1e-3, 1e-5, "rad"), "moment": (5.0, 1.0, "s")}, 1e-9, 0.1)
    first = said(found, wheel, slip)
    assert (first["stop-first"].severity, first["stop-first"].about) == ("caution", "joint2")
    assert "may-work" not in first
    loose = soft("joint1", confounded_with=(BaseCompliance(),))
    assert said(found, wheel, loose)["tighten-base-first"].values["numbers"] == ("2",)
    base = Finding(BaseCompliance(), {"compliance": (1e-5, 1e-5, "rad/(N m)")}, 1e-9, 0.3, determined=False)
    assert "stop-first" in said(found, wheel, base)
    changed = replace(found)
    vars(changed)["scatter_change"] = ScatterChange(128, 1e-4, 3e-4, 1e-5)
    ids = {one.id: one for one in changed.statements}
    assert ids["diagnosis.rows-changed-first"].values["line"] == "128"
    assert "calibration.scatter-changes" in ids


def test_causes_that_predict_unseen_rows_worse_are_not_believed(found: po.Diagnosis) -> None:
    bad = {name: replace(found.errors[name], rms=rms) for name, rms in (("calibrated", 0.8), ("extended", 0.7))}
    worse = {**found.errors, "nominal": replace(found.errors["nominal"], rms=0.5), **bad}
    doubted = said(found, *found.effects, errors=worse)
    assert doubted["overfitted"].severity == "danger"
    assert not {"may-work", "inspect", "correction-unbuildable"} & set(doubted)
    assert "overfitted" not in said(found)
    lines = replace(found, errors=worse).report(full=False).splitlines()
    assert lines[3].startswith("Do not use")


@pytest.mark.parametrize("named", ["geometry", "joint_offset", ""])
def test_a_correction_that_no_arm_is_built_with_leads_however_geometry_is_named(
    found: po.Diagnosis, named: str
) -> None:
    names = [p.name for p in found.model.residuals.parameters]
    effects = tuple(f for f in found.effects if not isinstance(f.cause, GeometricDeviation))
    cause = GeometricDeviation(named, "all" if named == "geometry" else "joint2")
    effects += (Finding(cause, {}, 1e-9, 0.3),) if named else ()
    for name, id in (("joint2.theta", "zero-unbuildable"), ("joint1.a", "correction-unbuildable")):
        x = np.where([own == name for own in names], 12e-3, 0.0 * found.model.x)
        ids = said(found, *effects, model=replace(found.model, x=x))
        assert (id in ids) == bool(named)
        if named:
            assert (ids[id].severity, ids[id].about) == ("caution", name)
        assert ("inspect-link-first" in ids) == (bool(named) and name == "joint1.a")
        built = np.where([own == name for own in names], 1e-3, 0.0 * found.model.x)
        assert id not in said(found, *effects, model=replace(found.model, x=built))


def test_a_verdict_without_a_named_cause_says_what_the_data_say(found: po.Diagnosis) -> None:
    vague = replace(found.effects[0], determined=False)
    assert replace(found, effects=(vague,)).actions[0].action == "measure"
    ids = said(found, vague, verdict="unexplained")
    assert {"no-cause-fits", "suspected"} <= set(ids)
    none = replace(found, effects=(), verdict="none_found")
    assert {"diagnosis.none-found", "diagnosis.structure-none"} <= {one.id for one in none.statements}


@pytest.mark.parametrize(
    ("low", "high", "id"), [(0.9, 1.2, "noise-reached"), (1.1, 1.2, "noise-not-reached"), (0.5, 0.6, "noise-exceeds")]
)
def test_what_is_left_is_held_against_noise(found: po.Diagnosis, low: float, high: float, id: str) -> None:
    cost = found.held_out_noise
    left = replace(found.errors["extended"], interval=(low * cost, high * cost))
    assert id in said(found, errors={**found.errors, "extended": left})


def wave(joint: str, cycles: float, *further: float, resolution: float = 0.0) -> Finding:
    names = [f"{part}{'' if i == 0 else f' {i + 1}'}" for i in range(1 + len(further)) for part in ("sin", "cos")]
    shape = {f"cycles{'' if i == 0 else f' {i + 1}'}": (c, 0.1, "1") for i, c in enumerate((cycles, *further))}
    estimate = dict.fromkeys(names, (0.0001, 1e-06, "rad")) | shape
    sizes = FittedSizes(estimate, span=3.0, resolution=resolution)
    return Finding(CyclicError(joint=joint, cycles=cycles, further=further), estimate, 1e-9, 0.3, fitted=sizes)


def test_lines_of_several_joints_that_are_alike_are_of_the_type_of_drive(found: po.Diagnosis) -> None:
    """18 and 19.5 cycles are one band over a range that tells frequencies of 2 apart; 16.2 is 1.8 below it."""
    for second, groups in ((17.4, 1), (20.8, 0)):
        assert len(of_one_type([wave("joint1", 17.2), wave("joint2", second)])) == groups
    assert list(of_one_type([wave("joint2", 19.5, 18.0, resolution=2.0), wave("joint1", 16.2, resolution=2.0)])) == [
        (16.2, 19.5)
    ]
    assert not of_one_type([wave("joint2", 19.5, 18.0, resolution=2.0), wave("joint1", 16.2, resolution=1.0)])
    alike = said(found, wave("joint1", 17.2), wave("joint2", 17.4))["alike-drives"]
    assert (alike.values["numbers"], alike.values["cycles"]) == (("1", "2"), "17 to 18")
