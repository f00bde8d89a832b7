"""What a diagnosis has to say: errors, causes, what is delivered, confirmation by another file, and what stays open."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.calibration.calibration_statements import (
    ELSEWHERE,
    data_warnings,
    doubts,
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
    from collections.abc import Sequence

    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.diagnosis.measured_goals import MeasuredGoals
    from posture_opt.diagnosis.noise.uneven_noise import UnevenErrors
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
    said = [state("diagnosis.promise-of-stretches")] if found.by == "stretch" else []
    if found.times_allowed is None or found.verdict != "unexplained":
        return said
    return [state("diagnosis.beyond-allowed", times=Quantity(found.times_allowed, "number")), *said]


def _causes(found: Diagnosis) -> list[Statement]:
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
    largest = found.unbuildable
    if largest is None or found.overfitted:
        return []
    parameter = largest.parameter
    off = Quantity(largest.value, "length" if parameter.unit == "m" else "angle", largest.std)
    which = "zero-unbuildable" if largest.is_zero else "correction-unbuildable"
    noun = GeometricDeviation.of(parameter).noun_on(found.problem.robot)
    return [state(f"diagnosis.{which}", parameter.name, noun=noun, off=off)]


def _far_row(found: Diagnosis) -> list[Statement]:
    data, best = found.model.residuals.data, found.errors["extended"]
    if data.part is not None or best.max < _FAR_OFF * best.p95:
        return [state("diagnosis.rows-within", p95=Quantity(best.p95), most=Quantity(best.max))]
    line = data.line[int(np.argmax(np.linalg.norm(found.held["extended"].errors, axis=1)))]
    return [state("diagnosis.row-far-off", str(line), off=Quantity(best.max), p95=Quantity(best.p95))]


def _delivery(found: Diagnosis) -> list[Statement]:
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
    assert found.test is not None
    nominal, calibrated, extended = (found.test.models[name].rms for name in MODELS)
    if extended >= nominal:
        return "test-nothing-holds" if calibrated >= nominal else "test-effects-fail"
    if extended >= calibrated:
        return "test-no-gain"
    return "test-gain-holds" if found.test.gain.low > 0 else "test-gain-unsure"


def _next(found: Diagnosis) -> list[Statement]:
    if found.split is not None and len(found.split.rows):
        return [state("diagnosis.measure-next", postures=len(found.split.rows))]
    if found.repeats_decide:
        joints, one = [plan.target for plan in found.repeat_plans], found.repeat_plans[0]
        return [state("diagnosis.repeat-postures", joints=joints, postures=len(one.rows), times=one.times)]
    return []


def _unsided(lines: Sequence[int]) -> list[Statement]:
    return [state("diagnosis.rows-without-side", lines=listed_lines(lines))] if lines else []


def _gain(found: Diagnosis) -> list[Statement]:
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
    if goals is None:
        return []
    old, new = (Quantity(float(np.median(goals.sent[name].missed))) for name in ("nominal", "extended"))
    best = goals.uncorrected["extended"]
    said = [state("diagnosis.goals-missed", goals=goals.goals, old=old, new=new)]
    if best.better > goals.chance + goals.margin:
        return [*said, state("diagnosis.goals-choice-better", share=Quantity(best.better, "share"))]
    return [*said, state("diagnosis.goals-choice-random")]


_MIN_IDENTIFIABLE_SHARE = 0.1  # of an effect that geometry leaves: ten times larger it would be as significant
_MAX_NAMES = 12
_TIME = "time"  # the place of residuals that are alike in the order of measuring


def open_statements(found: Diagnosis) -> list[Statement]:
    """What is left unexplained, what to repeat for it, and which causes these data cannot show."""
    return [*_structure(found), *_not_visible(found), *_discrimination(found)]


def _structure(found: Diagnosis) -> list[Statement]:
    left = found.adequacy
    if found.verdict != "unexplained":
        return [state("diagnosis.structure-none", p=Quantity(left.p_value, "p"))]
    said, structured = [], bool(found.unexplained) or left.p_value < levels.LACK_OF_FIT_LEVEL
    if structured:
        which = "structure-small" if found.like_noise else "structure"
        said.append(state(f"diagnosis.{which}", left=Quantity(found.errors["extended"].rms)))
    if found.unexplained:
        said.append(state("diagnosis.structure-depends", components=[one.words for one in found.unexplained]))
    order = "the order of the rows" if left.place == _TIME else left.place
    if not found.unexplained and structured and left.place in found.unexplained_places:
        said.append(state("diagnosis.structure-along", order))
    if left.structure < UNLIKELY:
        said.append(state("diagnosis.neighbours-correlated", order, p=Quantity(left.structure, "p")))
    if left.lack_of_fit < UNLIKELY:
        said.append(state("diagnosis.lack-of-fit", p=Quantity(left.lack_of_fit, "p")))
    said += uneven_statements(found.uneven)
    for plan in found.repeat_plans:
        lines = ", ".join(map(str, plan.rows.line))
        said.append(state("diagnosis.repeat-plan", plan.target, lines=lines, times=plan.times))
    said += [state("diagnosis.one-shape", joint, effects=names) for joint, names in _sums(found).items()]
    return said


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
        which = "uneven-scatters" if one.scatters else "uneven-refuted" if one.refuted else "uneven"
        which = "uneven-still" if one.still and which == "uneven" else which
        said.append(state(f"diagnosis.{which}", joints, clause=clause, p=Quantity(one.p_value, "p")))
    return said


def _sums(found: Diagnosis) -> dict[str, list[str]]:
    slow: dict[str, list[str]] = {}
    for _, finding in found.fitted_effects:
        if finding.effect is not None and finding.effect.slow:
            slow.setdefault(finding.target, []).append(finding.cause.title)
    return {joint: names for joint, names in slow.items() if len(names) > 1}


def _not_visible(found: Diagnosis) -> list[Statement]:
    said, search = [], found.search
    absorbed = {candidate.what.label for candidate, _ in search.absorbed}
    faint = {j.candidate.what.label for j in search.scored if j.candidate.named and j.rho < _MIN_IDENTIFIABLE_SHARE}
    for id, names in (("absorbed", absorbed), ("faint", faint)):
        if names:
            shown = sorted(names)[:_MAX_NAMES]
            more = [f"{len(names) - len(shown)} more"] if len(shown) < len(names) else []
            said.append(state(f"diagnosis.{id}", causes=[*shown, *more]))
    for key, (what, hint, kinds) in missing_inputs(found.model.residuals).items():
        id = "not-varied" if getattr(found.request.data, key, None) is not None else "not-searched"
        lacking = [kind.replace("_", " ") for kind in kinds]
        said.append(state(f"diagnosis.{id}", what, kinds=lacking, hint=hint))
    for limit in unknowable_causes(found.model.residuals):
        kind, hint = limit.kind.replace("_", " "), limit.hint.rstrip(".")
        said.append(state("diagnosis.unknowable", kind, reason=limit.reason.rstrip("."), hint=hint))
    return said


def _discrimination(found: Diagnosis) -> list[Statement]:
    plan = found.split
    if plan is None:
        return []
    said = [state("diagnosis.split-read")]
    if any(split.count is None for pairs in plan.pairs.values() for split in pairs):
        said.append(state("diagnosis.split-impossible"))
    return [*said, *([state("diagnosis.split-caution")] if len(plan.rows) else [])]
