"""Moments of what a task depends on at many postures: of the tool point, or of the worse end of a peg.

A map has thousands of postures: all of them are evaluated in one call.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.uncertainty.regions.critical import Critical
from posture_opt.uncertainty.regions.regions import deviation
from posture_opt.uncertainty.spread.peg_spread import peg_spread


@dataclass(frozen=True)
class EndMoments:
    """At N postures: covariance (N, 3, 3) [m²] and mean shift (N, 3) [m] of the end that counts, σ_max (N,) [m].

    ``position`` (N, 3) is the nominal tool point, world [m].
    """

    position: Array
    covariance: Array
    bias: Array
    sigma: Array


def end_moments(problem: OptimisationProblem, Q: Array, basis: Array, lever: Array) -> EndMoments:
    """Moments of postures Q (N, n) [rad or m] in the ``basis`` (3, m) of what counts, at targets of one ``lever``.

    Of a peg both ends are evaluated, and each posture keeps the end with the larger σ_max.
    """
    tip, part = problem.tool_point.seen_from(lever.tolist()), problem.task.part
    columns = [np.ascontiguousarray(column) for column in Q.T]
    ends = []
    for point in [tip] if part is None else [tip, part.behind(tip)]:
        moments = point.moments(columns)
        C = np.broadcast_to(moments.covariance, (len(Q), 3, 3))
        sigma = [deviation(float(np.linalg.eigvalsh(basis.T @ c @ basis)[-1]), c) for c in C]
        bias = np.broadcast_to(moments.mean - moments.position, (len(Q), 3))
        ends.append(EndMoments(np.broadcast_to(moments.position, (len(Q), 3)), C, bias, np.array(sigma)))
    if len(ends) == 1:
        return ends[0]
    worse = ends[1].sigma > ends[0].sigma
    C, bias = (
        np.where(worse.reshape(-1, *[1] * (a.ndim - 1)), b, a)
        for a, b in ((ends[0].covariance, ends[1].covariance), (ends[0].bias, ends[1].bias))
    )
    return EndMoments(ends[0].position, C, bias, np.maximum(ends[0].sigma, ends[1].sigma))


def success_with_peg(problem: OptimisationProblem, q: Array, basis: Array, target: TaskTarget) -> float | None:
    """The probability that both ends of the task's peg stay within the clearance; None without a peg or a clearance."""
    part = problem.task.part
    if part is None:
        return None
    point = problem.tool_point.seen_from(target.lever.tolist())
    moments = point.moments(q.tolist())
    C, bias = (np.asarray(v, dtype=float) for v in (moments.covariance, moments.mean - moments.position))
    tip = Critical.of(problem.task.within, basis, C, bias)
    return peg_spread(part, point, tuple(q.tolist()), (tip, basis), target.clearance).success
