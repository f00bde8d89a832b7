"""What to do about the causes of a diagnosis, and whether the arm may work meanwhile."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Literal

from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.diagnosis.causes.geometry_causes import CERTAIN
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.model.effects import BaseCompliance, CyclicError, InstrumentField
from posture_opt.model.effects.base.joint_effect import CATALOGUE_AMPLITUDE, Harmonic
from posture_opt.statements import Statement, state

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.causes.sessions import SecondSession
    from posture_opt.diagnosis.diagnosis import Diagnosis


_EQUAL_CYCLES_TOLERANCE = 0.05  # of the cycles of a line, by which those of other joints are the same
_MIN_SHARED_KINDS = 2  # in which two joints err alike by more than chance

# ``inspect`` the part; ``compensate`` by corrected commands and open nothing; ``check_instrument`` first; ``confirm``
# on other rows what a test file does not show; ``measure`` more where the size is open; ``ignore`` what no arm has.
Action = Literal["inspect", "compensate", "check_instrument", "confirm", "measure", "ignore"]
Reason = Literal["size_of_catalogues", "one_type", "unconfirmed", "implausible", "like_instrument", "open_size", ""]


@dataclass(frozen=True)
class CauseAction:
    """What is to be done about one cause, and why it is not simply looked at."""

    action: Action
    reason: Reason = ""
    cycles: tuple[float, float] = (0.0, 0.0)


def cause_actions(causes: Sequence[Finding], test: SecondSession | None, touches: bool) -> tuple[CauseAction, ...]:
    """The action for each cause, in their order."""
    sure = [f for f in causes if f.determined]
    alike = {
        id(finding): cycles
        for cycles, group in of_one_type([f for f in sure if f.plausible]).items()
        for finding in group
    }
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
    if test is None or finding.place is None or not any(test.gains):
        return False
    gain = test.gains[finding.place]
    return gain is not None and gain.low <= 0


def _as_in_catalogues(finding: Finding) -> bool:
    cause, rms = finding.cause, finding.sizes.rms
    if not isinstance(cause, Harmonic):
        return False
    size, std = cause.plausible_size(finding.sizes)
    if rms is not None and len(cause.frequencies) > 1:
        size, std = (math.sqrt(2) * value for value in rms)
    return size - (CERTAIN * std if math.isfinite(std) else 0.0) <= CATALOGUE_AMPLITUDE


def of_one_type(findings: Sequence[Finding]) -> dict[tuple[float, float], list[Finding]]:
    """Range of cycles per revolution -> errors of several joints that repeat about as often, as one type of drive."""
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
    (_, high, first), (low, _, second) = one, other
    apart = min(first.sizes.resolution, second.sizes.resolution)
    return low - high < max(_EQUAL_CYCLES_TOLERANCE * high, apart)


def shared_by_neighbours(
    causes: Sequence[Finding], names: Sequence[str]
) -> list[tuple[tuple[str, str], list[Finding]]]:
    """Neighbouring joints, of these names, that err alike in several ways at once, and these causes in pairs."""
    shared = []
    for joints in pairwise(names):
        own = [[f for f in causes if f.determined and f.target == joint and f.effect] for joint in joints]
        pairs = [(a, b) for a, b in combinations((*own[0], *own[1]), 2) if a.target != b.target and _of_one_size(a, b)]
        if len(pairs) >= _MIN_SHARED_KINDS:
            shared.append((joints, [finding for pair in pairs for finding in pair]))
    return shared


def _of_one_size(one: Finding, other: Finding) -> bool:
    if one.kind != other.kind or one.cause.spectral_lines:
        return False
    (x, u), (y, v) = (f.sizes.rms or f.effect.plausible_size(f.sizes) for f in (one, other) if f.effect)
    certain = min(abs(x) - CERTAIN * u, abs(y) - CERTAIN * v) > 0
    return certain and abs(x - y) < CERTAIN * math.hypot(u, v)


_MAX_DECIDED = 3  # measurements that decide what a cause of an open size is
_EDGE = 0.02  # rad or m beyond the measured range: nearer is at its edge


def numbers_of(found: Diagnosis, findings: Sequence[Finding]) -> tuple[str, ...]:
    """The numbers of causes in their table, in its order."""
    return tuple(str(k) for k, finding in enumerate(found.effects, 1) if any(finding is one for one in findings))


def may_work(found: Diagnosis) -> list[Statement]:
    """Whether the arm can work on until then, with which commands, and what is looked at before."""
    if found.overfitted:
        return []
    urgent = [f for f in found.effects if f.plausible and f.cause.urgent]
    if urgent:
        reasons = tuple(dict.fromkeys(f.cause.urgent.format(target=f.target) for f in urgent))
        return [state("diagnosis.stop-first", urgent[0].target, reasons=reasons)]
    bent = found.unbuildable
    if bent is not None and not bent.is_zero:
        return [state("diagnosis.inspect-link-first", GeometricDeviation.of(bent.parameter).target)]
    if found.scatter_change is not None:
        return [state("diagnosis.rows-changed-first", line=str(found.scatter_change.line))]
    loose = [f for f in found.effects if any(isinstance(rival, BaseCompliance) for rival in f.confounded_with)]
    said = [state("diagnosis.tighten-base-first", "base", numbers=numbers_of(found, loose))] if loose else []
    if not found.delivery.kept or not any(f.determined and f.effect for f in found.effects):
        return said
    leads = [f for f in found.effects if f.determined and f.leads]
    if leads:
        said.append(state("diagnosis.moved-by-hand", numbers=numbers_of(found, leads)))
    return [*said, state("diagnosis.may-work")]


def cause_statements(found: Diagnosis) -> list[Statement]:
    """What to do about the causes, and what else they could be, with their numbers in the table."""
    if not found.effects:
        return []
    actions = list(zip(found.effects, found.actions, strict=True))

    def because(reason: Reason) -> tuple[str, ...]:
        return numbers_of(found, [finding for finding, action in actions if action.reason == reason])

    said = [state("diagnosis.columns")]
    if like := because("like_instrument"):
        said.append(state("diagnosis.check-instrument", numbers=like))
    looked_at = [finding for finding, action in actions if action.action in ("inspect", "check_instrument")]
    for finding in [] if found.overfitted else looked_at:
        (number,), what = numbers_of(found, [finding]), finding.inspect(found.problem.robot)
        said.append(state("diagnosis.inspect", finding.target, number=number, what=what.rstrip(".?")))
    for joints, shared in shared_by_neighbours(found.effects, found.request.data.joint_names):
        said.append(state("diagnosis.in-common", joints=joints, numbers=numbers_of(found, shared)))
    for finding, action in actions:
        if action.reason == "implausible":
            (number,) = numbers_of(found, [finding])
            said.append(state("diagnosis.implausible", finding.target, number=number, need=finding.would_need))
    for id, reason in (("unconfirmed", "unconfirmed"), ("size-of-catalogues", "size_of_catalogues")):
        if numbers := because(reason):  # type: ignore[arg-type] # one of the reasons
            said.append(state(f"diagnosis.{id}", numbers=numbers))
    for cycles in dict.fromkeys(action.cycles for _, action in actions if action.reason == "one_type"):
        alike = [finding for finding, action in actions if action.cycles == cycles]
        low, high = math.floor(cycles[0]), math.ceil(cycles[1])
        between = str(low) if low == high else f"{low} to {high}"
        said.append(state("diagnosis.alike-drives", numbers=numbers_of(found, alike), cycles=between))
    return [*said, *_at_data(found, looked_at), *_confusable(found)]


def _at_data(found: Diagnosis, looked_at: Sequence[Finding]) -> list[Statement]:
    said, rivalled = [], [f for f in found.effects if f.confounded_with]
    sided = [f for f in found.effects if f.determined and f.effect and "approach" in f.effect.needs]
    if sided and not found.request.data.approach_given:
        said.append(state("diagnosis.sides-derived", numbers=numbers_of(found, sided)))
    if rivalled and found.request.data.rotation is not None and not found.model.residuals.further:
        said.append(state("diagnosis.orientations-unused"))
    texts: dict[str, list[Finding]] = {}
    for finding in (*looked_at, *(f for f in found.effects if not f.determined)):
        named = [rival for rival in finding.confounded_with if not isinstance(rival, UnnamedComponent)]
        if named:
            texts.setdefault(finding.cause.discrimination(named[0]), []).append(finding)
    for text, those in list(texts.items())[:_MAX_DECIDED]:
        said.append(state("diagnosis.measure-to-decide", numbers=numbers_of(found, those), measurement=text))
    if found.split is not None and len(found.split.rows):
        q, data = found.split.rows.q, found.request.data.q
        outside = ((q < data.min(axis=0) - _EDGE) | (q > data.max(axis=0) + _EDGE)).any(axis=1)
        if outside.any():
            said.append(state("diagnosis.measure-next-outside", outside=int(outside.sum())))
    return said


def _confusable(found: Diagnosis) -> list[Statement]:
    splits: dict[str, list[str]] = {}
    for finding in found.effects:
        for label, rival in {rival.title_or_words: rival for rival in finding.confounded_with}.items():
            splits.setdefault(finding.cause.discrimination(rival), []).append(f"{finding.label} or {label}")
    return [state("diagnosis.confusable", pairs=pairs, measurement=text) for text, pairs in splits.items()]


def geometric(found: Diagnosis) -> list[Finding]:
    """The causes that are wrong parameters of the arm, frames not among them."""
    named = [f for f in found.effects if isinstance(f.cause, GeometricDeviation)]
    return [f for f in named if f.kind not in ("base_frame", "tool_frame")]
