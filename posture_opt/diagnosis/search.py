"""The effects in the residuals of a calibrated arm: stepwise selection, their p-values and their rivals."""

from __future__ import annotations

from dataclasses import dataclass, replace

from posture_opt.diagnosis import levels
from posture_opt.diagnosis.candidates import Candidate, ScoredCandidate, absorbed, list_candidates
from posture_opt.diagnosis.linearised_data import LinearisedData
from posture_opt.diagnosis.score_tests import NullDistribution
from posture_opt.diagnosis.selection_criterion import candidate_pool, find_rivals, member_weight, rank_members
from posture_opt.diagnosis.stepwise_selection import (
    DEPENDENT_ROWS,
    INDEPENDENT_ROWS,
    ChosenSet,
    InitialScores,
    Tell,
    best_single,
    grow,
    residual_dependence,
    shortlist,
)
from posture_opt.diagnosis.subset_selection import best_set


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The effects that a search found.

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
    start = InitialScores.of(linearised, every if unnamed else [c for c in every if c.specific])
    if dependent and start.best_p_value < levels.FIRST_EFFECT and _stay_dependent(start):
        return _names_first(start, tell)
    start = start.decided()
    if start.best_p_value >= levels.FIRST_EFFECT:
        return _result(start, ChosenSet((), start.scored, start.null))
    found = grow(start, ChosenSet((), start.scored, start.null), INDEPENDENT_ROWS, tell)
    if not found.members:  # none is significant beside the others, yet one is by itself
        single = (best_single(start, found.shortlisted),)
        found = replace(found, members=single, null=start.beside(single, 1.0, True)[1])
    return _result(start, found)


def prefer_named(linearised: LinearisedData, found: SearchResult) -> SearchResult:
    """The best set of named effects alone, where it explains nearly as much as the set with unnamed components.

    Real arms' errors are no exact sines; names that explain nearly as much are the better model: they say where to look
    and can be planned with. The result of the search stays that unnamed components are needed.
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


def _stay_dependent(start: InitialScores) -> bool:
    """Whether rows are dependent beside the first few effects too."""
    first = shortlist(start.linearised, start.baseline, DEPENDENT_ROWS.foremost(start.scored))
    chosen = best_set(candidate_pool(start.baseline, first), (), levels.EFFECTS_A_ROUND)
    return residual_dependence(start.linearised, [first[i] for i in chosen]) != 1


def _names_first(start: InitialScores, tell: Tell) -> SearchResult:
    """The named effects, and the set with the unnamed components that are needed beside them."""
    specific = start.specific()
    first = grow(specific, ChosenSet((), specific.scored, start.null), DEPENDENT_ROWS, tell)
    names = _result(start, first)
    first = replace(first, scored=start.beside(first.members, first.design, False)[0])
    policy = replace(DEPENDENT_ROWS, most=len(first.members) + levels.EFFECTS_A_ROUND)
    wider = grow(start, first, policy, tell)
    return replace(_result(start, wider), names=names) if set(wider.members) - set(first.members) else names


def _result(start: InitialScores, found: ChosenSet) -> SearchResult:
    """The members by their weight, each with its p-value given the others and its rivals."""
    linearised = replace(start.linearised, design=found.design)
    chosen, weights = rank_members(linearised, found.members)
    null = start.null if len(chosen) == 1 else found.null
    p_values = tuple(null.family_wise(p, s.family) for (p, _), s in zip(weights, chosen, strict=True))
    rivals = find_rivals(replace(start.baseline, design=found.design), found.shortlisted, chosen)
    hidden = absorbed(start.baseline, start.candidates, start.scored)
    return SearchResult(
        chosen, p_values, rivals, tuple(start.scored), found.null, start.null, hidden, found.design
    )  # fmt: skip
