"""How many nodes the shared factors of correlated errors need: as many as an error estimate asks for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from posture_opt.numerics import Array, Json
from posture_opt.robot.robot import Factor
from posture_opt.uncertainty.moments.conditional_moments import Segment
from posture_opt.uncertainty.moments.gaussian_rules import (
    Nodes,
    degree_five,
    degree_three,
    product_rule,
    quasi_random,
    side_by_side,
)
from posture_opt.uncertainty.moments.shared_factors import SharedFactors
from posture_opt.uncertainty.regions.regions import RANK_TOLERANCE

Rule = Literal["polynomial", "quasi-Monte Carlo"]

GOAL = 1e-8  # relative error of the variance in any direction at which no more nodes are tried
_SURE = 1e-4  # the same, above which other rules are tried where products of all factors have too many nodes
_FAR = 0.3  # of the farthest turn: factors that turn less far have degree 5 beside products of the others
_ENOUGH = 1e-4  # the same, at which quasi-Monte Carlo stops
MOST = 50_000  # nodes of a product rule: half a second
_PRODUCT = 1100  # nodes of a product of four each, above which another rule of degree 5 is tried before it
LEVELS = 12  # of refinement
_GROWTH = 1.5  # nodes more along a factor at each level, for each radian by which it turns the tool
_BATCHES = 8  # independent shifts of a quasi-Monte Carlo rule, whose scatter is its error
_SIZES = (512, 4096, 16384)  # nodes of each

Moments = tuple[Array, Array]
"""Mean (m,) and covariance (m, m), of the tool point [m] or of its pose [m, rad]."""


@dataclass(frozen=True)
class Integration:
    """How a mean over shared factors was taken, and how far it may be off.

    Args:
        rule: ``polynomial`` for nodes that are exact up to a degree, products of Gauss-Hermite rules among them.
        factors: how many shared factors there are; nodes: how many walks along the chain were mixed.
        relative_error: estimate of the largest relative error of the variance along any direction: the change by
            the last refinement, or two standard errors of quasi-Monte Carlo.
    """

    rule: Rule
    factors: int
    nodes: int
    relative_error: float

    def to_json(self) -> dict[str, Json]:
        """Plain numbers."""
        return dict(vars(self))


@dataclass(frozen=True, eq=False)
class SharedSpan:
    """Factors that act along overlapping parts of the chain.

    Args:
        first, last: of the factors of the chain, both included.
        loadings: place in the chain -> (r,) standard deviation there by each shared factor [rad or m].
        turning: (k, r) those of rotations [rad].
        columns: (r,) which of all shared factors these are.
    """

    first: int
    last: int
    loadings: Mapping[int, Array]
    turning: Array
    columns: tuple[int, ...]

    @property
    def count(self) -> int:
        """How many factors there are."""
        return len(self.columns)

    def segment(self, centre: Nodes, width: Nodes | None = None) -> Segment:
        """The segment with these nodes; for means and covariances the same, unless others are given."""
        return Segment(self.first, self.last, self.loadings, centre, width or centre)


def spans(split: SharedFactors, indices: Sequence[int], factors: Sequence[Factor]) -> list[SharedSpan]:
    """The spans of all shared factors.

    Args:
        indices: (k,) place in the chain of every source.
        factors: the chain.
    """
    reach = []
    for column in range(split.count):
        touched = [indices[k] for k in np.flatnonzero(split.loadings[:, column]).tolist()]
        reach.append((min(touched), max(touched), column))
    joined: list[tuple[int, int, list[int]]] = []
    for first, last, column in sorted(reach):
        if joined and first <= joined[-1][1]:
            start, end, columns = joined[-1]
            joined[-1] = (start, max(end, last), [*columns, column])
        else:
            joined.append((first, last, [column]))
    return [_span(split, indices, factors, *parts) for parts in joined]


def _span(
    split: SharedFactors, indices: Sequence[int], factors: Sequence[Factor], first: int, last: int, columns: list[int]
) -> SharedSpan:
    L = split.loadings[:, columns]
    rows = np.flatnonzero(L.any(axis=1)).tolist()
    turning = [k for k in rows if factors[indices[k]].kind == "rotate"]
    return SharedSpan(first, last, {indices[k]: L[k] for k in rows}, L[turning], tuple(columns))


@dataclass(frozen=True, eq=False)
class Integrated:
    """Moments mixed over shared factors: mean (m,), covariance (m, m), the nodes, and how good they are."""

    mean: Array
    covariance: Array
    segments: Sequence[Segment]
    integration: Integration


def converged(
    evaluate: Callable[[Sequence[Segment]], Moments],
    spans: Sequence[SharedSpan],
    goal: float = GOAL,
    most: int = MOST,
) -> Integrated:
    """The moments of the tool point with as many nodes as their own error estimate asks for.

    Rules of rising degree are tried until a refinement changes the variance along no direction by more than ``goal``,
    or by what rounding leaves of the smallest. Where the error is above 1e-4 as ``most`` nodes are reached, the
    factors that turn the tool the farthest have more nodes beside the others, and if that does not do, quasi-Monte
    Carlo stands beside it all, and the answer is the one with the smaller error. Its ``segments`` are in any case those
    of the last rule of rising degree.

    Args:
        evaluate: moments with given nodes.
        spans: apart from each other.
    """
    found: Moments | None = None
    error, finest = math.inf, list[Segment]()
    for refinements, enough in ((_refinements, goal), (_far_refinements, max(goal, _SURE))):
        if found is not None and error <= enough + _rounding(found[1]):
            break
        for segments in refinements(spans, most):
            finer = evaluate(segments)
            error = math.inf if found is None else relative_difference(found[1], finer[1])
            found, finest = finer, segments
            if error <= enough + _rounding(finer[1]):
                break
    assert found is not None, "the coarsest rules are always affordable"
    nodes = sum(segment.centre.count for segment in finest)
    answer = Integrated(*found, finest, Integration("polynomial", _factors(spans), nodes, error))
    if error <= max(goal, _SURE):
        return answer
    return min(answer, _sampled(evaluate, spans, finest, error), key=lambda either: either.integration.relative_error)


def _refinements(spans: Sequence[SharedSpan], most: int) -> Iterator[list[Segment]]:
    """Nodes of rising degree for all spans, while they can be afforded."""
    for level in range(LEVELS):
        rules = [polynomial(span, level, most) for span in spans]
        if any(rule is None for rule in rules):
            return
        yield [span.segment(rule) for span, rule in zip(spans, rules, strict=True) if rule is not None]


def _far_refinements(spans: Sequence[SharedSpan], most: int) -> Iterator[list[Segment]]:
    """Nodes of products for the factors that turn the farthest, of degree 5 for the others."""
    for step in (1, 2):
        rules = [_far(span, step, most) for span in spans]
        if any(rule is None for rule in rules):
            return
        yield [span.segment(rule) for span, rule in zip(spans, rules, strict=True) if rule is not None]


def _far(span: SharedSpan, step: int, most: int) -> Nodes | None:
    turn = np.abs(span.turning).sum(axis=0)
    is_far = turn > _FAR**step * turn.max()
    far, near = np.flatnonzero(is_far), np.flatnonzero(~is_far)
    counts = [4 + step + round(2 * _GROWTH * step * w) for w in turn[far]]
    if not len(far) or not len(near) or math.prod(counts) > most:
        return None
    rest = degree_five(len(near), other=step == 1)
    if math.prod(counts) * rest.count > most:
        return None
    return side_by_side((product_rule(counts), far), (rest, near))


def polynomial(span: SharedSpan, level: int, most: int = MOST) -> Nodes | None:
    """Nodes for a span, None where they are more than ``most``.

    Of degree 5 at level 0 and, in other axes, where a product would have many nodes at level 1; then products of more
    and more nodes along each factor, the more the farther it turns the tool. Given the factors that turn, the others
    shift: the mean is linear in them, and degree 3 exact.
    """
    turn = np.abs(span.turning).sum(axis=0)
    turning, shifting = np.flatnonzero(turn), np.flatnonzero(turn == 0)
    many = 4 ** len(turning) > _PRODUCT
    rules = [(degree_three(len(shifting)), shifting)] if len(shifting) else []
    if not len(turning):
        return side_by_side(*rules)
    if level == 0 or (level == 1 and many):
        # Of degree 5 in all factors where that takes fewer nodes than degree 3 in those that shift beside it.
        both = side_by_side(*rules, (degree_five(len(turning), other=level == 1), turning))
        return min(both, degree_five(span.count, other=level == 1), key=lambda nodes: nodes.count)
    step = level - 1 if many else level
    counts = [3 + step + round(_GROWTH * step * w) for w in turn[turning]]
    if math.prod(counts) * max(1, 2 * len(shifting)) > most:
        return None
    return side_by_side(*rules, (product_rule(counts), turning))


def _sampled(
    evaluate: Callable[[Sequence[Segment]], Moments],
    spans: Sequence[SharedSpan],
    finest: Sequence[Segment],
    rival: float,
) -> Integrated:
    """Quasi-Monte Carlo, the mean of independent shifts: positive semidefinite as each of them is.

    It stops too where all its nodes will not bring its error below that of its ``rival``.
    """
    rng = np.random.default_rng(0)
    for size in _SIZES:
        drawn = [[span.segment(quasi_random(span.count, size, rng)) for span in spans] for _ in range(_BATCHES)]
        batches = [evaluate(segments) for segments in drawn]
        mean, C = (np.mean(parts, axis=0) for parts in zip(*batches, strict=True))
        squares = [relative_difference(part, C) ** 2 for _, part in batches]
        error = 2 * math.sqrt(sum(squares) / (_BATCHES * (_BATCHES - 1)))
        if error <= _ENOUGH or error * size / _SIZES[-1] > rival:
            break
    nodes = sum(segment.centre.count for segments in drawn for segment in segments)
    return Integrated(mean, C, finest, Integration("quasi-Monte Carlo", _factors(spans), nodes, error))


def _factors(spans: Sequence[SharedSpan]) -> int:
    return sum(span.count for span in spans)


def relative_difference(C: Array, reference: Array) -> float:
    """Largest relative difference of the variance along any direction in which the reference (m, m) has one."""
    variances, axes = np.linalg.eigh((reference + reference.T) / 2)
    wide = variances > RANK_TOLERANCE * max(float(variances[-1]), 0.0)
    if not wide.any():
        return 0.0
    W = axes[:, wide] / np.sqrt(variances[wide])
    return float(np.abs(np.linalg.eigvalsh(W.T @ (C - reference) @ W)).max())


def _rounding(C: Array) -> float:
    """What rounding may change the smallest variance by, relative to it."""
    variances = np.linalg.eigvalsh((C + C.T) / 2)
    wide = variances[variances > RANK_TOLERANCE * variances[-1]]
    return 1e-14 * float(wide[-1] / wide[0]) if len(wide) else 0.0
