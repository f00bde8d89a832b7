"""What a candidate costs in the criterion of a selection, and what a member of a set is worth beside the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate, LinearisedData
from posture_opt.diagnosis.scores.score_tests import (
    NullDistribution,
    ProjectedBaseline,
    ProjectedColumns,
    beyond_limits,
    log_p,
)
from posture_opt.diagnosis.scores.subset_selection import Pool, nested_subsets
from posture_opt.model.effects import Effect, FittedSizes
from posture_opt.numerics import Array, Codes


def merged_candidates(former: Iterable[Candidate], new: Iterable[Candidate]) -> tuple[Candidate, ...]:
    former = tuple(former)
    known = {str(s.what) for s in former}
    return (*former, *(s for s in new if str(s.what) not in known))


def candidate_pool(baseline: ProjectedBaseline, candidates: Sequence[Candidate]) -> Pool:
    columns = ProjectedColumns.of(baseline, [s.Z for s in candidates])
    freedom, rss = baseline.freedom, float(baseline.e @ baseline.e)
    evidence = columns.gains / max(rss / max(freedom, 1), 1e-300)
    choice = np.array([price_of_choice(s) for s in candidates])
    codes: dict[object, int] = {}
    exclusive = np.array([codes.setdefault(s.what.exclusive, len(codes)) for s in candidates])
    most = np.array([s.most for s in candidates])
    penalty = price_of_parameters(columns.sizes, evidence, max(freedom, 1)) + choice
    return Pool(columns, rss, freedom, penalty, exclusive, most)


def price_of_choice(candidate: Candidate) -> float:
    """Charge for a candidate beyond its parameters: ``2 log(searched) + γ``, and γ more where it is less likely.

    Extended BIC (Chen, Chen 2008). Less likely are unnamed components, and bending and a compliant base where no masses
    are stated: joints are most of an arm's compliance (Dumas, Caro, Garnier, Furet 2011).
    """
    twice = not candidate.named or candidate.what.less_likely
    return float(2 * np.log(candidate.searched) + (2 if twice else 1) * levels.CHOICE_PENALTY)


def price_of_parameters(count: Array | Codes, evidence: Array, freedom: float | Array) -> Array:
    """Charge for ``count`` parameters that explain ``evidence`` in units of the noise variance.

    A parameter costs ``log m`` (Schwarz 1978); those of a large group at most what an empirical Bayes prior on the
    group's size would charge, ``1 + log(T / k)`` each for an evidence T of k parameters (George, Foster 2000).
    """
    group = 1 + np.log(np.maximum(evidence / np.maximum(count, 1), 1.0))
    each = np.where(count > levels.LARGE_GROUP_SIZE, np.minimum(np.log(freedom), group), np.log(freedom))
    return np.asarray(count * each)


def member_weights(linearised: LinearisedData, members: Sequence[Candidate]) -> list[tuple[float, float]]:
    """Log p-value of the F test of every member given the others, and the rise of the criterion without it.

    All from one fit: ``ΔRSS = θᵀ C⁻¹ θ`` (Wald). 0 and −∞ where an estimate is physically impossible.
    """
    if not members:
        return []
    small, reduced = linearised.reduced(members)
    A, places = small.columns(reduced)
    norms = np.linalg.norm(A, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    A = A / scale
    C = np.linalg.pinv(A.T @ A, rcond=1e-12, hermitian=True)
    theta = C @ (A.T @ small.r)
    rss = max(float(small.r @ small.r - theta @ (A.T @ small.r)), 1e-300)
    freedom = float(small.count - np.linalg.matrix_rank(A))
    if freedom < 1:  # together they explain whatever was measured: none of them is shown
        return [(0.0, -np.inf)] * len(members)
    found = []
    for member, own in zip(reduced, places, strict=True):
        values, vectors = np.linalg.eigh(C[own, own])
        clear = (values > 0) & (values < levels.MIN_SURVIVING_SHARE**-2)
        gain, count = float(np.sum((vectors.T @ theta[own])[clear] ** 2 / values[clear])), int(clear.sum())
        errors = np.sqrt(np.diag(C)[own] * rss / freedom) / scale[own]
        if np.any(
            beyond_limits(-theta[own] / scale[own], errors if len(errors) > 1 else 0 * errors, *member.what.limits)
        ):
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
    """
    if not np.isfinite([s.most for s in members]).any():
        return []
    small, reduced = linearised.reduced(members)
    A, places = small.columns(reduced)
    theta = np.linalg.lstsq(A, small.r, rcond=1e-10)[0]
    Q = np.linalg.qr(small.G)[0]
    shifts = [A[:, own] @ theta[own] for own in places]
    return [s for s, v in zip(members, shifts, strict=True) if float(np.sum((v - Q @ (Q.T @ v)) ** 2)) > s.most]


def implausible_members(linearised: LinearisedData, members: Sequence[Candidate]) -> list[Candidate]:
    """The effects whose size, fitted with all members, no such cause can have on the arm, see `Effect.plausible`."""
    if not members:
        return []
    A, places = linearised.columns(members)
    norms = np.where((norms := np.linalg.norm(A, axis=0)) > 0, norms, 1.0)
    A = A / norms
    C = np.linalg.pinv(A.T @ A, rcond=1e-12, hermitian=True)
    theta = -C @ (A.T @ linearised.r)
    rest = linearised.r + A @ theta
    C = C * float(rest @ rest) / max(len(rest) - A.shape[1], 1)
    found = []
    for member, own in zip(members, places, strict=True):
        effect, scale = member.what, norms[own]
        known = effect.plausible(linearised.excitation.robot) if isinstance(effect, Effect) else None
        if isinstance(effect, Effect) and known is not None and not effect.unstated_loads:
            covariance = C[own, own] / np.outer(scale, scale)
            sizes = zip(effect.dimensions, theta[own] / scale, np.sqrt(np.diag(covariance)), strict=True)
            fitted = FittedSizes({name: (float(v), float(std), "") for (name, _), v, std in sizes}, covariance)
            if not known.holds(*effect.plausible_size(fitted)):
                found.append(member)
    return found


def substantial_members(linearised: LinearisedData, members: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The members without those that explain next to nothing, the least first: they are not worth a name.

    A member stays with 2 % of what all explain, or 6 % of the sum of squares that they leave, 3 % of the RMS: a choice
    of taste.
    """
    if len(members) < 2:
        return tuple(members)
    small, reduced = linearised.reduced(members)
    subsets = nested_subsets([s.Z for s in reduced], small.G, small.r)
    A = small.columns(reduced)[0]
    rss = [float(np.sum((small.r - A @ subset.coefficients) ** 2)) for subset in subsets]
    size = len(members)
    while size > 1 and rss[size - 1] - rss[size] < min(0.02 * (rss[0] - rss[size]), 0.06 * rss[size]):
        size -= 1
    return tuple(members[i] for i in subsets[size].members)


def eliminate_members(
    linearised: LinearisedData, nulls: FurtherNulls, members: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """Backward elimination of the members that are not significant given the others, the least significant first."""
    kept, (linearised, reduced) = list(members), linearised.reduced(members)
    while kept:
        weights = member_weights(linearised, reduced)
        p_values = nulls.family_wise(kept, [p for p, _ in weights])
        worst = max(range(len(kept)), key=lambda i: (p_values[i], weights[i][0]))
        if p_values[worst] < levels.EFFECT_LEVEL:
            break
        del kept[worst], reduced[worst]
    return tuple(kept)


@dataclass(eq=False)
class FurtherNulls:
    """Null distributions: ``first`` on the geometry alone, ``drawn`` beside all members where a decision needs it."""

    first: NullDistribution
    beside: Callable[[], NullDistribution]
    drawn: NullDistribution | None = field(default=None, init=False)

    def family_wise(self, members: Sequence[Candidate], log_p: Sequence[float]) -> list[float]:
        """p-values of the members of a set, each given the others."""
        found = family_wise(self.first, self.drawn, members, log_p)
        doubtful = [p for p, value in zip(log_p, found, strict=True) if value >= levels.EFFECT_LEVEL]
        # Above a log p of -8 no null makes a member significant: of some 30 candidates it would have to be -8.5.
        if self.drawn is None and len(members) > 1 and min(doubtful, default=0.0) < -8.0:
            self.drawn = self.beside()
            found = family_wise(self.first, self.drawn, members, log_p)
        return found


def family_wise(
    first: NullDistribution, beside: NullDistribution | None, members: Sequence[Candidate], log_p: Sequence[float]
) -> list[float]:
    """Family-wise p-values of the members of a set, each given the others: of several by the null beside them too."""
    nulls = [first] if beside is None or len(members) < 2 else [first, beside]
    return [min(null.family_wise(p, s.what.family) for null in nulls) for p, s in zip(log_p, members, strict=True)]
