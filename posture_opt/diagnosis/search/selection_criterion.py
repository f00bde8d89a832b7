"""What a candidate costs in the criterion of a selection, what a member is worth, and what could replace it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.scores.nested_subsets import nested_subsets
from posture_opt.diagnosis.scores.score_tests import (
    NullDistribution,
    ProjectedBaseline,
    ProjectedColumns,
    beyond_limits,
    log_p,
    projected_basis,
)
from posture_opt.diagnosis.scores.subset_selection import Chosen, Pool, close_alternatives
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.model.effects import Effect, FittedSizes
from posture_opt.numerics import Array

_HOPELESS_LOG_P = -8.0
"""Log p-value of a member above which no null makes it significant: of some 30 independent candidates it would have to
be -8.5 at `levels.FURTHER_EFFECT_LEVEL`."""


def merged_candidates(former: Iterable[Candidate], new: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """The former candidates, and the new ones that are not the same as one of them."""
    former = tuple(former)
    known = {str(s.what) for s in former}
    return (*former, *(s for s in new if str(s.what) not in known))


def candidate_pool(baseline: ProjectedBaseline, candidates: Sequence[Candidate]) -> Pool:
    """Candidates with their penalties on a baseline; two shapes of one effect exclude each other.

    Args:
        baseline: what is fitted before any of them.
    """
    columns = ProjectedColumns.of(baseline, [s.Z for s in candidates])
    counted = zip(candidates, columns.sizes.tolist(), columns.gains.tolist(), strict=True)
    penalty = [_candidate_penalty(baseline, s, size, gain) for s, size, gain in counted]
    codes: dict[object, int] = {}
    exclusive = [codes.setdefault(s.exclusive, len(codes)) for s in candidates]
    most = np.array([s.most for s in candidates])
    return Pool(columns, float(baseline.e @ baseline.e), baseline.freedom, np.array(penalty), np.array(exclusive), most)


def price_of_choice(candidate: Candidate) -> float:
    """What the criterion charges for a candidate beyond its parameters: for its grid, if it has no name or is unlikely.

    ``2 log(searched) + γ`` and as much again without a name: extended BIC (Chen, Chen 2008).
    """
    unnamed = 0.0 if candidate.named else levels.UNNAMED_PENALTY
    return float(2 * np.log(candidate.searched) + levels.CHOICE_PENALTY + unnamed + _price_of_unlikely(candidate))


def _price_of_unlikely(candidate: Candidate) -> float:
    """What is charged for an effect that is asked for more evidence than others."""
    unlikely = isinstance(candidate.what, Effect) and candidate.what.less_likely
    return levels.UNLIKELY_PENALTY if unlikely else 0.0


def price_of_parameters(count: Array, evidence: Array, freedom: float | Array) -> Array:
    """What the criterion charges for so many parameters, which explain ``evidence`` in units of the noise variance.

    A parameter costs ``log m`` (Schwarz 1978); those of a large group at most what an empirical Bayes prior on the
    group's size would charge, ``1 + log(T / k)`` each for an evidence T of k parameters (George, Foster 2000).
    """
    group = 1 + np.log(np.maximum(evidence / np.maximum(count, 1), 1.0))
    each = np.where(count > levels.LARGE_GROUP_SIZE, np.minimum(np.log(freedom), group), np.log(freedom))
    return np.asarray(count * each)


def _candidate_penalty(baseline: ProjectedBaseline, candidate: Candidate, size: int, gain: float) -> float:
    """What a candidate of so many directions that explain so much costs in the criterion."""
    freedom = max(baseline.freedom, 1)
    evidence = np.array(gain / max(float(baseline.rss[0]) / freedom, 1e-300))
    return float(price_of_parameters(np.array(size), evidence, freedom)) + price_of_choice(candidate)


def member_weight(
    linearised: LinearisedData, members: Sequence[Candidate], member: Candidate
) -> tuple[float, float]:  # fmt: skip
    """Log p-value of the F test of a member given the others, and the rise of the criterion without it.

    Args:
        members: the set, ``member`` among them.
    """
    others = [s for s in members if s is not member]
    baseline = linearised.baseline(others, flips=0)
    basis, _ = projected_basis(baseline, member.Z)
    if not basis.shape[1]:
        return 0.0, 0.0
    gain, rss = float(np.sum((basis.T @ baseline.e) ** 2)), max(float(baseline.rss[0]), 1e-300)
    p = float(log_p(np.array([gain]), np.array([rss]), basis.shape[1], baseline.freedom)[0])
    m = baseline.freedom
    rise = -m * np.log(max(1 - gain / rss, 1e-300)) - _candidate_penalty(baseline, member, basis.shape[1], gain)
    return p, float(rise)


def member_weights(linearised: LinearisedData, members: Sequence[Candidate]) -> list[tuple[float, float]]:
    """`member_weight` of every member given the others, all from one fit: ``ΔRSS = θᵀ C⁻¹ θ`` (Wald).

    Returns:
        (log p-value, rise of the criterion without it) of each; 0 and −∞ where its estimate is physically impossible.
    """
    if not members:
        return []
    small, reduced = linearised.reduced(members)
    sizes = [s.Z.shape[1] for s in reduced]
    A = np.concatenate([small.G, *(s.Z for s in reduced)], axis=1)
    norms = np.linalg.norm(A, axis=0)
    A = A / np.where(norms > 0, norms, 1.0)
    C = np.linalg.pinv(A.T @ A, rcond=1e-12, hermitian=True)
    theta = C @ (A.T @ small.r)
    rss = max(float(small.r @ small.r - theta @ (A.T @ small.r)), 1e-300)
    freedom = float(small.count - np.linalg.matrix_rank(A))
    if freedom < 1:  # together they explain whatever was measured: none of them is shown
        return [(0.0, -np.inf)] * len(members)
    edges = np.cumsum([small.G.shape[1], *sizes])
    found = []
    for member, a, b in zip(reduced, edges[:-1], edges[1:], strict=True):
        values, vectors = np.linalg.eigh(C[a:b, a:b])
        clear = (values > 0) & (values < levels.MIN_SURVIVING_SHARE**-2)
        gain, count = float(np.sum((vectors.T @ theta[a:b])[clear] ** 2 / values[clear])), int(clear.sum())
        scale = np.where(norms[a:b] > 0, norms[a:b], 1.0)
        errors = np.sqrt(np.diag(C)[a:b] * rss / freedom) / scale
        if not _size_possible(member, -theta[a:b] / scale, errors):
            found.append((0.0, -np.inf))
            continue
        m = freedom + count
        p = float(log_p(np.array([gain]), np.array([rss + gain]), max(count, 1), m)[0]) if count else 0.0
        price = float(price_of_parameters(np.array(count), np.array(gain / (rss / freedom)), m))
        found.append((p, m * float(np.log1p(gain / rss)) - price - price_of_choice(member)))
    return found


def beyond_instrument(linearised: LinearisedData, members: Sequence[Candidate]) -> list[Candidate]:
    """The members that shift the measured points by more than they can, ``|(I − G G⁺) Z θ|²`` above their limit.

    Columns that lean on each other may cancel: each may then do more than all of them explain.

    Args:
        members: fitted together with the geometry G.
    """
    limited = [s for s in members if np.isfinite(s.most)]
    if not limited:
        return []
    small, reduced = linearised.reduced(members)
    A = np.concatenate([small.G, *(s.Z for s in reduced)], axis=1)
    theta = np.linalg.lstsq(A, small.r, rcond=1e-10)[0]
    Q = np.linalg.qr(small.G)[0]
    edges = np.cumsum([small.G.shape[1], *(s.Z.shape[1] for s in reduced)])
    found = []
    for member, own, a, b in zip(members, reduced, edges[:-1], edges[1:], strict=True):
        shift = own.Z @ theta[a:b]
        if float(np.sum((shift - Q @ (Q.T @ shift)) ** 2)) > member.most:
            found.append(member)
    return found


def implausible_members(linearised: LinearisedData, members: Sequence[Candidate]) -> list[Candidate]:
    """The effects of a set of a size that such a cause cannot have on the arm, see `Effect.plausible`.

    Linear parameters alone decide; the standard errors are those of a fit of all members together.
    """
    if not members:
        return []
    A = np.concatenate([linearised.G, *(s.Z for s in members)], axis=1)
    norms = np.where((norms := np.linalg.norm(A, axis=0)) > 0, norms, 1.0)
    C = np.linalg.pinv((A / norms).T @ (A / norms), rcond=1e-12, hermitian=True)
    theta = -C @ ((A / norms).T @ linearised.r)
    rest = linearised.r + (A / norms) @ theta
    C = C * float(rest @ rest) / max(len(rest) - A.shape[1], 1)
    edges = np.cumsum([linearised.G.shape[1], *(s.Z.shape[1] for s in members)])
    robot, found = linearised.excitation.robot, []
    for member, a, b in zip(members, edges[:-1], edges[1:], strict=True):
        known = member.what.plausible(robot) if isinstance(member.what, Effect) else None
        if isinstance(member.what, Effect) and known is not None and not member.what.unstated_loads:
            own = slice(a, b)
            scale = norms[own]
            covariance = C[own, own] / np.outer(scale, scale)
            sizes = zip(member.what.dimensions, theta[own] / scale, np.sqrt(np.diag(covariance)), strict=True)
            fitted = FittedSizes({name: (float(v), float(std), "") for (name, _), v, std in sizes}, covariance)
            if not known.holds(*member.what.plausible_size(fitted)):
                found.append(member)
    return found


def _size_possible(candidate: Candidate, sizes: Array, errors: Array) -> bool:
    """Whether an estimate with its standard errors lies within the physical limits of the parameters."""
    low, high = candidate.what.limits if isinstance(candidate.what, Effect) else (-np.inf, np.inf)
    return not np.any(beyond_limits(sizes, errors if len(sizes) > 1 else 0 * errors, low, high))


def substantial_members(linearised: LinearisedData, members: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The members without those that explain next to nothing, of what all explain and of what they leave alike.

    It is the least that goes first. A name for less is not worth its line, however certain.

    A member stays with `levels.MIN_EFFECT_SHARE` of what all explain, or `levels.MIN_EFFECT_RISE` of what they leave.
    """
    if len(members) < 2:
        return tuple(members)
    small, reduced = linearised.reduced(members)
    columns = [s.Z for s in reduced]
    subsets = nested_subsets(columns, small.G, small.r)
    A = np.concatenate([small.G, *columns], axis=1)
    rss = [float(np.sum((small.r - A @ subset.coefficients) ** 2)) for subset in subsets]
    size = len(members)
    while size > 1:
        lost, explained = rss[size - 1] - rss[size], rss[0] - rss[size]
        if lost >= levels.MIN_EFFECT_SHARE * explained or lost >= levels.MIN_EFFECT_RISE * rss[size]:
            break
        size -= 1
    return tuple(members[i] for i in subsets[size].members)


def rank_members(
    linearised: LinearisedData, members: Sequence[Candidate]
) -> tuple[tuple[Candidate, ...], list[tuple[float, float]]]:
    """The members, the largest contribution first, and the weight of each.

    Returns:
        The members, the one whose loss costs most first.
    """
    weights = member_weights(linearised, members)
    order = sorted(range(len(members)), key=lambda i: -weights[i][1])
    return tuple(members[i] for i in order), [weights[i] for i in order]


def eliminate_members(
    linearised: LinearisedData, nulls: FurtherNulls, members: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """Backward elimination of the members that are not significant given the others, the least significant first.

    Args:
        nulls: the distribution of the best candidate on the geometry alone, which decides on a first effect, and that
            beside all members, which decides on every further one.
    """
    kept, (linearised, reduced) = list(members), linearised.reduced(members)
    while kept:
        weights = member_weights(linearised, reduced)
        p_values = nulls.family_wise(kept, [p for p, _ in weights])
        worst = max(range(len(kept)), key=lambda i: (p_values[i], weights[i][0]))
        if p_values[worst] < (levels.FIRST_EFFECT_LEVEL if len(kept) == 1 else levels.FURTHER_EFFECT_LEVEL):
            break
        del kept[worst], reduced[worst]
    return tuple(kept)


@dataclass(eq=False)
class FurtherNulls:
    """The null distributions of a first effect and of those beside others.

    Args:
        first: on the geometry alone; ``beside`` makes that beside all members, where a decision depends on it.
        drawn: that one, once it was made.
    """

    first: NullDistribution
    beside: Callable[[], NullDistribution]
    drawn: NullDistribution | None = field(default=None, init=False)

    def family_wise(self, members: Sequence[Candidate], log_p: Sequence[float]) -> list[float]:
        """The p-values of the members of a set, each given the others.

        The first null is the stricter one: where all are significant by it, the other one is not made.
        """
        found = family_wise(self.first, self.drawn, members, log_p)
        doubtful = [p for p, value in zip(log_p, found, strict=True) if value >= levels.FURTHER_EFFECT_LEVEL]
        if self.drawn is None and len(members) > 1 and min(doubtful, default=0.0) < _HOPELESS_LOG_P:
            self.drawn = self.beside()
            found = family_wise(self.first, self.drawn, members, log_p)
        return found


def family_wise(
    first: NullDistribution, beside: NullDistribution | None, members: Sequence[Candidate], log_p: Sequence[float]
) -> list[float]:
    """Family-wise p-values of the members of a set, each given the others: of several by the null beside them too."""
    nulls = [first] if beside is None or len(members) < 2 else [first, beside]
    return [min(null.family_wise(p, s.family) for null in nulls) for p, s in zip(log_p, members, strict=True)]


def find_rivals(
    baseline: ProjectedBaseline, shortlisted: Sequence[Candidate], chosen: Sequence[Candidate]
) -> tuple[tuple[Candidate, ...], ...]:
    """For each chosen candidate the others that explain as much in its place, within `levels.RIVAL_CRITERION`.

    Four kinds: those that explain as much; those that would, were parameters charged less (`levels.LENIENT_PENALTY`);
    of a persistent effect those of the session, and vice versa, that would at the price of the member, as which of them
    it is decides what is delivered; and names that alone explain as much as all members together.
    """
    every = merged_candidates(shortlisted, chosen)
    pool = candidate_pool(baseline, every)
    place = {str(s.what): i for i, s in enumerate(every)}
    members = tuple(sorted(place[str(s.what)] for s in chosen))
    pools = pool, _lenient_pool(pool, every)
    for_all = _for_all(pool, every, members)
    return tuple(_rivals_of(place[str(s.what)], pools, every, members, for_all) for s in chosen)


def _rivals_of(
    member: int,
    pools: Sequence[Pool],
    every: Sequence[Candidate],
    members: Chosen,
    for_all: Sequence[tuple[float, int]],
) -> tuple[Candidate, ...]:
    """Those of the alternatives to a member that resemble it, the best shape of each, the best first."""
    found: dict[object, Candidate] = {}
    pools = *pools, _other_duration_pool(pools[0], every, member)
    close = close_alternatives(pools, members, member, levels.RIVAL_CRITERION)
    for _, other in sorted([*close, *for_all]):
        alike = pools[0].alike(member, other) > levels.MIN_RIVAL_COSINE
        if alike and every[other].key != every[member].key:
            found.setdefault(every[other].exclusive, every[other])
    found.pop(every[member].exclusive, None)
    return tuple(found.values())


def _lenient_pool(pool: Pool, candidates: Sequence[Candidate]) -> Pool:
    """The pool with names charged 2 a parameter (Akaike 1974): what only costs more has not been refuted by data."""
    less = [
        (np.log(pool.freedom) - levels.LENIENT_PENALTY) * size if s.named and size <= levels.LARGE_GROUP_SIZE else 0.0
        for s, size in zip(candidates, pool.columns.sizes.tolist(), strict=True)
    ]
    unlikely = np.array([_price_of_unlikely(s) for s in candidates])
    return replace(pool, penalty=pool.penalty - np.maximum(less, 0.0) - unlikely)


def _other_duration_pool(pool: Pool, candidates: Sequence[Candidate], member: int) -> Pool:
    """The pool with names of the session at the price of a persistent member, and vice versa."""
    other = [
        s.named and s.persistent != candidates[member].persistent and size <= levels.LARGE_GROUP_SIZE
        for s, size in zip(candidates, pool.columns.sizes.tolist(), strict=True)
    ]
    cheap = np.minimum(pool.penalty, pool.penalty[member])
    return replace(pool, penalty=np.where(other, cheap, pool.penalty))


def _for_all(pool: Pool, candidates: Sequence[Candidate], members: Chosen) -> list[tuple[float, int]]:
    """Names that alone could replace all that was chosen."""
    least = pool.criterion(members)
    alone = ((value - least, only[0]) for value, only in pool.additions(())) if len(members) > 1 else ()
    return [(more, i) for more, i in alone if more <= levels.RIVAL_CRITERION and candidates[i].named]
