"""``StationsProblem``: the postures of several stations and the placement of what they stand on, chosen together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array, DerivedAgain, Mask
from posture_opt.selection.answer.placement import combined_success, combined_symbols
from posture_opt.selection.program.nlp import NonlinearSolver
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import SIZES, TaskTarget, turned_about_z
from posture_opt.selection.tasks.workpiece import Combine
from posture_opt.uncertainty.pose_covariance import covariance_root
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.success_of_all import ErrorParts


@dataclass(frozen=True, eq=False)
class StationErrors(DerivedAgain):
    """Errors of the tool point in the m directions that count, over the clearance: symbols and numbers of one graph."""

    problem: OptimisationProblem
    sources: Sources  # whose constant part, of r errors, is one draw for all stations

    @cached_property
    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Bias (m, 1), shift (m, r) by standard normals that stay, whole covariance (m, m), over the clearance."""
        at = self.problem.quantities
        C, bias = at.projected(at.within)
        shared = at.bases[at.within].T @ self._columns @ ca.DM(self._root)
        return bias / at.clearance, shared / at.clearance, C / at.clearance**2

    @cached_property
    def _columns(self) -> ca.SX:
        """(3, k) shift of the tool point by one unit of each source [m per SI unit], world."""
        at = self.problem.quantities
        point, q = at.tool_point, ca.vertsplit(at.q)
        J = ca.SX(point.jacobian(at.walk))
        return J if point.linear is None else ca.horzcat(J, ca.SX(point.linear_columns(q, at.walk)))

    @cached_property
    def _root(self) -> Array:
        """(k, r) root of the covariance of the errors that stay."""
        point, sources = self.problem.tool_point, self.sources
        names = point.names if point.linear is None else (*point.names, *point.linear.names)
        index = {name: k for k, name in enumerate(sources.names)}
        known = [i for i, name in enumerate(names) if name in index and sources.constant[index[name], index[name]] > 0]
        rows = [index[names[i]] for i in known]
        root = np.zeros((len(names), len(known)))
        root[known] = covariance_root(sources.constant[np.ix_(rows, rows)])
        return root

    @cached_property
    def _numbers(self) -> BatchFunction:
        """Postures (N, n) and parameters (N, p) to the flat symbols."""
        nlp = self.problem.nlp
        flat = ca.vertcat(*(ca.vec(part) for part in self.symbols))
        return BatchFunction(ca.Function("station_errors", [nlp.x, nlp.p], [ca.densify(flat)]), compiled=False)

    def at(self, Q: Array, parameters: Array) -> ErrorParts:
        """Parts at postures Q (N, n), each at its target of ``parameters`` (N, p)."""
        (m, r), flat = self.symbols[1].shape, self._numbers(Q, parameters)
        bias, shared, C = np.split(flat, [m, m + m * r], axis=1)
        return ErrorParts.of(bias, shared.reshape(-1, r, m).swapaxes(1, 2), C.reshape(-1, m, m))

    def success(self, delta: Array) -> ca.Function:
        """``(x, p) -> (N, 1)`` probability given the draws ``delta`` (N, r), smooth in both."""
        nlp, (bias, shared, C) = self.problem.nlp, self.symbols
        m, r = shared.shape
        b, A, S = ca.SX.sym("b", m), ca.SX.sym("A", m, r), ca.SX.sym("S", m, m)
        mean = ca.repmat(b, 1, len(delta)) + A @ ca.DM(delta.T)
        conditional = ca.Function("given_draws", [b, A, S], [_within(mean, S).T])
        # Of the clearance: narrower scatter is neither smooth in the draws nor seen by the nodes.
        scatter = C - shared @ shared.T + 0.15**2 * ca.SX.eye(m)
        parts = ca.Function("parts", [nlp.x, nlp.p], [ca.densify(v) for v in (bias, shared, scatter)])
        x, p = ca.MX.sym("x", nlp.x.shape[0]), ca.MX.sym("p", nlp.p.shape[0])
        return ca.Function("success", [x, p], [conditional(*parts(x, p))])


def _within(mean: ca.SX, covariance: ca.SX) -> ca.SX:
    """(1, N) ``∫ φ(x) [Φ((h − μ)/σ) − Φ((−h − μ)/σ)] dx`` in the unit circle, ``x = sin θ``, ``h = cos θ``."""
    s = ca.sqrt(covariance[0, 0])
    if mean.shape[0] == 1:
        return _between(1.0, mean, s)
    slope = covariance[1, 0] / covariance[0, 0]
    sigma = ca.sqrt(covariance[1, 1] - slope * covariance[1, 0])
    total = ca.SX(1, mean.shape[1])
    for node, weight in zip(*np.polynomial.legendre.leggauss(16), strict=True):
        x, h = math.sin(node * math.pi / 2), math.cos(node * math.pi / 2)
        away = x - mean[0, :]
        density = ca.exp(-((away / s) ** 2) / 2) / (math.sqrt(2 * math.pi) * s)
        total += weight * math.pi / 2 * h * density * _between(h, mean[1, :] + slope * away, sigma)
    return total


def _between(half: float, mu: ca.SX, sigma: ca.SX) -> ca.SX:
    root = math.sqrt(2) * sigma
    return (ca.erf((half - mu) / root) + ca.erf((half + mu) / root)) / 2


class StationFunction:
    """``(w, q, c) -> (f, extra, g)``: first and further terms, rows between constant ends, ``c`` moved by w."""

    def __init__(self, problem: OptimisationProblem, first: ca.Function | None = None) -> None:
        nlp, parts = problem.nlp, _constant_rows(problem)
        extra = sum((expression for _, expression in nlp.terms[1:]), ca.SX(0))
        rows = ca.vertcat(ca.SX(0, 1), *(expression for expression, _, _ in parts))
        at_target = ca.Function("at_target", [nlp.x, nlp.p], [nlp.terms[0][1], extra, rows])
        kind: Any = ca.SX if first is None else ca.MX
        w, q, c = (kind.sym(name, size) for name, size in zip("wqc", (4, nlp.x.numel(), nlp.p.numel()), strict=True))
        moved = moved_parameters(c, w)
        outputs = list(at_target(q, moved))
        outputs[0] = outputs[0] if first is None else first(q, moved)
        self.call: ca.Function = ca.Function("station", [w, q, c], [ca.densify(output) for output in outputs])
        self.ends: tuple[Array, Array] = (
            np.array([low for _, low, _ in parts]),
            np.array([high for *_, high in parts]),
        )


def moved_parameters(c: Any, w: Any) -> Any:
    """Parameters of a target in the frame of the workpiece that stands at w (4,), world; SX or MX."""
    parts, at = [], 0
    for name, size in SIZES.items():
        part = c[at : at + size]
        at += size
        if size == 3:
            part = turned_about_z(part, ca.cos(w[3]), ca.sin(w[3]))
            part = part + w[:3] if name in ("lower", "upper") else part  # the others are directions
        parts.append(part)
    return ca.vertcat(*parts)


def _constant_rows(problem: OptimisationProblem) -> list[tuple[ca.SX, float, float]]:
    parts: list[tuple[ca.SX, float, float]] = []
    for row in problem.nlp.rows:
        if ca.is_equal(row.lower, row.upper, 2):
            parts.append((row.expression - row.lower, 0.0, 0.0))
            continue
        for bound, low, high in ((row.lower, 0.0, np.inf), (row.upper, -np.inf, 0.0)):
            if not (bound.is_constant() and np.isinf(float(bound))):
                parts.append((row.expression - bound, low, high))
    off, slack = problem.nlp.p[:3] - ca.DM(problem.reach.offset), float(problem.reach.plane_slack)
    return parts + [(ca.dot(ca.DM(normal), off), -slack, slack) for normal in problem.reach.normals.T]


_BEFORE_POSTURES = 5
"""Variables before the postures: the placement (4,) and the level that is minimised."""
BARRIER = 1e-3
"""Barrier that IPOPT starts with: starts are feasible and good, but the placement has a way to go."""
_OPTIONS = {
    "ipopt.tol": 1e-7, "ipopt.constr_viol_tol": 1e-9, "ipopt.bound_push": 1e-6, "ipopt.bound_frac": 1e-6,
    "ipopt.acceptable_iter": 0, "ipopt.fixed_variable_treatment": "make_parameter",
}  # fmt: skip
_AVERAGE_OPTIONS = {"ipopt.hessian_approximation": "limited-memory", "ipopt.tol": 1e-4}
"""Of an average over draws: nearer to its optimum is not nearer to that of the probability."""


@dataclass(frozen=True)
class Station:
    """One target in the frame of the workpiece, and the optimisation problem of a point that serves it."""

    optimisation_problem: OptimisationProblem
    target: TaskTarget


@dataclass(frozen=True)
class StationsPoint:
    """A placement w (4,) [m, rad] and a posture for each station Q (K, n) [rad or m]."""

    w: Array
    Q: Array


@dataclass(frozen=True)
class StationsOutcome:
    """Where one solve ended."""

    point: StationsPoint
    objective: float
    violation: float  # of the worst row
    optimal: bool
    iterations: int
    residual: float  # the largest one of the optimality conditions, scaled


@dataclass(frozen=True)
class StationSteps:
    """The S steps between K stations, S = K − 1, or S = K where they are closed."""

    counted: Mask  # (n,) joints whose steps count; the others stay where a solve starts
    parts: Array  # (S,) how many times each step counts where steps are compared with each other
    closed: bool = False  # whether a last step leads back to the first posture, or whole turns away from it


@dataclass(frozen=True, eq=False)
class SharedSuccess:
    """Errors that move all stations at once, for the probability that all succeed."""

    sources: Sources  # whose constant part stays
    delta: Array  # (N, r) draws of it that the probability is averaged over


@dataclass(frozen=True)
class _Program:
    """A solver with its rows and the level (its objective without ties) as functions of ``(x, p)``."""

    solver: NonlinearSolver
    rows: ca.Function
    level: ca.Function
    bounded: int = 0  # how many of the last rows are steps, between bounds that each solve has


@dataclass(frozen=True, eq=False)
class StationsProblem(DerivedAgain):
    """``min over w, q_1 … q_K`` of combined objectives, ``|q_{k+1} − q_k| ≤ most_k``; worst: ``min t``, ``f_k ≤ t``."""

    stations: tuple[Station, ...]  # K of them, with one scale
    lower: Array  # lower, upper: (4,) of the placement; equal where a coordinate is fixed
    upper: Array
    combine: Combine = "worst"  # as of `combined_symbols`; worst where there are steps
    steps: StationSteps | None = None  # between neighbours; None where each posture is free of the others
    max_iterations: int = 300
    barrier: float = BARRIER  # that IPOPT starts with, less where the start is nearly the optimum
    shared: SharedSuccess | None = None  # errors that the stations share, where what counts is that all succeed

    def solve(self, start: StationsPoint, most: Array | float = np.inf) -> StationsOutcome:
        """Local optimum near a start; steps up to ``most`` (S, n) [rad or m].

        Where they are closed the start ends in its first posture again, or whole turns away; this has no variables.
        """
        return self._solved(self._least_objective, start, most=most)

    def least_step(self, start: StationsPoint, weights: Array) -> StationsOutcome:
        """Postures of least largest step, weighted by ``weights`` (S, n), whatever the objectives."""
        return self._solved(self._least_step, start, weights=weights)

    def _solved(
        self, program: _Program, start: StationsPoint, most: Array | float = np.inf, weights: Array | float = 0.0
    ) -> StationsOutcome:
        Q = np.asarray(start.Q, dtype=float)
        turns, closed = np.zeros(Q.shape[1]), self.steps is not None and self.steps.closed
        if closed:
            turns, Q = Q[-1] - Q[0], Q[:-1]
        lower, upper = self._variable_ends(Q, turns)
        p = self._step_parameters(weights, turns)
        x0 = np.concatenate([np.clip(start.w, self.lower, self.upper), [0.0], Q.ravel()])
        x0[4] = np.clip(float(program.level(x0, p)), lower[4], upper[4])
        row_lower, row_upper = self._row_ends(program, most)
        ends = lower, upper, row_lower, row_upper
        found = program.solver.solve(x0, *ends, p=p)
        x = np.clip(found.x, lower, upper)
        g = np.asarray(program.rows(x, p)).ravel()
        violation = float(np.max(np.maximum(row_lower - g, g - row_upper), initial=0.0))
        residual = program.solver.residual(replace(found, x=x), *ends, p=p) if found.optimal else np.inf
        Q, level = x[_BEFORE_POSTURES:].reshape(Q.shape), float(program.level(x, p))
        point = StationsPoint(x[:4], np.vstack([Q, Q[0] + turns]) if closed else Q)
        return StationsOutcome(point, level, violation, found.optimal, found.iterations, residual)

    def _variable_ends(self, Q: Array, turns: Array | float) -> tuple[Array, Array]:
        robot, level = self.stations[0].optimisation_problem.robot, np.inf if self.combine == "worst" else 0.0
        idle = np.zeros(robot.n, dtype=bool) if self.steps is None else ~self.steps.counted
        low, high = (np.where(idle, Q, np.asarray(ends)) for ends in (robot.lower, robot.upper))
        low[0], high[0] = np.maximum(low[0], low[0] - turns), np.minimum(high[0], high[0] - turns)
        return np.concatenate([self.lower, [-level], low.ravel()]), np.concatenate([self.upper, [level], high.ravel()])

    def _row_ends(self, program: _Program, most: Array | float) -> tuple[Array, Array]:
        lower, upper = (np.concatenate([np.tile(f.ends[i], len(of)) for f, of in self._functions]) for i in (0, 1))
        others = int(program.rows.numel_out(0)) - len(lower) - program.bounded
        bounds = np.zeros(0)
        if self.steps is not None and program.bounded:
            shape = len(self.steps.parts), len(self.steps.counted)
            bounds = np.broadcast_to(most, shape)[:, self.steps.counted].ravel()
        upper = np.concatenate([upper, np.full(others, np.inf), bounds])
        return np.concatenate([lower, np.zeros(others), -bounds]), upper

    def _step_parameters(self, weights: Array | float, turns: Array | float) -> Array:
        if self.steps is None:
            return np.zeros(0)
        n, counted = len(self.steps.counted), self.steps.counted
        each = np.broadcast_to(weights, (len(self.steps.parts), n))[:, counted]
        return np.concatenate([np.broadcast_to(turns, n)[counted], each.ravel()])

    @cached_property
    def _least_objective(self) -> _Program:
        x, p, main, extra, rows = self._expressions
        shared = self.shared is not None
        objective = combined_success(main, extra) if shared else combined_symbols(self.combine, main, extra)
        if shared or self.combine != "worst":
            return self._program(x, p, objective, objective, rows)
        level, values = x[4], main + extra
        rows = [*rows, level - values]
        if self.steps is None:
            return self._program(x, p, level, objective, rows)
        moved, parts = self._moved(x, p, self.steps), ca.DM(np.asarray(self.steps.parts, dtype=float)).T
        even = moved * ca.repmat(parts, moved.shape[0], 1)
        # Stations that are not the worst are good too, and of equal motions there is one.
        tie = 1e-4 * ca.sum1(values) / len(self.stations) + 1e-4 * ca.sumsqr(even) / even.shape[1]
        return self._program(x, p, level + tie, objective, [*rows, ca.vec(moved)], int(moved.numel()))

    @cached_property
    def _least_step(self) -> _Program:
        assert self.steps is not None, "stations that are not joined have no steps"
        x, p, main, extra, rows = self._expressions
        weights, level = ca.reshape(p[int(self.steps.counted.sum()) :], -1, len(self.steps.parts)), x[4]
        moved = self._moved(x, p, self.steps) * weights
        mean = ca.sum1(main + extra) / len(self.stations) + ca.sumsqr(moved) / moved.shape[1]
        step = ca.mmax(ca.fabs(ca.vec(moved)))
        rows = [*rows, ca.vec(level - moved), ca.vec(level + moved)]
        return self._program(x, p, level + 1e-8 * mean, step, rows)

    def _program(
        self, x: ca.MX, p: ca.MX, objective: ca.MX, level: ca.MX, rows: Sequence[ca.MX], bounded: int = 0
    ) -> _Program:
        g = ca.vertcat(*rows)
        # The second derivatives of an average over draws cost more than the iterations that they save.
        approximate = {} if self.shared is None else _AVERAGE_OPTIONS
        options = {**_OPTIONS, **approximate, "ipopt.max_iter": self.max_iterations, "ipopt.mu_init": self.barrier}
        solver = NonlinearSolver("stations", {"x": x, "p": p, "f": objective, "g": g}, options)
        return _Program(solver, ca.Function("rows", [x, p], [g]), ca.Function("level", [x, p], [level]), bounded)

    @cached_property
    def _expressions(self) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX, list[ca.MX]]:
        """Variables, parameters, first terms (K, 1) or (K, N) given draws, further terms (K, 1), rows."""
        n, K = self.stations[0].optimisation_problem.robot.n, len(self.stations)
        x, p = ca.MX.sym("x", _BEFORE_POSTURES + n * K), ca.MX.sym("p", len(self._step_parameters(0.0, 0.0)))
        parts = []
        for function, of in self._functions:
            parameters = ca.DM(np.array([self.stations[k].target.parameters for k in of]).T)
            mapped = function.call.map("stations", "serial", len(of), [0], [])
            parts.append(mapped(x[:4], self._postures(x)[:, of], parameters))
        main, extra = (ca.vertcat(*(part[i].T for part in parts)) for i in (0, 1))
        return x, p, main, extra, [ca.vec(part[2]) for part in parts]

    @cached_property
    def _functions(self) -> list[tuple[StationFunction, list[int]]]:
        served: dict[int, list[int]] = {}
        for k, station in enumerate(self.stations):
            served.setdefault(id(station.optimisation_problem), []).append(k)
        functions = []
        for of in served.values():
            problem, shared = self.stations[of[0]].optimisation_problem, self.shared
            first = None if shared is None else StationErrors(problem, shared.sources).success(shared.delta)
            functions.append((StationFunction(problem, first), of))
        return functions

    def _postures(self, x: ca.MX) -> ca.MX:
        """(n, K) the postures among the variables."""
        return ca.reshape(x[_BEFORE_POSTURES:], -1, len(self.stations))

    def _moved(self, x: ca.MX, p: ca.MX, steps: StationSteps) -> ca.MX:
        """(m, S) steps of the counted joints [rad or m]."""
        counted = np.flatnonzero(steps.counted).tolist()
        Q = self._postures(x)[counted, :]
        if steps.closed:
            Q = ca.horzcat(Q, Q[:, 0] + p[: len(counted)])
        return Q[:, 1:] - Q[:, :-1]
