"""Generated C of the spread: ``SpreadFunction`` for many postures at once, ``covariance_c`` for other programs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from posture_opt.errors import InputError, Issue
from posture_opt.model.c_source import c_source
from posture_opt.model.chain import Scalar
from posture_opt.model.lane_function import LaneFunction
from posture_opt.numerics import Array
from posture_opt.uncertainty.moments.integration import MAX_LEVELS, relative_difference
from posture_opt.uncertainty.moments.node_plan import NodePlan
from posture_opt.uncertainty.moments.tool_point import Moments, ToolPoint
from posture_opt.uncertainty.spread.spread import HasSources, require_sources

_VARIANCE_TOLERANCE = 1e-6
"""Relative error of the variance in any direction at which no further plan is tried."""
_MAX_WALKS = 128
"""Walks along a segment: generated code of half a megabyte."""
_PROBE_POSTURES = 6
"""Random postures at which the error of a plan is measured."""


class SpreadFunction:
    """Moments of the tool point of a problem over many postures; all numbers of the robot are compiled in.

    ``spread_at(Q)`` maps postures (N, n) [rad or m] to the covariances (N, 3, 3) [m²] of the tool point in the
    world that `propagate` gives, and one posture (n,) to one covariance (3, 3). Memory grows linearly in N;
    batches may run in threads. Correlated errors of a spatial arm are integrated at nodes that are the same at every
    posture: `relative_error` says how well.

    Args:
        problem: names ``arm`` and ``sources``.
        compiled: None compiles where a C compiler is found; False never; True or an error.

    Raises:
        InputError: no sources of error, or ``compiled=True`` and nothing could be compiled; from the calls,
            postures of another shape or not finite.

    Example:
        >>> from posture_opt import load_problem
        >>> spread_at = SpreadFunction(load_problem("insert_planar_2r"), compiled=False)
        >>> spread_at([[0.0, 0.5], [1.0, 1.0]]).shape
        (2, 3, 3)
    """

    def __init__(self, problem: HasSources, compiled: bool | None = None) -> None:
        require_sources(problem.sources)
        self._tool_point = ToolPoint.of(problem.arm, problem.sources)
        self._plan = FixedPlan.of(self._tool_point)
        self._wanted = compiled
        self._covariance = self._batch_of(lambda moments: _symmetric_expression(moments.covariance))

    @property
    def method(self) -> str:
        """How the covariance is computed, as of `propagate`."""
        return self._tool_point.method

    @property
    def relative_error(self) -> float:
        """Largest relative error of the variance along any direction found at random postures; 0 in closed form."""
        return self._plan.relative_error

    @property
    def compiled(self) -> bool:
        """Whether generated C is evaluated."""
        return self._covariance.compiled

    def __call__(self, Q: ArrayLike) -> Array:
        """(N, 3, 3) covariance of the tool point at postures (N, n), by `method` [m²]."""
        return self._evaluate_rows(self._covariance, Q, (3, 3))

    def first_order(self, Q: ArrayLike) -> Array:
        """(N, 3, 3) ``J Σ Jᵀ`` at postures (N, n) [m²]."""
        return self._evaluate_rows(self._first_order, Q, (3, 3))

    def position(self, Q: ArrayLike) -> Array:
        """(N, 3) nominal tool point in the world at postures (N, n) [m]."""
        return self._evaluate_rows(self._position, Q, (3,))

    def mean(self, Q: ArrayLike) -> Array:
        """(N, 3) mean tool point in the world at postures (N, n) [m]."""
        return self._evaluate_rows(self._mean, Q, (3,))

    @cached_property
    def _first_order(self) -> LaneFunction:
        """Rows of postures (N, n) -> entries (N, 9) of ``J Σ Jᵀ`` [m²]."""
        return self._batch_of(lambda moments: _symmetric_expression(moments.first_order))

    @cached_property
    def _position(self) -> LaneFunction:
        """Rows of postures (N, n) -> nominal tool points (N, 3) [m]."""
        return self._batch_of(lambda moments: moments.position)

    @cached_property
    def _mean(self) -> LaneFunction:
        """Rows of postures (N, n) -> mean tool points (N, 3) [m]."""
        return self._batch_of(lambda moments: moments.mean)

    def _batch_of(self, select: Callable[[Moments], Scalar]) -> LaneFunction:
        """The function of rows of postures that gives a part of the moments, column by column."""
        q = ca.SX.sym("q", self._tool_point.robot.n)
        # A robot that does not move its tool point leaves numbers, which CasADi must hear of as SX.
        entries = ca.densify(ca.SX(ca.vec(select(self._tool_point.moments(ca.vertsplit(q), self._plan.plan)))))
        return LaneFunction(ca.Function("moments", [q], [ca.cse(entries)], ["q"], ["moments"]), compiled=self._wanted)

    def _evaluate_rows(self, function: LaneFunction, Q: ArrayLike, shape: tuple[int, ...]) -> Array:
        """Values (N, …) of postures (N, n), or (…) of a single one (n,), each of the given shape."""
        postures, single = self._read_postures(Q)
        shaped = function(postures).reshape(-1, *shape)
        return shaped[0] if single else shaped

    def _read_postures(self, Q: ArrayLike) -> tuple[Array, bool]:
        """The postures (N, n) as floats, and whether a single one was given.

        Raises:
            InputError: another shape, or numbers that are not finite.
        """
        robot = self._tool_point.robot
        hint = (
            f"give (N, {robot.n}) or ({robot.n},) numbers: {', '.join(robot.joint_names)} (rad, prismatic joints in m)"
        )
        try:
            postures = np.asarray(Q, dtype=float)
        except (TypeError, ValueError):
            raise InputError(Issue("the postures are no array of numbers", ("Q",), hint=hint)) from None
        single = postures.ndim == 1
        if postures.ndim not in (1, 2) or postures.shape[-1] != robot.n:
            raise InputError(Issue(f"postures of shape {postures.shape}", ("Q",), hint=hint))
        rows = np.atleast_2d(postures)
        if not np.isfinite(rows).all():
            row = int(np.argmin(np.isfinite(rows).all(axis=1)))
            raise InputError(Issue(f"the posture in row {row} is not finite", ("Q",), rows[row].tolist(), hint))
        return rows, single


def _symmetric_expression(matrix: Scalar) -> ca.SX:
    """The matrix with its upper half on both sides, so that each entry is computed once."""
    C = ca.SX(matrix)
    return ca.SX(ca.triu2symm(ca.triu(C)))


def covariance_c(problem: HasSources, name: str = "tool_covariance") -> tuple[str, str]:
    """C99 text and header of ``int name(q, position, covariance, first_order)`` for the robot of a problem.

    ``q`` (n) [rad or m]; ``position`` (3) [m], world; ``covariance`` (3 x 3) and ``first_order`` (3 x 3) [m²], world.

    Raises:
        InputError: ``name`` is no free C identifier, or nothing is uncertain.
    """
    function, described = spread_expressions(problem)
    return c_source(function, name, described, rows=True)


def spread_expressions(problem: HasSources) -> tuple[ca.Function, dict[str, str]]:
    """``q -> (position, covariance, first_order)`` of `covariance_c` as a CasADi function, with what each is.

    Raises:
        InputError: nothing is uncertain.
    """
    require_sources(problem.sources)
    tool_point = ToolPoint.of(problem.arm, problem.sources)
    q = ca.SX.sym("q", problem.arm.robot.n)
    found = FixedPlan.of(tool_point)
    moments = tool_point.moments(ca.vertsplit(q), found.plan)
    results = [moments.position, _symmetric_expression(moments.covariance), _symmetric_expression(moments.first_order)]
    function = ca.Function("spread", [q], results, ["q"], ["position", "covariance", "first_order"])
    joints = ", ".join(f"{j.name} [{j.unit}]" for j in problem.arm.robot.joints)
    error = f" (relative error up to {found.relative_error:.1g})" if tool_point.integrated else ""
    described = {
        "q": f"joint values: {joints}",
        "position": "nominal tool point in the world [m]",
        "covariance": f"of the tool point in the world [m^2], {tool_point.method}{error}",
        "first_order": "the same to first order, J Sigma J' [m^2]",
    }
    return function, described


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
