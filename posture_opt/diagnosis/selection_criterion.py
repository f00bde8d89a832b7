"""What a candidate costs in the criterion of a selection, what a member is worth, and what could stand for it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from posture_opt.diagnosis import levels
from posture_opt.diagnosis.candidates import Candidate
from posture_opt.diagnosis.linearised_data import LinearisedData
from posture_opt.diagnosis.score_tests import NullDistribution, ProjectedBaseline, log_p, projected_basis
from posture_opt.diagnosis.subset_selection import Chosen, Pool, alternatives
from posture_opt.numerics import Array


def union(former: Iterable[Candidate], new: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """The former candidates, and the new ones that are not the same as one of them."""
    former = tuple(former)
    known = {str(s.what) for s in former}
    return (*former, *(s for s in new if str(s.what) not in known))


def candidate_pool(baseline: ProjectedBaseline, candidates: Sequence[Candidate]) -> Pool:
    """Candidates with their penalties on a baseline; two shapes of one effect exclude each other."""
    bases = [projected_basis(baseline, s.Z)[0] for s in candidates]
    penalty = [_penalty(baseline, s, basis) for s, basis in zip(candidates, bases, strict=True)]
    codes: dict[object, int] = {}
    exclusive = [codes.setdefault(s.exclusive, len(codes)) for s in candidates]
    return Pool(bases, baseline.e, baseline.effective, np.array(penalty), np.array(exclusive))


def _penalty(baseline: ProjectedBaseline, candidate: Candidate, basis: Array) -> float:
    """What a candidate costs in the criterion: its parameters, its grid, and the lack of a name.

    A parameter costs ``log m`` (Schwarz 1978); those of a large group at most what an empirical Bayes prior on the
    group's size would charge, ``1 + log(T / k)`` each for an evidence T of k parameters (George, Foster 2000).
    """
    k = basis.shape[1]
    evidence = float(np.sum((basis.T @ baseline.e) ** 2)) / (float(baseline.rss[0]) / baseline.effective)
    group = 1 + np.log(max(evidence / max(k, 1), 1.0)) if k > levels.LARGE_GROUP else np.inf
    each = min(np.log(baseline.effective), group)
    unnamed = 0.0 if candidate.named else levels.PENALTY_WITHOUT_A_NAME
    return float(k * each + 2 * np.log(candidate.searched) + levels.PENALTY_OF_A_CHOICE + unnamed)


def member_weight(
    linearised: LinearisedData, members: Sequence[Candidate], member: Candidate
) -> tuple[float, float]:  # fmt: skip
    """Log p-value of the F test of a member given the others, and the rise of the criterion without it."""
    others = [s for s in members if s is not member]
    baseline = linearised.baseline(others, flips=0)
    basis, _ = projected_basis(baseline, member.Z)
    if not basis.shape[1]:
        return 0.0, 0.0
    gain, rss = float(np.sum((basis.T @ baseline.e) ** 2)), float(baseline.rss[0])
    p = float(log_p(np.array([gain]), np.array([rss]), basis.shape[1], baseline.effective)[0])
    m = baseline.effective
    rise = -m * np.log(max(1 - gain / rss, 1e-300)) - _penalty(baseline, member, basis)
    return p, float(rise)


def rank_members(
    linearised: LinearisedData, members: Sequence[Candidate]
) -> tuple[tuple[Candidate, ...], list[tuple[float, float]]]:
    """The members, the weightiest first, and the weight of each."""
    small, reduced = linearised.reduced(members)
    weights = [member_weight(small, reduced, s) for s in reduced]
    order = sorted(range(len(reduced)), key=lambda i: -weights[i][1])
    return tuple(members[i] for i in order), [weights[i] for i in order]


def eliminate(
    linearised: LinearisedData, null: NullDistribution, members: Sequence[Candidate], initial_null: NullDistribution
) -> tuple[Candidate, ...]:
    """Backward elimination of the members that are not significant given the others, the least significant first.

    ``initial_null`` is the null distribution without any of them, for the last one that is left.
    """
    small, reduced = linearised.reduced(members)
    kept = list(range(len(members)))
    while kept:
        rest = [reduced[i] for i in kept]
        weights = [member_weight(small, rest, s) for s in rest]
        given = initial_null if len(rest) == 1 else null
        p_values = [given.family_wise(p, s.family) for (p, _), s in zip(weights, rest, strict=True)]
        worst = max(range(len(rest)), key=lambda i: (p_values[i], weights[i][0]))
        if p_values[worst] < (levels.FIRST_EFFECT if len(rest) == 1 else levels.FURTHER_EFFECT):
            break
        del kept[worst]
    return tuple(members[i] for i in kept)


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
