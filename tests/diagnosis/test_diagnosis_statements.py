"""What a diagnosis states: causes, what to do about them, whether the arm may work on, and what stays open."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.assumptions.contradictions import GeometricDeviation
from posture_opt.calibration.start_up import ScatterChange
from posture_opt.diagnosis.cause_statements import of_one_type
from posture_opt.diagnosis.causes.causes import Finding
from posture_opt.diagnosis.diagnosis_statements import uneven_statements
from posture_opt.diagnosis.noise.noise_causes import NoiseFloor
from posture_opt.diagnosis.noise.uneven_noise import UnevenErrors
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.model.effects import (
    Backlash,
    BaseCompliance,
    CyclicError,
    GearEccentricity,
    InstrumentField,
    JointCompliance,
    JointNoise,
    JointScale,
    Slip,
)
from posture_opt.model.effects.base.cause import FittedSizes
from posture_opt.report.figures.diagnosis import plot_periodogram
from posture_opt.statements import Statement
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> po.Diagnosis:
    """A wheel of two lines at the first joint, seen by 0.02 mm of noise."""
    folder = tmp_path_factory.mktemp("wheel")
    rng = np.random.default_rng(12)
    q = rng.uniform(-2.5, 2.5, (200, 2))
    wheel = 1e-4 * np.sin(40 * q[:, 0]) + 2e-4 * np.cos(73 * q[:, 0])
    write(folder / "data.csv", q, position(q + np.outer(wheel, [1, 0])) + rng.normal(0, 2e-5, q.shape))
    problem = po.problem_from_dict(PROBLEM)
    return po.diagnose(problem, po.read_measurements(folder / "data.csv", problem), plan=False)


def said(found: po.Diagnosis, *effects: Finding, **changes: Any) -> dict[str, Statement]:
    """The statements of the same diagnosis with other causes, by their ids."""
    other = replace(found, effects=effects or found.effects, **changes)
    return {one.id.removeprefix("diagnosis."): one for one in other.statements}


def soft(joint: str, size: float = 1e-5, **more: Any) -> Finding:
    return Finding(JointCompliance(joint=joint), {"compliance": (size, 1e-6, "rad/(N*m)")}, 1e-9, 0.1, **more)


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


def test_lines_of_open_size_stand_in_brackets_in_the_periodogram(found: po.Diagnosis) -> None:
    (wheel,) = [f for f in found.effects if f.kind == "cyclic_error"]
    (axes,) = plot_periodogram(found).axes
    assert {"40.0", "73.0"} <= {text.get_text() for text in axes.texts}
    doubtful = replace(found, effects=(replace(wheel, determined=False),))
    (axes,) = plot_periodogram(doubtful).axes
    assert {"(40.0)", "(73.0)"} <= {text.get_text() for text in axes.texts}


def test_an_instrument_that_could_err_as_the_arm_is_checked_first(found: po.Diagnosis) -> None:
    first = replace(soft("joint1"), confounded_with=(InstrumentField(),))
    assert said(found, first)["check-instrument"].values["numbers"] == ("1",)
    assert replace(found, effects=(first,)).actions[0].action == "check_instrument"
    assert "check-instrument" not in said(found, replace(first, confounded_with=(GearEccentricity(joint="joint1"),)))


def test_rivals_with_a_name_come_first_in_the_table(found: po.Diagnosis) -> None:
    curve, gear = UnnamedComponent("curve", "joint1"), GearEccentricity(joint="joint1")
    doubtful = replace(found, effects=(replace(found.effects[0], confounded_with=(curve, gear)),))
    assert "gear eccentricity (joint1) or a smooth curve over joint1" in doubtful.report()
    assert {"confusable", "measure-to-decide"} & set(said(doubtful))


def test_geometry_counts_the_parameters_that_differ(found: po.Diagnosis) -> None:
    """The arm that was simulated is that of the file; none of its parameters is off, and all are if they are moved."""
    geometry = Finding(GeometricDeviation.of_all(), {}, 1e-9, 0.3)
    moved = replace(found.model, x=found.model.x + 10 * found.model.std)
    for model, words in ((found.model, "0 of 4 parameters"), (moved, "4 of 4 parameters")):
        several = replace(found, effects=(replace(found.effects[0], place=None), geometry), model=model)
        assert words in " ".join(several.report(full=False).split())


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


def test_neighbouring_joints_that_err_alike_in_several_ways_are_said_to(found: po.Diagnosis) -> None:
    one = scale("joint1", 0.025), soft("joint1")
    both = said(found, *one, scale("joint2", 0.027), soft("joint2", 1.1e-5))["in-common"]
    assert both.values["joints"] == ("joint1", "joint2")
    for other in (scale("joint2", -0.025), scale("joint2", 0.06), scale("joint2", 1e-3)):
        assert "in-common" not in said(found, *one, other, soft("joint2", 1.1e-5))


def test_an_arm_can_work_on_unless_something_gave_way(found: po.Diagnosis) -> None:
    (wheel,) = [f for f in found.effects if f.kind == "cyclic_error"]
    assert said(found)["may-work"].severity == "result"
    slip = Finding(Slip(of="joint2", moment="5 s"), {"step": (1e-3, 1e-5, "rad"), "moment": (5.0, 1.0, "s")}, 1e-9, 0.1)
    first = said(found, wheel, slip)
    assert (first["stop-first"].severity, first["stop-first"].about) == ("caution", "joint2")
    assert "may-work" not in first
    loose = soft("joint1", confounded_with=(BaseCompliance(),))
    assert said(found, wheel, loose)["tighten-base-first"].values["numbers"] == ("2",)
    base = Finding(BaseCompliance(), {"compliance": (1e-5, 1e-5, "rad/(N*m)")}, 1e-9, 0.3, determined=False)
    assert "stop-first" in said(found, wheel, base)
    changed = replace(found)
    vars(changed)["scatter_change"] = ScatterChange(128, 1e-4, 3e-4, 1e-5)
    ids = {one.id: one for one in changed.statements}
    assert ids["diagnosis.rows-changed-first"].values["line"] == "128"
    assert "calibration.scatter-changes" in ids


def test_a_joint_that_goes_beyond_its_command_is_no_play(found: po.Diagnosis) -> None:
    """Of an arm that was moved by hand the sign is another one under its motors: it is asked."""
    (wheel,) = [f for f in found.effects if f.kind == "cyclic_error"]
    play, lead = (
        Finding(Backlash(joint="joint1"), {"width": (width, 1e-5, "rad")}, 1e-9, 0.1) for width in (1e-3, -1e-3)
    )
    assert "moved-by-hand" not in said(found, wheel, play)
    hand = said(found, wheel, lead)
    assert hand["moved-by-hand"].values["numbers"] == ("2",)
    assert "compensation in the controller" in hand["inspect"].text
    assert "sides-derived" in hand


def test_causes_that_predict_unseen_rows_worse_are_not_believed(found: po.Diagnosis) -> None:
    bad = {name: replace(found.errors[name], rms=rms) for name, rms in (("calibrated", 0.8), ("extended", 0.7))}
    worse = {**found.errors, "nominal": replace(found.errors["nominal"], rms=0.5), **bad}
    doubted = said(found, *found.effects, errors=worse)
    assert doubted["overfitted"].severity == "danger"
    assert not {"may-work", "inspect", "correction-unbuildable"} & set(doubted)
    assert "overfitted" not in said(found)
    lines = replace(found, errors=worse).report(full=False).splitlines()
    assert lines[3].startswith("Do not use")


def test_joints_whose_errors_grow_alike_share_a_sentence() -> None:
    def uneven(joint: str, refuted: bool, **more: bool) -> UnevenErrors:
        return UnevenErrors(JointNoise(joint=joint, sigma="0.1 mrad"), 1e-3, refuted, np.zeros(0), **more)

    one, two, three, four = uneven_statements(
        [
            *(uneven("a", False), uneven("b", True), uneven("c", False)),
            *(uneven("d", False, still=True), uneven("e", True, scatters=True)),
        ]
    )
    assert (one.id, one.about) == ("diagnosis.uneven", "a and c")
    assert (two.id, three.id, four.id) == (
        "diagnosis.uneven-refuted",
        "diagnosis.uneven-still",
        "diagnosis.uneven-scatters",
    )
    assert "{repeats: visits}" in three.text


@pytest.mark.parametrize("named", ["geometry", "joint_offset", "link_length", ""])
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


def test_a_cause_of_a_size_that_no_arm_has_only_looks_like_it(found: po.Diagnosis) -> None:
    """Nothing is opened for it: what it would take is said."""
    first, *rest = found.effects
    like = "a gear with a crack: 3 mrad, where 1 mrad is usual"
    odd = replace(found, effects=(replace(first, would_need=like), *rest))
    assert odd.actions[0].action == "ignore"
    assert said(odd)["implausible"].values["need"] == like
    assert "inspect" not in said(odd)
    assert "1. looks like cyclic error" in odd.report(full=False)


def test_orientations_that_the_file_has_are_used_before_others_are_measured(found: po.Diagnosis) -> None:
    rival = replace(found.effects[0], confounded_with=(GearEccentricity(joint="joint1"),))
    turned = replace(found.request.data, rotation=np.tile([1.0, 0.0, 0.0, 0.0], (len(found.request.data), 1)))
    assert "orientations-unused" not in said(found, rival)
    assert "orientations-unused" in said(found, rival, request=replace(found.request, data=turned))


def test_a_cause_that_the_test_file_does_not_confirm_is_confirmed_first(found: po.Diagnosis) -> None:
    test = SimpleNamespace(gains=(SimpleNamespace(value=0.02, low=-0.01),))
    unsure = replace(soft("joint1"), place=0)
    other = replace(found, effects=(unsure,), test=test)
    assert (other.actions[0].action, other.actions[0].reason) == ("confirm", "unconfirmed")


def test_a_verdict_without_a_named_cause_says_what_the_data_say(found: po.Diagnosis) -> None:
    vague = replace(found.effects[0], determined=False)
    assert replace(found, effects=(vague,)).actions[0].action == "measure"
    ids = said(found, vague, verdict="unexplained")
    assert {"no-cause-fits", "suspected"} <= set(ids)
    none = replace(found, effects=(), verdict="none_found")
    assert {"diagnosis.none-found", "diagnosis.structure-none"} <= {one.id for one in none.statements}


def test_what_fitting_costs_raises_the_noise_of_rows_held_out() -> None:
    # 80 rows of three coordinates of 0.03 mm in 5 rounds: 0.052 mm √(1 + 23/192) = 0.0550 mm.
    model: Any = SimpleNamespace(count=23, residuals=SimpleNamespace(data=range(80), axes=range(3)))
    assert NoiseFloor(5.2e-5, repeated=False).held_out(model, 5) == pytest.approx(5.2e-5 * np.sqrt(1 + 23 / 192))


@pytest.mark.parametrize(
    ("low", "high", "id"), [(0.9, 1.2, "noise-reached"), (1.1, 1.2, "noise-not-reached"), (0.5, 0.6, "noise-exceeds")]
)
def test_what_is_left_is_held_against_noise(found: po.Diagnosis, low: float, high: float, id: str) -> None:
    cost = found.held_out_noise
    left = replace(found.errors["extended"], interval=(low * cost, high * cost))
    assert id in said(found, errors={**found.errors, "extended": left})


def test_the_causes_stay_on_the_screen_whatever_the_rest_needs(found: po.Diagnosis) -> None:
    lines = found.report(full=False).splitlines()
    assert len(lines) <= 45
    assert "Causes" in lines
