"""``FixedPlan``: nodes for the shared factors of correlated errors that are the same at every posture."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array
from posture_opt.uncertainty.moments.gaussian_rules import Nodes, degree_five, joined, rotated
from posture_opt.uncertainty.moments.integration import MAX_LEVELS, relative_difference
from posture_opt.uncertainty.moments.node_plan import NodePlan
from posture_opt.uncertainty.moments.tool_point import Moments, ToolPoint

MAX_UNROLLED_WALKS = 128
"""Walks along a segment that are written out: generated code of half a megabyte."""
_VARIANCE_TOLERANCE = 1e-6
"""Relative error of the variance in any direction at which no further plan is tried."""
_ENOUGH_FOR_ROWS = 2e-3
"""The same, up to which the covariances of many postures take code written out, a hundred times as fast as arrays."""
_FEWEST_PROBES, _MOST_PROBES, _PROBE_NODES = 6, 32, 100_000
"""Random postures at which the error of a plan is measured: as many as take so many nodes to integrate at."""
_ROTATION_PROBES = 32
"""Random postures at which the scatter of rotated rules is taken."""
_FEWEST_ROTATIONS = 4
"""Rotated rules of one plan; their scatter is its error."""
MAX_ARRAY_NODES = 4096
"""Nodes up to which there are products, or more rotated rules: some milliseconds a posture."""


@dataclass(frozen=True, eq=False)
class FixedPlan:
    """Nodes for shared factors that do not depend on the posture.

    Args:
        plan: None where there is a closed form.
        relative_error: estimate of the largest of the variance along any direction at random postures; 0 in closed
            form.
    """

    plan: NodePlan | None
    relative_error: float

    @property
    def count(self) -> int:
        """How many walks along the chain there are."""
        return 1 if self.plan is None else self.plan.count

    @classmethod
    def of(cls, tool_point: ToolPoint) -> FixedPlan:
        """For code that is written out: the first of some plans, the cheapest first, whose error is below 1e-6, else
        the best of them.

        It costs an integration to convergence at each of 6 to 32 postures.
        """
        return cls._first(_unrolled_plans(tool_point), _Probes.of(tool_point), _VARIANCE_TOLERANCE)

    @classmethod
    def of_rows(cls, tool_point: ToolPoint) -> FixedPlan:
        """For many postures at once: the plan for code where that is good enough, else the best of it, products with
        more nodes and `rotated` rules.
        """
        probes = _Probes.of(tool_point)
        best = cls._first(_unrolled_plans(tool_point), probes, _VARIANCE_TOLERANCE)
        if best.relative_error > _ENOUGH_FOR_ROWS:
            more = cls._first(_levels(tool_point, MAX_ARRAY_NODES), probes, _ENOUGH_FOR_ROWS)
            best = min(best, more, key=lambda either: either.relative_error)
        if best.relative_error > _ENOUGH_FOR_ROWS:
            best = min(best, cls.rotated(tool_point), key=lambda either: either.relative_error)
        return best

    @classmethod
    def _first(cls, plans: Iterable[NodePlan], probes: _Probes, goal: float) -> FixedPlan:
        """The first of some plans whose error is at most the goal, else the best of them; none in closed form."""
        best = cls(None, math.inf if probes.truth else 0.0)
        for plan in plans if probes.truth else ():
            best = min(best, cls(plan, probes.error(plan)), key=lambda either: either.relative_error)
            if best.relative_error <= goal:
                break
        return best

    @classmethod
    def rotated(cls, tool_point: ToolPoint) -> FixedPlan:
        """Several rules of degree 5 in all factors, each in random axes of its own; twice their standard error at the
        probes is the error of their mean.

        There are four rules, or more where all have fewer than 4096 nodes. What one rule leaves, of the sixth
        order in the errors, scatters from axes to axes.

        Source: A. Genz, J. Monahan, Stochastic integration rules for infinite regions, SIAM J. Sci. Comput. 19 (1998)
        426.
        """
        Q, rng = _random_postures(tool_point, _ROTATION_PROBES), np.random.default_rng(0)
        rules = [degree_five(span.count, other=True) for span in tool_point.spans]
        most = max(_FEWEST_ROTATIONS, MAX_ARRAY_NODES // sum(rule.count for rule in rules))
        drawn = [[rotated(rule, rng) for rule in rules] for _ in range(most)]
        whole = _plan_of(tool_point, [joined([one[k] for one in drawn]) for k in range(len(rules))])
        parts = [_covariances(tool_point, _plan_of(tool_point, one), Q) for one in drawn]
        squares = np.array([
            [relative_difference(C, mean) ** 2 for C, mean in zip(part, np.mean(parts, axis=0), strict=True)]
            for part in parts
        ])  # fmt: skip
        return cls(whole, float(2 * np.sqrt(squares.sum(axis=0).max() / (most * (most - 1)))))


@dataclass(frozen=True, eq=False)
class _Probes:
    """Covariances that plans are compared with: postures Q (N, n) and what an integration to convergence finds there.

    Args:
        truth: N moments; none where there is a closed form.
    """

    tool_point: ToolPoint
    Q: Array
    truth: tuple[Moments, ...]

    @classmethod
    def of(cls, tool_point: ToolPoint) -> _Probes:
        """The moments at random postures, fewer where each takes many nodes."""
        Q = _random_postures(tool_point, _MOST_PROBES if tool_point.integrated else 0)
        truth: list[Moments] = []
        nodes = 0
        while len(truth) < len(Q) and (len(truth) < _FEWEST_PROBES or nodes < _PROBE_NODES):
            truth.append(tool_point.moments([float(v) for v in Q[len(truth)]]))
            integration = truth[-1].integration
            nodes += integration.nodes if integration else 0
        return cls(tool_point, Q[: len(truth)], tuple(truth))

    def error(self, plan: NodePlan) -> float:
        """Largest relative difference of the variance along any direction, and what the probes' own may be off by."""
        found = _covariances(self.tool_point, plan, self.Q)
        errors = (relative_difference(C, exact.covariance) for C, exact in zip(found, self.truth, strict=True))
        own = (exact.integration.relative_error if exact.integration else 0.0 for exact in self.truth)
        return max(map(sum, zip(errors, own, strict=True)))


def _random_postures(tool_point: ToolPoint, count: int) -> Array:
    """(count, n) postures within the limits [rad or m], always the same ones."""
    robot = tool_point.robot
    return np.random.default_rng(0).uniform(robot.lower, robot.upper, (count, robot.n))


def _covariances(tool_point: ToolPoint, plan: NodePlan, Q: Array) -> Array:
    """(N, 3, 3) covariances at postures (N, n) with the nodes of a plan [m²]."""
    columns = [np.ascontiguousarray(column) for column in Q.T]
    return np.broadcast_to(tool_point.moments(columns, plan).covariance, (len(Q), 3, 3))


def _plan_of(tool_point: ToolPoint, rules: Sequence[Nodes]) -> NodePlan:
    """The plan of one rule for each span, no factor left out."""
    segments = tuple(span.segment(rule) for span, rule in zip(tool_point.spans, rules, strict=True))
    return NodePlan(segments, tool_point.shared.loadings[:, :0])


def _unrolled_plans(tool_point: ToolPoint) -> Iterator[NodePlan]:
    """Plans of rising cost, at most `MAX_UNROLLED_WALKS` walks each."""
    chain = tool_point.shared, tool_point.indices, tool_point.robot.factors
    few = NodePlan.few(*chain)
    yield few
    if few.straight.shape[1]:
        whole = NodePlan.few(*chain, most=tool_point.shared.count)
        if whole.count <= MAX_UNROLLED_WALKS:
            yield whole
    yield from _levels(tool_point, MAX_UNROLLED_WALKS)


def _levels(tool_point: ToolPoint, most: int) -> Iterator[NodePlan]:
    """The nodes of rising refinements for all factors, at most so many walks each."""
    for level in range(MAX_LEVELS):
        plan = NodePlan.at_level(tool_point.shared, tool_point.spans, level)
        if plan is None or plan.count > most:
            return
        yield plan
