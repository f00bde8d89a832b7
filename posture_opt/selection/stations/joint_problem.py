"""``JointProblem``: the postures of several stations and the placement of what they stand on, chosen together.

A station is one feature of a part or one point of a path: the optimisation problem of a point with a target of its own,
which stands in the frame of the workpiece. Every expression of it, tool axis and further terms included, is evaluated
at the target that the placement ``w = (x, y, z, yaw)`` moves it to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np

from posture_opt.model.chain import Scalar
from posture_opt.numerics import Array, DerivedAgain
from posture_opt.selection.program.nlp import Row
from posture_opt.selection.program.nonlinear_solver import NonlinearSolver
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import SIZES, TaskTarget, turned_about_z

Combine = Literal["worst", "mean", "success"]
"""The largest objective of the stations, the mean of their standard deviations, or the probability that all succeed."""

PLACEMENT = ("x", "y", "z", "yaw")
"""Coordinates of a placement [m, m, m, rad], world."""
_POINTS = ("lower", "upper")  # of the target's parameters; the other ones of three entries are directions
_ALMOST = 1 - 1e-9  # of a probability to miss: the logarithm of its complement stays finite
_LEAST = 1e-12  # under the root of a scaled variance, about 1
_STARTED = 1e-3  # of the barrier: starts are feasible and good, but the placement has a way to go


@dataclass(frozen=True)
class Station:
    """One target in the frame of the workpiece, and the optimisation problem of a point that serves it."""

    optimisation_problem: OptimisationProblem
    target: TaskTarget


@dataclass(frozen=True)
class JointPoint:
    """A placement w (4,) [m, rad] and a posture for each station Q (K, n) [rad or m]."""

    w: Array
    Q: Array


@dataclass(frozen=True)
class JointOutcome:
    """Where one solve of the joint problem ended: the point, its objective, the worst row, the solver's words."""

    point: JointPoint
    objective: float
    violation: float
    optimal: bool
    message: str
    iterations: int


@dataclass(frozen=True, eq=False)
class JointProblem(DerivedAgain):
    """``min over w, q_1 … q_K`` of the stations' objectives taken together, subject to the rows of all of them.

    Args:
        stations: K of them, with one scale.
        lower, upper: (4,) of the placement; equal where a coordinate is fixed.
        combine: ``worst``: ``min t`` with ``f_k <= t``; ``mean``: of ``sqrt(f_k)``; ``success``: the product of the
            probabilities, for stations whose criterion is ``miss``, as ``log(-sum log(1 - exp(f_k)))``.
        largest_step: (n,) between consecutive stations [rad or m]; None for any.
    """

    stations: tuple[Station, ...]
    lower: Array
    upper: Array
    combine: Combine = "worst"
    largest_step: Array | None = None
    max_iterations: int = 300

    @property
    def n(self) -> int:
        """Joints."""
        return self.stations[0].optimisation_problem.robot.n

    def solve(self, start: JointPoint) -> JointOutcome:
        """The local optimum of IPOPT from a start, which should be feasible."""
        solver, lbg, ubg = self._solver
        lower, upper = self._bounds
        w = np.clip(start.w, self.lower, self.upper)
        x0 = np.concatenate([w, [0.0], np.asarray(start.Q, dtype=float).ravel()])
        if self.combine == "worst":
            x0[4] = float(self._objective(x0))
        found = solver.solve(x0, lower, upper, lbg, ubg)
        x = np.clip(found.x, lower, upper)
        g = np.asarray(self._rows(x)).ravel()
        violation = float(np.max(np.maximum(np.asarray(lbg) - g, g - np.asarray(ubg)), initial=0.0))
        point = JointPoint(x[:4], x[5:].reshape(start.Q.shape))
        level = float(self._objective(x))
        return JointOutcome(point, level, violation, found.optimal, found.message, found.iterations)

    @cached_property
    def _bounds(self) -> tuple[Array, Array]:
        robot, K = self.stations[0].optimisation_problem.robot, len(self.stations)
        lower = np.concatenate([self.lower, [-np.inf], np.tile(robot.lower, K)])
        upper = np.concatenate([self.upper, [np.inf], np.tile(robot.upper, K)])
        if self.combine != "worst":
            lower[4] = upper[4] = 0.0
        return lower, upper

    @cached_property
    def _parts(self) -> dict[str, Any]:
        K = len(self.stations)
        x = ca.MX.sym("x", 5 + self.n * K)
        w, t, Q = x[:4], x[4], ca.reshape(x[5:], self.n, K)
        values, rows = [], []
        functions: dict[int, StationFunction] = {}
        for k, station in enumerate(self.stations):
            problem = station.optimisation_problem
            function = functions.setdefault(id(problem), StationFunction(problem))
            main, extra, g = function.call(w, Q[:, k], station.target.parameters)
            values.append((main, extra))
            rows.append((g, *function.ends))
        objective = combined(self.combine, values)
        if self.combine == "worst":
            below = ca.vertcat(*(t - main - extra for main, extra in values))
            rows.append((below, np.zeros(K), np.full(K, np.inf)))
        if self.largest_step is not None and K > 1:
            steps = ca.vec(Q[:, 1:] - Q[:, :-1])
            most = np.tile(self.largest_step, K - 1)
            rows.append((steps, -most, most))
        g = ca.vertcat(*(row[0] for row in rows))
        ends = [np.concatenate([row[i] for row in rows]) for i in (1, 2)]
        return {"x": x, "f": t if self.combine == "worst" else objective, "objective": objective, "g": g, "ends": ends}

    @cached_property
    def _solver(self) -> tuple[NonlinearSolver, Array, Array]:
        parts = self._parts
        options = {
            "ipopt.tol": 1e-7,
            "ipopt.max_iter": self.max_iterations,
            "ipopt.constr_viol_tol": 1e-9,
            "ipopt.mu_init": _STARTED,
            "ipopt.bound_push": 1e-6,
            "ipopt.bound_frac": 1e-6,
            "ipopt.acceptable_iter": 0,
            "ipopt.fixed_variable_treatment": "make_parameter",
        }
        solver = NonlinearSolver("joint", {key: parts[key] for key in ("x", "f", "g")}, options)
        return solver, *parts["ends"]

    @cached_property
    def _rows(self) -> ca.Function:
        return ca.Function("rows", [self._parts["x"]], [self._parts["g"]])

    @cached_property
    def _objective(self) -> ca.Function:
        return ca.Function("objective", [self._parts["x"]], [self._parts["objective"]])


def combined(combine: Combine, values: Sequence[tuple[Scalar, Scalar]]) -> Scalar:
    """The objective of all stations from each one's own and what further terms add: symbols of CasADi."""
    if combine == "worst":
        return ca.mmax(ca.vertcat(*(main + extra for main, extra in values)))
    extras = sum(extra for _, extra in values) / len(values)
    if combine == "mean":
        return sum(ca.sqrt(ca.fmax(main, 0) + _LEAST) for main, _ in values) / len(values) + extras
    return ca.log(sum(-ca.log1p(-_ALMOST * ca.exp(main)) for main, _ in values)) + extras


class StationFunction:
    """``(w, q, c) -> (f, extra, g)`` of one optimisation problem at the target that a placement moves ``c`` to.

    ``f`` is the objective's first term and ``extra`` the sum of the further ones; ``g`` are rows between constant ends.

    Attributes:
        call: the CasADi function, of symbols or numbers.
        ends: lower and upper ends (m,) of ``g``.
    """

    def __init__(self, problem: OptimisationProblem) -> None:
        nlp = problem.nlp
        extra = sum((expression for _, expression in nlp.terms[1:]), ca.SX(0))
        parts = [part for row in nlp.rows for part in _one_sided(row)]
        parts += _in_reach(problem)
        rows = ca.vertcat(ca.SX(0, 1), *(expression for expression, _, _ in parts))
        at_target = ca.Function("at_target", [nlp.x, nlp.p], [nlp.terms[0][1], extra, rows])
        w, c = ca.SX.sym("w", 4), ca.SX.sym("c", nlp.p.shape[0])
        outputs = at_target(nlp.x, moved_parameters(c, w))
        self.call: ca.Function = ca.Function("station", [w, nlp.x, c], [ca.densify(output) for output in outputs])
        low, high = np.array([low for _, low, _ in parts]), np.array([high for _, _, high in parts])
        self.ends: tuple[Array, Array] = (low, high)


def moved_parameters(c: ca.SX, w: ca.SX) -> ca.SX:
    """The parameters of a target that stands in the frame of the workpiece, at the placement w (4,), world."""
    parts, at = [], 0
    for name, size in SIZES.items():
        part = c[at : at + size]
        at += size
        if size == 3:
            part = turned_about_z(part, ca.cos(w[3]), ca.sin(w[3]))
            part = part + w[:3] if name in _POINTS else part
        parts.append(part)
    return ca.vertcat(*parts)


def _one_sided(row: Row) -> list[tuple[ca.SX, float, float]]:
    """A row as expressions between constants: its bounds depend on the target, which depends on the placement."""
    if ca.is_equal(row.lower, row.upper, 2):
        return [(row.expression - row.lower, 0.0, 0.0)]
    sides = []
    if not _infinite(row.lower):
        sides.append((row.expression - row.lower, 0.0, np.inf))
    if not _infinite(row.upper):
        sides.append((row.expression - row.upper, -np.inf, 0.0))
    return sides


def _infinite(bound: ca.SX) -> bool:
    return bool(bound.is_constant()) and bool(np.isinf(float(bound)))


def _in_reach(problem: OptimisationProblem) -> list[tuple[ca.SX, float, float]]:
    """The target in the plane (or on the line) that the tool point never leaves."""
    reach = problem.reach
    off = problem.nlp.p[:3] - ca.DM(reach.offset)
    slack = float(reach.plane_slack)
    return [(ca.dot(ca.DM(normal), off), -slack, slack) for normal in reach.normals.T]
