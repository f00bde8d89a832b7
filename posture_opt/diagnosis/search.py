"""Which effects the residuals of a calibrated arm hold: scan, choose, drop what is not needed, scan again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.diagnosis.candidates import Candidate, ScoredCandidate, absorbed, catalogue, judge
from posture_opt.diagnosis.linearised_data import LinearisedData
from posture_opt.diagnosis.score_tests import NullDistribution, ProjectedBaseline, log_p, surviving
from posture_opt.diagnosis.shape_refinement import refined
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
    judged: tuple[ScoredCandidate, ...]
    chance: NullDistribution
    left: ScoredCandidate | None
    absorbed: tuple[tuple[Candidate, float], ...] = ()
    design: float = 1.0
    names: SearchResult | None = None
    at_first: NullDistribution | None = None

    @property
    def confused(self) -> dict[int, tuple[Candidate, ...]]:
        """By its place among the named ones, the rivals of every effect that has some."""
        named = [rivals for s, rivals in zip(self.chosen, self.rivals, strict=True) if s.named]
        return {place: rivals for place, rivals in enumerate(named) if rivals}


def search(scene: LinearisedData, tell: Callable[[], None] = lambda: None, *, nameless: bool = True) -> SearchResult:
    """The effects in the residuals, with the family-wise error of the first at 1.5 %; tells each round that is done.

    Without ``nameless`` only effects with a name stand to be chosen, and none that takes any smooth shape.
    """
    everyone = catalogue(scene.tangents, scene.case)
    suspects = everyone if nameless else [s for s in everyone if s.named and s.kind != "instrument_field"]
    base, judged, chance = _scan(scene, suspects)
    hidden = absorbed(base, suspects, judged)
    if not judged or judged[0].p_value >= FIRST:
        return SearchResult((), (), (), (), tuple(judged), chance, judged[0] if judged else None, hidden)
    first = chance
    finalists = finalists_of(scene, base, judged)
    chosen: tuple[Candidate, ...] = ()
    seen: set[tuple[str, ...]] = set()
    while True:
        tell()
        pool = pool_of(base, finalists)
        start = tuple(i for i, f in enumerate(finalists) if any(f.what == c.what for c in chosen))
        best = [finalists[i] for i in best_set(pool, start, MOST) or _likeliest(pool, finalists, judged)]
        after, chance = judge(scene.ground(best), suspects, scene.tangents, scene.case)
        while len(chosen := pruned(scene, chance, best, first)) < len(best):
            best = list(chosen)
            after, chance = judge(scene.ground(best), suspects, scene.tangents, scene.case)
        key = tuple(sorted(str(s.what) for s in chosen))
        fresh = [j for j in after if j.p_value < FURTHER]
        if not fresh or key in seen or len(chosen) >= MOST:
            break
        seen.add(key)
        finalists = merged(finalists, finalists_of(scene, scene.ground(chosen), fresh))
    if not chosen:  # all that stood together fell; one alone comes by chance too rarely for nothing to be named
        chosen = tuple(finalists[i] for i in _likeliest(pool, finalists, judged))
        after, chance = judge(scene.ground(chosen), suspects, scene.tangents, scene.case)
    chosen, weights = weighed(scene, chosen)
    given = first if len(chosen) == 1 else chance
    p_values = tuple(given.family_wise(p, s.family) for (p, _), s in zip(weights, chosen, strict=True))
    return SearchResult(
        chosen,
        p_values,
        tuple(w for _, w in weights),
        rivals_of(base, finalists, chosen),
        tuple(judged),
        chance,
        after[0] if after else None,
        hidden,
        at_first=first,
    )


def _scan(
    scene: LinearisedData, suspects: Sequence[Candidate]
) -> tuple[ProjectedBaseline, list[ScoredCandidate], NullDistribution]:
    """Every candidate on the geometry alone; a close decision is drawn anew, so that it does not hang on the draw."""
    ground = scene.ground()
    judged, chance = judge(ground, suspects, scene.tangents, scene.case)
    if judged and FIRST / CLOSE < judged[0].p_value < FIRST * CLOSE and len(scene.r) < STEADY:
        ground = scene.ground(flips=MORE * scene.flips)
        judged, chance = judge(ground, suspects, scene.tangents, scene.case)
    return ground, judged, chance


def with_names(scene: LinearisedData, found: SearchResult) -> SearchResult:
    """What names alone make of residuals that also need curves without a name.

    Where they explain nearly as much, as of real arms whose errors are no exact sines, they are the better model:
    they say where to look and can be planned with. The verdict stays that something is left without a name.
    """
    if found.names is not None:
        return found.names
    names = search(scene, nameless=False)
    rest, least = (float(scene.ground(v.chosen, flips=0).rss[0]) for v in (names, found))
    whole = float(scene.ground(flips=0).rss[0])
    return names if whole - rest >= NEARLY * (whole - least) else found


def still_nameless(scene: LinearisedData, found: SearchResult, names: SearchResult) -> tuple[Candidate, ...]:
    """The curves without a name that the residuals need beside the ``names`` of the model; else all that were found."""
    curves = tuple(s for s in found.chosen if not s.named)
    if names is found:
        return curves
    scene = replace(scene, design=found.design)
    beside = ((s, _weight(scene, [*names.chosen, s], s)[0]) for s in curves)
    return tuple(s for s, p in beside if found.chance.family_wise(p, s.family) < FURTHER) or curves


def finalists_of(
    scene: LinearisedData, ground: ProjectedBaseline, judged: Sequence[ScoredCandidate]
) -> list[Candidate]:
    """The candidates that stay in the running, those with a searched shape at their best."""
    leading = judged[0].log_p
    return [
        refined(scene.tangents, ground, j.suspect) if j.log_p < 0.15 * leading or k < 12 else j.suspect
        for k, j in enumerate(judged)
        if j.log_p < np.log(0.2)
    ]


def _likeliest(pool: Pool, finalists: list[Candidate], judged: Sequence[ScoredCandidate]) -> Chosen:
    """The best single one of those that chance hardly brings about, where the criterion would rather have none.

    The criterion charges a group of parameters more than the family-wise null does; that null has decided already.
    """
    sure = {j.suspect.key for j in judged if j.p_value < FIRST}
    return next(only for _, only in pool.additions(()) if finalists[only[0]].key in sure)


def merged(former: list[Candidate], new: list[Candidate]) -> list[Candidate]:
    known = {str(s.what) for s in former}
    return [*former, *(s for s in new if str(s.what) not in known)]


def pool_of(ground: ProjectedBaseline, suspects: Sequence[Candidate]) -> Pool:
    bases = [surviving(ground, s.Z)[0] for s in suspects]
    price = [_price(ground, s, basis) for s, basis in zip(suspects, bases, strict=True)]
    # Two shapes of one cause exclude each other; lines of one joint do not, unless they are the same line.
    codes: dict[object, int] = {}
    rivals = [codes.setdefault(_exclusive(s), len(codes)) for s in suspects]
    return Pool(bases, ground.e, ground.effective, np.array(price), np.array(rivals))


def _price(ground: ProjectedBaseline, suspect: Candidate, basis: Array) -> float:
    """What a suspect costs in the criterion: its parameters, its grid, and the lack of a name.

    A parameter costs ``log m`` (Schwarz 1978); those of a large group at most what an empirical Bayes prior on the
    group's size would charge, ``1 + log(T / k)`` each for an evidence T of k parameters (George, Foster 2000).
    """
    k = basis.shape[1]
    evidence = float(np.sum((basis.T @ ground.e) ** 2)) / (float(ground.rss[0]) / ground.effective)
    each = min(np.log(ground.effective), 1 + np.log(max(evidence / max(k, 1), 1.0)) if k > LARGE else np.inf)
    return float(k * each + 2 * np.log(suspect.searched) + ANOTHER + (0.0 if suspect.named else NAMELESS))


def _exclusive(suspect: Candidate) -> object:
    if suspect.kind == "cyclic_error":
        cycles = getattr(suspect.what, "cycles", 0.0)
        return suspect.kind, suspect.target, round(cycles, 1)
    return suspect.key


def _weight(scene: LinearisedData, chosen: Sequence[Candidate], member: Candidate) -> tuple[float, float]:
    """Log p-value of a member given the others, and what the criterion loses without it."""
    others = [s for s in chosen if s is not member]
    ground = scene.ground(others, flips=0)
    basis, _ = surviving(ground, member.Z)
    if not basis.shape[1]:
        return 0.0, 0.0
    gain, rss = float(np.sum((basis.T @ ground.e) ** 2)), float(ground.rss[0])
    p = float(log_p(np.array([gain]), np.array([rss]), basis.shape[1], ground.effective)[0])
    m = ground.effective
    lost = -m * np.log(max(1 - gain / rss, 1e-300)) - _price(ground, member, basis)
    return p, float(lost)


def weighed(
    scene: LinearisedData, chosen: Sequence[Candidate]
) -> tuple[tuple[Candidate, ...], list[tuple[float, float]]]:
    """The members, the weightiest first, and the weight of each."""
    small, members = scene.reduced(chosen)
    weights = [_weight(small, members, s) for s in members]
    order = sorted(range(len(members)), key=lambda i: -weights[i][1])
    return tuple(chosen[i] for i in order), [weights[i] for i in order]


def pruned(
    scene: LinearisedData, chance: NullDistribution, chosen: list[Candidate], alone: NullDistribution | None = None
) -> tuple[Candidate, ...]:
    """Without the members that are no longer significant given the others, the least first.

    ``alone`` is what chance can do without any of them, for the last one that is left.
    """
    small, members = scene.reduced(chosen)
    kept = list(range(len(chosen)))
    while kept:
        rest = [members[i] for i in kept]
        weights = [_weight(small, rest, s) for s in rest]
        given = (alone or chance) if len(rest) == 1 else chance
        p_values = [given.family_wise(p, s.family) for (p, _), s in zip(weights, rest, strict=True)]
        worst = max(range(len(rest)), key=lambda i: (p_values[i], weights[i][0]))
        if p_values[worst] < (FIRST if len(rest) == 1 else FURTHER):
            break
        del kept[worst]
    return tuple(chosen[i] for i in kept)


def _lenient(pool: Pool, suspects: Sequence[Candidate]) -> Pool:
    """The pool with names charged 2 a parameter (Akaike 1974): what only costs more has not been refuted by data."""
    less = [
        (np.log(pool.freedom) - 2) * basis.shape[1] if s.named and basis.shape[1] <= LARGE else 0.0
        for s, basis in zip(suspects, pool.bases, strict=True)
    ]
    return replace(pool, price=pool.price - np.maximum(less, 0.0))


def _for_all(pool: Pool, suspects: Sequence[Candidate], members: Chosen) -> list[tuple[float, int]]:
    """Names that alone could stand for all that was chosen."""
    least = pool.criterion(members)
    alone = ((value - least, only[0]) for value, only in pool.additions(())) if len(members) > 1 else ()
    return [(more, i) for more, i in alone if more <= RIVALS and suspects[i].named]


def rivals_of(
    ground: ProjectedBaseline, finalists: list[Candidate], chosen: Sequence[Candidate]
) -> tuple[tuple[Candidate, ...], ...]:
    everyone = merged(list(finalists), list(chosen))
    pool = pool_of(ground, everyone)
    lenient = _lenient(pool, everyone)
    place = {str(s.what): i for i, s in enumerate(everyone)}
    members = tuple(sorted(place[str(s.what)] for s in chosen))
    for_all = _for_all(pool, everyone, members)
    result = []
    for s in chosen:
        found: dict[tuple[str, str], Candidate] = {}
        here = place[str(s.what)]
        close = [*alternatives(pool, members, here, RIVALS), *alternatives(lenient, members, here, RIVALS), *for_all]
        for _, other in sorted(close):
            alike = np.linalg.norm(pool.bases[here].T @ pool.bases[other], 2) > ALIKE
            if alike and everyone[other].key != s.key:
                found.setdefault(everyone[other].key, everyone[other])
        result.append(tuple(found.values()))
    return tuple(result)
