"""How many nodes the shared factors of correlated errors need: as many as an error estimate asks for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from posture_opt.numerics import Array, Json
from posture_opt.robot.robot import Factor
from posture_opt.uncertainty.moments.exact_moments import Segment
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

MAX_NODES = 50_000  # of a product rule: half a second
# Relative error of the variance in any direction above which other rules than products of all factors are tried, and at
# which quasi-Monte Carlo stops.
_FALLBACK_ERROR = 1e-4

Moments = tuple[Array, Array]  # mean (m,) and covariance (m, m), of the tool point [m] or of its pose [m, rad]


@dataclass(frozen=True)
class Integration:
    """How a mean over shared factors was taken, and how far it may be off."""

    rule: Literal["polynomial", "quasi-Monte Carlo"]  # polynomial: exact up to a degree, products among them
    factors: int  # shared ones
    nodes: int  # walks along the chain that were mixed
    # Estimate of the largest relative error of the variance along any direction: the change by the last refinement, or
    # two standard errors of quasi-Monte Carlo.
    relative_error: float

    def to_json(self) -> dict[str, Json]:
        return dict(vars(self))


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
    for rules, enough in ((rising(spans, most), goal), (_far_rules(spans, most), fallback)):
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


def _far_rules(spans: Sequence[SharedSpan], most: int) -> Iterator[list[Segment]]:
    return _affordable(spans, ([_far_nodes(span, step, most) for span in spans] for step in (1, 2)))


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
