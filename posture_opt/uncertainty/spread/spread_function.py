"""Generated C of the spread: ``SpreadFunction`` for many postures at once, ``covariance_c`` for other programs."""

from __future__ import annotations

from collections.abc import Callable
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
from posture_opt.uncertainty.moments.tool_point import Moments, ToolPoint
from posture_opt.uncertainty.spread.fixed_plan import MAX_UNROLLED_WALKS, FixedPlan
from posture_opt.uncertainty.spread.spread import HasSources, require_sources

_BLOCK_WALKS = 1 << 15
"""Walks along the chain that are evaluated at once: arrays that stay in the cache."""


class SpreadFunction:
    """Moments of the tool point of a problem over many postures; all numbers of the robot are compiled in.

    ``spread_at(Q)`` maps postures (N, n) [rad or m] to the covariances (N, 3, 3) [m²] of the tool point in the
    world that `propagate` gives, and one posture (n,) to one covariance (3, 3). Memory grows linearly in N;
    batches may run in threads. Correlated errors of a spatial arm are integrated at nodes that are the same at every
    posture: `relative_error` says how well. Where errors are so large that these are thousands, NumPy evaluates the
    covariance, about a microsecond a node.

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
        self._plan = FixedPlan.of_rows(self._tool_point)
        self._wanted = compiled
        self._covariance = self._integrated_batch(lambda moments: moments.covariance, (3, 3))

    @property
    def method(self) -> str:
        """How the covariance is computed, as of `propagate`."""
        return self._tool_point.method

    @property
    def relative_error(self) -> float:
        """Estimate of the largest relative error of the variance along any direction, at random postures; 0 in closed
        form.
        """
        return self._plan.relative_error

    @property
    def compiled(self) -> bool:
        """Whether generated C gives the covariance."""
        return isinstance(self._covariance, LaneFunction) and self._covariance.compiled

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
        return self._batch_of(lambda moments: moments.first_order)

    @cached_property
    def _position(self) -> LaneFunction:
        """Rows of postures (N, n) -> nominal tool points (N, 3) [m]."""
        return self._batch_of(lambda moments: moments.position)

    @cached_property
    def _mean(self) -> Callable[[Array], Array]:
        """Rows of postures (N, n) -> mean tool points (N, 3) [m]."""
        return self._integrated_batch(lambda moments: moments.mean, (3,))

    def _integrated_batch(
        self, select: Callable[[Moments], Scalar], shape: tuple[int, ...]
    ) -> Callable[[Array], Array]:
        """The function of rows of postures that gives a part of the moments, of that shape, which takes nodes."""
        many = self._plan.count > MAX_UNROLLED_WALKS
        return _NodeRows(self._tool_point, self._plan, select, shape) if many else self._batch_of(select)

    def _batch_of(self, select: Callable[[Moments], Scalar]) -> LaneFunction:
        """The function of rows of postures that gives a part of the moments, column by column."""
        q = ca.SX.sym("q", self._tool_point.robot.n)
        # A robot that does not move its tool point leaves numbers, which CasADi must hear of as SX.
        plan = self._plan.plan if self._plan.count <= MAX_UNROLLED_WALKS else None
        part = ca.SX(select(self._tool_point.moments(ca.vertsplit(q), plan)))
        entries = ca.densify(ca.vec(_symmetric_expression(part) if part.is_square() else part))
        return LaneFunction(ca.Function("moments", [q], [ca.cse(entries)], ["q"], ["moments"]), compiled=self._wanted)

    def _evaluate_rows(self, function: Callable[[Array], Array], Q: ArrayLike, shape: tuple[int, ...]) -> Array:
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


@dataclass(frozen=True, eq=False)
class _NodeRows:
    """A part of the moments (N, …) at rows of postures (N, n), with many nodes, evaluated block by block."""

    tool_point: ToolPoint
    plan: FixedPlan
    select: Callable[[Moments], Scalar]
    shape: tuple[int, ...]

    def __call__(self, Q: Array) -> Array:
        found = np.empty((len(Q), *self.shape))
        size = max(_BLOCK_WALKS // self.plan.count, 1)
        for first in range(0, len(Q), size):
            columns = [np.ascontiguousarray(column) for column in Q[first : first + size].T]
            found[first : first + size] = self.select(self.tool_point.moments(columns, self.plan.plan))
        return found


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
