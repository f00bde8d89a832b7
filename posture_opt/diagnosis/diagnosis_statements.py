"""What a diagnosis has to say: errors, causes, what is delivered, confirmation by another file, and what stays open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.assumptions.contradictions import GeometricDeviation
from posture_opt.calibration.calibration_statements import (
    ELSEWHERE,
    data_warnings,
    doubts,
    frames,
    instrument,
    left_out,
    rows_in_time,
    thinned,
)
from posture_opt.diagnosis.cause_statements import cause_statements, may_work, unconfirmed
from posture_opt.diagnosis.causes.causes import missing_inputs, unknowable_causes
from posture_opt.diagnosis.scores import levels
from posture_opt.errors import enumerated
from posture_opt.statements import Quantity, Statement, state
from posture_opt.statements.notation import listed_lines, sentence
from posture_opt.statements.quantity import UNLIKELY

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.diagnosis.measured_goals import MeasuredGoals
    from posture_opt.diagnosis.noise.uneven_noise import UnevenErrors
    from posture_opt.selection.problem_data import ProblemData

MODELS = ("nominal", "calibrated", "extended")


def statements_of(found: Diagnosis) -> Iterator[Statement]:
    calibration, data = found.calibration, found.request.data
    yield _errors(found)
    if found.overfitted:
        yield state("diagnosis.overfitted")
    yield from instrument(calibration, found.delivery.nominal)
    yield from frames(calibration) if found.delivery.nominal else ()
    yield from (reading.statement for reading in found.weights)
    yield from doubts(calibration)
    if found.times_allowed is not None and found.verdict == "unexplained":
        yield state("diagnosis.beyond-allowed", times=Quantity(found.times_allowed, "number"))
    if found.by == "stretch":
        yield state("diagnosis.promise-of-stretches")
    yield from _unbuildable(found)
    yield from _causes(found)
    yield from may_work(found)
    yield from () if found.comparison is None else found.comparison.statements
    yield _far_row(found)
    yield from rows_in_time(data, found.start_up, found.scatter_change)
    yield from data_warnings(data.warnings)
    yield from _delivery(found)
    yield from _test(found)
    yield from _next(found)
    yield from left_out(calibration, [line for line in calibration.lines if line not in found.unsided_lines])
    if found.unsided_lines:
        yield state("diagnosis.rows-without-side", lines=listed_lines(found.unsided_lines))
    yield from _gain(found)
    if found.goals is not None:
        yield from _goals(found.goals)
    yield from cause_statements(found)
    yield from _structure(found)
    yield from _not_visible(found)
    if found.split is not None:
        yield state("diagnosis.split-read")
        if any(split.count is None for pairs in found.split.pairs.values() for split in pairs):
            yield state("diagnosis.split-impossible")
        if len(found.split.rows):
            yield state("diagnosis.split-caution")
    yield from thinned(found.large)
    for text in (*data.notes, *found.notes):
        yield state("diagnosis.note", text=sentence(text))


def _errors(found: Diagnosis) -> Statement:
    data, floor = found.request.data, found.noise_floor
    what = "error" if data.position is not None or data.touches else data.kind.error_words
    models, which = (MODELS, "error-effects") if found.fitted_effects else (MODELS[:2], "error")
    sizes = {name: Quantity(found.errors[name].rms) for name in models}
    if not floor.rms:
        return state(f"diagnosis.{which}", what=what, **sizes)
    which += "-noise" if floor.repeated else "-instrument"
    return state(f"diagnosis.{which}", what=what, noise=Quantity(floor.rms), source=floor.source, **sizes)


def _causes(found: Diagnosis) -> Iterator[Statement]:
    sure = [f for f in found.effects if f.determined]
    geometry = [f for f in sure if f.effect is None and f.noise is None]
    others = [f for f in sure if f not in geometry]
    causes = sorted(others or geometry, key=lambda f: unconfirmed(f, found.test))
    few = len(causes) <= 2
    names = [sized_words(found, f) for f in causes] if few else _by_title(causes)
    if others and geometry:
        names.append("the geometry differs from the file" if few else "a geometry that differs from the file")
    if found.verdict == "none_found":
        yield state("diagnosis.none-found")
    elif names:
        which = "causes-explain" if found.verdict == "effects_found" else "causes-explain-part"
        yield state(f"diagnosis.{which}", causes=names)
    elif found.verdict == "unexplained":
        yield state("diagnosis.no-cause-fits")
    if vague := [f for f in found.effects if not f.determined]:
        yield state("diagnosis.suspected", causes=_by_title(vague))


def _by_title(findings: Sequence[Finding]) -> list[str]:
    """Causes by what they are and of what: "cyclic error of elbow and wrist_1"; the first three kinds of many."""
    titles: dict[str, list[str]] = {}
    for finding in findings:
        title = finding.cause.title if finding.plausible else f"what looks like {finding.cause.title}"
        titles.setdefault(title, []).append(finding.cause.place)
    texts = [f"{title} of {enumerated(places)}" if any(places) else title for title, places in titles.items()]
    return _first(texts, 3)


def _first(texts: Sequence[str], most: int) -> list[str]:
    more = len(texts) - most
    return [*texts[:most], *([f"{more} more"] if more > 0 else [])]


def words(finding: Finding, problem: ProblemData) -> str:
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


def _unbuildable(found: Diagnosis) -> Iterator[Statement]:
    """The correction of the geometry that no arm is built with, where the geometry is a cause."""
    largest = found.unbuildable
    if largest is not None and not (found.overfitted or found.questioned):
        parameter = largest.parameter
        off = Quantity(largest.value, "length" if parameter.unit == "m" else "angle", largest.std)
        which = "zero-unbuildable" if largest.is_zero else "correction-unbuildable"
        noun = GeometricDeviation.of(parameter).noun_on(found.problem.robot)
        yield state(f"diagnosis.{which}", parameter.name, noun=noun, off=off)


def _far_row(found: Diagnosis) -> Statement:
    """Within what 95 % of the rows are, and all, or a row that is far off; kinds of instruments differ in accuracy."""
    data, best = found.model.residuals.data, found.errors["extended"]
    if data.part is not None or best.max < 3 * best.p95:
        return state("diagnosis.rows-within", p95=Quantity(best.p95), most=Quantity(best.max))
    line = data.line[int(np.argmax(np.linalg.norm(found.held["extended"].errors, axis=1)))]
    return state("diagnosis.row-far-off", str(line), off=Quantity(best.max), p95=Quantity(best.p95))


def _delivery(found: Diagnosis) -> Iterator[Statement]:
    """Which arm is delivered where it is not the one with all effects, and how well it explains these data."""
    delivery, effects = found.delivery, found.model.effects
    held, (rms, outliers) = Quantity(delivery.held.rms), found.delivered
    if not delivery.kept and effects:
        yield state(f"diagnosis.delivered-{'nominal' if delivery.nominal else 'calibrated'}", held=held)
    yield state("diagnosis.delivered-rms", rms=Quantity(rms), outliers=outliers)
    if delivery.nominal:
        return
    for reason, places in (
        ("which belongs to this session", delivery.session),
        ("of undetermined size", delivery.vague),
        ("which held-out rows do not need", delivery.dropped),
    ):
        if places:
            names = [effects[i].label for i in places]
            yield state("diagnosis.delivered-without", effects=names, reason=reason, held=held)
    if any("time" in effects[i].needs for i in delivery.session):
        yield state("diagnosis.delivered-average")


def _test(found: Diagnosis) -> Iterator[Statement]:
    """Whether what is delivered holds on a test file, and which causes that file confirms."""
    test = found.test
    if test is None:
        return
    errors = {name: Quantity(test.models[name].rms) for name in MODELS if name in test.models}
    nominal, calibrated = errors["nominal"].value, errors["calibrated"].value
    gains = [gain for gain in test.gains if gain is not None]
    if gains:
        yield state(f"diagnosis.{_held_on(found)}", rows=len(test.file.data), **errors)
    else:
        holds = "test-holds" if calibrated < nominal else "test-fails"
        yield state(f"calibration.{holds}", nominal=errors["nominal"], calibrated=errors["calibrated"])
        if found.fitted_effects:
            yield state("diagnosis.test-without-effects")
    if not test.file.refitted and calibrated > ELSEWHERE * found.errors["calibrated"].rms:
        yield state("calibration.test-moved")
    confirmed, against = sum(gain.low > 0 for gain in gains), sum(gain.value < 0 for gain in gains)
    if confirmed < len(gains):
        yield state("diagnosis.test-confirms", confirmed=confirmed, tested=len(gains), against=against)
    if gains and test.worse:
        yield state("diagnosis.test-extrapolates", effects=[test.effects[i].label for i in test.worse])


def _held_on(found: Diagnosis) -> str:
    """Whether the effects hold on the test file, as the end of an id."""
    assert found.test is not None
    nominal, calibrated, extended = (found.test.models[name].rms for name in MODELS)
    if extended >= nominal:
        return "test-nothing-holds" if calibrated >= nominal else "test-effects-fail"
    if extended >= calibrated:
        return "test-no-gain"
    return "test-gain-holds" if found.test.gain.low > 0 else "test-gain-unsure"


def _next(found: Diagnosis) -> Iterator[Statement]:
    """What to measure next: postures that refute the wrong cause, or repeats that tell scatter from structure."""
    if found.split is not None and len(found.split.rows):
        yield state("diagnosis.measure-next", postures=len(found.split.rows))
    elif found.repeats_decide:
        joints, one = [plan.target for plan in found.repeat_plans], found.repeat_plans[0]
        yield state("diagnosis.repeat-postures", joints=joints, postures=len(one.rows), times=one.times)


def _gain(found: Diagnosis) -> Iterator[Statement]:
    """What the effects bring on held-out rows, and how near noise is to what they leave."""
    gain, left, floor = found.gain, found.errors["extended"], found.noise_floor
    if found.fitted_effects:
        which = "gain-significant" if gain.low > 0 else "gain-insignificant"
        value, low, high = (Quantity(v, "share") for v in (gain.value, gain.low, gain.high))
        yield state(f"diagnosis.{which}", gain=value, low=low, high=high)
    inside = float(found.held["extended"].inside.mean())
    if inside < 0.9:
        yield state("diagnosis.regions-too-small", inside=Quantity(inside, "share"))
    if floor.rms:
        values = {"noise": Quantity(floor.rms), "left": Quantity(left.rms), "cost": Quantity(found.held_out_noise)}
        which = "noise-reached" if found.held_out_noise >= left.interval[0] else "noise-not-reached"
        which = "noise-exceeds" if floor.rms > left.interval[1] else which
        yield state(f"diagnosis.{which}", **values)


def _goals(goals: MeasuredGoals) -> Iterator[Statement]:
    """What the data say of the choice of postures, where targets were measured in several."""
    old, new = (Quantity(float(np.median(goals.sent[name].missed))) for name in ("nominal", "extended"))
    yield state("diagnosis.goals-missed", goals=goals.goals, old=old, new=new)
    best = goals.uncorrected["extended"]
    if best.better > goals.chance + goals.margin:
        yield state("diagnosis.goals-choice-better", share=Quantity(best.better, "share"))
    else:
        yield state("diagnosis.goals-choice-random")


def _structure(found: Diagnosis) -> Iterator[Statement]:
    """Whether anything is left that no cause explains, how certainly, and where; tests that find nothing left out."""
    left = found.adequacy
    if found.verdict != "unexplained":
        yield state("diagnosis.structure-none", p=Quantity(left.p_value, "p"))
        return
    structured = bool(found.unexplained) or left.p_value < levels.LACK_OF_FIT_LEVEL
    order = "the order of the rows" if left.place == "time" else left.place
    if structured:
        which = "structure-small" if found.like_noise else "structure"
        yield state(f"diagnosis.{which}", left=Quantity(found.errors["extended"].rms))
    if found.unexplained:
        yield state("diagnosis.structure-depends", components=[one.words for one in found.unexplained])
    elif structured and left.place in found.unexplained_places:
        yield state("diagnosis.structure-along", order)
    if left.structure < UNLIKELY:
        yield state("diagnosis.neighbours-correlated", order, p=Quantity(left.structure, "p"))
    if left.lack_of_fit < UNLIKELY:
        yield state("diagnosis.lack-of-fit", p=Quantity(left.lack_of_fit, "p"))
    yield from uneven_statements(found.uneven)
    for plan in found.repeat_plans:
        lines = ", ".join(map(str, plan.rows.line))
        yield state("diagnosis.repeat-plan", plan.target, lines=lines, times=plan.times)
    slow: dict[str, list[str]] = {}  # joints on which several slow curves are needed at once
    for _, finding in found.fitted_effects:
        if finding.effect is not None and finding.effect.slow:
            slow.setdefault(finding.target, []).append(finding.cause.title)
    for joint, names in slow.items():
        if len(names) > 1:
            yield state("diagnosis.one-shape", joint, effects=names)


def uneven_statements(uneven: Sequence[UnevenErrors]) -> list[Statement]:
    """Errors that look like noisy joints or instruments; joints of which repeats say the same share a sentence."""
    alike: dict[tuple[object, ...], list[UnevenErrors]] = {}
    for errors in uneven:
        of_joint = errors.effect.moved_joint and (errors.refuted, errors.still, errors.scatters)
        alike.setdefault((errors.effect.kind, of_joint or errors.effect.target), []).append(errors)
    said = []
    for those in alike.values():
        one = max(those, key=lambda errors: errors.p_value)
        joints = enumerated([errors.effect.target for errors in those])
        several = one.effect.uneven_words.format(target=f"any of {joints}")
        clause = one.effect.uneven_clause if len(those) == 1 else several
        marks = (("-scatters", one.scatters), ("-refuted", one.refuted), ("-still", one.still))
        which = "uneven" + next((end for end, holds in marks if holds), "")
        said.append(state(f"diagnosis.{which}", joints, clause=clause, p=Quantity(one.p_value, "p")))
    return said


def _not_visible(found: Diagnosis) -> Iterator[Statement]:
    """Causes that geometry absorbs in these data, that were not searched for, or that no such data can show."""
    search, residuals = found.search, found.model.residuals
    absorbed = {candidate.what.label for candidate, _ in search.absorbed}
    # Of a tenth of its length that geometry leaves, an effect would have to be ten times larger.
    faint = {j.candidate.what.label for j in search.scored if j.candidate.named and j.rho < 0.1}
    for id, names in (("absorbed", absorbed), ("faint", faint)):
        if names:
            yield state(f"diagnosis.{id}", causes=_first(sorted(names), 12))
    for key, (what, hint, kinds) in missing_inputs(residuals).items():
        id = "not-varied" if getattr(found.request.data, key, None) is not None else "not-searched"
        yield state(f"diagnosis.{id}", what, kinds=[kind.replace("_", " ") for kind in kinds], hint=hint)
    for limit in unknowable_causes(residuals):
        kind, hint = limit.kind.replace("_", " "), limit.hint.rstrip(".")
        yield state("diagnosis.unknowable", kind, reason=limit.reason.rstrip("."), hint=hint)
