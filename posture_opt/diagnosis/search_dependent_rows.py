"""The search where neighbouring postures err alike: names first, a few at a time, among as many rows as tell apart.

What no candidate has the shape of, such as the error of a gear that is no pure sine, is the same for postures that lie
close together. Thousands of such rows seem to prove the smallest effect; whatever is chosen by them in one go is a
mixture of what resembles the strongest ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from posture_opt.calibration.clustered_covariance import design_effect
from posture_opt.diagnosis.candidates import Candidate, ScoredCandidate, absorbed, list_candidates, score_candidates
from posture_opt.diagnosis.linearised_data import LinearisedData
from posture_opt.diagnosis.score_tests import NullDistribution, ProjectedBaseline
from posture_opt.diagnosis.search import (
    FIRST,
    FURTHER,
    SearchResult,
    candidate_pool,
    eliminate,
    find_rivals,
    rank_members,
    search,
    shortlist,
    union,
)
from posture_opt.diagnosis.subset_selection import best_set

STEP = 4  # members that a round adds: each takes away what others seemed to explain
MOST = 40
_LEADING = 40  # candidates of a round that stay in the running


def find(linearised: LinearisedData, alike: bool, tell: Callable[[], None] = lambda: None) -> SearchResult:
    """The effects in the residuals, as `search` where their rows are independent once effects are taken away.

    ``alike`` says whether neighbouring postures err alike after the geometry alone. Where they do so with effects too,
    every round counts as many rows as tell something new.
    """
    if not alike:
        return search(linearised, tell)
    every_candidate = list_candidates(linearised.sensitivities, linearised.excitation)
    base = linearised.baseline()
    scored, null = score_candidates(base, every_candidate, linearised.sensitivities, linearised.excitation)
    if not scored or scored[0].p_value >= FIRST:
        return search(linearised, tell)
    if dependence(linearised, _best(base, _leading(linearised, base, scored), (), STEP)) == 1:
        return search(linearised, tell)
    return _Growth(linearised, base, null, tell).verdict(every_candidate, scored)


def dependence(linearised: LinearisedData, chosen: Sequence[Candidate]) -> float:
    """The design effect of what geometry and effects leave; 1 of independent rows."""
    columns = np.concatenate([linearised.G, *(s.Z for s in chosen)], axis=1)
    return design_effect(linearised.sensitivities.residuals, linearised.baseline(chosen, flips=0).e, columns)


def _has_name(candidate: Candidate) -> bool:
    return candidate.named and candidate.kind != "instrument_field"


def _leading(
    linearised: LinearisedData, baseline: ProjectedBaseline, scored: Sequence[ScoredCandidate]
) -> list[Candidate]:
    return shortlist(linearised, baseline, sorted(scored, key=lambda j: j.log_p)[:_LEADING])


def _best(
    base: ProjectedBaseline, shortlisted: list[Candidate], chosen: Sequence[Candidate], most: int
) -> list[Candidate]:
    start = tuple(i for i, f in enumerate(shortlisted) if any(f.what == c.what for c in chosen))
    return [shortlisted[i] for i in best_set(candidate_pool(base, shortlisted), start, most)]


class _Growth:
    """A set that grows round by round, with what is known of chance."""

    def __init__(
        self, linearised: LinearisedData, base: ProjectedBaseline, null: NullDistribution, tell: Callable[[], None]
    ) -> None:
        self.linearised, self.base, self.null, self.tell = linearised, base, null, tell
        self.shortlisted: list[Candidate] = []

    def verdict(self, every_candidate: list[Candidate], scored: list[ScoredCandidate]) -> SearchResult:
        """With names alone, and with the curves that are needed beside them."""
        hidden = absorbed(self.base, every_candidate, scored)
        names = [s for s in every_candidate if _has_name(s)]
        chosen = self._grown((), names, [j for j in scored if _has_name(j.candidate)], MOST)
        left = self._scored(chosen, every_candidate)
        named = replace(self._result(chosen, scored), left=left[0] if left else None, absorbed=hidden)
        more = self._grown(chosen, every_candidate, left, len(chosen) + STEP)
        return replace(self._result(more, scored), absorbed=hidden, names=named) if set(more) - set(chosen) else named

    def _grown(
        self, chosen: tuple[Candidate, ...], candidates: list[Candidate], scored: list[ScoredCandidate], most: int
    ) -> tuple[Candidate, ...]:
        """The set from which nothing is to be added, or that is full."""
        seen: set[tuple[str, ...]] = set()
        while True:
            self.tell()
            fresh = [j for j in scored if j.p_value < FURTHER]
            key = tuple(sorted(str(s.what) for s in chosen))
            if not fresh or key in seen or len(chosen) >= most:
                return chosen
            seen.add(key)
            baseline = self.linearised.baseline(chosen, flips=0)
            self.shortlisted = union(self.shortlisted, _leading(self.linearised, baseline, fresh))
            best = _best(
                replace(self.base, design=self.linearised.design), self.shortlisted, chosen, len(chosen) + STEP
            )
            self.linearised = replace(self.linearised, design=dependence(self.linearised, best))
            chosen = eliminate(self.linearised, self.null, best)
            scored = self._scored(chosen, candidates)

    def _scored(self, chosen: Sequence[Candidate], candidates: list[Candidate]) -> list[ScoredCandidate]:
        linearised = self.linearised
        return score_candidates(
            linearised.baseline(chosen, flips=0), candidates, linearised.sensitivities, linearised.excitation, self.null
        )[0]

    def _result(self, chosen: Sequence[Candidate], scored: list[ScoredCandidate]) -> SearchResult:
        chosen, weights = rank_members(self.linearised, chosen)
        p_values = tuple(self.null.family_wise(p, s.family) for (p, _), s in zip(weights, chosen, strict=True))
        base = replace(self.base, design=self.linearised.design)
        rivals = find_rivals(base, self.shortlisted, chosen)
        lost = tuple(w for _, w in weights)
        return SearchResult(
            chosen, p_values, lost, rivals, tuple(scored), self.null, None, design=self.linearised.design
        )
