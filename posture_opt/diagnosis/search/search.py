"""The effects in the residuals of a calibrated arm: which explain them, how many predict, what could replace them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.data_checks import spread_poses
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate, ScoredCandidate, absorbed_candidates, list_candidates
from posture_opt.diagnosis.scores.nested_subsets import nested_subsets
from posture_opt.diagnosis.scores.score_tests import NullDistribution, ProjectedBaseline
from posture_opt.diagnosis.scores.subset_selection import exchange_members
from posture_opt.diagnosis.search.aliases import find_aliases
from posture_opt.diagnosis.search.dictionary import Dictionary
from posture_opt.diagnosis.search.initial_scores import InitialScores
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.diagnosis.search.matching_pursuit import pursue_candidates
from posture_opt.diagnosis.search.nested_selection import Folding, NestedSelections
from posture_opt.diagnosis.search.selection_criterion import (
    FurtherNulls,
    beyond_instrument,
    candidate_pool,
    eliminate_members,
    family_wise,
    find_rivals,
    implausible_members,
    member_weight,
    member_weights,
    merged_candidates,
    rank_members,
    substantial_members,
)
from posture_opt.diagnosis.search.shape_refinement import has_shape, refine_shape, separate_lines
from posture_opt.errors import InsufficientDataError
from posture_opt.model.effects import CyclicError

ReportStep = Callable[[], None]


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The effects that a search found.

    Largest contribution first means by the rise of the criterion without a member, all others kept.

    Args:
        chosen: the candidates that together explain the residuals best, the largest contribution first.
        p_values: (chosen,) family-wise, of dropping each.
        rivals: for each chosen one the candidates that could replace it.
        scored: every candidate on the geometry alone.
        null: the null distribution of the best candidate on the geometry alone.
        absorbed: named candidates that the geometry alone could replace, with the share of their columns that is
            left.
        nested: what folds chose by themselves; ``considered`` the significant candidates that were chosen from.
        names: the best set of named effects alone, where it is the better model.
        null: of the best candidate on the geometry alone; ``beside`` the same beside a set, where it was needed.
    """

    chosen: tuple[Candidate, ...]
    p_values: tuple[float, ...]
    rivals: tuple[tuple[Candidate, ...], ...]
    scored: tuple[ScoredCandidate, ...]
    null: NullDistribution
    nested: NestedSelections
    absorbed: tuple[tuple[Candidate, float], ...] = ()
    considered: tuple[Candidate, ...] = ()
    names: SearchResult | None = None
    beside: NullDistribution | None = None

    @property
    def size(self) -> int:
        """How many candidates were chosen, every line of a joint counted."""
        return _count(self.chosen)

    @property
    def detached(self) -> SearchResult:
        """The same without the dictionary that it was found in."""
        return replace(
            self,
            chosen=tuple(s.detached for s in self.chosen),
            rivals=tuple(tuple(s.detached for s in own) for own in self.rivals),
            scored=tuple(replace(s, candidate=s.candidate.without_columns) for s in self.scored),
            absorbed=tuple((s.without_columns, rho) for s, rho in self.absorbed),
            considered=tuple(s.without_columns for s in self.considered),
            names=None if self.names is None else self.names.detached,
        )

    @property
    def confusable(self) -> dict[int, tuple[Candidate, ...]]:
        """By its place among the named ones, the rivals of every effect that has some."""
        named = [rivals for s, rivals in zip(self.chosen, self.rivals, strict=True) if s.named]
        return {place: rivals for place, rivals in enumerate(named) if rivals}


@dataclass(frozen=True, eq=False)
class _Selection:
    """A set that was chosen from some of the candidates, before it is known what could replace its members.

    Args:
        chosen, nested, considered, beside: as of a `SearchResult`; ``others`` could replace members.
    """

    chosen: tuple[Candidate, ...]
    nested: NestedSelections
    others: tuple[Candidate, ...] = ()
    considered: tuple[Candidate, ...] = ()
    beside: NullDistribution | None = None

    @property
    def size(self) -> int:
        """How many candidates were chosen, every line of a joint counted."""
        return _count(self.chosen)


def _count(chosen: Sequence[Candidate]) -> int:
    """How many candidates these are, every line of a joint counted."""
    return sum(len(s.what.lines) if isinstance(s.what, CyclicError) else 1 for s in chosen)


def search_effects(
    linearised: LinearisedData, foldings: Sequence[Folding] | None = None, report_step: ReportStep = lambda: None
) -> SearchResult:
    """The effects in the residuals, with the family-wise error of the first at `levels.FIRST_EFFECT_LEVEL`.

    A matching pursuit over all candidates, backward elimination by F tests with a null distribution of sign flips
    (Winkler et al. 2014), and as many effects as predict rows left out: `nested_selection`.

    Real arms' errors are no exact sines; names that explain nearly as much as the best description are the better
    model: they say where to look and can be planned with. The result stays that unnamed components are needed.

    Args:
        foldings: ways to leave rows out, the usual ones if None.
        report_step: called after every part.

    Returns:
        The chosen set without its dictionary; ``names`` the best named set, where unnamed components explain more.
    """
    if foldings is None:
        foldings = Folding.usual(linearised.sensitivities.residuals.data)
    return _search_all(linearised, foldings, report_step).detached


def _search_all(linearised: LinearisedData, foldings: Sequence[Folding], report_step: ReportStep) -> SearchResult:
    """The search itself.

    Raises:
        InsufficientDataError: the parameters of the geometry take up all that was measured.
    """
    start = InitialScores.of(linearised, candidates_of(linearised)).decided()
    report_step()
    if start.baseline.freedom < 1:
        rows = linearised.sensitivities.residuals
        raise InsufficientDataError(f"the parameters take up all that was measured; {spread_poses(rows)}")
    if start.best_p_value >= levels.FIRST_EFFECT_LEVEL:
        return _search_result(start, _Selection((), NestedSelections.of(Dictionary(linearised, ()), 0, foldings)))
    # What is only compared is judged by the strictest way to leave rows out, for time.
    found = _select_allowed(start, foldings[-1:], lambda c: True)
    report_step()
    if all(s.persistent for s in found.considered):
        lasting = _select_allowed(start, foldings, lambda c: c.persistent)
        return _search_result(start, _plausible(start, foldings, lasting))
    names = _plausible(start, foldings, _named_model(start, foldings))
    report_step()
    if all(s.named for s in found.chosen):
        return _search_result(start, names)
    alone = NestedSelections(names.nested.each[-1:])
    if alone.explained >= levels.NAMED_SHARE * found.nested.explained:
        return replace(_search_result(start, found), names=_search_result(start, names))
    every = found if len(foldings) == 1 else _select_allowed(start, foldings, lambda c: True)
    return _search_result(start, every)


def candidates_of(linearised: LinearisedData) -> list[Candidate]:
    """Every candidate but lines, with what the instrument as stated limits them to."""
    return list_candidates(linearised.sensitivities, linearised.excitation, linearised.G, linearised.instrument)


def _plausible(start: InitialScores, foldings: Sequence[Folding], found: _Selection) -> _Selection:
    """The set, or one whose sizes arms can have, where that explains nearly as much.

    A drift explains what a length would only by growing ten times as much as metals do.
    """
    impossible = {s.key for s in implausible_members(start.linearised, found.chosen)}
    if not impossible:
        return found
    other = _select_allowed(start, foldings, lambda c: c.named and c.key not in impossible)
    if not other.chosen or implausible_members(start.linearised, other.chosen):
        return found
    return other if other.nested.explained >= levels.PLAUSIBLE_SHARE * found.nested.explained else found


def _named_model(start: InitialScores, foldings: Sequence[Folding]) -> _Selection:
    """The best set of named effects: with those of the session only where these predict rows left out clearly better.

    What stays constant for a while, or bends with the place in the room, imitates much that has another cause. Yet one
    drift is likelier than several lasting causes that explain no more, or than one of a size that no arm has.

    Both sets are chosen in the same way; only what they may choose from differs.
    """
    persistent = _select_allowed(start, foldings, lambda c: c.persistent)
    last = foldings[-1:]
    every = _select_allowed(start, last, lambda c: c.named)
    if all(s.persistent for s in every.considered):
        return persistent
    alone = NestedSelections(persistent.nested.each[-1:])
    enough = alone.explained >= levels.PERSISTENT_SHARE * every.nested.explained
    fewer = 0 < every.size < persistent.size and every.nested.explained >= alone.explained
    if fewer or implausible_members(start.linearised, persistent.chosen):
        return every if len(foldings) == 1 else _select_allowed(start, foldings, lambda c: c.named)
    if enough or not every.nested.clearly_better(alone):
        return persistent
    return every if len(foldings) == 1 else _select_allowed(start, foldings, lambda c: c.named)


def _select_allowed(
    start: InitialScores, foldings: Sequence[Folding], allowed: Callable[[Candidate], bool]
) -> _Selection:
    """The best set of those candidates that are allowed.

    Pursuit, exchange, elimination, and a size by nested folds; each step only removes or replaces members of the one
    before.
    """
    linearised = start.linearised
    dictionary = Dictionary(linearised, tuple(filter(allowed, start.candidates)))
    pursued = pursue_candidates(dictionary, levels.MAX_EFFECTS)
    shortlisted = merged_candidates(filter(allowed, start.shortlist), pursued.runners_up)
    members = _exchanged_members(start, pursued.chosen, shortlisted)
    refined = _refined_members(linearised, members)
    nulls = FurtherNulls(start.null, lambda: start.null_beside(refined))
    members = eliminate_members(linearised, nulls, refined)
    if not members:  # the criterion charges a group of parameters more than the test, which has decided already
        best = [s.candidate for s in start.scored if allowed(s.candidate)][:1]
        members = tuple(refine_shape(linearised.sensitivities, start.baseline, c) for c in best)
    nested = NestedSelections.of(dictionary, len(members), foldings)
    subsets = nested_subsets([s.Z for s in members], linearised.G, linearised.r)
    chosen = substantial_members(
        linearised, _joined_lines(linearised, [members[i] for i in subsets[nested.size].members])
    )
    impossible = {s.key for s in beyond_instrument(linearised, chosen)}
    if impossible:  # what was chosen with them may have been chosen because of them
        return _select_allowed(start, foldings, lambda c: allowed(c) and c.key not in impossible)
    # What this set may not hold can explain it all the same: drift for growth, an unnamed curve for a gear error.
    others = merged_candidates(shortlisted, start.shortlist)
    return _Selection(chosen, nested, others, members, nulls.drawn)


def _joined_lines(linearised: LinearisedData, members: Sequence[Candidate]) -> list[Candidate]:
    """The members with all lines of one joint as one cyclic error.

    Lines of one joint are one cause, a cyclic error with several harmonics; they were searched for one by one.
    """
    lines: dict[str, list[Candidate]] = {}
    for member in members:
        if isinstance(member.what, CyclicError):
            lines.setdefault(member.target, []).append(member)
    others = [member for member in members if not isinstance(member.what, CyclicError)]
    sizes = _sizes(linearised, members) if any(len(own) > 1 for own in lines.values()) else {}
    return [*others, *(own[0] if len(own) == 1 else _one_error(linearised, own, sizes) for own in lines.values())]


def _sizes(linearised: LinearisedData, members: Sequence[Candidate]) -> dict[str, float]:
    """Length of the parameters [SI] of each member by its name, all fitted together with the geometry."""
    A = np.concatenate([linearised.G, *(s.Z for s in members)], axis=1)
    scale = np.linalg.norm(A, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    theta = np.linalg.lstsq(A / scale, linearised.r, rcond=1e-10)[0] / scale
    ends = np.cumsum([linearised.G.shape[1], *(s.Z.shape[1] for s in members)])
    return {
        str(s.what): float(np.linalg.norm(theta[i:j])) for s, i, j in zip(members, ends[:-1], ends[1:], strict=True)
    }


def _one_error(linearised: LinearisedData, lines: Sequence[Candidate], sizes: Mapping[str, float]) -> Candidate:
    """Lines of one joint as one cyclic error, the largest first."""
    errors = [s.what for s in lines if isinstance(s.what, CyclicError)]
    error = CyclicError.joined(errors, [sizes[str(one)] for one in errors])
    searched = float(np.exp(np.sum(np.log([s.searched for s in lines]))))  # each was searched for by itself
    return Candidate(error, linearised.sensitivities.columns(error), searched)


def _exchanged_members(
    start: InitialScores, members: tuple[Candidate, ...], shortlisted: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """The members after drops and swaps with the shortlisted, as long as the criterion falls.

    Sets of one member, or of more than `levels.MAX_EXCHANGED_EFFECTS`, stay as they are.
    """
    if not 1 < len(members) <= levels.MAX_EXCHANGED_EFFECTS:
        return members
    every = separate_lines(start.linearised, merged_candidates(members, shortlisted))
    place = {str(s.what): i for i, s in enumerate(every)}
    former = tuple(sorted(place[str(s.what)] for s in members if str(s.what) in place))
    chosen = exchange_members(candidate_pool(start.baseline, every), former)
    return tuple(every[i] for i in chosen)


def _refined_members(linearised: LinearisedData, members: Sequence[Candidate]) -> list[Candidate]:
    """The members, each at the shape that explains most given the others."""
    found = list(members)
    for i, member in enumerate(found):
        if not isinstance(member.what, CyclicError) and has_shape(linearised.sensitivities, member):
            others = linearised.baseline([*found[:i], *found[i + 1 :]], flips=0)
            found[i] = refine_shape(linearised.sensitivities, others, member)
    return found


def remaining_unnamed(linearised: LinearisedData, found: SearchResult) -> tuple[Candidate, ...]:
    """The unnamed components that the residuals need in addition to the named effects; else all that were found."""
    unnamed = tuple(s for s in found.chosen if not s.named)
    if found.names is None:
        return unnamed
    names = found.names.chosen
    weighed = ((s, member_weight(linearised, [*names, s], s)[0]) for s in unnamed)
    return tuple(s for s, p in weighed if found.null.family_wise(p, s.family) < levels.FURTHER_EFFECT_LEVEL) or unnamed


def keep_named(linearised: LinearisedData, found: SearchResult, kept: Sequence[int]) -> SearchResult:
    """The result with some of its named effects alone; what the data lose without each of them is found anew.

    Args:
        kept: places among the named ones; what went is among the rivals of those that stay, if it could replace one.
    """
    named = [s for s in found.chosen if s.named]
    if len(kept) == len(named):
        return found
    members = (*(named[i] for i in kept), *(s for s in found.chosen if not s.named))
    weights = member_weights(linearised, members)
    p_values = tuple(family_wise(found.null, found.beside, members, [p for p, _ in weights]))
    considered = merged_candidates(found.chosen, [rival for own in found.rivals for rival in own])
    rivals = _all_rivals(linearised, linearised.baseline(flips=0), considered, members)
    return replace(found, chosen=members, p_values=p_values, rivals=rivals)


def _search_result(start: InitialScores, found: _Selection) -> SearchResult:
    """The members by their weight, each with its p-value given the others and its rivals."""
    chosen, weights = rank_members(start.linearised, found.chosen)
    p_values = tuple(family_wise(start.null, found.beside, chosen, [p for p, _ in weights]))
    rivals = _all_rivals(start.linearised, start.baseline, found.others, chosen)
    hidden = absorbed_candidates(start.baseline, start.candidates, start.scored)
    scored = tuple(start.scored)
    return SearchResult(
        chosen, p_values, rivals, scored, start.null, found.nested, hidden, found.considered, beside=found.beside
    )


def _all_rivals(
    linearised: LinearisedData, baseline: ProjectedBaseline, others: Sequence[Candidate], chosen: Sequence[Candidate]
) -> tuple[tuple[Candidate, ...], ...]:
    """The rivals of each chosen candidate among others, and the aliases of its first line."""
    found = find_rivals(baseline, others, chosen)
    return tuple((*own, *find_aliases(linearised, chosen, i)) for i, own in enumerate(found))
