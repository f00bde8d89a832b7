"""``StationsProblem``: the postures of several stations and the placement of what they stand on, chosen together.

A station is one feature of a part or one point of a path: the optimisation problem of a point with a target of its own,
which is in the frame of the workpiece. Every expression of it, tool axis and further terms included, is evaluated
at the target that the placement ``w = (x, y, z, yaw)`` moves it to. Neighbours may be joined by steps of the joints,
whose bound may be the objective itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from posture_opt.numerics import Array, DerivedAgain, Mask
from posture_opt.selection.answer.combine import combined_success, combined_symbols
from posture_opt.selection.program.nonlinear_solver import NonlinearSolver
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.stations.station_errors import StationErrors
from posture_opt.selection.stations.station_function import StationFunction
from posture_opt.selection.tasks.workpiece import Combine
from posture_opt.uncertainty.sources.sources import Sources

_VARIABLES_BEFORE_POSTURES = 5  # variables before the postures: the placement (4,) and the level that is minimised
_MEAN_WEIGHT = 1e-4  # of the mean objective: stations that are not the worst are good too, at no cost to it
_STEP_WEIGHT = 1e-4  # of the mean squared step [rad²]: makes the motion the only one
BARRIER = 1e-3
"""Barrier that IPOPT starts with: starts are feasible and good, but the placement has a way to go."""
_OPTIONS = {
    "ipopt.tol": 1e-7,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.bound_push": 1e-6,
    "ipopt.bound_frac": 1e-6,
    "ipopt.acceptable_iter": 0,
    "ipopt.fixed_variable_treatment": "make_parameter",
}

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
    """Where one solve ended: the point, its objective, the worst row, the solver's words.

    Args:
        residual: the largest one of the optimality conditions, scaled.
    """

    point: StationsPoint
    objective: float
    violation: float
    optimal: bool
    message: str
    iterations: int
    residual: float


@dataclass(frozen=True)
class StationSteps:
    """The S steps from each of K stations to the next, S = K − 1, and where they are closed back to the first, S = K.

    Args:
        counted: (n,) joints whose steps count; the others stay where a solve starts.
        parts: (S,) how many times each step counts where steps are compared with each other.
        closed: whether a last step leads back to the first posture, or to one that is whole turns of joints away.
    """

    counted: Mask
    parts: Array
    closed: bool = False


@dataclass(frozen=True, eq=False)
class SharedSuccess:
    """Errors that move all stations at once, for the probability that all succeed.

    Args:
        sources: whose constant part stays.
        delta: (N, r) draws of it that the probability is averaged over.
    """

    sources: Sources
    delta: Array


@dataclass(frozen=True)
class _Program:
    """A solver with its rows and the level (its objective without ties) as functions of ``(x, p)``.

    Args:
        bounded: how many of the last rows are steps, between bounds that each solve has.
    """

    solver: NonlinearSolver
    rows: ca.Function
    level: ca.Function
    bounded: int = 0


@dataclass(frozen=True, eq=False)
class StationsProblem(DerivedAgain):
    """``min over w, q_1 … q_K`` of the stations' objectives taken together, subject to the rows of all of them.

    ``worst`` is ``min t`` with ``f_k ≤ t``; steps add ``|q_{k+1} − q_k| ≤ most_k``, of each joint that counts.

    Args:
        stations: K of them, with one scale.
        lower, upper: (4,) of the placement; equal where a coordinate is fixed.
        combine: as of `combined_symbols`; ``worst`` where there are steps.
        barrier: that IPOPT starts with, less where the start is nearly the optimum.
        steps: between neighbours; None where each posture is free of the others.
        shared: where what counts is that all succeed, errors that the stations share; None where they share none.
    """

    stations: tuple[Station, ...]
    lower: Array
    upper: Array
    combine: Combine = "worst"
    steps: StationSteps | None = None
    max_iterations: int = 300
    barrier: float = BARRIER
    shared: SharedSuccess | None = None

    def solve(self, start: StationsPoint, most: Array | float = np.inf, turns: Array | float = 0.0) -> StationsOutcome:
        """The local optimum of IPOPT from a start, which should be feasible.

        Args:
            most: (S, n), or what they all are: how far each joint may move in each step [rad or m].
            turns: (n,) how far from the first posture closed steps end [rad]: whole turns.
        """
        return self._solved(self._least_objective, start, most=most, turns=turns)

    def least_step(
        self, start: StationsPoint, weights: Array | None = None, turns: Array | float = 0.0
    ) -> StationsOutcome:
        """The postures whose largest step is least, whatever the objectives.

        Args:
            weights: (S, n) by which the steps of each joint count; default: by ``parts`` of the steps.
            turns: as of `solve`.
        """
        assert self.steps is not None, "stations that are not joined have no steps"
        each = np.asarray(self.steps.parts, dtype=float)[:, None] if weights is None else weights
        return self._solved(self._least_step, start, weights=each, turns=turns)

    def _solved(
        self,
        program: _Program,
        start: StationsPoint,
        most: Array | float = np.inf,
        weights: Array | float = 0.0,
        turns: Array | float = 0.0,
    ) -> StationsOutcome:
        """Where a program ends from a start; the level begins at its value there."""
        Q = np.asarray(start.Q, dtype=float)
        lower, upper = self._bounds(Q, turns)
        p = self._step_parameters(weights, turns)
        x0 = np.concatenate([np.clip(start.w, self.lower, self.upper), [0.0], Q.ravel()])
        x0[4] = np.clip(float(program.level(x0, p)), lower[4], upper[4])
        row_lower, row_upper = self._row_ends(program, most)
        found = program.solver.solve(x0, lower, upper, row_lower, row_upper, p=p)
        x = np.clip(found.x, lower, upper)
        g = np.asarray(program.rows(x, p)).ravel()
        violation = float(np.max(np.maximum(row_lower - g, g - row_upper), initial=0.0))
        ends = lower, upper, row_lower, row_upper
        residual = program.solver.residual(replace(found, x=x), *ends, p=p) if found.optimal else np.inf
        point = StationsPoint(x[:4], x[_VARIABLES_BEFORE_POSTURES:].reshape(Q.shape))
        return StationsOutcome(
            point, float(program.level(x, p)), violation, found.optimal, found.message, found.iterations, residual
        )

    def _bounds(self, Q: Array, turns: Array | float) -> tuple[Array, Array]:
        """Of all variables; the level is fixed at zero where it bounds nothing, a posture that is come back to whole
        turns away has to be within the limits there too.
        """
        robot, level = self.stations[0].optimisation_problem.robot, np.inf if self.combine == "worst" else 0.0
        idle = np.zeros(robot.n, dtype=bool) if self.steps is None else ~self.steps.counted
        low, high = (np.where(idle, Q, np.asarray(ends)) for ends in (robot.lower, robot.upper))
        low[0], high[0] = np.maximum(low[0], low[0] - turns), np.minimum(high[0], high[0] - turns)
        return np.concatenate([self.lower, [-level], low.ravel()]), np.concatenate([self.upper, [level], high.ravel()])

    def _row_ends(self, program: _Program, most: Array | float) -> tuple[Array, Array]:
        """Those of the stations' rows, zero and infinity of those to be positive, and the bounds of the steps."""
        lower, upper = (np.concatenate([np.tile(f.ends[i], len(of)) for f, of in self._functions]) for i in (0, 1))
        others = int(program.rows.numel_out(0)) - len(lower) - program.bounded
        bounds = np.zeros(0)
        if self.steps is not None and program.bounded:
            shape = len(self.steps.parts), len(self.steps.counted)
            bounds = np.broadcast_to(most, shape)[:, self.steps.counted].ravel()
        return (
            np.concatenate([lower, np.zeros(others), -bounds]), np.concatenate([upper, np.full(others, np.inf), bounds])
        )  # fmt: skip

    def _step_parameters(self, weights: Array | float, turns: Array | float) -> Array:
        """What a solve says of steps: whole turns (m,) and weights (m S,) of the counted joints, if there are steps."""
        if self.steps is None:
            return np.zeros(0)
        n, counted = len(self.steps.counted), self.steps.counted
        each = np.broadcast_to(weights, (len(self.steps.parts), n))[:, counted]
        return np.concatenate([np.broadcast_to(turns, n)[counted], each.ravel()])

    @cached_property
    def _least_objective(self) -> _Program:
        """The stations' objectives combined; with steps their bound and a tie-break besides."""
        x, p, main, extra, rows = self._expressions
        if self.shared is not None:
            objective = combined_success(main, extra)
            return self._program(x, p, objective, objective, rows)
        objective = combined_symbols(self.combine, main, extra)
        if self.combine != "worst":
            return self._program(x, p, objective, objective, rows)
        level, values = x[4], main + extra
        rows = [*rows, level - values]
        if self.steps is None:
            return self._program(x, p, level, objective, rows)
        moved, parts = self._moved(x, p, self.steps), ca.DM(np.asarray(self.steps.parts, dtype=float)).T
        even = moved * ca.repmat(parts, moved.shape[0], 1)
        tie = _MEAN_WEIGHT * ca.sum1(values) / len(self.stations) + _STEP_WEIGHT * ca.sumsqr(even) / even.shape[1]
        return self._program(x, p, level + tie, objective, [*rows, ca.vec(moved)], int(moved.numel()))

    @cached_property
    def _least_step(self) -> _Program:
        """The largest step as the level; the objectives break ties."""
        assert self.steps is not None, "stations that are not joined have no steps"
        x, p, main, extra, rows = self._expressions
        weights, level = ca.reshape(p[int(self.steps.counted.sum()) :], -1, len(self.steps.parts)), x[4]
        moved = self._moved(x, p, self.steps) * weights
        mean = ca.sum1(main + extra) / len(self.stations) + ca.sumsqr(moved) / moved.shape[1]
        step = ca.mmax(ca.fabs(ca.vec(moved)))
        rows = [*rows, ca.vec(level - moved), ca.vec(level + moved)]
        return self._program(x, p, level + _STEP_WEIGHT**2 * mean, step, rows)

    def _program(
        self, x: ca.MX, p: ca.MX, objective: ca.MX, level: ca.MX, rows: Sequence[ca.MX], bounded: int = 0
    ) -> _Program:
        """A solver of ``objective`` subject to ``rows``, with functions of the rows and of the level.

        Args:
            bounded: as of `_Program`.
        """
        g = ca.vertcat(*rows)
        # The second derivatives of an average over draws cost more than the iterations that they save.
        approximate = {} if self.shared is None else _AVERAGE_OPTIONS
        options = {**_OPTIONS, **approximate, "ipopt.max_iter": self.max_iterations, "ipopt.mu_init": self.barrier}
        solver = NonlinearSolver("stations", {"x": x, "p": p, "f": objective, "g": g}, options)
        return _Program(solver, ca.Function("rows", [x, p], [g]), ca.Function("level", [x, p], [level]), bounded)

    @cached_property
    def _expressions(self) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX, list[ca.MX]]:
        """Variables, what a solve says of its steps, first and further terms of the objectives, rows of the stations.

        First terms are (K, 1), or (K, N) probabilities given draws of shared errors; further ones (K, 1).
        """
        n, K = self.stations[0].optimisation_problem.robot.n, len(self.stations)
        x, p = ca.MX.sym("x", _VARIABLES_BEFORE_POSTURES + n * K), ca.MX.sym("p", len(self._step_parameters(0.0, 0.0)))
        parts = []
        for function, of in self._functions:
            parameters = ca.DM(np.array([self.stations[k].target.parameters for k in of]).T)
            mapped = function.call.map("stations", "serial", len(of), [0], [])
            parts.append(mapped(x[:4], self._postures(x)[:, of], parameters))
        main, extra = (ca.vertcat(*(part[i].T for part in parts)) for i in (0, 1))
        return x, p, main, extra, [ca.vec(part[2]) for part in parts]

    @cached_property
    def _functions(self) -> list[tuple[StationFunction, list[int]]]:
        """A function for each optimisation problem, and the stations that it serves."""
        served: dict[int, list[int]] = {}
        for k, station in enumerate(self.stations):
            served.setdefault(id(station.optimisation_problem), []).append(k)
        return [(self._function(self.stations[of[0]].optimisation_problem), of) for of in served.values()]

    def _function(self, problem: OptimisationProblem) -> StationFunction:
        """Of one optimisation problem; where errors are shared, its first term is the success given each draw."""
        if self.shared is None:
            return StationFunction(problem)
        return StationFunction(problem, StationErrors(problem, self.shared.sources).success(self.shared.delta))

    def _postures(self, x: ca.MX) -> ca.MX:
        """(n, K) the postures among the variables."""
        return ca.reshape(x[_VARIABLES_BEFORE_POSTURES:], -1, len(self.stations))

    def _moved(self, x: ca.MX, p: ca.MX, steps: StationSteps) -> ca.MX:
        """(m, S) steps of the counted joints [rad or m]."""
        counted = np.flatnonzero(steps.counted).tolist()
        Q = self._postures(x)[counted, :]
        if steps.closed:
            Q = ca.horzcat(Q, Q[:, 0] + p[: len(counted)])
        return Q[:, 1:] - Q[:, :-1]
