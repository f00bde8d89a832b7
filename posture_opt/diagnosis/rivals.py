"""Rivals: candidates that could stand for a member of the chosen set, as the data do not refute them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posture_opt.diagnosis import levels
from posture_opt.diagnosis.candidates import Candidate
from posture_opt.diagnosis.score_tests import ProjectedBaseline
from posture_opt.diagnosis.selection_criterion import candidate_pool, union
from posture_opt.diagnosis.subset_selection import Chosen, Pool, alternatives


def find_rivals(
    baseline: ProjectedBaseline, shortlisted: Sequence[Candidate], chosen: Sequence[Candidate]
) -> tuple[tuple[Candidate, ...], ...]:
    """For each chosen candidate the others that explain as much in its place, within `levels.RIVAL_CRITERION`."""
    every = union(shortlisted, chosen)
    pool = candidate_pool(baseline, every)
    place = {str(s.what): i for i, s in enumerate(every)}
    members = tuple(sorted(place[str(s.what)] for s in chosen))
    pools = pool, _lenient(pool, every)
    for_all = _for_all(pool, every, members)
    return tuple(_rivals_of(place[str(s.what)], pools, every, members, for_all) for s in chosen)


def _rivals_of(
    member: int,
    pools: Sequence[Pool],
    every: Sequence[Candidate],
    members: Chosen,
    for_all: Sequence[tuple[float, int]],
) -> tuple[Candidate, ...]:
    """Those of the alternatives to a member that resemble it, one of each kind and target, the best first."""
    found: dict[tuple[str, str], Candidate] = {}
    bases = pools[0].bases
    close = [a for pool in pools for a in alternatives(pool, members, member, levels.RIVAL_CRITERION)]
    for _, other in sorted([*close, *for_all]):
        alike = np.linalg.norm(bases[member].T @ bases[other], 2) > levels.RIVAL_COSINE
        if alike and every[other].key != every[member].key:
            found.setdefault(every[other].key, every[other])
    return tuple(found.values())


def _lenient(pool: Pool, candidates: Sequence[Candidate]) -> Pool:
    """The pool with names charged 2 a parameter (Akaike 1974): what only costs more has not been refuted by data."""
    less = [
        (np.log(pool.freedom) - levels.LENIENT_PENALTY) * basis.shape[1]
        if s.named and basis.shape[1] <= levels.LARGE_GROUP
        else 0.0
        for s, basis in zip(candidates, pool.bases, strict=True)
    ]
    return replace(pool, penalty=pool.penalty - np.maximum(less, 0.0))


def _for_all(pool: Pool, candidates: Sequence[Candidate], members: Chosen) -> list[tuple[float, int]]:
    """Names that alone could stand for all that was chosen."""
    least = pool.criterion(members)
    alone = ((value - least, only[0]) for value, only in pool.additions(())) if len(members) > 1 else ()
    return [(more, i) for more, i in alone if more <= levels.RIVAL_CRITERION and candidates[i].named]
