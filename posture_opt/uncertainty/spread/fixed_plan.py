"""Nodes for the shared factors of correlated errors that are the same at every posture, chosen by their error there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from posture_opt.numerics import Array
from posture_opt.uncertainty.moments.exact_moments import Segment
from posture_opt.uncertainty.moments.gaussian_rules import degree_five, joined, rotated
from posture_opt.uncertainty.moments.integration import NodePlan, relative_difference, rising
from posture_opt.uncertainty.moments.tool_point import Moments, ToolPoint

MAX_UNROLLED_WALKS = 128  # along a segment, written out: generated code of half a megabyte
_ENOUGH = 1e-6  # relative error of the variance in any direction at which no further plan is tried
_ENOUGH_FOR_ROWS = 2e-3  # up to which many postures take code written out, a hundred times as fast as arrays
_MAX_ARRAY_NODES = 4096  # of products and rotated rules: some milliseconds a posture


def plan_for_code(tool_point: ToolPoint) -> NodePlan | None:
    """For code that is written out: the cheapest plan whose error is below 1e-6, else the best; None in closed form.

    It costs an integration to convergence at each of 6 to 32 postures.
    """
    if not tool_point.integrated:
        return None
    return _best_of(_unrolled_plans(tool_point), _Probes.of(tool_point), _ENOUGH)


def plan_for_rows(tool_point: ToolPoint) -> NodePlan | None:
    """For many postures at once: the plan for code where that is good enough, else more nodes or `rotated` rules."""
    if not tool_point.integrated:
        return None
    probes = _Probes.of(tool_point)
    best = _best_of(_unrolled_plans(tool_point), probes, _ENOUGH)
    if best.relative_error > _ENOUGH_FOR_ROWS:
        best = _best_of(chain([best], _levels(tool_point, _MAX_ARRAY_NODES)), probes, _ENOUGH_FOR_ROWS)
    if best.relative_error > _ENOUGH_FOR_ROWS:
        best = min(best, _rotated_plan(tool_point), key=lambda plan: plan.relative_error)
    return best


def _best_of(plans: Iterable[NodePlan], probes: _Probes, goal: float) -> NodePlan:
    """The first of some plans whose error is at most the goal, else the best of them."""
    found: list[NodePlan] = []
    for plan in plans:
        known = plan.relative_error >= 0  # NaN before it is measured
        found.append(plan if known else replace(plan, relative_error=probes.error(plan)))
        if found[-1].relative_error <= goal:
            break
    return min(found, key=lambda plan: plan.relative_error)


def _rotated_plan(tool_point: ToolPoint) -> NodePlan:
    """Four or more rules of degree 5 in all factors, each in random axes of its own, at most 4096 nodes in all.

    What one rule leaves, of the sixth order in the errors, scatters from axes to axes: twice the standard error at the
    probes is the error of the mean. Source: A. Genz, J. Monahan, Stochastic integration rules for infinite regions,
    SIAM J. Sci. Comput. 19 (1998) 426.
    """
    Q, rng = _random_postures(tool_point, 32), np.random.default_rng(0)
    rules = [degree_five(span.count, other=True) for span in tool_point.spans]
    most = max(4, _MAX_ARRAY_NODES // sum(rule.count for rule in rules))
    drawn = [[rotated(rule, rng) for rule in rules] for _ in range(most)]
    plans = [
        _whole_plan(tool_point, [span.segment(rule) for span, rule in zip(tool_point.spans, one, strict=True)])
        for one in (*drawn, [joined(rotations) for rotations in zip(*drawn, strict=True)])
    ]
    parts = [_covariances(tool_point, plan, Q) for plan in plans[:-1]]
    means = np.mean(parts, axis=0)
    squares = np.array([[relative_difference(*pair) ** 2 for pair in zip(part, means, strict=True)] for part in parts])
    error = float(2 * np.sqrt(squares.sum(axis=0).max() / (most * (most - 1))))
    return replace(plans[-1], relative_error=error)


@dataclass(frozen=True, eq=False)
class _Probes:
    """Random postures Q (N, n) and what an integration to convergence finds there: plans are compared with it."""

    tool_point: ToolPoint
    Q: Array
    truth: tuple[Moments, ...]

    @classmethod
    def of(cls, tool_point: ToolPoint) -> _Probes:
        """Six to 32 postures, fewer where each takes many nodes."""
        Q, truth, nodes = _random_postures(tool_point, 32), list[Moments](), 0
        while len(truth) < len(Q) and (len(truth) < 6 or nodes < 100_000):
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


def _whole_plan(tool_point: ToolPoint, segments: Sequence[Segment]) -> NodePlan:
    return NodePlan(segments, tool_point.shared.loadings[:, :0])


def _unrolled_plans(tool_point: ToolPoint) -> Iterator[NodePlan]:
    """Plans of rising cost."""
    split = tool_point.shared, tool_point.indices, tool_point.robot.factors
    few = NodePlan.few(*split)
    yield few
    if few.straight.shape[1]:
        whole = NodePlan.few(*split, most=tool_point.shared.count)
        if whole.count <= MAX_UNROLLED_WALKS:
            yield whole
    yield from _levels(tool_point, MAX_UNROLLED_WALKS)


def _levels(tool_point: ToolPoint, most: int) -> Iterator[NodePlan]:
    """Rising refinements for all factors, at most so many walks each."""
    for segments in rising(tool_point.spans):
        plan = _whole_plan(tool_point, segments)
        if plan.count > most:
            return
        yield plan
