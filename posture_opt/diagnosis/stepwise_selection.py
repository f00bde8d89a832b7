"""Stepwise selection of effects: score all candidates, choose the best set, eliminate what it does not need."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.clustered_covariance import design_effect
from posture_opt.diagnosis import levels
from posture_opt.diagnosis.candidates import Candidate, ScoredCandidate, score_candidates
from posture_opt.diagnosis.linearised_data import LinearisedData
from posture_opt.diagnosis.score_tests import NullDistribution, ProjectedBaseline
from posture_opt.diagnosis.selection_criterion import candidate_pool, eliminate, union
from posture_opt.diagnosis.shape_refinement import refine_shape
from posture_opt.diagnosis.subset_selection import best_set

Tell = Callable[[], None]


@dataclass(frozen=True)
class GrowthPolicy:
    """How the chosen set grows.

    Args:
        most: members at which it is full.
        step: members that a round adds at the most; None: as many as the criterion asks for.
        first_level: p-value below which a candidate is looked at in the first round.
        leading: candidates that a round looks at, those of the least p-value of their own; None: all.
        redrawn: whether the null distribution is drawn again beside every set.
        tests_decide: whether the best single candidate is chosen where the criterion would rather have none. It
            charges a group of parameters more than the family-wise null does; that null has decided already.
        dependent: whether the design effect is estimated beside every set.
    """

    most: int
    step: int | None
    first_level: float
    leading: int | None
    redrawn: bool
    tests_decide: bool
    dependent: bool

    def limit(self, size: int) -> int:
        """Members of the next set at the most."""
        return self.most if self.step is None else size + self.step

    def foremost(self, scored: Sequence[ScoredCandidate]) -> Sequence[ScoredCandidate]:
        """Those of the candidates that a round looks at."""
        return scored if self.leading is None else sorted(scored, key=lambda j: j.log_p)[: self.leading]


INDEPENDENT_ROWS = GrowthPolicy(
    most=levels.MOST_EFFECTS,
    step=None,
    first_level=np.inf,
    leading=None,
    redrawn=True,
    tests_decide=True,
    dependent=False,
)
"""Whole sets at once: the criterion, the tests and the null distribution count every row."""
DEPENDENT_ROWS = GrowthPolicy(
    most=levels.MOST_EFFECTS_OF_DEPENDENT_ROWS,
    step=levels.EFFECTS_A_ROUND,
    first_level=levels.FURTHER_EFFECT,
    leading=levels.SHORTLIST_OF_DEPENDENT_ROWS,
    redrawn=False,
    tests_decide=False,
    dependent=True,
)
"""A few members at a time, with as many effective rows as their design effect leaves.

An error that no candidate has the shape of, as of a gear that is no pure sine, is the same for postures that lie close
together. Thousands of such rows seem to prove the smallest effect, and what is chosen by them at once is a mixture of
candidates that resemble the strongest ones.
"""


@dataclass(frozen=True, eq=False)
class InitialScores:
    """The data with every candidate scored on the geometry alone, the least p-value first."""

    linearised: LinearisedData
    candidates: Sequence[Candidate]
    baseline: ProjectedBaseline
    scored: Sequence[ScoredCandidate]
    null: NullDistribution

    @classmethod
    def of(cls, linearised: LinearisedData, candidates: Sequence[Candidate], flips: int | None = None) -> InitialScores:
        """With ``flips`` draws of the null distribution, as many as the data ask for if None."""
        baseline = linearised.baseline(flips=flips)
        scored, null = score_candidates(baseline, candidates, linearised.sensitivities, linearised.excitation)
        return cls(linearised, candidates, baseline, scored, null)

    @property
    def best_p_value(self) -> float:
        """Family-wise p-value of the best candidate; 1 without any."""
        return self.scored[0].p_value if self.scored else 1.0

    def decided(self) -> InitialScores:
        """A close decision with more draws of the null, so that it does not depend on the draw."""
        close = self.best_p_value > levels.FIRST_EFFECT / levels.CLOSE_DECISION
        close &= self.best_p_value < levels.FIRST_EFFECT * levels.CLOSE_DECISION
        if not self.scored or not close or len(self.linearised.r) >= levels.STEADY_RESIDUALS:
            return self
        return InitialScores.of(self.linearised, self.candidates, levels.MORE_SIGN_FLIPS * self.linearised.flips)

    def specific(self) -> InitialScores:
        """With the named effects alone, and none that takes any smooth shape."""
        return replace(
            self,
            candidates=[c for c in self.candidates if c.specific],
            scored=[s for s in self.scored if s.candidate.specific],
        )

    def beside(
        self, members: Sequence[Candidate], design: float, redrawn: bool
    ) -> tuple[Sequence[ScoredCandidate], NullDistribution]:
        """All candidates scored beside the members, and the null distribution there, drawn again or as it was."""
        linearised = replace(self.linearised, design=design)
        baseline = linearised.baseline(members, flips=None if redrawn else 0)
        known = None if redrawn else self.null
        return score_candidates(baseline, self.candidates, linearised.sensitivities, linearised.excitation, known)


@dataclass(frozen=True, eq=False)
class ChosenSet:
    """The set of effects so far.

    Args:
        scored: all candidates beside the members, the least p-value first.
        null: the null distribution beside them.
        shortlisted: all candidates that sets were chosen from.
        design: design effect of the rows (Kish 1965).
    """

    members: tuple[Candidate, ...]
    scored: Sequence[ScoredCandidate]
    null: NullDistribution
    shortlisted: tuple[Candidate, ...] = ()
    design: float = 1.0

    @property
    def key(self) -> tuple[str, ...]:
        """By which a set is recognised when it comes back."""
        return tuple(sorted(str(s.what) for s in self.members))


def grow(start: InitialScores, found: ChosenSet, policy: GrowthPolicy, tell: Tell) -> ChosenSet:
    """The set to which nothing significant is to be added, that is full, or that comes back."""
    seen: set[tuple[str, ...]] = set()
    level = levels.FURTHER_EFFECT if found.members else policy.first_level
    while True:
        tell()
        significant = [s for s in found.scored if s.p_value < level]
        if not significant or found.key in seen or len(found.members) >= policy.most:
            return found
        seen.add(found.key)
        found = _round(start, found, policy, significant)
        level = levels.FURTHER_EFFECT


def _round(
    start: InitialScores, found: ChosenSet, policy: GrowthPolicy, significant: Sequence[ScoredCandidate]
) -> ChosenSet:  # fmt: skip
    """The best set of all that was ever shortlisted, from the last one on, without members that it does not need."""
    baseline = start.linearised.baseline(found.members, flips=0)
    shortlisted = union(found.shortlisted, shortlist(start.linearised, baseline, policy.foremost(significant)))
    pool = candidate_pool(replace(start.baseline, design=found.design), shortlisted)
    former = tuple(i for i, s in enumerate(shortlisted) if any(s.what == c.what for c in found.members))
    chosen = best_set(pool, former, policy.limit(len(found.members)))
    members: Sequence[Candidate] = [shortlisted[i] for i in chosen]
    if not members and policy.tests_decide:
        members = (best_single(start, shortlisted),)
    design = residual_dependence(start.linearised, members) if policy.dependent else 1.0
    linearised = replace(start.linearised, design=design)
    scored, null = start.beside(members, design, policy.redrawn)
    while len(kept := eliminate(linearised, null, members, start.null)) < len(members):
        members = kept
        scored, null = start.beside(members, design, policy.redrawn)
    return ChosenSet(kept, scored, null, shortlisted, design)


def shortlist(
    linearised: LinearisedData, baseline: ProjectedBaseline, scored: Sequence[ScoredCandidate]
) -> list[Candidate]:
    """The candidates worth choosing from, those with a searched shape at their best."""
    refined = levels.REFINED_EVIDENCE * scored[0].log_p if scored else 0.0
    return [
        refine_shape(linearised.sensitivities, baseline, s.candidate)
        if s.log_p < refined or k < levels.ALWAYS_REFINED
        else s.candidate
        for k, s in enumerate(scored)
        if s.log_p < np.log(levels.SHORTLIST_P_VALUE)
    ]


def best_single(start: InitialScores, shortlisted: Sequence[Candidate]) -> Candidate:
    """The best single one of those that are significant on the geometry alone."""
    significant = {s.candidate.key for s in start.scored if s.p_value < levels.FIRST_EFFECT}
    additions = candidate_pool(start.baseline, shortlisted).additions(())
    return next(shortlisted[i] for _, (i,) in additions if shortlisted[i].key in significant)


def residual_dependence(linearised: LinearisedData, members: Sequence[Candidate]) -> float:
    """The design effect of the residuals that geometry and members leave; 1 of independent rows (Kish 1965)."""
    columns = np.concatenate([linearised.G, *(s.Z for s in members)], axis=1)
    rest = linearised.baseline(members, flips=0).e
    return design_effect(linearised.sensitivities.residuals, rest, columns)
