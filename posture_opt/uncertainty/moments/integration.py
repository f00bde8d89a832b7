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

VARIANCE_TOLERANCE = 1e-8
"""Relative error of the variance in any direction at which no more nodes are tried."""
_FALLBACK_ERROR = 1e-4
"""The same, above which other rules are tried where products of all factors have too many nodes."""
_FAR_TURN_SHARE = 0.3
"""Of the farthest turn: factors that turn less far have degree 5, combined with products of the others."""
_SAMPLED_TOLERANCE = 1e-4
"""Relative error at which quasi-Monte Carlo stops."""
MAX_NODES = 50_000
"""Nodes of a product rule: half a second."""
_MAX_PRODUCT_NODES = 1100
"""Nodes of a product of four each, above which another rule of degree 5 is tried before it."""
MAX_LEVELS = 12
"""Levels of refinement."""
_NODES_PER_RADIAN = 1.5
"""Nodes more along a factor at each level, for each radian by which it turns the tool."""
_SHIFT_COUNT = 8
"""Independent shifts of a quasi-Monte Carlo rule, whose scatter is its error."""
_SAMPLE_SIZES = (512, 4096, 16384)
"""Nodes of each shift, tried in turn."""

Moments = tuple[Array, Array]
"""Mean (m,) and covariance (m, m), of the tool point [m] or of its pose [m, rad]."""


@dataclass(frozen=True)
class Integration:
    """How a mean over shared factors was taken, and how far it may be off.

    Args:
        rule: ``polynomial`` for nodes that are exact up to a degree, products of Gauss-Hermite rules among them.
        factors: how many shared factors there are.
        nodes: how many walks along the chain were mixed.
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
        """r, how many factors there are."""
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
    return [_shared_span(split, indices, factors, *parts) for parts in joined]


def _shared_span(
    split: SharedFactors, indices: Sequence[int], factors: Sequence[Factor], first: int, last: int, columns: list[int]
) -> SharedSpan:
    """The span of the factors ``columns``, from the first to the last place in the chain at which they act."""
    L = split.loadings[:, columns]
    rows = np.flatnonzero(L.any(axis=1)).tolist()
    turning = [k for k in rows if factors[indices[k]].kind == "rotate"]
    return SharedSpan(first, last, {indices[k]: L[k] for k in rows}, L[turning], tuple(columns))


@dataclass(frozen=True, eq=False)
class Integrated:
    """Moments mixed over shared factors.

    Args:
        mean: (m,) [m, rad].
        covariance: (m, m) [m², rad²].
        segments: the nodes of the last rule of rising degree.
        integration: how good they are.
    """

    mean: Array
    covariance: Array
    segments: Sequence[Segment]
    integration: Integration


def converged(
    evaluate: Callable[[Sequence[Segment]], Moments],
    spans: Sequence[SharedSpan],
    goal: float = VARIANCE_TOLERANCE,
    most: int = MAX_NODES,
) -> Integrated:
    """The moments of the tool point with as many nodes as their own error estimate asks for.

    Rules of rising degree are tried until a refinement changes the variance along no direction by more than ``goal``,
    or by what rounding leaves of the smallest. Where the error is above 1e-4 as ``most`` nodes are reached, the
    factors that turn the tool the farthest get more nodes than the others, and if that does not do, quasi-Monte
    Carlo is tried too, and the answer is the one with the smaller error. Its ``segments`` are in any case those
    of the last rule of rising degree.

    Args:
        evaluate: moments with given nodes.
        spans: apart from each other.
        goal: relative error of the variance along any direction.
        most: nodes of one rule.
    """
    found: Moments | None = None
    error, finest = math.inf, list[Segment]()
    for refinements, enough in ((_refined_segments, goal), (_far_refinements, max(goal, _FALLBACK_ERROR))):
        if found is not None and error <= enough + _rounding_error(found[1]):
            break
        for segments in refinements(spans, most):
            finer = evaluate(segments)
            error = math.inf if found is None else relative_difference(found[1], finer[1])
            found, finest = finer, segments
            if error <= enough + _rounding_error(finer[1]):
                break
    assert found is not None, "the coarsest rules are always affordable"
    nodes = sum(segment.centre.count for segment in finest)
    answer = Integrated(*found, finest, Integration("polynomial", _factor_count(spans), nodes, error))
    if error <= max(goal, _FALLBACK_ERROR):
        return answer
    return min(
        answer, _sampled_moments(evaluate, spans, finest, error), key=lambda either: either.integration.relative_error
    )


def _refined_segments(spans: Sequence[SharedSpan], most: int) -> Iterator[list[Segment]]:
    """Nodes of rising degree for all spans, while they can be afforded."""
    for level in range(MAX_LEVELS):
        rules = [polynomial(span, level, most) for span in spans]
        if any(rule is None for rule in rules):
            return
        yield [span.segment(rule) for span, rule in zip(spans, rules, strict=True) if rule is not None]


def _far_refinements(spans: Sequence[SharedSpan], most: int) -> Iterator[list[Segment]]:
    """Nodes of products for the factors that turn the farthest, of degree 5 for the others."""
    for step in (1, 2):
        rules = [_far_nodes(span, step, most) for span in spans]
        if any(rule is None for rule in rules):
            return
        yield [span.segment(rule) for span, rule in zip(spans, rules, strict=True) if rule is not None]


def _far_nodes(span: SharedSpan, step: int, most: int) -> Nodes | None:
    """Nodes of products for the factors that turn farther than a share of the farthest; None where they are too
    many.
    """
    turn = np.abs(span.turning).sum(axis=0)
    is_far = turn > _FAR_TURN_SHARE**step * turn.max()
    far, near = np.flatnonzero(is_far), np.flatnonzero(~is_far)
    counts = [4 + step + round(2 * _NODES_PER_RADIAN * step * w) for w in turn[far]]
    if not len(far) or not len(near) or math.prod(counts) > most:
        return None
    rest = degree_five(len(near), other=step == 1)
    if math.prod(counts) * rest.count > most:
        return None
    return side_by_side((product_rule(counts), far), (rest, near))


def polynomial(span: SharedSpan, level: int, most: int = MAX_NODES) -> Nodes | None:
    """Nodes for a span, None where they are more than ``most``.

    Of degree 5 at level 0 and, in other axes, where a product would have many nodes at level 1; then products of more
    and more nodes along each factor, the more the farther it turns the tool. Given the factors that turn, the others
    shift: the mean is linear in them, and degree 3 exact.
    """
    turn = np.abs(span.turning).sum(axis=0)
    turning, shifting = np.flatnonzero(turn), np.flatnonzero(turn == 0)
    many = 4 ** len(turning) > _MAX_PRODUCT_NODES
    rules = [(degree_three(len(shifting)), shifting)] if len(shifting) else []
    if not len(turning):
        return side_by_side(*rules)
    if level == 0 or (level == 1 and many):
        # Of degree 5 in all factors where that takes fewer nodes than degree 3 in those that shift.
        both = side_by_side(*rules, (degree_five(len(turning), other=level == 1), turning))
        return min(both, degree_five(span.count, other=level == 1), key=lambda nodes: nodes.count)
    step = level - 1 if many else level
    counts = [3 + step + round(_NODES_PER_RADIAN * step * w) for w in turn[turning]]
    if math.prod(counts) * max(1, 2 * len(shifting)) > most:
        return None
    return side_by_side(*rules, (product_rule(counts), turning))


def _sampled_moments(
    evaluate: Callable[[Sequence[Segment]], Moments],
    spans: Sequence[SharedSpan],
    finest: Sequence[Segment],
    rival: float,
) -> Integrated:
    """Quasi-Monte Carlo, the mean of independent shifts: positive semidefinite as each of them is.

    It stops too where all its nodes will not bring its error below that of its ``rival``.

    Args:
        evaluate: moments with given nodes.
        spans: apart from each other.
        finest: segments of the last polynomial rule, which the answer keeps.
        rival: relative error of that rule.
    """
    rng = np.random.default_rng(0)
    for size in _SAMPLE_SIZES:
        drawn = [[span.segment(quasi_random(span.count, size, rng)) for span in spans] for _ in range(_SHIFT_COUNT)]
        batches = [evaluate(segments) for segments in drawn]
        mean, C = (np.mean(parts, axis=0) for parts in zip(*batches, strict=True))
        squares = [relative_difference(part, C) ** 2 for _, part in batches]
        error = 2 * math.sqrt(sum(squares) / (_SHIFT_COUNT * (_SHIFT_COUNT - 1)))
        if error <= _SAMPLED_TOLERANCE or error * size / _SAMPLE_SIZES[-1] > rival:
            break
    nodes = sum(segment.centre.count for segments in drawn for segment in segments)
    return Integrated(mean, C, finest, Integration("quasi-Monte Carlo", _factor_count(spans), nodes, error))


def _factor_count(spans: Sequence[SharedSpan]) -> int:
    """How many shared factors all spans have."""
    return sum(span.count for span in spans)


def relative_difference(C: Array, reference: Array) -> float:
    """Largest relative difference of the variance along any direction in which the reference has one.

    ``max |uᵀ (C − R) u / uᵀ R u|``: the largest eigenvalue of ``R^-½ (C − R) R^-½`` in size, on the range of R.

    Args:
        C, reference: (m, m), in the same units.
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
