"""What to do about the causes of a diagnosis, and whether the arm may work meanwhile."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice, pairwise
from typing import TYPE_CHECKING, Literal

from posture_opt.calibration.assumptions.contradictions import GeometricDeviation
from posture_opt.diagnosis.causes.geometry_causes import CERTAIN
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.model.effects import BaseCompliance, CyclicError, InstrumentField
from posture_opt.model.effects.base.joint_effect import CATALOGUE_AMPLITUDE, Harmonic
from posture_opt.statements import Statement, state

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.causes.sessions import SecondSession
    from posture_opt.diagnosis.diagnosis import Diagnosis

Action = Literal["inspect", "compensate", "check_instrument", "confirm", "measure", "ignore"]
# ``inspect`` the part; ``compensate`` by corrected commands, open nothing; ``check_instrument`` first; ``confirm`` on
# other rows what a test file does not show; ``measure`` more where the size is open; ``ignore`` what no arm has.
Reason = Literal["size_of_catalogues", "one_type", "unconfirmed", "implausible", "like_instrument", "open_size", ""]


@dataclass(frozen=True)
class CauseAction:
    """What is to be done about one cause, and why it is not simply looked at.

    Args:
        cycles: range of cycles per revolution in which errors of several joints repeat, where that is the reason.
    """

    action: Action
    reason: Reason = ""
    cycles: tuple[float, float] = (0.0, 0.0)


def cause_actions(causes: Sequence[Finding], test: SecondSession | None, touches: bool) -> tuple[CauseAction, ...]:
    """The action for each cause, in their order; no instrument reads touched points."""
    groups = of_one_type([f for f in causes if f.determined and f.plausible])
    alike = {id(finding): cycles for cycles, group in groups.items() for finding in group}
    return tuple(_action(finding, alike.get(id(finding)), test, touches) for finding in causes)


def _action(
    finding: Finding, cycles: tuple[float, float] | None, test: SecondSession | None, touches: bool
) -> CauseAction:
    if not finding.determined:
        return CauseAction("measure", "open_size")
    if not finding.plausible:
        return CauseAction("ignore", "implausible")
    if cycles is not None:
        return CauseAction("compensate", "one_type", cycles)
    if _as_in_catalogues(finding):
        return CauseAction("compensate", "size_of_catalogues")
    if unconfirmed(finding, test):
        return CauseAction("confirm", "unconfirmed")
    if not touches and any(isinstance(rival, InstrumentField) for rival in finding.confounded_with):
        return CauseAction("check_instrument", "like_instrument")
    return CauseAction("inspect")


def unconfirmed(finding: Finding, test: SecondSession | None) -> bool:
    """Whether it is not sure that a cause predicts the test file better; false of what is not tested there."""
    gain = None if test is None or finding.place is None else test.gains[finding.place]
    return gain is not None and gain.low <= 0


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
    tell apart, or 5 % of their cycles.
    """
    bands = []
    for finding in findings:
        error = finding.cause
        if isinstance(error, CyclicError) and (strongest := error.bands(finding.sizes)[:1]):
            cycles = [error.lines[i] for i in strongest[0]]
            bands.append((min(cycles), max(cycles), finding))
    groups: list[list[tuple[float, float, Finding]]] = []
    for low, end, second in sorted(bands, key=lambda band: band[0]):
        near = (
            low - high < max(0.05 * high, min(first.sizes.resolution, second.sizes.resolution))
            for _, high, first in (groups[-1] if groups else ())
        )
        if not any(near):
            groups.append([])
        groups[-1].append((low, end, second))
    several = [group for group in groups if len(group) > 1]
    return {(min(b[0] for b in group), max(b[1] for b in group)): [b[2] for b in group] for group in several}


def shared_by_neighbours(
    causes: Sequence[Finding], names: Sequence[str]
) -> list[tuple[tuple[str, str], list[Finding]]]:
    """Neighbouring joints, of these names, that err alike in several ways at once, and these causes in pairs."""
    shared = []
    for joints in pairwise(names):
        own = [f for joint in joints for f in causes if f.determined and f.target == joint and f.effect]
        pairs = [(a, b) for a, b in combinations(own, 2) if a.target != b.target and _of_one_size(a, b)]
        if len(pairs) > 1:
            shared.append((joints, [finding for pair in pairs for finding in pair]))
    return shared


def _of_one_size(one: Finding, other: Finding) -> bool:
    """Whether two findings are of one kind that is no line of a spectrum, and of sizes that agree and are not zero."""
    if one.kind != other.kind or one.cause.spectral_lines:
        return False
    (x, u), (y, v) = (f.sizes.rms or f.effect.plausible_size(f.sizes) for f in (one, other) if f.effect)
    certain = min(abs(x) - CERTAIN * u, abs(y) - CERTAIN * v) > 0
    return certain and abs(x - y) < CERTAIN * math.hypot(u, v)


def numbers_of(found: Diagnosis, findings: Sequence[Finding]) -> tuple[str, ...]:
    return tuple(str(k) for k, finding in enumerate(found.effects, 1) if any(finding is one for one in findings))


def may_work(found: Diagnosis) -> Iterator[Statement]:
    urgent = [f for f in found.effects if f.plausible and f.cause.urgent]
    loose = [f for f in found.effects if any(isinstance(rival, BaseCompliance) for rival in f.confounded_with)]
    sure = [f for f in found.effects if f.determined]
    bent = found.unbuildable
    if found.overfitted:
        return
    if urgent:
        reasons = tuple(dict.fromkeys(f.cause.urgent.format(target=f.target) for f in urgent))
        yield state("diagnosis.stop-first", urgent[0].target, reasons=reasons)
    elif found.questioned:
        return
    elif bent is not None and not bent.is_zero:
        yield state("diagnosis.inspect-link-first", GeometricDeviation.of(bent.parameter).target)
    elif found.scatter_change is not None:
        yield state("diagnosis.rows-changed-first", line=str(found.scatter_change.line))
    else:
        if loose:
            yield state("diagnosis.tighten-base-first", "base", numbers=numbers_of(found, loose))
        if found.delivery.kept and any(f.effect for f in sure):
            if leads := [f for f in sure if f.leads]:
                yield state("diagnosis.moved-by-hand", numbers=numbers_of(found, leads))
            yield state("diagnosis.may-work")


def cause_statements(found: Diagnosis) -> Iterator[Statement]:
    if not found.effects:
        return
    actions = list(zip(found.effects, found.actions, strict=True))
    because = {r: numbers_of(found, [f for f, a in actions if a.reason == r]) for r in {a.reason for _, a in actions}}
    looked_at = [finding for finding, action in actions if action.action in ("inspect", "check_instrument")]
    yield state("diagnosis.columns")
    if "like_instrument" in because:
        yield state("diagnosis.check-instrument", numbers=because["like_instrument"])
    for finding in [] if found.overfitted else looked_at:
        (number,), what = numbers_of(found, [finding]), finding.inspect(found.problem.robot)
        yield state("diagnosis.inspect", finding.target, number=number, what=what.rstrip(".?"))
    for joints, shared in shared_by_neighbours(found.effects, found.request.data.joint_names):
        yield state("diagnosis.in-common", joints=joints, numbers=numbers_of(found, shared))
    ignored = [finding for finding, action in actions if action.reason == "implausible"]
    for need in dict.fromkeys(finding.would_need for finding in ignored):
        those = [finding for finding in ignored if finding.would_need == need]
        about = those[0].target if len(those) == 1 else ""
        yield state("diagnosis.implausible", about, numbers=numbers_of(found, those), need=need)
    if "unconfirmed" in because:
        yield state("diagnosis.unconfirmed", numbers=because["unconfirmed"])
    if "size_of_catalogues" in because:
        yield state("diagnosis.size-of-catalogues", numbers=because["size_of_catalogues"])
    for cycles in dict.fromkeys(action.cycles for _, action in actions if action.reason == "one_type"):
        alike = [finding for finding, action in actions if action.cycles == cycles]
        low, high = math.floor(cycles[0]), math.ceil(cycles[1])
        between = str(low) if low == high else f"{low} to {high}"
        yield state("diagnosis.alike-drives", numbers=numbers_of(found, alike), cycles=between)
    yield from _at_data(found, looked_at)
    yield from _confusable(found)


def _at_data(found: Diagnosis, looked_at: Sequence[Finding]) -> Iterator[Statement]:
    """What to use, state or measure to know what else the causes could be."""
    data, rivalled = found.request.data, any(f.confounded_with for f in found.effects)
    sided = [f for f in found.effects if f.determined and f.effect and "approach" in f.effect.needs]
    if sided and not data.approach_given:
        yield state("diagnosis.sides-derived", numbers=numbers_of(found, sided))
    if rivalled and data.rotation is not None and not found.model.residuals.further:
        yield state("diagnosis.orientations-unused")
    texts: dict[str, list[Finding]] = {}
    for finding in (*looked_at, *(f for f in found.effects if not f.determined)):
        named = [rival for rival in finding.confounded_with if not isinstance(rival, UnnamedComponent)]
        if named:
            texts.setdefault(finding.cause.discrimination(named[0]), []).append(finding)
    for text, those in islice(texts.items(), 3):
        yield state("diagnosis.measure-to-decide", numbers=numbers_of(found, those), measurement=text)
    if found.split is not None and len(found.split.rows):
        q, edge = found.split.rows.q, 0.02  # rad or m beyond the measured range: nearer is at its edge
        outside = ((q < data.q.min(axis=0) - edge) | (q > data.q.max(axis=0) + edge)).any(axis=1)
        if outside.any():
            yield state("diagnosis.measure-next-outside", outside=int(outside.sum()))


def _confusable(found: Diagnosis) -> Iterator[Statement]:
    splits: dict[str, list[str]] = {}
    for finding in found.effects:
        for label, rival in {rival.title_or_words: rival for rival in finding.confounded_with}.items():
            splits.setdefault(finding.cause.discrimination(rival), []).append(f"{finding.label} or {label}")
    for text, pairs in splits.items():
        yield state("diagnosis.confusable", pairs=pairs, measurement=text)
