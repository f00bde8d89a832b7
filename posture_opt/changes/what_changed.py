"""``Recheck``: the answer to what changed on a calibrated arm."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from posture_opt.calibration.assumptions.contradictions import GeometricDeviation
from posture_opt.changes.hypotheses import POWER, REFERENCE_M, Probabilities, Visibility
from posture_opt.changes.new_rows import Estimate
from posture_opt.encoding import Encoded, encoded
from posture_opt.errors import enumerated
from posture_opt.experiments.measurement_plan import MeasurementPlan, tour_statements
from posture_opt.experiments.possible_changes import PossibleChange, change_name
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, rms_length
from posture_opt.result import Result
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Quantity, Statement, state

Verdict = Literal["unchanged", "changed", "several", "unclear"]
# Of the probability of the likeliest change: what is likelier than this is a rival of it.
RIVAL_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class LikelyChange(Encoded):
    """One thing that may have changed, by how much, and how probable it is.

    Args:
        possible: what it is; ``estimate`` mean and covariance of its parameters [rad, m or SI of the effect].
        shift: root mean square motion of the tool by it over the rows [m].
    """

    possible: PossibleChange
    estimate: Estimate
    probability: float
    shift: float

    @property
    def kind(self) -> str:
        return self.possible.kind

    @property
    def target(self) -> str:
        return self.possible.target

    @property
    def name(self) -> str:
        return change_name(self.kind, self.target)

    @property
    def sizes(self) -> tuple[Quantity, ...]:
        mean, covariance = self.estimate.mean, self.estimate.covariance
        if len(mean) == 1:
            unit, effect = self.possible.parameters[0].unit, self.possible.effect
            dimension = effect.dimensions[0][1] if effect is not None else "angle" if unit == "rad" else "length"
            return (Quantity(float(mean[0]), dimension, math.sqrt(covariance[0, 0])),)
        shift, turn = mean[:3], mean[3:]
        size = float(np.linalg.norm(shift))
        std = math.sqrt(max(float(shift @ covariance[:3, :3] @ shift), 0.0)) / size if size else 0.0
        turned = np.any(np.abs(turn) > 2 * np.sqrt(np.diag(covariance)[3:]))
        turns = (Quantity(float(np.linalg.norm(turn)), "angle"),) if turned else ()
        return (Quantity(size, "length", std), *turns)

    @property
    def deviations(self) -> dict[str, float]:
        """Parameter of the arm -> its deviation from the file [rad, m or SI of the effect]."""
        return dict(zip(self.possible.names, self.estimate.mean.tolist(), strict=True))

    @property
    def values(self) -> dict[str, tuple[float, float, str]]:
        """Last part of each parameter's name -> (deviation, standard error, SI unit); those that the rows can show."""
        std = np.sqrt(np.diag(self.estimate.covariance))
        rows = zip(self.possible.parameters, self.estimate.mean.tolist(), std.tolist(), strict=True)
        return {p.name.rpartition(".")[2]: (mean, s, p.unit) for p, mean, s in rows if s > 0}

    def fields_json(self) -> dict[str, object]:
        estimate = {name: {"value": v, "std": s, "unit": unit} for name, (v, s, unit) in self.values.items()}
        first = encoded(self, "kind target alike=possible.alike")
        return {**first, "estimate": estimate, **encoded(self, "probability shift")}


@dataclass(frozen=True)
class GrossRow:
    """A row that no change explains and all others contradict, as a misread target.

    Args:
        error: how far it is from the arm as all other rows have it [m].
    """

    line: int
    error: float


@dataclass(frozen=True, eq=False, repr=False)
class Recheck(Result):
    """Whether an arm is still the one that was calibrated, and if not, what changed.

    Args:
        problem: the calibrated arm; ``data`` the new rows, without gross ones.
        verdict: ``unchanged``; one thing ``changed``; ``several`` things, or something else; ``unclear`` which one.
        changes: everything that may have changed, the likeliest first.
        probabilities: of all models.
        visible: how large each change must be to be seen on these rows.
        errors_before, errors_after: (N, 3) position errors of the arm as it is in the file, and with what is named [m];
            0 where a coordinate was not measured.
        named_count: so many of the changes, from the first, are what the verdict names: 1, 2 or none.
        shared_count: so many behind the one that is named share the headline: these postures cannot tell them apart.
        updated: the problem with the one change; None where none is named alone.
        gross: the rows that are left out, as all others contradict them.
        plan: the postures to measure next, where more than one thing changed or it is not clear which.
        unplanned: why no postures are proposed where they would be of use; empty otherwise.
        notes: sentences on what was assumed of the rows.
    """

    problem: ProblemData
    data: Measurements
    verdict: Verdict
    changes: tuple[LikelyChange, ...]
    probabilities: Probabilities
    visible: tuple[Visibility, ...]
    errors_before: Array
    errors_after: Array
    named_count: int
    shared_count: int
    updated: ProblemData | None
    gross: tuple[GrossRow, ...] = ()
    plan: MeasurementPlan | None = None
    unplanned: str = ""
    notes: tuple[str, ...] = ()

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """What changed, what else it could be, and what to do; or what could be detected."""
        return tuple(recheck_statements(self))

    def stated_size(self, change: LikelyChange) -> str:
        """The size of an effect that the file states already; empty otherwise."""
        effect = change.possible.effect
        same = (e for e in self.problem.arm.effects if effect and (e.kind, e.target) == (effect.kind, effect.target))
        return next((e.stated_size for e in same), "")

    @property
    def before(self) -> float:
        """Root mean square error of the arm of the file [m]."""
        return rms_length(self.errors_before)

    @property
    def after(self) -> float:
        """Root mean square error of the arm with what is named changed [m]."""
        return rms_length(self.errors_after)

    @property
    def unchanged(self) -> float:
        """Probability that nothing changed."""
        return self.probabilities.unchanged

    @property
    def named(self) -> tuple[LikelyChange, ...]:
        """The one change, or the two, that the verdict names."""
        return self.changes[: self.named_count]

    @property
    def shared(self) -> tuple[LikelyChange, ...]:
        """What may have changed in place of the one that is named, as these postures cannot tell them apart."""
        return self.changes[self.named_count : self.named_count + self.shared_count]

    @property
    def rivals(self) -> tuple[LikelyChange, ...]:
        """The changes that are nearly as likely as the first one, beside those that share the headline with it."""
        others = self.changes[1 + self.shared_count :]
        return tuple(c for c in others if c.probability > RIVAL_SHARE * self.changes[0].probability)

    @property
    def detectable(self) -> dict[str, float]:
        """Kind -> motion of the tool [m] by which the least visible change of the kind is detected; ∞ where none is."""
        found: dict[str, float] = {}
        for visible in self.visible:
            found[visible.kind] = max(found.get(visible.kind, 0.0), visible.shift)
        return found

    def fields_json(self) -> dict[str, object]:
        """The document ``recheck.json``: SI units and radians."""
        return {
            **encoded(self, "verdict changes unchanged"),
            "probability": encoded(self.probabilities, "unchanged one several"),
            "named": _kinds(self.named),
            "shared": _kinds(self.shared),
            "rivals": _kinds(self.rivals),
            **encoded(self, "detectable visible"),
            "rms": encoded(self, "before after"),
            "rows": len(self.data),
            "gross": self.gross,
            "measure": [] if self.plan is None else self.plan.postures,
            "notes": [*self.notes, *(s.text for s in self.statements if s.id == "changes.no-further-postures")],
        }


def recheck_statements(found: Recheck) -> Iterator[Statement]:
    yield _verdict(found)
    for row in found.gross:
        yield state("changes.gross-row", str(row.line), error=Quantity(row.error))
    before, rows = Quantity(found.before), len(found.data)
    if found.verdict == "unchanged":
        yield from _power(found)
    elif found.after < found.before:
        yield state("changes.errors-explained", before=before, rows=rows, after=Quantity(found.after))
    else:
        yield state("changes.errors", before=before, rows=rows)
    if found.verdict == "changed":
        yield from _alternatives(found)
    if found.plan is not None:
        yield state("changes.measure-next", postures=len(found.plan.q))
        yield from tour_statements(found.plan)
    if found.unplanned:
        yield state("changes.no-further-postures", reason=found.unplanned)


def _verdict(found: Recheck) -> Statement:
    first, either = found.changes[0], (found.changes[0], *found.shared)
    several = Quantity(found.probabilities.several, "share")
    if found.verdict == "unchanged":
        return state("changes.unchanged", probability=Quantity(found.unchanged, "share"))
    if found.shared:
        total = Quantity(sum(change.probability for change in either), "share")
        return state("changes.one-of", changes=_names(either), probability=total, several=several)
    if found.verdict == "changed":
        size, p = enumerated(map(str, first.sizes)), Quantity(first.probability, "share")
        if stated := found.stated_size(first):
            return state("changes.changed-from", first.name, size=size, probability=p, several=several, stated=stated)
        return state("changes.changed", first.name, size=size, probability=p, several=several)
    if found.verdict == "unclear":
        return state("changes.unclear", changes=_names((first, *found.rivals)))
    if not found.named:
        return state("changes.unexplained")
    second, sizes = found.changes[1], [enumerated(map(str, change.sizes)) for change in found.named]
    return state("changes.several", first.name, size=sizes[0], other=second.name, other_size=sizes[1])


def _alternatives(found: Recheck) -> Iterator[Statement]:
    first, either = found.changes[0], (found.changes[0], *found.shared)
    if not found.shared:
        if first.possible.alike:
            yield state("changes.alike", changes=first.possible.alike)
        rivals = _names(found.rivals[:3])
        yield state("changes.rivals", changes=rivals) if rivals else state("changes.no-rival")
    names: dict[str, str] = {}
    for change in either:
        cause = change.possible.effect or GeometricDeviation.of(change.possible.parameters[0])
        names.setdefault(cause.inspect(found.problem.robot), change.name)
    yield from (state("changes.inspect", name, what=what) for what, name in names.items())
    effects = (change.possible.effect for change in either)
    if found.data.payload is None and any(e is not None and "payload" in e.asks for e in effects):
        yield state("changes.payload-unstated", payload=found.problem.arm.inputs.payload)


def _power(found: Recheck) -> Iterator[Statement]:
    """How many changes of 0.1 mm would be detected, and which is the hardest to detect."""
    seen = sum(visible.power >= POWER for visible in found.visible)
    yield state("changes.power", seen=seen, changes=len(found.visible), motion=Quantity(REFERENCE_M, "stated length"))
    least = min(found.visible, key=lambda visible: visible.power)
    yield state("changes.least-power", least.name, power=Quantity(least.power, "share"))


def _names(changes: Sequence[LikelyChange]) -> tuple[str, ...]:
    return tuple(change.name for change in changes)


def _kinds(changes: Sequence[LikelyChange]) -> list[object]:
    return [encoded(change, "kind target") for change in changes]
