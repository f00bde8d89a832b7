"""``Recheck``: the answer to what changed on a calibrated arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from posture_opt.changes.gaussian_evidence import Estimate
from posture_opt.changes.hypotheses import Probabilities
from posture_opt.changes.visibility import Visibility
from posture_opt.experiments.measurement_plan import MeasurementPlan
from posture_opt.experiments.possible_changes import PossibleChange
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Json, rms_length
from posture_opt.result import Result
from posture_opt.selection.problem_data import ProblemData

Verdict = Literal["unchanged", "changed", "several", "unclear"]
RIVAL_SHARE = 0.05
"""Of the probability of the likeliest change: what is likelier than this is a rival of it."""


@dataclass(frozen=True, eq=False)
class LikelyChange:
    """One thing that may have changed, by how much, and how probable it is.

    Args:
        possible: what it is; ``estimate`` mean and covariance of its parameters [rad, m or SI of the effect].
        probability: that it changed; the pairs that it is part of count by half.
        shift: root mean square motion of the tool by it over the rows [m].
    """

    possible: PossibleChange
    estimate: Estimate
    probability: float
    shift: float

    @property
    def kind(self) -> str:
        """``tool_frame``, ``base_frame``, ``joint_offset``, ``link``, ``backlash`` or ``joint_compliance``."""
        return self.possible.kind

    @property
    def target(self) -> str:
        """``tool``, ``base``, a joint, or a length or twist of a link: ``elbow.a``."""
        return self.possible.target

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

    def to_json(self) -> dict[str, Json]:
        """The entry of ``changes``."""
        return {
            "kind": self.kind,
            "target": self.target,
            "alike": list(self.possible.alike),
            "estimate": {name: {"value": v, "std": s, "unit": unit} for name, (v, s, unit) in self.values.items()},
            "probability": self.probability,
            "shift": self.shift,
        }


@dataclass(frozen=True)
class GrossRow:
    """A row that no change explains and all others contradict, as a misread target.

    Args:
        line: its line in the file.
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
        notes: sentences for the report.
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
    notes: tuple[str, ...] = ()

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

    def fields_json(self) -> dict[str, Json]:
        """The document ``recheck.json``: SI units and radians."""
        p = self.probabilities
        return {
            "verdict": self.verdict,
            "changes": [change.to_json() for change in self.changes],
            "unchanged": p.unchanged,
            "probability": {"unchanged": p.unchanged, "one": p.one, "several": p.several},
            "named": [{"kind": c.kind, "target": c.target} for c in self.named],
            "shared": [{"kind": c.kind, "target": c.target} for c in self.shared],
            "rivals": [{"kind": c.kind, "target": c.target} for c in self.rivals],
            "detectable": {kind: v if np.isfinite(v) else None for kind, v in self.detectable.items()},
            "visible": [visible.to_json() for visible in self.visible],
            "rms": {"before": self.before, "after": self.after},
            "rows": len(self.data),
            "gross": [{"line": row.line, "error": row.error} for row in self.gross],
            "measure": [] if self.plan is None else [dict(posture) for posture in self.plan.postures],
            "notes": list(self.notes),
        }
