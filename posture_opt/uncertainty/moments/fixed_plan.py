"""Which few nodes serve all postures of an arm: chosen by their error at some of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from posture_opt.uncertainty.moments.integration import MAX_LEVELS, relative_difference
from posture_opt.uncertainty.moments.node_plan import NodePlan
from posture_opt.uncertainty.moments.tool_point import ToolPoint

_VARIANCE_TOLERANCE = 1e-6
"""Relative error of the variance in any direction at which no further plan is tried."""
_MAX_WALKS = 128
"""Walks along a segment: generated code of half a megabyte."""
_PROBE_POSTURES = 6
"""Random postures at which the error of a plan is measured."""


@dataclass(frozen=True, eq=False)
class FixedPlan:
    """Nodes for shared factors that do not depend on the posture.

    Args:
        plan: None where there is a closed form.
        relative_error: the largest of the variance along any direction that was found at random postures; 0 in closed
            form.
    """

    plan: NodePlan | None
    relative_error: float

    @classmethod
    def of(cls, tool_point: ToolPoint) -> FixedPlan:
        """The first of some plans, the cheapest first, whose error is below 1e-6, else the best of them.

        It costs an integration to convergence at each of `_PROBE_POSTURES` postures.
        """
        if not tool_point.integrated:
            return cls(None, 0.0)
        robot = tool_point.robot
        Q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (_PROBE_POSTURES, robot.n))
        truth = [tool_point.moments([float(v) for v in q]).covariance for q in Q]
        columns = [np.ascontiguousarray(column) for column in Q.T]
        best = cls(None, np.inf)
        for plan in _candidate_plans(tool_point):
            found = np.broadcast_to(tool_point.moments(columns, plan).covariance, (_PROBE_POSTURES, 3, 3))
            error = max(relative_difference(C, exact) for C, exact in zip(found, truth, strict=True))
            best = min(best, cls(plan, error), key=lambda either: either.relative_error)
            if error <= _VARIANCE_TOLERANCE:
                break
        return best


def _candidate_plans(tool_point: ToolPoint) -> Iterator[NodePlan]:
    """Plans of rising cost, at most `_MAX_WALKS` walks each."""
    chain = tool_point.shared, tool_point.indices, tool_point.robot.factors
    few = NodePlan.few(*chain)
    yield few
    if few.straight.shape[1] and (whole := NodePlan.few(*chain, most=tool_point.shared.count)).count <= _MAX_WALKS:
        yield whole
    for level in range(MAX_LEVELS):
        plan = NodePlan.at_level(tool_point.shared, tool_point.spans, level)
        if plan is None or plan.count > _MAX_WALKS:
            return
        yield plan
