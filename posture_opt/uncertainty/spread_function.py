"""Generated C of the spread: ``SpreadFunction`` for many postures at once, ``covariance_c`` for other programs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from posture_opt.errors import InputError, Issue
from posture_opt.model.c_source import c_source
from posture_opt.model.chain import Scalar
from posture_opt.model.compiled import LaneFunction
from posture_opt.numerics import Array
from posture_opt.uncertainty.exact_moments import Segment
from posture_opt.uncertainty.gaussian_rules import degree_five, joined, rotated
from posture_opt.uncertainty.integration import NodePlan, relative_difference, rising
from posture_opt.uncertainty.spread import HasSources, require_sources
from posture_opt.uncertainty.tool_point import Moments, ToolPoint

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
