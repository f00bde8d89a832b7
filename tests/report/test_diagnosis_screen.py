"""The first screen of a diagnosis: all causes with size and share, counted once, and what to look at on the arm."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from posture_opt.report.measured_parts.cause_advice import of_one_type
from posture_opt.report.measured_parts.cause_inspections import bent_lead, inspection, inspections_by_text
from posture_opt.report.measured_parts.causes_table import rivals_of
from posture_opt.report.measured_parts.diagnosis_open import all_uneven_words

import posture_opt as po
from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.calibration.scatter_change import ScatterChange
from posture_opt.diagnosis.causes.causes import Finding
from posture_opt.diagnosis.noise.uneven_noise import UnevenErrors
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.model.effects import (
    Backlash,
    BaseCompliance,
    Cause,
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
from posture_opt.report.figures.diagnosis_curves import curve_of, plot_curves, shown_curves
from posture_opt.report.figures.diagnosis_scores import scored_rows
from posture_opt.report.results.diagnosis_report import diagnosis_report
from posture_opt.report.text.screen import SCREEN, on_a_screen
from posture_opt.report.text.text import render
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


def test_every_cause_is_on_the_screen_with_size_and_share(found: po.Diagnosis) -> None:
    text = render(on_a_screen(diagnosis_report(found), 100, ()), 100)
    assert text.rstrip().count("\n") < SCREEN
    for number, finding in enumerate(found.effects, 1):
        assert f"{number}. {finding.cause.label}" in text
    (line,) = [row for row in text.splitlines() if row.startswith("1. cyclic error (joint1, 73.0/rev + 1 more)")]
    assert re.search(r"0\.1\d+ ± 0\.\d+ mrad RMS +0\.\d+ mm +\d+ %$", line)
    assert "what comes 73.0 times per revolution of joint1: bolts of a flange" in " ".join(text.split())


def test_each_line_is_drawn_over_its_own_phase_without_the_others(found: po.Diagnosis, tmp_path: Path) -> None:
    from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities

    seen = EffectSensitivities(found.model.residuals, found.model.x)
    shown = [entry for entry in shown_curves(found) if entry[1].kind == "cyclic_error"]
    assert [line for _, _, line in shown] == [0, 1]
    for (place, finding, line), size in zip(shown, (0.2, 0.1), strict=True):
        curve = curve_of(found, seen, place, finding, line)
        # A single sine over its phase: one value a phase, of the amplitude that was simulated [mrad].
        x = np.radians(curve.x)
        A = np.stack([np.sin(x), np.cos(x)], axis=1)
        theta = np.linalg.lstsq(A, curve.modelled, rcond=None)[0]
        np.testing.assert_allclose(A @ theta, curve.modelled, atol=2e-3 * size)
        assert np.hypot(*theta) == pytest.approx(size, rel=0.1)
    figure = plot_curves(found)
    figure.canvas.draw()
    edges = [axes.title.get_window_extent() for axes in figure.axes if axes.get_visible()]
    assert all(box.x0 >= 0 and box.x1 <= figure.bbox.width for box in edges)
    assert not any(a.overlaps(b) for i, a in enumerate(edges) for b in edges[:i])


def test_what_is_in_the_model_is_a_cause_that_was_found(found: po.Diagnosis) -> None:
    rows, _ = scored_rows(found)
    causes = {(f.kind, f.target) for f in found.effects}
    inside = [row for row in rows if row.p_value is not None]
    assert inside
    assert all(row.scored.candidate.key in causes for row in inside)
    assert all(row.named for row in inside)


def test_rivals_stand_on_the_screen_those_with_a_name_first(found: po.Diagnosis) -> None:
    curve = UnnamedComponent("curve", "joint1")
    gear, scale = GearEccentricity(joint="joint1"), JointScale(joint="joint1")
    wave = replace(found.effects[0], confounded_with=(curve, gear))
    assert rivals_of(wave) == "gear eccentricity (joint1) or a smooth curve over joint1"
    three, four = (curve, gear, scale), (curve, gear, scale, GearEccentricity(joint="joint2"))
    assert rivals_of(replace(wave, confounded_with=three)) == (
        "gear eccentricity (joint1), joint scale (joint1) or a smooth curve over joint1"
    )
    assert (
        rivals_of(replace(wave, confounded_with=four)) == "gear eccentricity (joint1), joint scale (joint1) or 2 more"
    )
    assert rivals_of(replace(wave, confounded_with=four), 4).endswith("or a smooth curve over joint1")
    doubtful = replace(found, effects=(wave, *found.effects[1:]))
    text = " ".join(render(on_a_screen(diagnosis_report(doubtful), 100, ()), 100).split())
    assert "Could be (1) gear eccentricity (joint1) or a smooth curve over joint1 instead" in text


def test_lines_of_open_size_stand_in_brackets_in_the_periodogram(found: po.Diagnosis) -> None:
    (wheel,) = [f for f in found.effects if f.kind == "cyclic_error"]
    (axes,) = plot_periodogram(found).axes
    assert [text.get_text() for text in axes.texts] == ["40.0", "73.0"]
    doubtful = replace(found, effects=(replace(wheel, determined=False),))
    (axes,) = plot_periodogram(doubtful).axes
    assert [text.get_text() for text in axes.texts] == ["(40.0)", "(73.0)"]


def test_an_instrument_that_could_err_as_the_arm_is_checked_first(found: po.Diagnosis) -> None:
    def text(rival: Cause) -> str:
        doubtful = replace(found.effects[0], confounded_with=(rival,))
        several = replace(found, effects=(doubtful, *found.effects[1:]))
        return " ".join(render(on_a_screen(diagnosis_report(several), 100, ()), 100).split())

    assert "Instrument first (1) check the instrument, by a scale bar or from a second station" in text(
        InstrumentField()
    )
    assert "Instrument first" not in text(GearEccentricity(joint="joint1"))


def test_what_is_looked_at_alike_on_several_joints_is_said_once(found: po.Diagnosis) -> None:
    def soft(joint: str) -> Finding:
        cause = JointCompliance(joint=joint)
        return Finding(cause, {"compliance": (1e-5, 1e-6, "rad/(N*m)")}, 1e-9, 0.3)

    several = replace(found, effects=(soft("joint1"), soft("joint2")))
    assert list(inspections_by_text(several, list(several.effects)).items()) == [
        (JointCompliance(joint="joint1 and joint2").inspect(several.problem.robot), ["1", "2"])
    ]


def test_periods_of_several_joints_share_their_words(found: po.Diagnosis) -> None:
    def wave(joint: str, cycles: float) -> Finding:
        sizes = {"sin": 1e-4, "cos": 0.0, "sin 2": 1e-5, "cos 2": 0.0}
        estimate = {name: (size, 1e-6, "rad") for name, size in sizes.items()}
        return Finding(CyclicError(joint=joint, cycles=cycles, further=(99.0,)), estimate, 1e-9, 0.3)

    several = replace(found, effects=(wave("joint1", 17.2), wave("joint2", 20.8)))
    (text,) = inspections_by_text(several, list(several.effects))
    assert text.startswith(
        "what comes 17.2 times per revolution of joint1 and 20.8 times per revolution of joint2: bolts"
    )


def test_geometry_is_told_by_how_many_parameters_differ(found: po.Diagnosis) -> None:
    """The arm that was simulated is that of the file; none of its parameters is off, and all are if they are moved."""
    geometry = Finding(GeometricDeviation.of_all(), {}, 1e-9, 0.3)
    moved = replace(found.model, x=found.model.x + 10 * found.model.std)
    for model, told in ((found.model, "0 of 4 parameters differ"), (moved, "4 of 4 parameters differ")):
        several = replace(found, effects=(replace(found.effects[0], place=None), geometry), model=model)
        assert told in render(on_a_screen(diagnosis_report(several), 100, ()), 100)


def test_lines_of_several_joints_that_are_alike_are_of_the_type_of_drive(found: po.Diagnosis) -> None:
    def wave(joint: str, cycles: float) -> Finding:
        estimate = {"sin": (1e-4, 1e-6, "rad"), "cos": (0.0, 1e-6, "rad")}
        return Finding(CyclicError(joint=joint, cycles=cycles), estimate, 1e-9, 0.3)

    for second, told in ((17.4, 1), (20.8, 0)):
        assert len(of_one_type([wave("joint1", 17.2), wave("joint2", second)])) == told


def test_bands_are_alike_where_the_ranges_do_not_tell_them_apart() -> None:
    """18 and 19.5 cycles are one band over a range that tells frequencies of 2 apart; 16.2 is 1.8 below it."""

    def band(joint: str, cycles: float, *further: float, resolution: float) -> Finding:
        names = [f"{part}{'' if i == 0 else f' {i + 1}'}" for i in range(1 + len(further)) for part in ("sin", "cos")]
        estimate = dict.fromkeys(names, (0.0001, 1e-06, "rad"))
        sizes = FittedSizes(estimate, span=3.0, resolution=resolution)
        cause = CyclicError(joint=joint, cycles=cycles, further=further)
        return Finding(cause, estimate, 1e-9, 0.3, fitted=sizes)

    def groups(resolution: float) -> list[tuple[float, float]]:
        wide = band("joint2", 19.5, 18.0, resolution=2.0)
        return list(of_one_type([wide, band("joint1", 16.2, resolution=resolution)]))

    assert groups(2.0) == [(16.2, 19.5)]
    assert groups(1.0) == []  # the finer of both tells them apart


def screen_of(found: po.Diagnosis, *effects: Finding) -> str:
    """The first screen of the same diagnosis with other causes, in one line."""
    return " ".join(render(on_a_screen(diagnosis_report(replace(found, effects=effects)), 100, ()), 100).split())


def test_neighbouring_joints_that_err_alike_in_several_ways_are_said_to(found: po.Diagnosis) -> None:
    def scale(joint: str, size: float) -> Finding:
        return Finding(JointScale(joint=joint), {"scale": (size, 1e-3, "1")}, 1e-9, 0.1)

    def soft(joint: str, size: float) -> Finding:
        return Finding(JointCompliance(joint=joint), {"compliance": (size, 1e-6, "rad/(N*m)")}, 1e-9, 0.1)

    words = "joint1 and joint2 err alike in joint scale and joint compliance: look first for what they share"
    one = scale("joint1", 0.025), soft("joint1", 1e-5)
    assert words in screen_of(found, *one, scale("joint2", 0.027), soft("joint2", 1.1e-5))
    for other in (scale("joint2", -0.025), scale("joint2", 0.06), scale("joint2", 1e-3)):
        assert "err alike" not in screen_of(found, *one, other, soft("joint2", 1.1e-5))


def test_an_arm_can_work_on_unless_something_gave_way(found: po.Diagnosis) -> None:
    (wheel,) = [f for f in found.effects if f.kind == "cyclic_error"]
    assert "Meanwhile nothing of this is a reason to stop the arm" in screen_of(found, wheel)
    slip = Finding(Slip(of="joint2", moment="5 s"), {"step": (1e-3, 1e-5, "rad"), "moment": (5.0, 1.0, "s")}, 1e-9, 0.1)
    text = screen_of(found, wheel, slip)
    assert "Before it works on (2) look for what gave way at joint2: what slipped once can slip again" in text
    assert "Meanwhile" not in text
    soft = Finding(JointCompliance(joint="joint1"), {"compliance": (1e-5, 1e-6, "rad/(N*m)")}, 1e-9, 0.3)
    loose = replace(soft, confounded_with=(BaseCompliance(),))
    assert "once the mounting bolts of its base are found tight (cause 2 could be a compliant base" in screen_of(
        found, wheel, loose
    )
    base = Finding(BaseCompliance(), {"compliance": (1e-5, 1e-5, "rad/(N*m)")}, 1e-9, 0.3, determined=False)
    assert "Before it works on (2) tighten the mounting bolts of the base" in screen_of(found, wheel, base)
    changed = replace(found)
    vars(changed)["scatter_change"] = ScatterChange(128, 1e-4, 3e-4, 1e-5)
    text = " ".join(render(on_a_screen(diagnosis_report(changed), 100, ()), 100).split())
    assert "Before it works on look for what was moved, came loose or changed at line 128" in text


def test_a_joint_that_goes_beyond_its_command_is_no_play(found: po.Diagnosis) -> None:
    """Of an arm that was moved by hand the sign is another one under its motors: it is asked."""

    def play(width: float) -> str:
        return screen_of(found, Finding(Backlash(joint="joint1"), {"width": (width, 1e-5, "rad")}, 1e-9, 0.1))

    assert "1. backlash (joint1)" in play(1e-3)
    text = play(-1e-3)
    assert "1. reversed backlash (joint1)" in text
    assert "if motors drove joint1: its friction or backlash compensation in the controller, and nothing is" in text
    (wheel,) = [f for f in found.effects if f.kind == "cyclic_error"]
    lead = Finding(Backlash(joint="joint1"), {"width": (-1e-3, 1e-5, "rad")}, 1e-9, 0.1)
    both = screen_of(found, wheel, lead)
    assert "if it was moved by hand, lost motion (2) has the other sign under its motors" in both


def test_causes_that_predict_unseen_rows_worse_are_not_believed(found: po.Diagnosis) -> None:
    bad = {name: replace(found.errors[name], rms=rms) for name, rms in (("calibrated", 0.8), ("extended", 0.7))}
    worse = replace(found, errors={**found.errors, "nominal": replace(found.errors["nominal"], rms=0.5), **bad})
    text = screen_of(worse, *found.effects)
    assert text.split("Planar arm ")[-1].startswith("Measure more postures before anything of this is believed: rows")
    assert "Measure first more postures" in text
    assert "Look at" not in text
    assert "Meanwhile" not in text
    assert "Measure more postures" not in screen_of(found, *found.effects)


def test_the_largest_errors_stand_beside_the_rms(found: po.Diagnosis) -> None:
    best = found.errors["extended"]
    within = f"(95 % of the rows within {1e3 * best.p95:.4f} mm, all within {1e3 * best.max:.4f} mm)"
    assert within in screen_of(found, *found.effects)


def test_joints_whose_errors_grow_alike_share_a_sentence() -> None:
    def uneven(joint: str, refuted: bool) -> UnevenErrors:
        return UnevenErrors(JointNoise(joint=joint, sigma="0.1 mrad"), 1e-3, refuted, np.zeros(0))

    one, two = all_uneven_words([uneven("a", False), uneven("b", True), uneven("c", False)])
    assert one.startswith("Errors are larger where any of a and c moves the tool more, as if it stopped elsewhere")
    assert two.startswith("Errors are larger where b moves the tool more")


def test_the_causes_stay_on_the_screen_whatever_the_rest_needs(found: po.Diagnosis) -> None:
    report = diagnosis_report(found)
    long = replace(report, lead=tuple(f"Sentence {i}." for i in range(60)))
    titles = [block.title for block in on_a_screen(long, 100, ()).blocks]
    assert titles[0].startswith("Causes, by what they explain")
    assert len(titles) == 2


def test_a_correction_that_no_arm_is_built_with_is_said_to_be_so(found: po.Diagnosis) -> None:
    geometry = Finding(GeometricDeviation.of_all(), {}, 1e-9, 0.3)
    for size, told in ((1e-3, "as arms are built"), (12e-3, "more than arms are built with")):
        x = np.where([p.name == "joint2.theta" for p in found.model.residuals.parameters], size, 0.0 * found.model.x)
        text = inspection(replace(found, model=replace(found.model, x=x)), geometry)
        assert f"largest certain correction: zero of joint2 (joint2.theta), {size * 1e3:.0f}" in text
        assert told in text


@pytest.mark.parametrize("named", ["geometry", "joint_offset", "link_length", ""])
def test_a_correction_that_no_arm_is_built_with_leads_however_geometry_is_named(
    found: po.Diagnosis, named: str
) -> None:
    x = np.where([p.name == "joint2.theta" for p in found.model.residuals.parameters], 12e-3, 0.0 * found.model.x)
    effects = tuple(f for f in found.effects if not isinstance(f.cause, GeometricDeviation))
    cause = GeometricDeviation(named, "all" if named == "geometry" else "joint2")
    effects += (Finding(cause, {}, 1e-9, 0.3),) if named else ()
    lead = bent_lead(replace(found, model=replace(found.model, x=x), effects=effects))
    if not named:
        assert lead == ()
        return
    (text,) = lead
    number = "" if named == "link_length" else f" (cause {len(effects)})"
    assert text.startswith(f"First check the geometry{number}: zero of joint2 (joint2.theta), 12")


def test_a_cause_of_a_size_that_no_arm_has_only_looks_like_it(found: po.Diagnosis) -> None:
    """Nothing is opened for it: the screen says what it would take."""
    first, *rest = found.effects
    like = "a gear with a crack: 3 mrad, where 1 mrad is usual"
    odd = replace(found, effects=(replace(first, would_need=like), *rest))
    text = " ".join(render(on_a_screen(diagnosis_report(odd), 100, ()), 100).split())
    assert "1. looks like cyclic error (joint1, 73.0/rev" in text
    assert "Looks like (1) an error that only looks like this, until shown otherwise: it would take a gear with" in text
    assert not re.search(r"Look at \([^)]*\b1\b", text)


def test_orientations_that_the_file_has_are_used_before_others_are_measured(found: po.Diagnosis) -> None:
    rival = replace(found.effects[0], confounded_with=(GearEccentricity(joint="joint1"),))
    turned = replace(found.request.data, rotation=np.tile([1.0, 0.0, 0.0, 0.0], (len(found.request.data), 1)))
    other = replace(found, request=replace(found.request, data=turned), effects=(rival, *found.effects[1:]))
    texts = [" ".join(render(on_a_screen(diagnosis_report(one), 100, ()), 100).split()) for one in (found, other)]
    assert ["Use first (1) the orientations in the file" in text for text in texts] == [False, True]
