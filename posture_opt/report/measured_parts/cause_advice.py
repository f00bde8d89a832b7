"""What to do about the causes of a diagnosis: the lines below their table, at the arm first and then at the data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.errors import enumerated
from posture_opt.model.effects import BaseCompliance, CyclicError, InstrumentField
from posture_opt.model.effects.base.joint_effect import CATALOGUE_AMPLITUDE, Harmonic
from posture_opt.model.effects.base.lost_motion import REVERSED
from posture_opt.report.measured_parts.cause_inspections import bent_link, inspections_by_text
from posture_opt.report.measured_parts.causes_table import CERTAIN, number_of, rivals_of, unconfirmed
from posture_opt.report.measured_parts.diagnosis_sizes import MODELS
from posture_opt.report.text.blocks import Facts
from posture_opt.statements.notation import count

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis

FILE = "split_measurements.csv"
"""The table of measurements that discriminate between causes."""
_MAX_INSPECTED = 4  # lines on the parts of causes on a screen
_EQUAL_CYCLES_TOLERANCE = 0.05  # of the cycles of a line, by which those of other joints are the same
_MIN_SHARED_KINDS = 2  # in which two joints err alike by more than chance
_CORRECTED = "joint commands by 'compensate --problem extended.yaml'"
_DERIVED_SIDES_NOTE = (
    "from which side each joint arrived is taken from the row before; if the arm went elsewhere in between, state it "
    "in columns JOINT.approach"
)
_CATALOGUE_SIZE_NOTE = (
    f"as large as gears and encoders in catalogues err: do not open, and keep this report to compare; {_CORRECTED} "
    "allow for it"
)
_NOT_CONFIRMED_NOTE = "the test file does not confirm this: nothing is opened for it before other rows do"
_IMPLAUSIBLE_NOTE = "an error that only looks like this, until shown otherwise: it would take {}"
_ALIKE_NOTE = (
    "these repeat about as often, {} times per revolution, as drives of one type do: do not open, and keep this report "
    f"to compare; {_CORRECTED} allow for it"
)
_SHARED_NOTE = (
    "{} err alike in {}: look first for what they share: gear ratios and coupling in controller and file, then "
    "a differential, its cables or belts"
)
_INSTRUMENT_NOTE = (
    "check the instrument, by a scale bar or from a second station, before anything is opened: errors that vary "
    "smoothly over its volume look the same here"
)
_UNUSED_NOTE = (
    "the orientations in the file, left out as no σ is stated for them: state uncertainty: {measurement: {orientation: "
    "...}}, by the data sheet of the instrument, and diagnose again before measuring anything"
)
_OUTSIDE_NOTE = (
    "outside the joint ranges measured so far: collisions with cell and target are not checked; approach slowly, and "
    "check line of sight and cables"
)
_MEANWHILE_NOTE = f"nothing of this is a reason to stop the arm: let it work with {_CORRECTED}"
_LOOSE_NOTE = "see that the mounting bolts of the base are tight: this could be a compliant base"
_FIRM_NOTE = ", once the mounting bolts of its base are found tight (cause {} could be a compliant base)"
_BY_HAND_NOTE = (
    ", if motors drove it when it was measured; if it was moved by hand, lost motion ({}) has the other sign under its "
    "motors: do not use these commands then"
)
_BENT_NOTE = (
    "compare with the maker's calibration in the controller, and with the file; if they do not explain it, look at that"
    f" link for damage and loose screws, and stop the arm if there is any; otherwise let it work with {_CORRECTED}"
)
_OVERFITTED_NOTE = (
    "more postures, spread over all joint ranges ('plan-measurements' proposes them): nothing is opened for these "
    "causes"
)
_CHANGED_NOTE = "look for what was moved, came loose or changed at line {}"
_STAYS_NOTE = "compensate; opened only if it grew, or the joint is noisy, rough or loose:"
_EDGE = 0.02  # rad or m beyond the measured range: nearer is at its edge
_MAX_DECIDED = 3  # measurements that decide what a cause of an open size is

_Row = tuple[str, str]


@dataclass(frozen=True)
class SortedCauses:
    """The causes of a known size by what is to be done about them; each is in one group.

    Args:
        alike: range of cycles per revolution -> errors of several joints that repeat about as often.
        normal: periodic errors of the size that new gears have.
        unconfirmed: those that a test file does not confirm.
        odd: those of a size that no arm has.
        elsewhere: those that the instrument could err like, which is checked before the arm is opened.
        others: those that are looked at.
    """

    alike: Mapping[tuple[float, float], list[Finding]]
    normal: tuple[Finding, ...]
    unconfirmed: tuple[Finding, ...]
    odd: tuple[Finding, ...]
    elsewhere: tuple[Finding, ...]
    others: tuple[Finding, ...]

    @classmethod
    def of(cls, found: Diagnosis) -> SortedCauses:
        """Those of a diagnosis."""
        left = [f for f in found.effects if f.determined]

        def taken(group: Sequence[Finding]) -> tuple[Finding, ...]:
            for finding in group:
                left.remove(finding)
            return tuple(group)

        alike = of_one_type([f for f in left if f.plausible])  # what no gear does is opened, however many do it
        for group in alike.values():
            taken(group)
        normal = taken([f for f in left if f.plausible and _as_in_catalogues(f)])
        doubtful = taken([f for f in left if unconfirmed(found, f)])
        odd = taken([f for f in left if not f.plausible])
        elsewhere = taken([f for f in left if f in _like_instrument(found)])
        return cls(alike, normal, doubtful, odd, elsewhere, tuple(left))

    @property
    def left_closed(self) -> tuple[Finding, ...]:
        """Those that no one opens an arm for, unless they grow."""
        return (*self.normal, *(finding for group in self.alike.values() for finding in group))


def advice(found: Diagnosis) -> tuple[Facts, ...]:
    """What to do about the causes, and what else they could be; nothing where there is nothing to say."""
    if overfitted(found):
        return (Facts((("Measure first", _OVERFITTED_NOTE),)),)
    causes = SortedCauses.of(found)
    rows = [*_at_arm(found, causes), *_at_data(found, causes), *_meanwhile(found)]
    return (Facts(tuple(rows)),) if rows else ()


def overfitted(found: Diagnosis) -> bool:
    """Whether causes are found, and yet every fit predicts unseen rows worse than the arm of the file does."""
    nominal, *fitted = (found.errors[name].rms for name in MODELS)
    return bool(found.effects) and min(fitted) > nominal


def _at_arm(found: Diagnosis, causes: SortedCauses) -> list[_Row]:
    """What to look at on the arm, what not, and what only if it grew."""
    rows = _inspected(found, "Look at", causes.others)
    if len(rows) > _MAX_INSPECTED:
        rows = [*rows[:_MAX_INSPECTED], ("Look at", "for the others see --full")]
    rows = [*_instrument_first(found), *rows]
    rows += [(label, f"{_STAYS_NOTE} {words}") for label, words in _inspected(found, "If it stays", causes.elsewhere)]
    rows += [
        (f"In common ({_numbers(found, shared)})", _SHARED_NOTE.format(enumerated(joints), enumerated(kinds)))
        for joints, kinds, shared in _shared(found)
    ]
    rows += [(f"Looks like ({number_of(found, f)})", _IMPLAUSIBLE_NOTE.format(f.would_need)) for f in causes.odd]
    rows += _noted(found, "Not confirmed", causes.unconfirmed, _NOT_CONFIRMED_NOTE)
    rows += _noted(found, "Normal", causes.normal, _CATALOGUE_SIZE_NOTE)
    for cycles, group in causes.alike.items():
        rows += _noted(found, "Alike", group, _ALIKE_NOTE.format(_cycles_text(*cycles)))
    return rows + _inspected(found, "If it grew", causes.left_closed)[:_MAX_INSPECTED]


def _at_data(found: Diagnosis, causes: SortedCauses) -> list[_Row]:
    """What else the causes could be, and what to use, state, check or measure to know."""
    sided = [f for f in found.effects if f.determined and f.effect and "approach" in f.effect.needs]
    return [
        *_noted(found, "Sides", [] if found.request.data.approach_given else sided, _DERIVED_SIDES_NOTE),
        *((f"Could be ({number_of(found, f)})", f"{rivals_of(f)} instead") for f in found.effects if f.confounded_with),
        *_unused_orientations(found),
        *_to_decide(found, causes),
        *_next(found),
    ]


def _numbers(found: Diagnosis, findings: Sequence[Finding]) -> str:
    """The numbers of some causes in the table, in their order."""
    return ", ".join(map(str, sorted(number_of(found, finding) for finding in findings)))


def _inspected(found: Diagnosis, label: str, findings: Sequence[Finding]) -> list[_Row]:
    """What to look at on the arm for some causes, a line for those alike."""
    own = [finding for finding in found.effects if finding in findings]
    return [(f"{label} ({', '.join(n)})", words) for words, n in inspections_by_text(found, own).items()]


def _noted(found: Diagnosis, label: str, findings: Sequence[Finding], note: str) -> list[_Row]:
    """One note on some causes; nothing without any."""
    return [(f"{label} ({_numbers(found, findings)})", note)] if findings else []


def _as_in_catalogues(finding: Finding) -> bool:
    """Whether it is a periodic error of the size that new gears have, within its own error."""
    cause, rms = finding.cause, finding.sizes.rms
    if not isinstance(cause, Harmonic):
        return False
    size, std = cause.plausible_size(finding.sizes)
    if rms is not None and len(cause.frequencies) > 1:
        size, std = (math.sqrt(2) * value for value in rms)
    return size - (CERTAIN * std if math.isfinite(std) else 0.0) <= CATALOGUE_AMPLITUDE


def of_one_type(findings: Sequence[Finding]) -> dict[tuple[float, float], list[Finding]]:
    """Range of cycles per revolution -> errors of several joints that repeat about as often, as one type of drive.

    Of each joint the strongest band counts. Two are alike where no more is between them than the ranges of both joints
    tell apart.
    """
    bands = []
    for finding in findings:
        error = finding.cause
        if isinstance(error, CyclicError) and (strongest := error.bands(finding.sizes)[:1]):
            cycles = [error.lines[i] for i in strongest[0]]
            bands.append((min(cycles), max(cycles), finding))
    groups: list[list[tuple[float, float, Finding]]] = []
    for band in sorted(bands, key=lambda band: band[0]):
        if groups and any(_alike(one, band) for one in groups[-1]):
            groups[-1].append(band)
        else:
            groups.append([band])
    several = [group for group in groups if len(group) > 1]
    return {
        (min(low for low, _, _ in group), max(high for _, high, _ in group)): [finding for _, _, finding in group]
        for group in several
    }


def _alike(one: tuple[float, float, Finding], other: tuple[float, float, Finding]) -> bool:
    """Whether two bands of cycles per revolution are the same for all that the ranges of their joints tell."""
    (_, high, first), (low, _, second) = one, other
    apart = min(first.sizes.resolution, second.sizes.resolution)
    return low - high < max(_EQUAL_CYCLES_TOLERANCE * high, apart)


def _cycles_text(low: float, high: float) -> str:
    """From, to in whole cycles; one number where they are the same."""
    return f"{low:.0f}" if round(low) == round(high) else f"{math.floor(low)} to {math.ceil(high)}"


def _shared(found: Diagnosis) -> list[tuple[tuple[str, str], list[str], list[Finding]]]:
    """Neighbouring joints that err alike in several ways at once, the ways, and these causes.

    Alike is a size of the same kind and sign that is the same within 1.96 of its standard errors, and not zero.
    """
    names, shared = found.request.data.joint_names, []
    for joints in pairwise(names):
        own = [[f for f in found.effects if f.determined and f.target == joint and f.effect] for joint in joints]
        pairs = [(a, b) for a, b in combinations((*own[0], *own[1]), 2) if a.target != b.target and _of_one_size(a, b)]
        if len(pairs) >= _MIN_SHARED_KINDS:
            shared.append((joints, [a.cause.title for a, _ in pairs], [finding for pair in pairs for finding in pair]))
    return shared


def _of_one_size(one: Finding, other: Finding) -> bool:
    """Whether two findings are of one kind that is no line of a spectrum, and of sizes that agree and are not zero."""
    if one.kind != other.kind or one.cause.spectral_lines:
        return False
    (x, u), (y, v) = (f.sizes.rms or f.effect.plausible_size(f.sizes) for f in (one, other) if f.effect)
    certain = min(abs(x) - CERTAIN * u, abs(y) - CERTAIN * v) > 0
    return certain and abs(x - y) < CERTAIN * math.hypot(u, v)


def _instrument_first(found: Diagnosis) -> list[_Row]:
    """That the instrument is checked before the arm is opened, where it could err as the arm is said to."""
    return _noted(found, "Instrument first", _like_instrument(found), _INSTRUMENT_NOTE)


def _like_instrument(found: Diagnosis) -> list[Finding]:
    """Causes that the instrument could err like; none of touched points, of which none is read."""
    if found.request.data.touches:
        return []
    return [f for f in found.effects if any(isinstance(rival, InstrumentField) for rival in f.confounded_with)]


def _unused_orientations(found: Diagnosis) -> list[_Row]:
    """That the file has orientations which could decide between causes, but no σ for them."""
    unused = found.request.data.rotation is not None and not found.model.residuals.further
    return _noted(found, "Use first", [f for f in found.effects if f.confounded_with] if unused else [], _UNUSED_NOTE)


def _to_decide(found: Diagnosis, causes: SortedCauses) -> list[_Row]:
    """What to measure for causes of an open size, or that are looked at, which another one could be, each text once."""
    texts: dict[str, list[Finding]] = {}
    for finding in (*causes.elsewhere, *causes.others, *(f for f in found.effects if not f.determined)):
        rivals = [rival for rival in finding.confounded_with if not isinstance(rival, UnnamedComponent)]
        if rivals:
            texts.setdefault(finding.cause.discrimination(rivals[0]), []).append(finding)
    still = "if that does not decide it: " if _unused_orientations(found) else ""
    return [(f"To decide ({_numbers(found, those)})", f"{still}{text}") for text, those in texts.items()][:_MAX_DECIDED]


def _next(found: Diagnosis) -> list[_Row]:
    """The postures that discriminate causes from their rivals; nothing where none are planned."""
    plan = found.split
    if plan is None or not len(plan.rows):
        return []
    often = "" if plan.rounds == 1 else f" in {plan.rounds} rounds"
    which = f"{count(len(plan.rows), 'posture')}{often} that refute the wrong cause ({FILE}, by --out DIR)"
    low, high = found.request.data.q.min(axis=0), found.request.data.q.max(axis=0)
    outside = int(np.count_nonzero(np.any((plan.rows.q < low - _EDGE) | (plan.rows.q > high + _EDGE), axis=1)))
    if outside:
        which += f"; {'all' if outside == len(plan.rows) else outside} of them {_OUTSIDE_NOTE}"
    return [("Measure next", which)]


def _meanwhile(found: Diagnosis) -> list[_Row]:
    """Whether the arm can work on until then, and with which commands; nothing where none are corrected.

    What slipped, stands loose or changed while it was measured is looked at before.
    """
    urgent = [f for f in found.effects if f.plausible and f.cause.urgent]
    if urgent:
        reasons = dict.fromkeys(f.cause.urgent.format(target=f.target) for f in urgent)
        return _noted(found, "Before it works on", urgent, enumerated(reasons))
    if bent := bent_link(found):
        return _noted(found, "Before it works on", bent, _BENT_NOTE)
    if found.scatter_change is not None:
        return [("Before it works on", _CHANGED_NOTE.format(found.scatter_change.line))]
    corrected = bool(found.delivery.kept) and any(f.determined and f.effect for f in found.effects)
    reversed_ = [f for f in found.effects if f.determined and f.label.startswith(REVERSED)]
    loose = [f for f in found.effects if any(isinstance(rival, BaseCompliance) for rival in f.confounded_with)]
    if loose and not corrected:
        return _noted(found, "Before it works on", loose, _LOOSE_NOTE)
    firm = _FIRM_NOTE.format(_numbers(found, loose)) if loose else ""
    by_hand = _BY_HAND_NOTE.format(_numbers(found, reversed_)) if reversed_ else ""
    return [("Meanwhile", f"{_MEANWHILE_NOTE}{firm}{by_hand}")] if corrected else []
