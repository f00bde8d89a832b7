"""What a diagnosis has to say: the errors, the causes, what is delivered, and whether another file confirms it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.calibration_statements import (
    ELSEWHERE,
    data_warnings,
    doubts,
    instrument,
    left_out,
    rows_in_time,
    thinned,
)
from posture_opt.diagnosis.cause_actions import unconfirmed
from posture_opt.diagnosis.cause_statements import cause_statements, may_work
from posture_opt.diagnosis.open_statements import open_statements
from posture_opt.errors import enumerated
from posture_opt.statements import Quantity, Statement, state
from posture_opt.statements.notation import listed_lines, sentence

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.diagnosis.measured_goals import MeasuredGoals
    from posture_opt.selection.problem_data import ProblemData

MODELS = ("nominal", "calibrated", "extended")
_MAX_SIZED_CAUSES = 2  # in the first lines with their sizes; of more, their kinds
_MAX_KINDS = 3
_FAR_OFF = 3.0  # times what 95 % of the rows are within: a row that is farther off is looked at by itself
_MIN_COVERAGE = 0.9  # of the 95 % regions: below it they are said to be too small


def statements_of(found: Diagnosis) -> tuple[Statement, ...]:
    """All statements of a diagnosis, the errors first."""
    calibration = found.calibration
    gone = [line for line in calibration.lines if line not in found.unsided_lines]
    return (
        _errors(found),
        *([state("diagnosis.overfitted")] if found.overfitted else []),
        *instrument(calibration, found.delivery.nominal),
        *(reading.statement for reading in found.weights),
        *doubts(calibration),
        *_beyond_allowed(found),
        *_unbuildable(found),
        *_causes(found),
        *may_work(found),
        *(() if found.comparison is None else found.comparison.statements),
        *_far_row(found),
        *rows_in_time(found.request.data, found.start_up, found.scatter_change),
        *data_warnings(found.request.data.warnings),
        *_delivery(found),
        *_test(found),
        *_next(found),
        *left_out(calibration, gone),
        *(
            [state("diagnosis.rows-without-side", lines=listed_lines(found.unsided_lines))]
            if found.unsided_lines
            else []
        ),
        *_gain(found),
        *_goals(found.goals),
        *cause_statements(found),
        *open_statements(found),
        *thinned(found.large),
        *(state("diagnosis.note", text=sentence(text)) for text in (*found.request.data.notes, *found.notes)),
    )


def _errors(found: Diagnosis) -> Statement:
    """RMS error on held-out rows of each model, and the noise below them."""
    data, floor = found.request.data, found.noise_floor
    what = "error" if data.position is not None or data.touches else data.kind.error_words
    models = MODELS if found.fitted_effects else MODELS[:2]
    sizes = {name: Quantity(found.errors[name].rms) for name in models}
    which = "error-effects" if found.fitted_effects else "error"
    if not floor.rms:
        return state(f"diagnosis.{which}", what=what, **sizes)
    which += "-noise" if floor.repeated else "-instrument"
    return state(f"diagnosis.{which}", what=what, noise=Quantity(floor.rms), source=floor.source, **sizes)


def _beyond_allowed(found: Diagnosis) -> list[Statement]:
    """That errors are larger than readings and instrument allow, and what the promise of a path is for."""
    said = [state("diagnosis.promise-of-stretches")] if found.by == "stretch" else []
    if found.times_allowed is None or found.verdict != "unexplained":
        return said
    return [state("diagnosis.beyond-allowed", times=Quantity(found.times_allowed, "number")), *said]


def _causes(found: Diagnosis) -> list[Statement]:
    """What explains the errors, or part of them, and what is suspected."""
    geometry = [f for f in found.effects if f.effect is None and f.noise is None]
    others = [f for f in found.effects if f not in geometry and f.determined]
    causes = others or geometry
    ordered = sorted(causes, key=lambda f: unconfirmed(f, found.test))
    few = len(causes) <= _MAX_SIZED_CAUSES
    names = [sized_words(found, f) for f in ordered] if few else _by_title(ordered)
    differs = "the geometry differs from the file" if few else "a geometry that differs from the file"
    names += [differs] if others and geometry else []
    vague = [f for f in found.effects if f not in geometry and not f.determined]
    said = [state("diagnosis.suspected", causes=_by_title(vague))] if vague else []
    if found.verdict == "none_found":
        return [state("diagnosis.none-found"), *said]
    if not names:
        return [state("diagnosis.no-cause-fits"), *said]
    which = "causes-explain" if found.verdict == "effects_found" else "causes-explain-part"
    return [state(f"diagnosis.{which}", causes=names), *said]


def _by_title(findings: Sequence[Finding]) -> list[str]:
    """Causes by what they are and of what: "cyclic error of elbow and wrist_1"; the first three kinds of many."""
    titles: dict[str, list[str]] = {}
    for finding in findings:
        title = finding.cause.title if finding.plausible else f"what looks like {finding.cause.title}"
        titles.setdefault(title, []).append(finding.cause.place)
    texts = [f"{title} of {enumerated(places)}" if any(places) else title for title, places in titles.items()]
    more = len(texts) - _MAX_KINDS
    return [*texts[:_MAX_KINDS], *([f"{more} more"] if more > 0 else [])]


def words(finding: Finding, problem: ProblemData) -> str:
    """A cause in one clause; scatter of which the file states nothing is said to be so."""
    noise, sources = finding.noise, problem.sources
    if noise is not None and noise.unstated and finding.determined:
        names = noise.scatter(problem.robot)
        if not any(sources.scatter[i, i] > 0 for i, name in enumerate(sources.names) if name in names):
            return noise.unstated.format(target=noise.target, size=noise.headline(finding.sizes))
    return finding.cause.worded(finding.sizes) if finding.plausible else finding.cause.looks_like


def sized_words(found: Diagnosis, finding: Finding) -> str:
    """A cause in one clause with its size in brackets, where a single number says it."""
    clause, size = words(finding, found.problem), finding.size_text
    return clause if not size or size in clause else f"{clause} ({size})"


def _unbuildable(found: Diagnosis) -> list[Statement]:
    """The correction of the geometry that no arm is built with, where the geometry is a cause."""
    largest = found.unbuildable
    if largest is None or found.overfitted:
        return []
    parameter = largest.parameter
    off = Quantity(largest.value, "length" if parameter.unit == "m" else "angle", largest.std)
    which = "zero-unbuildable" if largest.is_zero else "correction-unbuildable"
    noun = largest.deviation.noun_on(found.problem.robot)
    return [state(f"diagnosis.{which}", parameter.name, noun=noun, off=off)]


def _far_row(found: Diagnosis) -> list[Statement]:
    """Within what 95 % of the rows are, and all, or a row that is far off; kinds of instruments differ in accuracy."""
    data, best = found.model.residuals.data, found.errors["extended"]
    if data.part is not None or best.max < _FAR_OFF * best.p95:
        return [state("diagnosis.rows-within", p95=Quantity(best.p95), most=Quantity(best.max))]
    line = data.line[int(np.argmax(np.linalg.norm(found.held["extended"].errors, axis=1)))]
    return [state("diagnosis.row-far-off", str(line), off=Quantity(best.max), p95=Quantity(best.p95))]


def _delivery(found: Diagnosis) -> list[Statement]:
    """Which arm is delivered where it is not the one with all effects, and how well it explains these data."""
    delivery, effects = found.delivery, found.model.effects
    held = Quantity(delivery.held.rms)
    rms, outliers = found.delivered
    said = [state("diagnosis.delivered-rms", rms=Quantity(rms), outliers=outliers)]
    if not delivery.kept and effects:
        return [state(f"diagnosis.delivered-{'nominal' if delivery.nominal else 'calibrated'}", held=held), *said]
    reasons = {
        "which belongs to this session": delivery.session,
        "of undetermined size": delivery.vague,
        "which held-out rows do not need": delivery.dropped,
    }
    for reason, places in reasons.items():
        if places:
            names = [effects[i].label for i in places]
            said.append(state("diagnosis.delivered-without", effects=names, reason=reason, held=held))
    if any("time" in effects[i].needs for i in delivery.session):
        said.append(state("diagnosis.delivered-average"))
    return said


def _test(found: Diagnosis) -> list[Statement]:
    """Whether what is delivered holds on a test file, and which causes that file confirms."""
    test = found.test
    if test is None:
        return []
    errors = {name: Quantity(test.models[name].rms) for name in MODELS if name in test.models}
    nominal, calibrated = errors["nominal"].value, errors["calibrated"].value
    moved = not test.file.refitted and calibrated > ELSEWHERE * found.errors["calibrated"].rms
    said = [state("calibration.test-moved")] if moved else []
    if not any(test.gains):
        holds = "test-holds" if calibrated < nominal else "test-fails"
        untested = [state("diagnosis.test-without-effects")] if found.fitted_effects else []
        fitted = {name: errors[name] for name in ("nominal", "calibrated")}
        return [state(f"calibration.{holds}", **fitted), *untested, *said]
    said = [state(f"diagnosis.{_held_on(found)}", rows=len(test.file.data), **errors), *said]
    gains = [gain for gain in test.gains if gain is not None]
    confirmed, against = sum(gain.low > 0 for gain in gains), sum(gain.value < 0 for gain in gains)
    if confirmed < len(gains):
        said.append(state("diagnosis.test-confirms", confirmed=confirmed, tested=len(gains), against=against))
    if test.worse:
        said.append(state("diagnosis.test-extrapolates", effects=[test.effects[i].label for i in test.worse]))
    return said


def _held_on(found: Diagnosis) -> str:
    """Whether the effects hold on the test file, as the end of an id."""
    assert found.test is not None
    nominal, calibrated, extended = (found.test.models[name].rms for name in MODELS)
    if extended >= nominal:
        return "test-nothing-holds" if calibrated >= nominal else "test-effects-fail"
    if extended >= calibrated:
        return "test-no-gain"
    return "test-gain-holds" if found.test.gain.low > 0 else "test-gain-unsure"


def _next(found: Diagnosis) -> list[Statement]:
    """What to measure next: postures that refute the wrong cause, or repeats that tell scatter from structure."""
    if found.split is not None and len(found.split.rows):
        return [state("diagnosis.measure-next", postures=len(found.split.rows))]
    if found.repeats_decide:
        joints, one = [plan.target for plan in found.repeat_plans], found.repeat_plans[0]
        return [state("diagnosis.repeat-postures", joints=joints, postures=len(one.rows), times=one.times)]
    return []


def _unsided(lines: Sequence[int]) -> list[Statement]:
    """Rows that are left out as a joint with play came to them from an unknown side."""
    return [state("diagnosis.rows-without-side", lines=listed_lines(lines))] if lines else []


def _gain(found: Diagnosis) -> list[Statement]:
    """What the effects bring on held-out rows, and how near noise is to what they leave."""
    said = []
    if found.fitted_effects:
        which = "gain-significant" if found.gain.low > 0 else "gain-insignificant"
        sizes = {"gain": found.gain.value, "low": found.gain.low, "high": found.gain.high}
        said.append(state(f"diagnosis.{which}", **{name: Quantity(v, "share") for name, v in sizes.items()}))
    inside = float(found.held["extended"].inside.mean())
    if inside < _MIN_COVERAGE:
        said.append(state("diagnosis.regions-too-small", inside=Quantity(inside, "share")))
    left, floor = found.errors["extended"], found.noise_floor
    if not floor.rms:
        return said
    values = {"noise": Quantity(floor.rms), "left": Quantity(left.rms), "cost": Quantity(found.held_out_noise)}
    which = "noise-reached" if found.held_out_noise >= left.interval[0] else "noise-not-reached"
    which = "noise-exceeds" if floor.rms > left.interval[1] else which
    return [*said, state(f"diagnosis.{which}", **values)]


def _goals(goals: MeasuredGoals | None) -> list[Statement]:
    """What the data say of the choice of postures, where targets were measured in several."""
    if goals is None:
        return []
    old, new = (Quantity(float(np.median(goals.sent[name].missed))) for name in ("nominal", "extended"))
    best = goals.uncorrected["extended"]
    said = [state("diagnosis.goals-missed", goals=goals.goals, old=old, new=new)]
    if best.better > goals.chance + goals.margin:
        return [*said, state("diagnosis.goals-choice-better", share=Quantity(best.better, "share"))]
    return [*said, state("diagnosis.goals-choice-random")]
