"""Which few nodes serve all postures of an arm: chosen by their error at some of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from posture_opt.uncertainty.moments.integration import LEVELS, relative_difference
from posture_opt.uncertainty.moments.node_plan import NodePlan
from posture_opt.uncertainty.moments.tool_point import ToolPoint

_GOAL = 1e-6  # relative error of the variance in any direction
_MOST = 128  # walks along a segment: generated code of half a megabyte
_PROBES = 6  # postures


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
        """The first of some plans, the cheapest first, whose error is below 1e-6, else the best of them."""
        if not tool_point.integrated:
            return cls(None, 0.0)
        robot = tool_point.robot
        Q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (_PROBES, robot.n))
        truth = [tool_point.moments([float(v) for v in q]).covariance for q in Q]
        columns = [np.ascontiguousarray(column) for column in Q.T]
        best = cls(None, np.inf)
        for plan in _plans(tool_point):
            found = np.broadcast_to(tool_point.moments(columns, plan).covariance, (_PROBES, 3, 3))
            error = max(relative_difference(C, exact) for C, exact in zip(found, truth, strict=True))
            best = min(best, cls(plan, error), key=lambda either: either.relative_error)
            if error <= _GOAL:
                break
        return best


def _plans(tool_point: ToolPoint) -> Iterator[NodePlan]:
    chain = tool_point.shared, tool_point.indices, tool_point.robot.factors
    few = NodePlan.few(*chain)
    yield few
    if few.straight.shape[1] and (whole := NodePlan.few(*chain, most=tool_point.shared.count)).count <= _MOST:
        yield whole
    for level in range(LEVELS):
        plan = NodePlan.at_level(tool_point.shared, tool_point.spans, level)
        if plan is None or plan.count > _MOST:
            return
        yield plan
