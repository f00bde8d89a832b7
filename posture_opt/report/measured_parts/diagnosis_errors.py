"""What the report on a diagnosis says of position errors: of three models here, and on a test file."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.errors import enumerated
from posture_opt.report.measured_parts.causes_table import gain_elsewhere, number_of
from posture_opt.report.measured_parts.diagnosis_sizes import (
    MODELS,
    NoiseFloor,
    fitted_effects,
    held_out_noise,
    noise_floor,
)
from posture_opt.report.measured_parts.error_table import (
    ELSEWHERE,
    error_cells,
    error_headers,
    error_table,
    held_out_sentence,
    mm,
)
from posture_opt.report.measured_parts.other_file_words import calibration_words, effects_words, file_words, range_items
from posture_opt.report.text.blocks import Block, Item, Later, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements.notation import count, listed_lines, percent

if TYPE_CHECKING:
    from posture_opt.diagnosis.diagnosis import Diagnosis

_MIN_COVERAGE = 0.9
"""Share of rows in their 95 % regions below which it is said that these are too small."""
_CHOSEN = "Effects were selected and fitted anew in each round, from the other rows alone."


def errors_block(found: Diagnosis) -> Block:
    """Position errors of the three models, cross-validated, with the noise floor."""
    return Block("Gain from the causes found", Later(partial(_errors, found)), "diagnosis_errors", brief=())


def _errors(found: Diagnosis) -> tuple[Item, ...]:
    """Sentences on the errors, and a table of them.

    The table [mm] has RMS with its 95 % interval, mean, 95 % quantile, largest error, and the share inside the 95 %
    regions. A fourth model is that which is delivered, where it is none of the three. The last row is the noise that
    no model can explain, left out where it is not known.
    """
    rounds = min(found.request.folds, len(np.unique(found.groups)))
    rows = [
        (words, *error_cells(found.errors[name]), percent(float(found.held[name].inside.mean())))
        for name, words in {**models_of(found), **_as_delivered(found)}.items()
    ]
    floor = noise_floor(found)
    rows += [(floor.label, mm(floor.rms), "", "", "", "", "")] if floor.rms else []
    headers = (*error_headers(found.request.data), "in its 95 % region")
    texts = [
        f"{held_out_sentence(found.by, rounds)} The interval holds the RMS with 95 % confidence. A 95 % region is as "
        "large as the errors of the other rows make it, whatever σ's the file states."
    ]
    if fitted_effects(found):
        texts.append(_gain_text(found))
    texts.append(delivered_words(found))
    inside = float(found.held[next(reversed(models_of(found)))].inside.mean())
    if inside < _MIN_COVERAGE:
        texts.append(
            f"Of the rows left out {percent(inside)} lie in their 95 % regions: these lack what is unexplained."
        )
    if floor.rms:
        texts.append(f"{floor.sentence}{_beside(found, floor)}")
    return (*texts, Table(headers, tuple(rows)))


def _as_delivered(found: Diagnosis) -> dict[str, str]:
    """The arm that is delivered, where it is neither the calibrated one nor that with all effects."""
    delivery = found.delivery
    return {"delivered": MODEL_NAMES["delivered"]} if delivery.kept and (delivery.session or delivery.vague) else {}


def models_of(found: Diagnosis) -> dict[str, str]:
    """The models that differ."""
    return {name: words for name, words in MODELS.items() if name != "extended" or fitted_effects(found)}


def _beside(found: Diagnosis, noise: NoiseFloor) -> str:
    """How far noise, and what it costs to fit many parameters to few numbers, make up what is left.

    Residual errors near that cannot be reduced by any model.
    """
    left, floor, said = found.errors["extended"], noise.rms, ""
    fitted = found.model.count
    numbers = len(found.model.residuals.data) * len(found.model.residuals.axes)
    cost = held_out_noise(found, noise)
    if floor > left.interval[1]:
        return ": more than the residual error, so the noise must be smaller than that."
    if floor < left.interval[0]:
        said = f"; fitting {fitted} parameters to {numbers} numbers raises that to {mm(cost)} mm"
    if cost < left.interval[0]:
        own = "no model does better" if noise.repeated else "the scatter of the arm itself adds to that"
        return f"{said}; {own}."
    if found.verdict == "unexplained":
        return f"{said}: about as large as the residual error, so the unexplained part is small on average."
    return f"{said}: about as large as the residual error, so nothing more can be gained."


def _gain_text(found: Diagnosis) -> str:
    """The gain of the effects over the calibrated arm with its 95 % interval.

    Significant where the lower end is above zero; the effects are selected anew in each round of the cross-validation.
    """
    gain = found.gain
    span = f"{percent(gain.low)} to {percent(gain.high)} with 95 % confidence"
    if gain.low > 0:
        text = f"The effects reduce the RMS of the calibrated arm by {percent(gain.value)} ({span})."
    else:
        text = (
            f"The effects bring no significant gain: the RMS of the calibrated arm drops by {percent(gain.value)} "
            f"({span})."
        )
    return f"{text} {_CHOSEN}"


def delivery_lead(found: Diagnosis) -> tuple[str, ...]:
    """Which arm is delivered where it is not the one with all effects, and how well it explains these data.

    Effects that belong to the session (a drift, say), that have no determined size, or that held-out rows do not need
    are left out of ``extended.yaml``.
    """
    delivery, effects = found.delivery, found.model.effects
    places = (delivery.session, delivery.vague, delivery.dropped)
    if not any(places):
        return ()
    session, vague, others = (", ".join(effects[i].label for i in those) for those in places)
    one = len(delivery.session) == 1
    it, belongs = ("it", "belongs") if one else ("them", "belong")
    unknown = f"{vague}, of a size that these data do not determine"
    if delivery.kept:
        arm = f"the arm fitted without {session}, which {belongs} to this session" if session else ""
        arm += f"; nor {unknown}" if session and vague else f"the arm fitted without {unknown}" if vague else ""
        arm += f", nor {others}, which held-out rows do not need then" if others else ""
    else:
        arm = "the nominal arm" if delivery.nominal else "the calibrated arm"
        arm += f": {session} {belongs} to this session" if session else ""
        arm += f", and without {it} no other effect improves held-out rows" if session and others else ""
        arm += f"; not delivered is {unknown}" if vague else ""
        arm += "" if session or vague else ": held-out rows are predicted no better with effects"
    moved = any("time" in effects[i].needs for i in delivery.session)
    average = " Quantities that drifted are delivered at their average." if moved else ""
    return (
        f"Delivered in extended.yaml is {arm}. Its RMS error on held-out rows is {mm(delivery.held.rms)} mm.{average}",
    )


def delivered_words(found: Diagnosis) -> str:
    """How far the written file is off on the data that it was learned from."""
    rms, _ = found.delivered
    free = "but touched points" if found.request.data.touches else ""
    free = "but the offsets of the targets" if len(found.request.data.target_names) > 1 else free
    lines = found.delivered_outliers
    outliers = f" without its {'outlier' if len(lines) == 1 else 'outliers'}, {listed_lines(lines)}" if lines else ""
    return f"extended.yaml, loaded again with nothing fitted {free}".rstrip() + (
        f", is off by {mm(rms)} mm RMS on the data that it was learned from{outliers}."
    )


def elsewhere_lead(found: Diagnosis) -> tuple[str, ...]:
    """Whether what is delivered holds on the test file, in a sentence or two; nothing without one.

    Effects that are not delivered are not tested, and the sentence says why.
    """
    test = found.test
    if test is None:
        return ()
    if any(test.gains):
        words = effects_words(test.file, test.gain, tested_models(found)["extended"])
        tested = [(number_of(found, f), gain) for place, f in fitted_effects(found) if (gain := test.gains[place])]
        sure = [str(number) for number, gain in tested if gain.low > 0]
        which = f"cause{'s' * (len(sure) > 1)} {enumerated(sure)}" if sure else "none"
        alone = f" One by one, it supports {which} of the {count(len(tested), 'cause')}"
        alone += ", though not against what else they could be" if _have_rivals(found) else ""
        against = [str(number) for number, gain in tested if gain.value < 0]
        alone += f"; it speaks against cause{'s' * (len(against) > 1)} {enumerated(against)}." if against else "."
        alone = alone if len(sure) < len(tested) else ""
        return (f"{words}{alone}",)
    one = len(fitted_effects(found)) == 1
    which = "The effect is" if one else "The effects are"
    why = f"{'it belongs' if one else 'they belong'} to the first session"
    why = "the arm is delivered without" if found.delivery.dropped or found.delivery.vague else why
    untested = (f"{which} not tested on the other file: {why}.",) if fitted_effects(found) else ()
    return (*untested, calibration_words(test.file))


def _have_rivals(found: Diagnosis) -> bool:
    """Whether a cause that the test file supports could be another one that it would support as well."""
    gains = () if found.test is None else found.test.gains
    return any(f.confounded_with for place, f in fitted_effects(found) if (gain := gains[place]) and gain.low > 0)


def tested_models(found: Diagnosis) -> dict[str, str]:
    """The models that predict the test file, by name with their words.

    With effects it is the model as it is delivered; without delivered effects it is left out.
    """
    names = models_of(found)
    if not found.delivery.kept:
        names.pop("extended", None)
    elif len(found.delivery.kept) < len(fitted_effects(found)):
        names["extended"] = MODEL_NAMES["delivered"]
    return names


def test_block(found: Diagnosis) -> Block:
    """Another file, predicted by what this one taught; effect by effect.

    Errors by model [mm], those inside and outside of the joint ranges of the first file, and a row an effect: its gain
    here, its gain there, and whether that holds.
    """
    test = found.test
    assert test is not None
    models = tested_models(found)
    table = error_table({words: test.models[name] for name, words in models.items()}, found.request.data)
    odd = list[str]()
    if test.worse:
        labels = [f.label for place, f in fitted_effects(found) if place in test.worse]
        odd.append(f"These effects extrapolate badly, rows outside are predicted better without: {'; '.join(labels)}.")
    own = found.errors["calibrated"].rms
    if not test.file.refitted and test.models["calibrated"].rms > ELSEWHERE * own:
        odd.append(
            "Errors this large suggest that base or instrument were moved: --refit-frames fits base and tool again."
        )
    rows = [(f.label, percent(f.gain), *gain_elsewhere(test.gains[place])) for place, f in fitted_effects(found)]
    effects = [Table(("effect", "gain here", "on the test file", "verdict"), tuple(rows))] if rows else []
    items = (file_words(test.file), table, *range_items(test.file, models), *odd, *effects)
    # The lead has the RMS errors, and the table of causes what each brings.
    return Block("On the test file", items, brief=tuple(odd) if effects else None)
