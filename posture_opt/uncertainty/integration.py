"""Correlated errors as independent ones with a few shared factors, ``Σ = D + L Lᵀ``, and the nodes that these need.

Given the factors ``z ~ N(0, I)`` the errors ``p = L z + e``, ``e ~ N(0, D)``, are independent, and every formula for
independent errors holds again. D is as large as can be, so that the factors are few: two correlated sources, or any
number with equal correlations ρ > 0, share one. There are as many nodes as an error estimate asks for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from posture_opt.encoding import Encoded
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.robot.robot import Factor
from posture_opt.uncertainty.exact_moments import Segment
from posture_opt.uncertainty.gaussian_rules import (
    Nodes,
    degree_five,
    degree_three,
    product_rule,
    quasi_random,
    side_by_side,
)
from posture_opt.uncertainty.regions import RANK_TOLERANCE

# Eigenvalue of a matrix of correlations below which is rounding, or what the barrier left of a zero
_ZERO_EIGENVALUE = 1e-10
_ROUNDING_EIGENVALUE = 1e-15  # The same of rounding alone


@dataclass(frozen=True, eq=False)
class SharedFactors:
    """A covariance (k, k) split as ``diag(own) + loadings @ loadings.T``."""

    own: Array  # (k,) variances ≥ 0 of what every source has for itself [rad², m²]
    # (k, r) standard deviation of each source by each factor [rad, m]; the factor that turns the chain the farthest is
    # first. Each factor changes sources alone that are correlated with each other, and as many as can be change lengths
    # alone
    loadings: Array

    @classmethod
    def of(cls, covariance: Array, turning: Mask) -> SharedFactors:
        """The split of a semidefinite covariance (k, k) of sources with variance, (k,) whether they turn the chain.

        The diagonal maximises ``Σ_i D_ii / Σ_ii`` with ``D ⪰ 0`` and ``Σ − D ⪰ 0`` in every group of sources that are
        correlated with each other: minimum trace factor analysis of the matrix of correlations. Sources: P. M. Bentler,
        J. A. Woodward, Psychometrika 45 (1980) 249; A. Shapiro, Psychometrika 47 (1982) 187.
        """
        sigma = np.sqrt(np.diag(covariance))
        own = np.array(np.diag(covariance), dtype=float)
        columns: list[Array] = []
        for group in _correlated_groups(covariance):
            at = np.ix_(group, group)
            single, shared = _split_correlations(covariance[at] / np.outer(sigma[group], sigma[group]))
            own[group] = single * sigma[group] ** 2
            for column in _oriented_loadings(shared * sigma[group][:, None], turning[group]).T:
                loading = np.zeros(len(sigma))
                loading[group] = column
                columns.append(loading)
        order = sorted(range(len(columns)), key=lambda c: -float(np.linalg.norm(columns[c][turning])))
        return cls(own, np.array([columns[c] for c in order]).T if columns else np.zeros((len(sigma), 0)))

    @property
    def count(self) -> int:
        return int(self.loadings.shape[1])


def _correlated_groups(covariance: Array) -> list[list[int]]:
    """The sources that are correlated with others, linked ones in one list."""
    linked = covariance != 0
    left = [k for k in range(len(linked)) if np.count_nonzero(linked[k]) > 1]
    groups = []
    while left:
        group, reached = {left[0]}, [left[0]]
        while reached:
            near = set(np.flatnonzero(linked[reached.pop()]).tolist()) - group
            group |= near
            reached += near
        groups.append(sorted(group))
        left = [k for k in left if k not in group]
    return groups


def _split_correlations(R: Array) -> tuple[Array, Array]:
    """Diagonal (k,) and factors (k, r) of a matrix of correlations (k, k)."""
    if len(R) == 2:
        rho = max(-1.0, min(1.0, float(R[0, 1])))
        return np.full(2, 1 - abs(rho)), math.sqrt(abs(rho)) * np.array([[1.0], [math.copysign(1.0, rho)]])
    own = np.frombuffer(_kept_diagonal(R.tobytes(), len(R)))
    values, vectors = np.linalg.eigh(R - np.diag(own))
    # Errors that nearly cancel, as after a calibration, leave a combination with little variance: what is left out
    # must be little compared with that too.
    least = max(min(_ZERO_EIGENVALUE * len(R), 1e-6 * float(np.linalg.eigvalsh(R)[0])), _ROUNDING_EIGENVALUE * len(R))
    kept = np.flatnonzero(values > least)[::-1]
    shared = vectors[:, kept] * np.sqrt(values[kept])
    # What the smallest eigenvalues leave out of the diagonal goes back into it: the variances stay what they are.
    return np.maximum(np.diag(R) - (shared**2).sum(axis=1), 0.0), shared


def _oriented_loadings(L: Array, turning: Mask) -> Array:
    """The loadings (k, r) in other axes of the factors: as few as can be turn the chain, the first the farthest."""
    if L.shape[1] < 2 or not turning.any():
        return L
    _, sizes, axes = np.linalg.svd(L[turning])
    oriented: Array = L @ axes.T
    still = np.arange(L.shape[1]) >= np.count_nonzero(sizes > _ROUNDING_EIGENVALUE * len(L) * sizes[0])
    oriented[np.ix_(turning, still)] = 0.0
    # Where all sources turn the chain, a factor that does not is rounding.
    return oriented[:, oriented.any(axis=0)]


@lru_cache(maxsize=16)
def _kept_diagonal(packed: bytes, count: int) -> bytes:
    """`_largest_diagonal` of a matrix (``count``, ``count``): one arm is judged in many postures, each time anew."""
    return _largest_diagonal(np.frombuffer(packed).reshape(count, count)).tobytes()


def _largest_diagonal(R: Array) -> Array:
    """The diagonal d ≥ 0 of largest sum with ``R − diag(d)`` positive semidefinite, by a logarithmic barrier. Newton's
    method on ``Σ d + μ (log det Uᵀ (R − diag d) U + Σ log d)`` for μ → 0, U spanning the range of R. Where R has a null
    vector v, ``vᵀ (R − diag d) v ≥ 0`` leaves no diagonal to any source that v names."""
    values, vectors = np.linalg.eigh(R)
    null = values <= _ZERO_EIGENVALUE * len(R)
    # The square root of what is overlooked here comes back as an eigenvalue below zero.
    free = np.flatnonzero((vectors[:, null] ** 2).sum(axis=1) <= _ZERO_EIGENVALUE**2)
    d = np.zeros(len(R))
    if not len(free):
        return d
    U = vectors[:, ~null]
    d[free] = values[~null][0] / 2
    for power in range(14):
        former = d.copy()
        _centre_barrier(R, U, free, d, 10.0**-power)
        # Where the range of R hardly has some direction, rounding throws the steps out of the barrier.
        rest = np.linalg.eigvalsh(U.T @ (R - np.diag(d)) @ U) if np.isfinite(d).all() else np.array([-1.0])
        if rest[0] < -_ZERO_EIGENVALUE or np.any(d[free] <= 0):
            return former
    return d


def _centre_barrier(R: Array, U: Array, free: Codes, d: Array, mu: float) -> None:
    for _ in range(50):
        # (R - diag d)^-1 on the range of R; its square, entry by entry, is the Hessian of -log det.
        inverse = (U @ np.linalg.inv(U.T @ (R - np.diag(d)) @ U) @ U.T)[np.ix_(free, free)]
        gradient = 1 + mu * (1 / d[free] - np.diag(inverse))
        step = np.linalg.solve(mu * (inverse**2 + np.diag(1 / d[free] ** 2)), gradient)
        decrement = float(gradient @ step) / mu
        # The function is self-concordant: the damped step stays inside, and the last ones are whole.
        d[free] += step / (1 + math.sqrt(max(decrement, 0.0))) if decrement > 0.05 else step
        if decrement < 1e-8:
            return


MAX_NODES = 50_000  # of a product rule: half a second
# Relative error of the variance in any direction above which other rules than products of all factors are tried, and at
# which quasi-Monte Carlo stops.
_FALLBACK_ERROR = 1e-4

Moments = tuple[Array, Array]  # mean (m,) and covariance (m, m), of the tool point [m] or of its pose [m, rad]


@dataclass(frozen=True)
class Integration(Encoded):
    """How a mean over shared factors was taken, and how far it may be off."""

    rule: Literal["polynomial", "quasi-Monte Carlo"]  # polynomial: exact up to a degree, products among them
    factors: int  # shared ones
    nodes: int  # walks along the chain that were mixed
    # Estimate of the largest relative error of the variance along any direction: the change by the last refinement, or
    # two standard errors of quasi-Monte Carlo.
    relative_error: float


@dataclass(frozen=True, eq=False)
class SharedSpan:
    """r factors that act along overlapping parts of the chain."""

    first: int  # place in the chain; last: likewise, included
    last: int
    loadings: Mapping[int, Array]  # place -> (r,) standard deviation there by each shared factor [rad or m]
    turn: Array  # (r,) by how far each factor turns the tool, the sum over rotations [rad]
    columns: tuple[int, ...]  # (r,) which of all shared factors these are

    @property
    def count(self) -> int:
        return len(self.columns)

    def segment(self, centre: Nodes, width: Nodes | None = None) -> Segment:
        """The segment with these nodes; for means and covariances the same, unless others are given."""
        return Segment(self.first, self.last, self.loadings, centre, width or centre)


def spans(split: SharedFactors, indices: Sequence[int], factors: Sequence[Factor]) -> list[SharedSpan]:
    """The spans of all shared factors of sources at the places ``indices`` (k,) of a chain."""
    joined: list[tuple[int, int, list[int]]] = []
    reach = [[indices[k] for k in np.flatnonzero(column).tolist()] for column in split.loadings.T]
    for first, last, column in sorted((min(touched), max(touched), c) for c, touched in enumerate(reach)):
        if joined and first <= joined[-1][1]:
            start, end, columns = joined[-1]
            joined[-1] = (start, max(end, last), [*columns, column])
        else:
            joined.append((first, last, [column]))
    found = []
    for first, last, columns in joined:
        L = split.loadings[:, columns]
        rows = np.flatnonzero(L.any(axis=1)).tolist()
        turning = [k for k in rows if factors[indices[k]].kind == "rotate"]
        turn = np.abs(L[turning]).sum(axis=0)
        found.append(SharedSpan(first, last, {indices[k]: L[k] for k in rows}, turn, tuple(columns)))
    return found


@dataclass(frozen=True, eq=False)
class Integrated:
    """Moments mixed over shared factors."""

    mean: Array  # (m,) [m, rad]
    covariance: Array  # (m, m) [m², rad²]
    segments: Sequence[Segment]  # of the last rule of rising degree
    integration: Integration


def converged(
    evaluate: Callable[[Sequence[Segment]], Moments],
    spans: Sequence[SharedSpan],
    goal: float = 1e-8,
    most: int = MAX_NODES,
) -> Integrated:
    """The moments of the tool point with as many nodes as their own error estimate asks for.

    Rules of rising degree are tried until one changes the variance along no direction by more than ``goal``, or by
    what rounding leaves of the smallest. If the error is above 1e-4 as ``most`` nodes of a rule are reached, the
    factors that turn the tool the farthest get more nodes than the others, then quasi-Monte Carlo is tried too.
    """
    found: Moments | None = None
    error, finest, fallback = math.inf, list[Segment](), max(goal, _FALLBACK_ERROR)
    far = _affordable(spans, ([_far_nodes(span, step, most) for span in spans] for step in (1, 2)))
    for rules, enough in ((rising(spans, most), goal), (far, fallback)):
        if found is not None and error <= enough + _rounding_error(found[1]):
            break
        for segments in rules:
            finer = evaluate(segments)
            error = math.inf if found is None else relative_difference(found[1], finer[1])
            found, finest = finer, segments
            if error <= enough + _rounding_error(finer[1]):
                break
    assert found is not None, "the coarsest rules are always affordable"
    count, nodes = sum(span.count for span in spans), sum(segment.centre.count for segment in finest)
    answer = Integrated(*found, finest, Integration("polynomial", count, nodes, error))
    if error <= fallback:
        return answer
    mean, C, nodes, sampled = _sampled_moments(evaluate, spans, error)
    other = Integrated(mean, C, finest, Integration("quasi-Monte Carlo", count, nodes, sampled))
    return other if sampled < error else answer


def rising(spans: Sequence[SharedSpan], most: int = MAX_NODES) -> Iterator[list[Segment]]:
    """Nodes of rising degree for all spans, at most ``most`` of one span."""
    return _affordable(spans, ([_polynomial(span, level, most) for span in spans] for level in range(12)))


def _affordable(spans: Sequence[SharedSpan], rules: Iterable[Sequence[Nodes | None]]) -> Iterator[list[Segment]]:
    for nodes in rules:
        found = [span.segment(rule) for span, rule in zip(spans, nodes, strict=True) if rule is not None]
        if len(found) < len(spans):
            return
        yield found


def _polynomial(span: SharedSpan, level: int, most: int) -> Nodes | None:
    """Nodes for a span, None where they are more than ``most``.

    Of degree 5 at level 0 and, in other axes, where a product would have many nodes at level 1; then products of more
    and more nodes along each factor, the more the farther it turns the tool. Given the factors that turn, the others
    shift: the mean is linear in them, and degree 3 exact.
    """
    turning, shifting = np.flatnonzero(span.turn), np.flatnonzero(span.turn == 0)
    many = 4 ** len(turning) > 1100
    rules = [(degree_three(len(shifting)), shifting)] if len(shifting) else []
    if not len(turning):
        return side_by_side(*rules)
    if level == 0 or (level == 1 and many):
        # Of degree 5 in all factors where that takes fewer nodes than degree 3 in those that shift.
        both = side_by_side(*rules, (degree_five(len(turning), other=level == 1), turning))
        return min(both, degree_five(span.count, other=level == 1), key=lambda nodes: nodes.count)
    step = level - 1 if many else level
    counts = [3 + step + round(1.5 * step * w) for w in span.turn[turning]]
    if math.prod(counts) * max(1, 2 * len(shifting)) > most:
        return None
    return side_by_side(*rules, (product_rule(counts), turning))


def _far_nodes(span: SharedSpan, step: int, most: int) -> Nodes | None:
    """Products for the factors that turn farther than 0.3 (0.09) of the farthest, degree 5 for the others."""
    is_far = span.turn > 0.3**step * span.turn.max()
    far, near = np.flatnonzero(is_far), np.flatnonzero(~is_far)
    counts = [4 + step + round(3 * step * w) for w in span.turn[far]]
    if not len(far) or not len(near) or math.prod(counts) > most:
        return None
    rest = degree_five(len(near), other=step == 1)
    if math.prod(counts) * rest.count > most:
        return None
    return side_by_side((product_rule(counts), far), (rest, near))


def _sampled_moments(
    evaluate: Callable[[Sequence[Segment]], Moments], spans: Sequence[SharedSpan], rival: float, shifts: int = 8
) -> tuple[Array, Array, int, float]:
    """Moments, nodes and relative error of quasi-Monte Carlo: the mean of independent shifts, semidefinite as each.

    It stops too where all its nodes will not bring its error below that of its ``rival``.
    """
    rng = np.random.default_rng(0)
    sizes = (512, 4096, 16384)
    for size in sizes:
        drawn = [[span.segment(quasi_random(span.count, size, rng)) for span in spans] for _ in range(shifts)]
        batches = [evaluate(segments) for segments in drawn]
        mean, C = (np.mean(parts, axis=0) for parts in zip(*batches, strict=True))
        squares = [relative_difference(part, C) ** 2 for _, part in batches]
        error = 2 * math.sqrt(sum(squares) / (shifts * (shifts - 1)))
        if error <= _FALLBACK_ERROR or error * size / sizes[-1] > rival:
            break
    return mean, C, sum(segment.centre.count for segments in drawn for segment in segments), error


def relative_difference(C: Array, reference: Array) -> float:
    """``max |uᵀ (C − R) u / uᵀ R u|`` of covariances (m, m) over the directions u in which the reference R has any.

    The largest eigenvalue of ``R^-½ (C − R) R^-½`` in size, on the range of R.
    """
    variances, axes = np.linalg.eigh((reference + reference.T) / 2)
    wide = variances > RANK_TOLERANCE * max(float(variances[-1]), 0.0)
    if not wide.any():
        return 0.0
    W = axes[:, wide] / np.sqrt(variances[wide])
    return float(np.abs(np.linalg.eigvalsh(W.T @ (C - reference) @ W)).max())


def _rounding_error(C: Array) -> float:
    """What rounding may change the smallest variance by, relative to it."""
    variances = np.linalg.eigvalsh((C + C.T) / 2)
    wide = variances[variances > RANK_TOLERANCE * variances[-1]]
    return 1e-14 * float(wide[-1] / wide[0]) if len(wide) else 0.0


@dataclass(frozen=True, eq=False)
class NodePlan:
    """Nodes for some shared factors, the same at every posture, while the others move the tool point straight.

    For symbols, generated code and many postures at once. What the others add, ``J L Lᵀ Jᵀ``, is semidefinite too.
    """

    segments: Sequence[Segment]  # of the factors with nodes
    straight: Array  # (k, r) loadings L of the others
    relative_error: float = math.nan  # estimate of the largest of the variance along any direction, if it was measured

    @property
    def count(self) -> int:
        """Walks along a segment, of means and covariances together."""
        return sum(s.centre.count + (s.width.count if s.width is not s.centre else 0) for s in self.segments)

    @classmethod
    def few(cls, split: SharedFactors, indices: Sequence[int], factors: Sequence[Factor], most: int = 0) -> NodePlan:
        """Complete to fourth order in σ in the ``most`` factors with the largest turn of every span.

        Unless stated these are three, but one where there are more than six, as there are after a calibration: errors
        are small then, and a graph of many factors would be large.
        """
        most = most or (3 if split.count <= 6 else 1)
        kept = [column for span in spans(split, indices, factors) for column in sorted(span.columns)[:most]]
        chosen = SharedFactors(split.own, split.loadings[:, kept])
        segments = [_fourth_order(span) for span in spans(chosen, indices, factors)]
        return cls(segments, np.delete(split.loadings, kept, axis=1))


def _fourth_order(span: SharedSpan) -> Segment:
    """Complete to fourth order in σ: the mean, whose covariance counts, at nodes of degree 5, and the covariance, which
    the factors change at the second order of σ only, of degree 3: 5 walks for one factor, 11 for two, 19 for three."""
    if not span.turn.any():
        return span.segment(degree_three(span.count))  # what shifts alone, shifts linearly
    if span.count > 1:
        return span.segment(degree_five(span.count), degree_three(span.count))
    more = round(3 * float(span.turn.sum()))  # a factor alone that turns the tool far has more
    return span.segment(product_rule((3 + more,)), product_rule((2 + more,)))
