"""The report on a diagnosis: what the simulation gets wrong, why, what naming it brings, and what stays open."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.diagnosis.instrument import position_sigma
from posture_opt.report.blocks import Block, Facts, Report, Table
from posture_opt.report.cause_blocks import causes_block, confusion_block, cyclic_block
from posture_opt.report.diagnosed import MODELS, Diagnosed
from posture_opt.report.effect_words import cause_words, main_size, short_words
from posture_opt.report.extended_blocks import choice_block, choice_lead
from posture_opt.report.goal_blocks import goals_block, goals_lead
from posture_opt.report.open_blocks import absorbed_block, left_block, scores_block, unknowable_block
from posture_opt.report.parts import note_facts, robot_facts
from posture_opt.report.split_blocks import split_block
from posture_opt.report.units_text import count, decimals_of, fixed, number, percent, stated_length

if TYPE_CHECKING:
    from posture_opt.diagnosis.findings import Finding
    from posture_opt.diagnosis.validation import Statistics
    from posture_opt.problem.problem import Problem

_MOST_NAMES = 3
_ELSEWHERE = 20  # times the errors at home: no arm drifts that far
_LEFT_OUT = {
    "pose": "its pose",
    "block": "its block of the workspace",
    "place": "the place that it touches",
}


def diagnosis_report(problem: Problem, diagnosed: Diagnosed) -> Report:
    """The verdict, the causes, what they bring, what they may be confused with, what stays open, the data."""
    blocks = (
        causes_block(diagnosed),
        *cyclic_block(diagnosed),
        errors_block(diagnosed),
        *([test_block(diagnosed)] if diagnosed.diagnosis.test is not None else []),
        *choice_block(diagnosed.plans),
        *goals_block(diagnosed.goals),
        *confusion_block(diagnosed),
        *split_block(diagnosed),
        left_block(diagnosed),
        scores_block(diagnosed),
        absorbed_block(diagnosed),
        unknowable_block(diagnosed),
        data_block(problem, diagnosed),
    )
    return Report(problem.name or "Diagnosis", answer(diagnosed), blocks)


def answer(diagnosed: Diagnosed) -> tuple[str, ...]:
    """The verdict in one sentence, and what it brings in another."""
    found = diagnosed.diagnosis
    geometry = [f for f in found.findings if f.effect is None and f.noise is None]
    causes = [f for f in found.findings if f not in geometry] or geometry
    said = [_named(diagnosed, f) for f in causes[:_MOST_NAMES]]
    more = len(causes) - len(said)
    names = "; ".join(said) + (f"; and {count(more, 'more cause')}" if more else "")
    beside = " Beside that, the geometry of the arm is off." if geometry and causes is not geometry else ""
    if found.outcome == "none_found":
        first = "The model is right as far as these data can tell: nothing is found that it gets wrong."
    elif found.outcome == "effects_found":
        first = f"What the model gets wrong has a name: {names}.{beside}"
    elif said:
        first = f"Part of what the model gets wrong has a name: {names}. The rest has none.{beside}"
    else:
        first = "Something is left that the model gets wrong, and no cause of the catalogue explains it."
    return (
        first,
        _improvement(diagnosed),
        *_elsewhere(diagnosed),
        *choice_lead(diagnosed.plans),
        *goals_lead(diagnosed.goals),
    )


def _named(diagnosed: Diagnosed, finding: Finding) -> str:
    place = diagnosed.place(finding)
    if place is not None and getattr(finding.effect, "loads", "masses") == "points":
        return cause_words(finding.kind, finding.target)
    size = main_size(finding, None if place is None else diagnosed.amplitude(place))
    words = cause_words(finding.kind, finding.target, finding.estimate)
    return f"{words} ({size})" if any(map(str.isdigit, size)) and finding.kind != "instrument_field" else words


def _improvement(diagnosed: Diagnosed) -> str:
    found = diagnosed.diagnosis
    sizes = {name: found.errors[name].rms for name in MODELS}
    text = f"Where they had not been seen, positions were {_mm(sizes['nominal'])} mm off as the arm stands (RMS), "
    text += f"{_mm(sizes['calibrated'])} mm calibrated"
    if diagnosed.effects:
        text += f", and {_mm(sizes['extended'])} mm with {_these(len(diagnosed.effects))}"
    floor, _ = diagnosed.floor
    return text + (f"; noise alone makes {_mm(floor)} mm." if 0 < floor < sizes["extended"] else ".")


def _these(n: int) -> str:
    return "this effect" if n == 1 else f"these {n} effects"


def _elsewhere(diagnosed: Diagnosed) -> tuple[str, ...]:
    test = diagnosed.diagnosis.test
    if test is None or not diagnosed.effects:
        return ()
    if test.gain.low > 0:
        return (f"The gain holds on the test file: {percent(test.gain.value)} off the RMS.",)
    if test.gain.value > 0:
        off = f"the RMS drops by {percent(test.gain.value)}"
        return (f"On the test file {off}, which {count(len(test.data), 'row')} cannot tell from chance: no sure gain.",)
    return ("On the test file it is no gain: there the arm with its effects errs as much as without, or more.",)


def errors_block(diagnosed: Diagnosed) -> Block:
    """Position errors of the three models, cross-validated, with the noise floor."""
    found = diagnosed.diagnosis
    rounds = min(diagnosed.folds, len(np.unique(found.groups)))
    how = f"Every row is predicted by an arm that was fitted without {_LEFT_OUT[found.by]}"
    how += "." if found.by == "place" else f", in {rounds} rounds."
    rows = [
        _cells(words, found.errors[name], float(found.held[name].inside.mean()))
        for name, words in _models(diagnosed).items()
    ]
    floor, source = diagnosed.floor
    if floor:
        rows.append(("noise alone", _mm(floor), "", "", "", "", ""))
    headers = ("position error [mm]", "RMS", "interval of RMS", "mean", "95 % below", "max", "in its 95 % region")
    texts = [f"{how} The interval holds the RMS with 95 % confidence."]
    if diagnosed.effects:
        texts.append(_gain_text(diagnosed))
    if floor:
        texts.append(f"Noise alone is {source}{_beside(source, floor, found.errors['extended'], found.verdict)}")
    return Block("What naming the cause brings", (*texts, Table(headers, tuple(rows))), "diagnosis_errors")


def _models(diagnosed: Diagnosed) -> dict[str, str]:
    """The models that differ."""
    return {name: words for name, words in MODELS.items() if name != "extended" or diagnosed.effects}


def _beside(source: str, floor: float, left: Statistics, verdict: str) -> str:
    if floor > left.interval[1]:
        return ": more than is left, so it is better than that."
    if floor > left.interval[0]:
        if verdict == "unexplained":
            return ": about what is left, so what has no name makes little of it on average."
        return ": about what is left, so there is nothing more to gain."
    return "; the scatter of the arm itself comes on top." if "instrument" in source else "; no model does better."


def _gain_text(diagnosed: Diagnosed) -> str:
    gain = diagnosed.diagnosis.gain
    span = f"{percent(gain.low)} to {percent(gain.high)} with 95 % confidence"
    if gain.low > 0:
        return f"The effects take {percent(gain.value)} off the RMS of the calibrated arm ({span})."
    return f"The effects bring no sure gain over the calibrated arm: {percent(gain.value)} off its RMS ({span})."


def _cells(name: str, s: Statistics, inside: float) -> tuple[str, ...]:
    return (name, *_figures(s), percent(inside))


def _figures(s: Statistics) -> tuple[str, ...]:
    low, high = (value * 1e3 for value in s.interval)
    decimals = decimals_of(high, 3)
    return (_mm(s.rms), f"{fixed(low, decimals)} to {fixed(high, decimals)}", _mm(s.mean), _mm(s.p95), _mm(s.max))


def _mm(metres: float) -> str:
    return number(metres * 1e3)


def test_block(diagnosed: Diagnosed) -> Block:
    """Another file, predicted by what this one taught; effect by effect."""
    test = diagnosed.diagnosis.test
    assert test is not None
    how = "base and tool fitted again to it" if test.refitted else "nothing fitted to it"
    text = f"{Path(test.data.file).name or 'table'}, {count(len(test.data), 'row')}: {how}."
    headers = ("position error [mm]", "RMS", "interval of RMS", "mean", "95 % below", "max")
    table = Table(headers, tuple((words, *_figures(test.models[name])) for name, words in _models(diagnosed).items()))
    items: list[str | Facts | Table] = [text, table]
    own = diagnosed.diagnosis.errors["calibrated"].rms
    if not test.refitted and test.models["calibrated"].rms > _ELSEWHERE * own:
        items.append(
            "So far off, base or instrument may have stood elsewhere: --refit-frames fits base and tool again."
        )
    rows = []
    for place, finding in diagnosed.effects:
        gain = test.gains[place]
        name = short_words(finding.kind, finding.target, finding.estimate)
        rows.append(
            (name, percent(finding.gain), "" if gain is None else percent(gain.value), _held(finding.gain, gain))
        )
    if rows:
        items.append(Table(("effect", "gain here", "on the test file", "verdict"), tuple(rows)))
    return Block("On the test file", tuple(items))


def _held(here: float, gain: object) -> str:
    from posture_opt.diagnosis.second_session import Gain

    if not isinstance(gain, Gain):
        return "left out of it"
    if gain.low > 0:
        return "holds"
    return "too small to be sure" if gain.value > 0 else "no gain"


def data_block(problem: Problem, diagnosed: Diagnosed) -> Block:
    """The file, its rows, the instrument, and what looks odd."""
    data, found = diagnosed.data, diagnosed.diagnosis
    sigma = position_sigma(problem, data)
    stated = f"{stated_length(sigma)} (one standard deviation of a coordinate)" if sigma else "no accuracy is stated"
    touched = f"none: the arm touches {count(len(data.point_names), 'fixed point')}"
    gone = found.calibration.lines
    facts = [
        ("File", Path(data.file).name or "table"),
        ("Rows", f"{len(data)} in {count(len(np.unique(data.pose)), 'pose')}"),
        ("Instrument", touched if data.position is None else stated),
        ("Geometry", f"{found.calibration.identifiability.rank} combinations of parameters are fitted in every model"),
        *(
            [("Left out", f"as outliers, lines {', '.join(map(str, gone[:10]))}{' …' * (len(gone) > 10)}")]
            if gone
            else []
        ),
    ]
    notes = note_facts((*data.warnings, *problem.notes, *found.notes))
    return Block("Data", (Facts((*robot_facts(problem), *facts, *notes)),))
