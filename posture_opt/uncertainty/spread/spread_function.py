"""Generated C of the spread: ``SpreadFunction`` for many postures at once, ``covariance_c`` for other programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from posture_opt.errors import InputError, Issue
from posture_opt.model.c_source import c_source
from posture_opt.model.chain import Scalar
from posture_opt.model.compiled import LaneFunction
from posture_opt.numerics import Array
from posture_opt.uncertainty.moments.integration import NodePlan
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.spread.fixed_plan import MAX_UNROLLED_WALKS, plan_for_code, plan_for_rows
from posture_opt.uncertainty.spread.spread import HasSources, require_sources

_SHAPES = {"covariance": (3, 3), "first_order": (3, 3), "position": (3,), "mean": (3,)}  # parts of `Moments`


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
        self._plan = plan_for_rows(self._tool_point)
        self._wanted = compiled
        self._functions: dict[str, Callable[[Array], Array]] = {"covariance": self._function_of("covariance")}

    @property
    def method(self) -> str:
        """How the covariance is computed, as of `propagate`."""
        return self._tool_point.method

    @property
    def relative_error(self) -> float:
        """Estimate of the largest relative error of the variance in any direction at random postures; 0 if exact."""
        return self._plan.relative_error if self._plan else 0.0

    @property
    def compiled(self) -> bool:
        """Whether generated C gives the covariance."""
        function = self._functions["covariance"]
        return isinstance(function, LaneFunction) and function.compiled

    def __call__(self, Q: ArrayLike) -> Array:
        """(N, 3, 3) covariance of the tool point at postures (N, n), by `method` [m²]."""
        return self._evaluate("covariance", Q)

    def first_order(self, Q: ArrayLike) -> Array:
        """(N, 3, 3) ``J Σ Jᵀ`` at postures (N, n) [m²]."""
        return self._evaluate("first_order", Q)

    def position(self, Q: ArrayLike) -> Array:
        """(N, 3) nominal tool point in the world at postures (N, n) [m]."""
        return self._evaluate("position", Q)

    def mean(self, Q: ArrayLike) -> Array:
        """(N, 3) mean tool point in the world at postures (N, n) [m]."""
        return self._evaluate("mean", Q)

    def _evaluate(self, part: str, Q: ArrayLike) -> Array:
        """A part of the moments (N, …) at postures (N, n), or (…) at a single one (n,)."""
        postures, single = self._read_postures(Q)
        if part not in self._functions:
            self._functions[part] = self._function_of(part)
        shaped = self._functions[part](postures).reshape(-1, *_SHAPES[part])
        return shaped[0] if single else shaped

    def _function_of(self, part: str) -> Callable[[Array], Array]:
        plan = self._plan
        if plan and plan.count > MAX_UNROLLED_WALKS:
            if part in ("covariance", "mean"):
                return _NodeRows(self._tool_point, plan, part)
            plan = None
        q = ca.SX.sym("q", self._tool_point.robot.n)
        # A robot that does not move its tool point leaves numbers, which CasADi must hear of as SX.
        found = ca.SX(getattr(self._tool_point.moments(ca.vertsplit(q), plan), part))
        entries = ca.densify(ca.vec(_symmetric_expression(found) if found.is_square() else found))
        return LaneFunction(ca.Function("moments", [q], [ca.cse(entries)], ["q"], ["moments"]), compiled=self._wanted)

    def _read_postures(self, Q: ArrayLike) -> tuple[Array, bool]:
        """The postures (N, n) as floats, and whether a single one was given."""
        robot = self._tool_point.robot
        hint = f"give (N, {robot.n}) or ({robot.n},) numbers: {', '.join(robot.joint_names)} (rad, slides in m)"
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
    """A part of the moments (N, …) at rows of postures (N, n), with many nodes."""

    tool_point: ToolPoint
    plan: NodePlan
    part: str

    def __call__(self, Q: Array) -> Array:
        found = np.empty((len(Q), *_SHAPES[self.part]))
        size = max((1 << 15) // self.plan.count, 1)  # walks at once: arrays that stay in the cache
        for first in range(0, len(Q), size):
            columns = [np.ascontiguousarray(column) for column in Q[first : first + size].T]
            found[first : first + size] = getattr(self.tool_point.moments(columns, self.plan), self.part)
        return found


def _symmetric_expression(matrix: Scalar) -> ca.SX:
    """The upper half on both sides, so that each entry is computed once."""
    return ca.SX(ca.triu2symm(ca.triu(ca.SX(matrix))))


def covariance_c(problem: HasSources, name: str = "tool_covariance") -> tuple[str, str]:
    """C99 text and header of ``int name(q, position, covariance, first_order)`` for the robot of a problem. ``q`` (n)
    [rad or m]; ``position`` (3) [m], world; ``covariance`` (3 x 3) and ``first_order`` (3 x 3) [m²], world."""
    function, described = spread_expressions(problem)
    return c_source(function, name, described, rows=True)


def spread_expressions(problem: HasSources) -> tuple[ca.Function, dict[str, str]]:
    """``q -> (position, covariance, first_order)`` of `covariance_c` as a CasADi function, with what each is."""
    require_sources(problem.sources)
    tool_point = ToolPoint.of(problem.arm, problem.sources)
    q = ca.SX.sym("q", problem.arm.robot.n)
    plan = plan_for_code(tool_point)
    moments = tool_point.moments(ca.vertsplit(q), plan)
    results = [moments.position, _symmetric_expression(moments.covariance), _symmetric_expression(moments.first_order)]
    function = ca.Function("spread", [q], results, ["q"], ["position", "covariance", "first_order"])
    joints = ", ".join(f"{j.name} [{j.unit}]" for j in problem.arm.robot.joints)
    error = f" (relative error up to {plan.relative_error:.1g})" if plan else ""
    described = {
        "q": f"joint values: {joints}",
        "position": "nominal tool point in the world [m]",
        "covariance": f"of the tool point in the world [m^2], {tool_point.method}{error}",
        "first_order": "the same to first order, J Sigma J' [m^2]",
    }
    return function, described
