"""What to do about the causes of a diagnosis, and whether the arm may work meanwhile, as statements."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.diagnosis.cause_actions import Reason, shared_by_neighbours
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.model.effects import BaseCompliance
from posture_opt.statements import Statement, state

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis

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
        return [state("diagnosis.inspect-link-first", bent.deviation.target)]
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
    """What to use, state or measure to know what else the causes could be."""
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
    """What each cause may be confused with, and the measurement that discriminates them; pairs of one share a line."""
    splits: dict[str, list[str]] = {}
    for finding in found.effects:
        for label, rival in {rival.title_or_words: rival for rival in finding.confounded_with}.items():
            splits.setdefault(finding.cause.discrimination(rival), []).append(f"{finding.label} or {label}")
    return [state("diagnosis.confusable", pairs=pairs, measurement=text) for text, pairs in splits.items()]


def geometric(found: Diagnosis) -> list[Finding]:
    """The causes that are wrong parameters of the arm, frames not among them."""
    named = [f for f in found.effects if isinstance(f.cause, GeometricDeviation)]
    return [f for f in named if f.kind not in ("base_frame", "tool_frame")]
