"""Which effects the residuals of a calibrated arm hold: score, choose, eliminate what is not needed, score again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.clustered_covariance import design_effect
from posture_opt.diagnosis import levels
from posture_opt.diagnosis.candidates import Candidate, ScoredCandidate, absorbed, list_candidates, score_candidates
from posture_opt.diagnosis.linearised_data import LinearisedData
from posture_opt.diagnosis.score_tests import NullDistribution, ProjectedBaseline
from posture_opt.diagnosis.selection_criterion import (
    candidate_pool,
    eliminate,
    find_rivals,
    member_weight,
    rank_members,
    union,
)
from posture_opt.diagnosis.shape_refinement import refine_shape
from posture_opt.diagnosis.subset_selection import best_set

Tell = Callable[[], None]


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What a search found.

    Args:
        chosen: the candidates that together explain the residuals best, the weightiest first.
        p_values: (chosen,) family-wise, of dropping each.
        rivals: for each chosen one the candidates that could stand for it.
        scored: every candidate on the geometry alone.
        null: the null distribution beside the chosen ones; ``initial_null`` that beside the geometry alone.
        absorbed: named candidates that the geometry alone could stand for, with the share of their columns that is
            left.
        design: design effect, the number of residuals that tell as much as one independent residual would.
        names: the best set of named effects alone, where that was searched for first.
    """

    chosen: tuple[Candidate, ...]
    p_values: tuple[float, ...]
    rivals: tuple[tuple[Candidate, ...], ...]
    scored: tuple[ScoredCandidate, ...]
    null: NullDistribution
    initial_null: NullDistribution
    absorbed: tuple[tuple[Candidate, float], ...] = ()
    design: float = 1.0
    names: SearchResult | None = None

    @property
    def confusable(self) -> dict[int, tuple[Candidate, ...]]:
        """By its place among the named ones, the rivals of every effect that has some."""
        named = [rivals for s, rivals in zip(self.chosen, self.rivals, strict=True) if s.named]
        return {place: rivals for place, rivals in enumerate(named) if rivals}


@dataclass(frozen=True)
class _Policy:
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


_INDEPENDENT_ROWS = _Policy(levels.MOST_EFFECTS, None, np.inf, None, True, True, False)
_DEPENDENT_ROWS = _Policy(
    levels.MOST_EFFECTS_OF_DEPENDENT_ROWS, levels.EFFECTS_A_ROUND, levels.FURTHER_EFFECT,
    levels.SHORTLIST_OF_DEPENDENT_ROWS, False, False, True,
)  # fmt: skip
"""What no candidate has the shape of, such as the error of a gear that is no pure sine, is the same for postures that
lie close together. Thousands of such rows seem to prove the smallest effect, and what is chosen by them in one go is a
mixture of what resembles the strongest ones: so few are added at a time, by as many rows as tell apart."""


@dataclass(frozen=True, eq=False)
class _Start:
    """The data with every candidate scored on the geometry alone, the least p-value first."""

    linearised: LinearisedData
    candidates: Sequence[Candidate]
    baseline: ProjectedBaseline
    scored: Sequence[ScoredCandidate]
    null: NullDistribution

    @classmethod
    def of(cls, linearised: LinearisedData, candidates: Sequence[Candidate], flips: int | None = None) -> _Start:
        baseline = linearised.baseline(flips=flips)
        scored, null = score_candidates(baseline, candidates, linearised.sensitivities, linearised.excitation)
        return cls(linearised, candidates, baseline, scored, null)

    @property
    def best_p_value(self) -> float:
        return self.scored[0].p_value if self.scored else 1.0

    def decided(self) -> _Start:
        """A close decision with more draws of the null, so that it does not hang on the draw."""
        close = self.best_p_value > levels.FIRST_EFFECT / levels.CLOSE_DECISION
        close &= self.best_p_value < levels.FIRST_EFFECT * levels.CLOSE_DECISION
        if not self.scored or not close or len(self.linearised.r) >= levels.STEADY_RESIDUALS:
            return self
        return _Start.of(self.linearised, self.candidates, levels.MORE_SIGN_FLIPS * self.linearised.flips)

    def specific(self) -> _Start:
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
class _Chosen:
    """The set so far, with all candidates scored beside it, and all that were shortlisted."""

    members: tuple[Candidate, ...]
    scored: Sequence[ScoredCandidate]
    null: NullDistribution
    shortlisted: tuple[Candidate, ...] = ()
    design: float = 1.0

    @property
    def key(self) -> tuple[str, ...]:
        return tuple(sorted(str(s.what) for s in self.members))


def search(
    linearised: LinearisedData, dependent: bool = False, tell: Tell = lambda: None, *, unnamed: bool = True
) -> SearchResult:
    """The effects in the residuals, with the family-wise error of the first at `levels.FIRST_EFFECT`.

    Forward selection of whole sets by the criterion of `subset_selection`, with backward elimination by score tests
    and a null distribution of sign flips (Winkler et al. 2014). Where rows stay dependent once effects are taken away,
    named effects are chosen first, a few at a time, by as many rows as their design effect leaves.

    Args:
        dependent: whether neighbouring postures err alike after the geometry alone.
        tell: called after every round.
        unnamed: whether unnamed components, and effects that take any smooth shape, are candidates.
    """
    every = list_candidates(linearised.sensitivities, linearised.excitation)
    start = _Start.of(linearised, every if unnamed else [c for c in every if c.specific])
    if dependent and start.best_p_value < levels.FIRST_EFFECT and _stay_dependent(start):
        return _names_first(start, tell)
    start = start.decided()
    if start.best_p_value >= levels.FIRST_EFFECT:
        return _result(start, _Chosen((), start.scored, start.null))
    found = _grow(start, _Chosen((), start.scored, start.null), _INDEPENDENT_ROWS, tell)
    if not found.members:  # all that stood together fell; one alone comes by chance too rarely for nothing to be named
        single = (_best_single(start, found.shortlisted),)
        found = replace(found, members=single, null=start.beside(single, 1.0, True)[1])
    return _result(start, found)


def prefer_named(linearised: LinearisedData, found: SearchResult) -> SearchResult:
    """The best set of named effects alone, where it explains nearly as much as the set with unnamed components.

    Real arms' errors are no exact sines; names that explain nearly as much are the better model: they say where to look
    and can be planned with. The result of the search stays that something is left without a name.
    """
    if found.names is not None:
        return found.names
    names = search(linearised, unnamed=False)
    rest, least = (float(linearised.baseline(v.chosen, flips=0).rss[0]) for v in (names, found))
    whole = float(linearised.baseline(flips=0).rss[0])
    return names if whole - rest >= levels.NAMES_EXPLAIN_ENOUGH * (whole - least) else found


def remaining_unnamed(linearised: LinearisedData, found: SearchResult, names: SearchResult) -> tuple[Candidate, ...]:
    """The unnamed components that the residuals need beside the ``names`` of the model; else all that were found."""
    unnamed = tuple(s for s in found.chosen if not s.named)
    if names is found:
        return unnamed
    linearised = replace(linearised, design=found.design)
    beside = ((s, member_weight(linearised, [*names.chosen, s], s)[0]) for s in unnamed)
    return tuple(s for s, p in beside if found.null.family_wise(p, s.family) < levels.FURTHER_EFFECT) or unnamed


def residual_dependence(linearised: LinearisedData, members: Sequence[Candidate]) -> float:
    """The design effect of what geometry and members leave; 1 of independent rows (Kish 1965)."""
    columns = np.concatenate([linearised.G, *(s.Z for s in members)], axis=1)
    rest = linearised.baseline(members, flips=0).e
    return design_effect(linearised.sensitivities.residuals, rest, columns)


def _stay_dependent(start: _Start) -> bool:
    """Whether rows are dependent beside the first few effects too."""
    first = _shortlist(start.linearised, start.baseline, _DEPENDENT_ROWS.foremost(start.scored))
    chosen = best_set(candidate_pool(start.baseline, first), (), levels.EFFECTS_A_ROUND)
    return residual_dependence(start.linearised, [first[i] for i in chosen]) != 1


def _names_first(start: _Start, tell: Tell) -> SearchResult:
    """The named effects, and the set with the unnamed components that are needed beside them."""
    specific = start.specific()
    first = _grow(specific, _Chosen((), specific.scored, start.null), _DEPENDENT_ROWS, tell)
    names = _result(start, first)
    first = replace(first, scored=start.beside(first.members, first.design, False)[0])
    policy = replace(_DEPENDENT_ROWS, most=len(first.members) + levels.EFFECTS_A_ROUND)
    wider = _grow(start, first, policy, tell)
    return replace(_result(start, wider), names=names) if set(wider.members) - set(first.members) else names


def _grow(start: _Start, found: _Chosen, policy: _Policy, tell: Tell) -> _Chosen:
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
    start: _Start, found: _Chosen, policy: _Policy, significant: Sequence[ScoredCandidate]
) -> _Chosen:  # fmt: skip
    """The best set of all that was ever shortlisted, from the last one on, without members that it does not need."""
    baseline = start.linearised.baseline(found.members, flips=0)
    shortlisted = union(found.shortlisted, _shortlist(start.linearised, baseline, policy.foremost(significant)))
    pool = candidate_pool(replace(start.baseline, design=found.design), shortlisted)
    former = tuple(i for i, s in enumerate(shortlisted) if any(s.what == c.what for c in found.members))
    chosen = best_set(pool, former, policy.limit(len(found.members)))
    members: Sequence[Candidate] = [shortlisted[i] for i in chosen]
    if not members and policy.tests_decide:
        members = (_best_single(start, shortlisted),)
    design = residual_dependence(start.linearised, members) if policy.dependent else 1.0
    linearised = replace(start.linearised, design=design)
    scored, null = start.beside(members, design, policy.redrawn)
    while len(kept := eliminate(linearised, null, members, start.null)) < len(members):
        members = kept
        scored, null = start.beside(members, design, policy.redrawn)
    return _Chosen(kept, scored, null, shortlisted, design)


def _shortlist(
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


def _best_single(start: _Start, shortlisted: Sequence[Candidate]) -> Candidate:
    """The best single one of those that are significant on the geometry alone."""
    significant = {s.candidate.key for s in start.scored if s.p_value < levels.FIRST_EFFECT}
    additions = candidate_pool(start.baseline, shortlisted).additions(())
    return next(shortlisted[i] for _, (i,) in additions if shortlisted[i].key in significant)


def _result(start: _Start, found: _Chosen) -> SearchResult:
    linearised = replace(start.linearised, design=found.design)
    chosen, weights = rank_members(linearised, found.members)
    null = start.null if len(chosen) == 1 else found.null
    p_values = tuple(null.family_wise(p, s.family) for (p, _), s in zip(weights, chosen, strict=True))
    rivals = find_rivals(replace(start.baseline, design=found.design), found.shortlisted, chosen)
    hidden = absorbed(start.baseline, start.candidates, start.scored)
    return SearchResult(
        chosen, p_values, rivals, tuple(start.scored), found.null, start.null, hidden, found.design
    )  # fmt: skip
