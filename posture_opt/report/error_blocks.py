"""What the report says of position errors: those of three models beside what noise alone makes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.blocks import Block, Table
from posture_opt.report.diagnosed import MODELS, Diagnosed
from posture_opt.report.units_text import decimals_of, fixed, number, percent

if TYPE_CHECKING:
    from posture_opt.diagnosis.validation import Statistics

_CHOSEN = "Their sizes were fitted anew in each round; the effects themselves were chosen on all rows."
_LEFT_OUT = {
    "pose": "its pose",
    "block": "its block of the workspace",
    "place": "the place that it touches",
}


def errors_block(diagnosed: Diagnosed) -> Block:
    """Position errors of the three models, cross-validated, with the noise floor."""
    found = diagnosed.diagnosis
    rounds = min(diagnosed.folds, len(np.unique(found.groups)))
    how = f"Every row is predicted by an arm that was fitted without {_LEFT_OUT[found.by]}"
    how += "." if found.by == "place" else f", in {rounds} rounds."
    rows = [
        _cells(words, found.errors[name], float(found.held[name].inside.mean()))
        for name, words in models_of(diagnosed).items()
    ]
    floor, source = diagnosed.floor
    if floor:
        rows.append(("noise alone", mm(floor), "", "", "", "", ""))
    headers = ("position error [mm]", "RMS", "interval of RMS", "mean", "95 % below", "max", "in its 95 % region")
    texts = [f"{how} The interval holds the RMS with 95 % confidence."]
    if diagnosed.effects:
        texts.append(_gain_text(diagnosed))
    if floor:
        texts.append(f"Noise alone is {source}{_beside(source, floor, found.errors['extended'], found.verdict)}")
    return Block("What naming the cause brings", (*texts, Table(headers, tuple(rows))), "diagnosis_errors")


def models_of(diagnosed: Diagnosed) -> dict[str, str]:
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
        text = f"The effects take {percent(gain.value)} off the RMS of the calibrated arm ({span})."
    else:
        text = f"The effects bring no sure gain over the calibrated arm: {percent(gain.value)} off its RMS ({span})."
    return f"{text} {_CHOSEN}"


def _cells(name: str, s: Statistics, inside: float) -> tuple[str, ...]:
    return (name, *figures_of(s), percent(inside))


def figures_of(s: Statistics) -> tuple[str, ...]:
    low, high = (value * 1e3 for value in s.interval)
    decimals = decimals_of(high, 3)
    return (mm(s.rms), f"{fixed(low, decimals)} to {fixed(high, decimals)}", mm(s.mean), mm(s.p95), mm(s.max))


def mm(metres: float) -> str:
    return number(metres * 1e3)
