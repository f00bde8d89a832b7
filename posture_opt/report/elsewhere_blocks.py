"""What the report says of another file: how well the models fitted to the first one predict it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from posture_opt.report.blocks import Block, Facts, Table
from posture_opt.report.diagnosed import Diagnosed
from posture_opt.report.error_blocks import figures_of, models_of
from posture_opt.report.units_text import count, percent

if TYPE_CHECKING:
    from posture_opt.diagnosis.other_session import Gain

_ELSEWHERE = 20  # times the errors at home: no arm drifts that far


def elsewhere_lead(diagnosed: Diagnosed) -> tuple[str, ...]:
    """Whether the effects help on the test file, in a sentence; nothing without one, or without effects."""
    test = diagnosed.diagnosis.test
    if test is None or not diagnosed.effects:
        return ()
    if not any(test.gains):
        one = len(diagnosed.effects) == 1
        whose = "it belongs" if one else "they belong"
        return (
            f"The {'effect is' if one else 'effects are'} not tested on the other file: {whose} to the first session.",
        )
    if test.gain.low > 0:
        return (f"The gain holds on the test file: {percent(test.gain.value)} off the RMS.",)
    if test.gain.value > 0:
        off = f"the RMS drops by {percent(test.gain.value)}"
        return (f"On the test file {off}, which is not significant with {count(len(test.data), 'row')}.",)
    return ("On the test file there is no gain: the error with effects is as large as without, or larger.",)


def test_block(diagnosed: Diagnosed) -> Block:
    """Another file, predicted by what this one taught; effect by effect."""
    test = diagnosed.diagnosis.test
    assert test is not None
    how = "base and tool fitted again to it" if test.refitted else "nothing fitted to it"
    text = f"{Path(test.data.file).name or 'table'}, {count(len(test.data), 'row')}: {how}."
    headers = ("position error [mm]", "RMS", "interval of RMS", "mean", "95 % below", "max")
    models = models_of(diagnosed)
    if "extended" in models and not any(test.gains):
        models["extended"] = "fitted beside its effects"  # none of which is in this prediction
    table = Table(headers, tuple((words, *figures_of(test.models[name])) for name, words in models.items()))
    items: list[str | Facts | Table] = [text, table]
    own = diagnosed.diagnosis.errors["calibrated"].rms
    if not test.refitted and test.models["calibrated"].rms > _ELSEWHERE * own:
        items.append(
            "Errors this large suggest that base or instrument were moved: --refit-frames fits base and tool again."
        )
    rows = [(f.cause.label, percent(f.gain), *_elsewhere(test.gains[place])) for place, f in diagnosed.effects]
    if rows:
        items.append(Table(("effect", "gain here", "on the test file", "verdict"), tuple(rows)))
    return Block("On the test file", tuple(items))


def _elsewhere(gain: Gain | None) -> tuple[str, str]:
    """What an effect brings on the other file, and whether that can be sure."""
    if gain is None:
        return "not tested", "left out"
    sure = "not significant" if gain.value > 0 else "no gain"
    return percent(gain.value), "holds" if gain.low > 0 else sure
