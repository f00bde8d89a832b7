"""All causes of a diagnosis on one screen: size, share of the error, and what to look at on the arm."""

from __future__ import annotations

import math
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.diagnosis.causes.causes import tool_shifts
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.errors import enumerated
from posture_opt.model.effects import CyclicError, InstrumentField
from posture_opt.model.effects.base.joint_effect import CATALOGUE_AMPLITUDE, Harmonic
from posture_opt.report.measured_parts.diagnosis_sizes import headline_of, largest_scatter
from posture_opt.report.measured_parts.error_table import mm
from posture_opt.report.text.blocks import Facts, Table
from posture_opt.report.text.units_text import count, percent
from posture_opt.units import ERROR_UNITS, plus_minus

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt.calibration.estimation.parameters import Parameter
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.causes.sessions import Gain
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.model.effects import Cause

FILE = "split_measurements.csv"
"""The table of measurements that discriminate between causes."""
_MAX_INSPECTED = 4  # lines on the parts of causes on a screen
_MANUFACTURING_TOLERANCES = {"rad": 5e-3, "m": 5e-3}  # rad, m, of new arms; a choice of taste
_EQUAL_CYCLES_TOLERANCE = 0.05  # of the cycles of a line, by which those of other joints are the same
_MAX_CAUSES = 16  # that a screen has room for
_DERIVED_SIDES_NOTE = (
    "from which side each joint arrived is taken from the row before; if the arm went elsewhere in between, state it "
    "in columns JOINT.approach"
)
_CATALOGUE_SIZE_NOTE = (
    "as large as gears and encoders in catalogues err: do not open; commands by 'compensate --problem extended.yaml' "
    "allow for it"
)
_CHECK_ZERO = "Was the joint set to zero anew, its encoder or drive replaced? Compare its reference with the file."
_CHECK_LINK = (
    "Compare with the maker's calibration in the controller, then the type of the arm with the file; then look for a "
    "link that is bent or seated askew."
)
_NOT_CONFIRMED_NOTE = "the test file does not confirm this: measure again before anything is opened for it"
_IMPLAUSIBLE_NOTE = "an error that only looks like this, until shown otherwise: it would take {}"
_ALIKE_NOTE = (
    "these repeat about as often, {:.0f} times per revolution, as drives of one type do: do not open; commands by "
    "'compensate --problem extended.yaml' allow for it"
)
_INSTRUMENT_NOTE = (
    "the instrument, by a scale bar or from a second station, before the arm is opened: errors that vary smoothly over "
    "its volume look the same here"
)
_UNUSED_NOTE = (
    "the orientations in the file, left out as no σ is stated for them: state uncertainty: {measurement: {orientation: "
    "...}}, by the data sheet of the instrument, and diagnose again before measuring anything"
)
_OUTSIDE_NOTE = "outside the joint ranges measured so far: approach slowly, and check line of sight and cables"
_EDGE = 0.02  # rad or m beyond the measured range: nearer is at its edge
_HOLDS = "holds"
_TARGET = "{target}"  # in place of the joint in texts that are compared
_MAX_OPEN_RATIO = 10.0  # times the standard error among what the data determine: the rest is open
_MAX_HELD_RATIO = 3.0  # times its standard error is that by the rows alone, of what no tolerance holds
_DIFFERENT = 1.96  # standard errors
_MAX_DECIDED = 2  # measurements that decide what a cause of an open size is
_MAX_RIVALS = 2  # causes that one could be confused with, by name


def causes_table(found: Diagnosis) -> Table:
    """Every cause with its size and the share of the RMS error on held-out rows that it removes.

    The share is that which is lost without it, everything else fitted again. Scatter removes no error. Between them
    is the largest shift of the tool point in the data [mm]; behind it the share on a test file, where there is one.
    """
    rows, views = [], []
    for number, finding in enumerate(found.effects, 1):
        gain = "" if finding.noise is not None else percent(finding.gain)
        like = "" if finding.plausible else "looks like "
        row = (f"{number}. {like}{finding.label}", _size(found, finding), _largest_shift(found, finding), gain)
        rows.append((*row, *_elsewhere(found, finding)))
        views.append(view_key(found, finding))
    headers = ("cause", "size", "at the tool", "RMS drop", *_elsewhere_header(found))
    return Table(headers, tuple(rows), views=tuple(views), least=_MAX_CAUSES)


def _elsewhere_header(found: Diagnosis) -> tuple[str, ...]:
    """The header of what causes bring on a test file; none without one that effects are tested on."""
    return ("on the test file",) if found.test is not None and any(found.test.gains) else ()


def _elsewhere(found: Diagnosis, finding: Finding) -> tuple[str, ...]:
    """The share that a cause removes on the test file, and that it is not significant there."""
    if not _elsewhere_header(found):
        return ()
    if found.test is None or finding.place is None:
        return ("",)
    gain, verdict = gain_elsewhere(found.test.gains[finding.place])
    return (gain if verdict == _HOLDS else f"{gain}, {verdict}",)


def gain_elsewhere(gain: Gain | None) -> tuple[str, str]:
    """What an effect brings on the other file, and whether that can be sure."""
    if gain is None:
        return "not tested", "left out"
    sure = "not significant" if gain.value > 0 else "no gain"
    return percent(gain.value), _HOLDS if gain.low > 0 else sure


def _largest_shift(found: Diagnosis, finding: Finding) -> str:
    """The largest shift of the tool point in the data [mm]; of a joint that scatters, its largest σ.

    Empty of causes that move nothing, or by an open size.
    """
    if not finding.determined:
        return ""
    if finding.noise is not None and finding.noise.moved_joint:
        return f"σ {mm(largest_scatter(found, finding.noise))} mm"
    return "" if finding.place is None else f"{mm(float(tool_shifts(found.model, finding)[0].max()))} mm"


def _size(found: Diagnosis, finding: Finding) -> str:
    """The size with its standard error; that it is open, or how many parameters differ, where there is no number."""
    if not finding.determined:
        return "not determined"
    if finding.open_part is not None:
        return f"{headline_of(finding)} + {len(finding.open_part.size_parts)} open"
    return headline_of(finding) or (_differing(found) if finding.kind == "geometry" else "several parameters")


def _differing(found: Diagnosis) -> str:
    """How many of the geometric parameters that the data determine differ from the file, by 1.96 standard errors."""
    every = determined_geometry(found)
    return f"{sum(abs(x) > _DIFFERENT * std for _, x, std in every)} of {count(len(every), 'parameter')} differ"


def determined_geometry(found: Diagnosis) -> list[tuple[Parameter, float, float]]:
    """The geometric parameters of the arm with its effects that the data determine, with x and its standard error.

    Left out are those whose standard error is mostly what the data leave open, or what a tolerance of parts holds: a
    zero of the last joint but one and the length behind it act alike, and the tighter tolerance decides which it is.
    """
    calibration, model = found.calibration, found.model
    rows = zip(calibration.parameters, model.x, model.std, calibration.std, model.held_by_prior, strict=False)
    return [
        (p, float(x), float(std))
        for p, x, std, whole, held in rows
        if p.group == "geometry"
        and 0 < whole < _MAX_OPEN_RATIO * std  # what the data leave open has a small part in what they determine
        and held < _MAX_HELD_RATIO
    ]


def look_at(found: Diagnosis) -> tuple[Facts, ...]:
    """What to look at on the arm for causes of a known size, and what else a cause could be; nothing without such."""
    known = [f for f in found.effects if f.determined]
    alike = _of_one_type([f for f in known if f.plausible])  # what no gear does is opened, however many do it
    typical = [f for those in alike.values() for f in those]
    normal = [f for f in known if f.plausible and _as_in_catalogues(f) and f not in typical]
    doubtful = [f for f in known if f not in (*normal, *typical) and unconfirmed(found, f)]
    odd = [f for f in known if not f.plausible and f not in (*typical, *doubtful)]
    other = [f for f in known if f not in (*normal, *typical, *doubtful, *odd)]
    rows = [(f"Look at ({', '.join(numbers)})", words) for words, numbers in _inspections(found, other).items()]
    rows = rows[:_MAX_INSPECTED] + ([("Look at", "for the others see --full")] if len(rows) > _MAX_INSPECTED else [])
    rows += [(f"Looks like ({number_of(found, f)})", _IMPLAUSIBLE_NOTE.format(f.would_need)) for f in odd]
    rows += [(f"Not confirmed ({_numbers(found, doubtful)})", _NOT_CONFIRMED_NOTE)] if doubtful else []
    rows += [(f"Normal ({_numbers(found, normal)})", _CATALOGUE_SIZE_NOTE)] if normal else []
    rows += [(f"Alike ({_numbers(found, those)})", _ALIKE_NOTE.format(cycles)) for cycles, those in alike.items()]
    grown = list(_inspections(found, [f for f in known if f in (*normal, *typical)]).items())[:_MAX_INSPECTED]
    rows += [(f"If it grew ({', '.join(numbers)})", words) for words, numbers in grown]
    sided = [str(number_of(found, f)) for f in known if f.effect and "approach" in f.effect.needs]
    if sided and not found.request.data.approach_given:
        rows.append((f"Sides ({', '.join(sided)})", _DERIVED_SIDES_NOTE))
    rows += [
        (f"Could be ({number_of(found, f)})", f"{rivals_of(f)} instead") for f in found.effects if f.confounded_with
    ]
    rows += _unused_orientations(found)
    rows += _to_decide(found)
    rows += _instrument_first(found)
    rows += _next(found)
    return (Facts(tuple(rows)),) if rows else ()


def _numbers(found: Diagnosis, findings: Sequence[Finding]) -> str:
    """The numbers of some causes in the table."""
    return ", ".join(str(number_of(found, finding)) for finding in findings)


def unconfirmed(found: Diagnosis, finding: Finding) -> bool:
    """Whether it is not sure that a cause predicts the test file better; false of what is not tested there."""
    if found.test is None or finding.place is None or not any(found.test.gains):
        return False
    gain = found.test.gains[finding.place]
    return gain is not None and gain.low <= 0


def _as_in_catalogues(finding: Finding) -> bool:
    """Whether it is a periodic error of the size that new gears have, within its own error."""
    cause, rms = finding.cause, finding.sizes.rms
    if not isinstance(cause, Harmonic):
        return False
    size, std = cause.plausible_size(finding.sizes)
    if rms is not None and len(cause.frequencies) > 1:
        size, std = (math.sqrt(2) * value for value in rms)
    return size - (_DIFFERENT * std if math.isfinite(std) else 0.0) <= CATALOGUE_AMPLITUDE


def inspections(found: Diagnosis, findings: Sequence[Finding]) -> tuple[Facts, ...]:
    """What to look at on the arm for some causes, each line with their numbers; nothing for none."""
    texts = _inspections(found, findings).items()
    return (Facts(tuple((f"Look at ({', '.join(numbers)})", words) for words, numbers in texts)),) if texts else ()


def inspection(found: Diagnosis, finding: Finding) -> str:
    """What to look at for one cause; of the geometry also the correction that is hardest to build."""
    text = finding.inspect(found.problem.robot)
    if finding.kind != "geometry" or (largest := _largest_correction(found)) is None:
        return text
    _, size, check = largest
    end = "more than arms are built with" if check else "as arms are built"
    return f"{text}; largest certain correction: {size}, {end}"


def _largest_correction(found: Diagnosis) -> tuple[GeometricDeviation, str, str] | None:
    """The certain correction of the geometry that is hardest to build, the same in words, and what to check.

    Nothing is to be checked where arms are built so, within the error of the correction. None where none is certain.
    """
    every = [(p, x, std) for p, x, std in determined_geometry(found) if abs(x) > _DIFFERENT * std]
    if not every:
        return None
    sizes = [(abs(x) - _DIFFERENT * std) / _MANUFACTURING_TOLERANCES[p.unit] for p, x, std in every]
    sure, (largest, x, std) = max(zip(sizes, every, strict=True), key=lambda pair: pair[0])
    deviation, size = GeometricDeviation.of(largest), plus_minus(x, std, *ERROR_UNITS[largest.unit])
    check = _CHECK_ZERO if largest.name.endswith(".theta") else _CHECK_LINK
    return deviation, f"{deviation.noun} ({largest.name}), {size}", "" if sure <= 1 else check


def bent_lead(found: Diagnosis) -> tuple[str, ...]:
    """The largest correction of the geometry, where it is a cause and no arm is built with it; else nothing."""
    largest = _largest_correction(found)
    geometry = (f for f in found.effects if isinstance(f.cause, GeometricDeviation))
    named = [f for f in geometry if f.kind not in ("base_frame", "tool_frame")]
    if not named or largest is None or not largest[2]:
        return ()
    deviation, size, check = largest
    own = [f for f in named if f.cause in (deviation, GeometricDeviation.of_all())]
    cause = f" (cause {number_of(found, own[0])})" if own else ""
    return (f"First check the geometry{cause}: {size}, more than arms are built with. {check}",)


def _of_one_type(findings: Sequence[Finding]) -> dict[float, list[Finding]]:
    """Cycles per revolution -> errors of several joints that repeat about as often, as of the type of their drives."""
    first: dict[float, list[Finding]] = {}
    for finding in findings:
        error = finding.cause
        bands = error.bands(finding.sizes) if isinstance(error, CyclicError) else ()
        if isinstance(error, CyclicError) and bands:
            cycles = error.lines[bands[0][0]]
            apart = finding.sizes.resolution  # neighbours that its range does not tell from each other
            near = next((k for k in first if abs(k - cycles) < max(_EQUAL_CYCLES_TOLERANCE * k, apart)), cycles)
            first.setdefault(near, []).append(finding)
    return {cycles: those for cycles, those in first.items() if len(those) > 1}


def _instrument_first(found: Diagnosis) -> list[tuple[str, str]]:
    """That the instrument is checked before the arm is opened, where it could err as the arm is said to."""
    fields = [
        str(number_of(found, f))
        for f in found.effects
        if any(isinstance(rival, InstrumentField) for rival in f.confounded_with)
    ]
    if not fields or found.request.data.touches:
        return []
    return [(f"Check first ({', '.join(fields)})", _INSTRUMENT_NOTE)]


def _unused_orientations(found: Diagnosis) -> list[tuple[str, str]]:
    """That the file has orientations which could decide between causes, but no σ for them."""
    unused = found.request.data.rotation is not None and not found.model.residuals.further
    return [("Use first", _UNUSED_NOTE)] if unused and any(f.confounded_with for f in found.effects) else []


def _to_decide(found: Diagnosis) -> list[tuple[str, str]]:
    """What to measure for causes of an open size that another one could be, each text once."""
    texts: dict[str, list[Finding]] = {}
    for finding in found.effects:
        rivals = [rival for rival in finding.confounded_with if not isinstance(rival, UnnamedComponent)]
        if not finding.determined and rivals:
            texts.setdefault(finding.cause.discrimination(rivals[0]), []).append(finding)
    return [(f"To decide ({_numbers(found, those)})", text) for text, those in texts.items()][:_MAX_DECIDED]


def _next(found: Diagnosis) -> list[tuple[str, str]]:
    """The postures that discriminate causes from their rivals; nothing where none are planned."""
    plan = found.split
    if plan is None or not len(plan.rows):
        return []
    which = f"{count(len(plan.rows), 'posture')} that refute the wrong cause ({FILE}, by --out DIR)"
    low, high = found.request.data.q.min(axis=0), found.request.data.q.max(axis=0)
    outside = int(np.count_nonzero(np.any((plan.rows.q < low - _EDGE) | (plan.rows.q > high + _EDGE), axis=1)))
    if outside:
        which += f"; {outside} of them {_OUTSIDE_NOTE}"
    return [("Measure next", which)]


def _inspections(found: Diagnosis, findings: Sequence[Finding]) -> dict[str, list[str]]:
    """What to look at -> the numbers of the causes that it is for: what is alike of several joints is said once."""
    alike: dict[str, list[tuple[Finding, str]]] = {}
    for finding in findings:
        subject, colon, parts = inspection(found, finding).partition(": ")
        key = colon + parts if colon else subject.replace(finding.target, _TARGET)
        alike.setdefault(key, []).append((finding, subject))
    texts = {}
    for words, those in alike.items():
        text = words.replace(_TARGET, enumerated(finding.target for finding, _ in those))
        subjects = _enumerated_once([subject for _, subject in those]) if words.startswith(": ") else ""
        texts[f"{subjects}{text}"] = [str(number_of(found, finding)) for finding, _ in those]
    return texts


def _enumerated_once(texts: Sequence[str]) -> str:
    """Texts as a list; the words that all of them begin with stand once."""
    words = [text.split() for text in texts]
    same = 0 if len(texts) < 2 else next(i for i, each in enumerate(zip_longest(*words)) if len(set(each)) > 1)
    return enumerated([texts[0], *(" ".join(own[same:]) for own in words[1:])])


def rivals_of(finding: Finding, most: int = _MAX_RIVALS) -> str:
    """The causes that the data cannot tell from a finding: the first of many by name, and how many more there are.

    Errors without a name are counted where there are causes that have one.
    """
    named = dict.fromkeys(rival.label for rival in finding.confounded_with if not isinstance(rival, UnnamedComponent))
    others = dict.fromkeys(rival.words for rival in finding.confounded_with if isinstance(rival, UnnamedComponent))
    labels = [*named, *others]
    shown = labels[: min(most, len(named)) or most] if most + 1 < len(labels) else labels  # "1 more" is as long
    more = len(labels) - len(shown)
    return enumerated([*shown, *([f"{more} more"] if more else [])], "or")


def rival_words(rival: Cause) -> str:
    """The label of a rival; one without a name in words, as its label says it to those only who know the search."""
    return rival.words if isinstance(rival, UnnamedComponent) else rival.label


def number_of(found: Diagnosis, finding: Finding) -> int:
    """The number of a cause in the table."""
    return found.effects.index(finding) + 1


def view_key(found: Diagnosis, finding: Finding) -> str:
    """By which the interactive view knows a cause."""
    return f"cause-{number_of(found, finding)}"
