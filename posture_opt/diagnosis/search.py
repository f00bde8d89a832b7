"""Which effects the residuals of a calibrated arm hold: scan, choose, drop what is not needed, scan again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.diagnosis.candidates import Candidate, ScoredCandidate, absorbed, list_candidates, score_candidates
from posture_opt.diagnosis.linearised_data import LinearisedData
from posture_opt.diagnosis.score_tests import NullDistribution, ProjectedBaseline, log_p, projected_basis
from posture_opt.diagnosis.shape_refinement import refine_shape
from posture_opt.diagnosis.subset_selection import Chosen, Pool, alternatives, best_set
from posture_opt.numerics import Array

FIRST = 0.015  # of the 5 % for the whole verdict: the first effect; the rest is left to noise and lack of fit
FURTHER = 0.006  # every effect after the first
ALIKE = 0.5  # cosine of the least angle between what two causes do: what is less alike stands for nothing else
RIVALS = 6.0  # of the criterion: within it, two causes cannot be told apart
NAMELESS = 5.0  # the price of having no name
ANOTHER = 5.0  # the price of a cause: the logarithm of how many there are to choose from (Chen, Chen 2008, γ = 1/2)
LARGE = 4  # parameters: beyond, a group is charged as a group
NEARLY = 0.85  # of what the best description explains: names that explain as much are taken for the model
MOST = 24
CLOSE, MORE, STEADY = 8.0, 4, 2000  # within this factor of the level so many times the flips, of fewer residuals


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What a search found.

    Args:
        chosen: the suspects that together explain the residuals best, the weightiest first.
        p_values: (chosen,) family-wise, of dropping each.
        lost: (chosen,) rise of the criterion when it is dropped.
        rivals: for each chosen one the suspects that could stand for it.
        judged: every candidate on the geometry alone.
        left: the best candidate on all that was chosen.
        absorbed: named suspects that the geometry alone could stand for, with the share of their trace that is left.
        design: so many residuals tell as much as one alone would, as neighbouring postures err alike.
        names: what names alone make of the residuals, where that was looked for first.
        at_first: what chance can do to the data as they are, as ``judged`` has it; where None, ``chance`` is that.
    """

    chosen: tuple[Candidate, ...]
    p_values: tuple[float, ...]
    lost: tuple[float, ...]
    rivals: tuple[tuple[Candidate, ...], ...]
    scored: tuple[ScoredCandidate, ...]
    null: NullDistribution
    left: ScoredCandidate | None
    absorbed: tuple[tuple[Candidate, float], ...] = ()
    design: float = 1.0
    names: SearchResult | None = None
    initial_null: NullDistribution | None = None

    @property
    def confused(self) -> dict[int, tuple[Candidate, ...]]:
        """By its place among the named ones, the rivals of every effect that has some."""
        named = [rivals for s, rivals in zip(self.chosen, self.rivals, strict=True) if s.named]
        return {place: rivals for place, rivals in enumerate(named) if rivals}


def search(
    linearised: LinearisedData, tell: Callable[[], None] = lambda: None, *, nameless: bool = True
) -> SearchResult:
    """The effects in the residuals, with the family-wise error of the first at 1.5 %; tells each round that is done.

    Without ``nameless`` only effects with a name stand to be chosen, and none that takes any smooth shape.
    """
    every_candidate = list_candidates(linearised.sensitivities, linearised.excitation)
    candidates = (
        every_candidate if nameless else [s for s in every_candidate if s.named and s.kind != "instrument_field"]
    )
    base, scored, null = _scan(linearised, candidates)
    hidden = absorbed(base, candidates, scored)
    if not scored or scored[0].p_value >= FIRST:
        return SearchResult((), (), (), (), tuple(scored), null, scored[0] if scored else None, hidden)
    first = null
    shortlisted = shortlist(linearised, base, scored)
    chosen: tuple[Candidate, ...] = ()
    seen: set[tuple[str, ...]] = set()
    while True:
        tell()
        pool = candidate_pool(base, shortlisted)
        start = tuple(i for i, f in enumerate(shortlisted) if any(f.what == c.what for c in chosen))
        best = [shortlisted[i] for i in best_set(pool, start, MOST) or _likeliest(pool, shortlisted, scored)]
        after, null = score_candidates(
            linearised.baseline(best), candidates, linearised.sensitivities, linearised.excitation
        )
        while len(chosen := eliminate(linearised, null, best, first)) < len(best):
            best = list(chosen)
            after, null = score_candidates(
                linearised.baseline(best), candidates, linearised.sensitivities, linearised.excitation
            )
        key = tuple(sorted(str(s.what) for s in chosen))
        fresh = [j for j in after if j.p_value < FURTHER]
        if not fresh or key in seen or len(chosen) >= MOST:
            break
        seen.add(key)
        shortlisted = union(shortlisted, shortlist(linearised, linearised.baseline(chosen), fresh))
    if not chosen:  # all that stood together fell; one alone comes by chance too rarely for nothing to be named
        chosen = tuple(shortlisted[i] for i in _likeliest(pool, shortlisted, scored))
        after, null = score_candidates(
            linearised.baseline(chosen), candidates, linearised.sensitivities, linearised.excitation
        )
    chosen, weights = rank_members(linearised, chosen)
    given = first if len(chosen) == 1 else null
    p_values = tuple(given.family_wise(p, s.family) for (p, _), s in zip(weights, chosen, strict=True))
    return SearchResult(
        chosen,
        p_values,
        tuple(w for _, w in weights),
        find_rivals(base, shortlisted, chosen),
        tuple(scored),
        null,
        after[0] if after else None,
        hidden,
        initial_null=first,
    )


def _scan(
    linearised: LinearisedData, candidates: Sequence[Candidate]
) -> tuple[ProjectedBaseline, list[ScoredCandidate], NullDistribution]:
    """Every candidate on the geometry alone; a close decision is drawn anew, so that it does not hang on the draw."""
    baseline = linearised.baseline()
    scored, null = score_candidates(baseline, candidates, linearised.sensitivities, linearised.excitation)
    if scored and FIRST / CLOSE < scored[0].p_value < FIRST * CLOSE and len(linearised.r) < STEADY:
        baseline = linearised.baseline(flips=MORE * linearised.flips)
        scored, null = score_candidates(baseline, candidates, linearised.sensitivities, linearised.excitation)
    return baseline, scored, null


def prefer_named(linearised: LinearisedData, found: SearchResult) -> SearchResult:
    """What names alone make of residuals that also need curves without a name.

    Where they explain nearly as much, as of real arms whose errors are no exact sines, they are the better model:
    they say where to look and can be planned with. The verdict stays that something is left without a name.
    """
    if found.names is not None:
        return found.names
    names = search(linearised, nameless=False)
    rest, least = (float(linearised.baseline(v.chosen, flips=0).rss[0]) for v in (names, found))
    whole = float(linearised.baseline(flips=0).rss[0])
    return names if whole - rest >= NEARLY * (whole - least) else found


def remaining_unnamed(linearised: LinearisedData, found: SearchResult, names: SearchResult) -> tuple[Candidate, ...]:
    """The curves without a name that the residuals need beside the ``names`` of the model; else all that were found."""
    curves = tuple(s for s in found.chosen if not s.named)
    if names is found:
        return curves
    linearised = replace(linearised, design=found.design)
    beside = ((s, _weight(linearised, [*names.chosen, s], s)[0]) for s in curves)
    return tuple(s for s, p in beside if found.null.family_wise(p, s.family) < FURTHER) or curves


def shortlist(
    linearised: LinearisedData, baseline: ProjectedBaseline, scored: Sequence[ScoredCandidate]
) -> list[Candidate]:
    """The candidates that stay in the running, those with a searched shape at their best."""
    leading = scored[0].log_p
    return [
        refine_shape(linearised.sensitivities, baseline, j.candidate)
        if j.log_p < 0.15 * leading or k < 12
        else j.candidate
        for k, j in enumerate(scored)
        if j.log_p < np.log(0.2)
    ]


def _likeliest(pool: Pool, shortlisted: list[Candidate], scored: Sequence[ScoredCandidate]) -> Chosen:
    """The best single one of those that chance hardly brings about, where the criterion would rather have none.

    The criterion charges a group of parameters more than the family-wise null does; that null has decided already.
    """
    sure = {j.candidate.key for j in scored if j.p_value < FIRST}
    return next(only for _, only in pool.additions(()) if shortlisted[only[0]].key in sure)


def union(former: list[Candidate], new: list[Candidate]) -> list[Candidate]:
    known = {str(s.what) for s in former}
    return [*former, *(s for s in new if str(s.what) not in known)]


def candidate_pool(baseline: ProjectedBaseline, candidates: Sequence[Candidate]) -> Pool:
    bases = [projected_basis(baseline, s.Z)[0] for s in candidates]
    penalty = [_penalty(baseline, s, basis) for s, basis in zip(candidates, bases, strict=True)]
    # Two shapes of one cause exclude each other; lines of one joint do not, unless they are the same line.
    codes: dict[object, int] = {}
    rivals = [codes.setdefault(_exclusive(s), len(codes)) for s in candidates]
    return Pool(bases, baseline.e, baseline.effective, np.array(penalty), np.array(rivals))


def _penalty(baseline: ProjectedBaseline, candidate: Candidate, basis: Array) -> float:
    """What a suspect costs in the criterion: its parameters, its grid, and the lack of a name.

    A parameter costs ``log m`` (Schwarz 1978); those of a large group at most what an empirical Bayes prior on the
    group's size would charge, ``1 + log(T / k)`` each for an evidence T of k parameters (George, Foster 2000).
    """
    k = basis.shape[1]
    evidence = float(np.sum((basis.T @ baseline.e) ** 2)) / (float(baseline.rss[0]) / baseline.effective)
    each = min(np.log(baseline.effective), 1 + np.log(max(evidence / max(k, 1), 1.0)) if k > LARGE else np.inf)
    return float(k * each + 2 * np.log(candidate.searched) + ANOTHER + (0.0 if candidate.named else NAMELESS))


def _exclusive(candidate: Candidate) -> object:
    if candidate.kind == "cyclic_error":
        cycles = getattr(candidate.what, "cycles", 0.0)
        return candidate.kind, candidate.target, round(cycles, 1)
    return candidate.key


def _weight(linearised: LinearisedData, chosen: Sequence[Candidate], member: Candidate) -> tuple[float, float]:
    """Log p-value of a member given the others, and what the criterion loses without it."""
    others = [s for s in chosen if s is not member]
    baseline = linearised.baseline(others, flips=0)
    basis, _ = projected_basis(baseline, member.Z)
    if not basis.shape[1]:
        return 0.0, 0.0
    gain, rss = float(np.sum((basis.T @ baseline.e) ** 2)), float(baseline.rss[0])
    p = float(log_p(np.array([gain]), np.array([rss]), basis.shape[1], baseline.effective)[0])
    m = baseline.effective
    lost = -m * np.log(max(1 - gain / rss, 1e-300)) - _penalty(baseline, member, basis)
    return p, float(lost)


def rank_members(
    linearised: LinearisedData, chosen: Sequence[Candidate]
) -> tuple[tuple[Candidate, ...], list[tuple[float, float]]]:
    """The members, the weightiest first, and the weight of each."""
    small, members = linearised.reduced(chosen)
    weights = [_weight(small, members, s) for s in members]
    order = sorted(range(len(members)), key=lambda i: -weights[i][1])
    return tuple(chosen[i] for i in order), [weights[i] for i in order]


def eliminate(
    linearised: LinearisedData, null: NullDistribution, chosen: list[Candidate], alone: NullDistribution | None = None
) -> tuple[Candidate, ...]:
    """Without the members that are no longer significant given the others, the least first.

    ``alone`` is what chance can do without any of them, for the last one that is left.
    """
    small, members = linearised.reduced(chosen)
    kept = list(range(len(chosen)))
    while kept:
        rest = [members[i] for i in kept]
        weights = [_weight(small, rest, s) for s in rest]
        given = (alone or null) if len(rest) == 1 else null
        p_values = [given.family_wise(p, s.family) for (p, _), s in zip(weights, rest, strict=True)]
        worst = max(range(len(rest)), key=lambda i: (p_values[i], weights[i][0]))
        if p_values[worst] < (FIRST if len(rest) == 1 else FURTHER):
            break
        del kept[worst]
    return tuple(chosen[i] for i in kept)


def _lenient(pool: Pool, candidates: Sequence[Candidate]) -> Pool:
    """The pool with names charged 2 a parameter (Akaike 1974): what only costs more has not been refuted by data."""
    less = [
        (np.log(pool.freedom) - 2) * basis.shape[1] if s.named and basis.shape[1] <= LARGE else 0.0
        for s, basis in zip(candidates, pool.bases, strict=True)
    ]
    return replace(pool, penalty=pool.penalty - np.maximum(less, 0.0))


def _for_all(pool: Pool, candidates: Sequence[Candidate], members: Chosen) -> list[tuple[float, int]]:
    """Names that alone could stand for all that was chosen."""
    least = pool.criterion(members)
    alone = ((value - least, only[0]) for value, only in pool.additions(())) if len(members) > 1 else ()
    return [(more, i) for more, i in alone if more <= RIVALS and candidates[i].named]


def find_rivals(
    baseline: ProjectedBaseline, shortlisted: list[Candidate], chosen: Sequence[Candidate]
) -> tuple[tuple[Candidate, ...], ...]:
    every_candidate = union(list(shortlisted), list(chosen))
    pool = candidate_pool(baseline, every_candidate)
    lenient = _lenient(pool, every_candidate)
    place = {str(s.what): i for i, s in enumerate(every_candidate)}
    members = tuple(sorted(place[str(s.what)] for s in chosen))
    for_all = _for_all(pool, every_candidate, members)
    result = []
    for s in chosen:
        found: dict[tuple[str, str], Candidate] = {}
        here = place[str(s.what)]
        close = [*alternatives(pool, members, here, RIVALS), *alternatives(lenient, members, here, RIVALS), *for_all]
        for _, other in sorted(close):
            alike = np.linalg.norm(pool.bases[here].T @ pool.bases[other], 2) > ALIKE
            if alike and every_candidate[other].key != s.key:
                found.setdefault(every_candidate[other].key, every_candidate[other])
        result.append(tuple(found.values()))
    return tuple(result)
