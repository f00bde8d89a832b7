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
from posture_opt.diagnosis.candidates import Candidate, ScoredCandidate, absorbed, catalogue, judge
from posture_opt.diagnosis.linearised_data import LinearisedData
from posture_opt.diagnosis.score_tests import NullDistribution, ProjectedBaseline
from posture_opt.diagnosis.search import (
    FIRST,
    FURTHER,
    SearchResult,
    finalists_of,
    merged,
    pool_of,
    pruned,
    rivals_of,
    search,
    weighed,
)
from posture_opt.diagnosis.subset_selection import best_set

STEP = 4  # members that a round adds: each takes away what others seemed to explain
MOST = 40
_LEADING = 40  # candidates of a round that stay in the running


def find(scene: LinearisedData, alike: bool, tell: Callable[[], None] = lambda: None) -> SearchResult:
    """The effects in the residuals, as `search` where their rows are independent once effects are taken away.

    ``alike`` says whether neighbouring postures err alike after the geometry alone. Where they do so with effects too,
    every round counts as many rows as tell something new.
    """
    if not alike:
        return search(scene, tell)
    everyone = catalogue(scene.tangents, scene.case)
    base = scene.ground()
    judged, chance = judge(base, everyone, scene.tangents, scene.case)
    if not judged or judged[0].p_value >= FIRST:
        return search(scene, tell)
    if dependence(scene, _best(base, _leading(scene, base, judged), (), STEP)) == 1:
        return search(scene, tell)
    return _Growth(scene, base, chance, tell).verdict(everyone, judged)


def dependence(scene: LinearisedData, chosen: Sequence[Candidate]) -> float:
    """The design effect of what geometry and effects leave; 1 of independent rows."""
    columns = np.concatenate([scene.G, *(s.Z for s in chosen)], axis=1)
    return design_effect(scene.tangents.residuals, scene.ground(chosen, flips=0).e, columns)


def _has_name(suspect: Candidate) -> bool:
    return suspect.named and suspect.kind != "instrument_field"


def _leading(scene: LinearisedData, ground: ProjectedBaseline, judged: Sequence[ScoredCandidate]) -> list[Candidate]:
    return finalists_of(scene, ground, sorted(judged, key=lambda j: j.log_p)[:_LEADING])


def _best(
    base: ProjectedBaseline, finalists: list[Candidate], chosen: Sequence[Candidate], most: int
) -> list[Candidate]:
    start = tuple(i for i, f in enumerate(finalists) if any(f.what == c.what for c in chosen))
    return [finalists[i] for i in best_set(pool_of(base, finalists), start, most)]


class _Growth:
    """A set that grows round by round, with what is known of chance."""

    def __init__(
        self, scene: LinearisedData, base: ProjectedBaseline, chance: NullDistribution, tell: Callable[[], None]
    ) -> None:
        self.scene, self.base, self.chance, self.tell = scene, base, chance, tell
        self.finalists: list[Candidate] = []

    def verdict(self, everyone: list[Candidate], judged: list[ScoredCandidate]) -> SearchResult:
        """With names alone, and with the curves that are needed beside them."""
        hidden = absorbed(self.base, everyone, judged)
        names = [s for s in everyone if _has_name(s)]
        chosen = self._grown((), names, [j for j in judged if _has_name(j.suspect)], MOST)
        left = self._judged(chosen, everyone)
        named = replace(self._said(chosen, judged), left=left[0] if left else None, absorbed=hidden)
        more = self._grown(chosen, everyone, left, len(chosen) + STEP)
        return replace(self._said(more, judged), absorbed=hidden, names=named) if set(more) - set(chosen) else named

    def _grown(
        self, chosen: tuple[Candidate, ...], suspects: list[Candidate], judged: list[ScoredCandidate], most: int
    ) -> tuple[Candidate, ...]:
        """The set from which nothing is to be added, or that is full."""
        seen: set[tuple[str, ...]] = set()
        while True:
            self.tell()
            fresh = [j for j in judged if j.p_value < FURTHER]
            key = tuple(sorted(str(s.what) for s in chosen))
            if not fresh or key in seen or len(chosen) >= most:
                return chosen
            seen.add(key)
            ground = self.scene.ground(chosen, flips=0)
            self.finalists = merged(self.finalists, _leading(self.scene, ground, fresh))
            best = _best(replace(self.base, design=self.scene.design), self.finalists, chosen, len(chosen) + STEP)
            self.scene = replace(self.scene, design=dependence(self.scene, best))
            chosen = pruned(self.scene, self.chance, best)
            judged = self._judged(chosen, suspects)

    def _judged(self, chosen: Sequence[Candidate], suspects: list[Candidate]) -> list[ScoredCandidate]:
        scene = self.scene
        return judge(scene.ground(chosen, flips=0), suspects, scene.tangents, scene.case, self.chance)[0]

    def _said(self, chosen: Sequence[Candidate], judged: list[ScoredCandidate]) -> SearchResult:
        chosen, weights = weighed(self.scene, chosen)
        p_values = tuple(self.chance.family_wise(p, s.family) for (p, _), s in zip(weights, chosen, strict=True))
        base = replace(self.base, design=self.scene.design)
        rivals = rivals_of(base, self.finalists, chosen)
        lost = tuple(w for _, w in weights)
        return SearchResult(chosen, p_values, lost, rivals, tuple(judged), self.chance, None, design=self.scene.design)
