"""``PathProblem``: one smooth optimisation problem over the postures of all points of a path and its placement.

It differs from :mod:`posture_opt.selection.stations.joint_problem`, whose station functions it takes, by what holds the
postures together: steps of joints between neighbours, whose bound may be the objective itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from posture_opt.numerics import Array, Codes, DerivedAgain
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.program.nonlinear_solver import NonlinearSolver
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.stations.joint_problem import JointOutcome, JointPoint, StationFunction

_MEAN = 1e-4  # of the mean objective: points that are not the worst one are good too, at no cost to it
_SMOOTH = 1e-4  # of the mean squared step [rad²]: makes the motion the only one
_STEP_MARGIN = 1e-9  # rad: what IPOPT may overstep
_OPTIONS = {
    "ipopt.tol": 1e-7,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.mu_init": 1e-3,
    "ipopt.bound_push": 1e-6,
    "ipopt.bound_frac": 1e-6,
    "ipopt.acceptable_iter": 0,
    "ipopt.max_iter": 200,
    "ipopt.fixed_variable_treatment": "make_parameter",
}


@dataclass(frozen=True, eq=False)
class PathProblem(DerivedAgain):
    """``min t`` with ``f(q_k) ≤ t`` at all points, or ``min s`` with ``parts |q_{k+1} − q_k| ≤ s`` at all steps.

    Args:
        parameters: (K, p) of the points' targets, in the frame of the workpiece.
        parts: (K − 1,) how many times each step counts.
        lower, upper: (4,) of the placement [m, rad].
    """

    optimisation_problem: OptimisationProblem
    steps: JointSteps
    parameters: Array
    parts: Codes
    lower: Array
    upper: Array

    @cached_property
    def _station(self) -> StationFunction:
        return StationFunction(self.optimisation_problem)

    def least_spread(self, start: JointPoint, largest: float) -> JointOutcome:
        """The motion of least largest objective with no step above ``largest`` [rad or m]."""
        return self._solve(self._spread, start, max(largest - _STEP_MARGIN, 0.0))

    def least_step(self, start: JointPoint) -> JointOutcome:
        """The motion whose largest step is least."""
        return self._solve(self._step, start, 0.0)

    def _solve(self, parts: dict[str, Any], start: JointPoint, largest: float) -> JointOutcome:
        K, n = start.Q.shape
        robot = self.optimisation_problem.robot
        Q = np.asarray(start.Q)
        low, high = np.tile(robot.lower, K), np.tile(robot.upper, K)
        idle = np.tile(~self.steps.counted, K)
        low, high = np.where(idle, Q.ravel(), low), np.where(idle, Q.ravel(), high)
        w = np.clip(start.w, self.lower, self.upper)
        x0 = np.concatenate([w, [0.0], Q.ravel()])
        x0[4] = float(parts["level"](x0))
        lbx, ubx = np.concatenate([self.lower, [-np.inf], low]), np.concatenate([self.upper, [np.inf], high])
        found = parts["solver"].solve(x0, lbx, ubx, parts["lbg"], parts["ubg"], p=largest)
        x = np.clip(found.x, lbx, ubx)
        g = np.asarray(parts["g"](x, largest)).ravel()
        violation = float(np.max(np.maximum(parts["lbg"] - g, g - parts["ubg"]), initial=0.0))
        point = JointPoint(x[:4], x[5:].reshape(K, n))
        level = float(parts["level"](x))
        return JointOutcome(point, level, violation, found.optimal, found.message, found.iterations)

    @cached_property
    def _spread(self) -> dict[str, Any]:
        x, t, values, rows, moved = self._expressions
        largest = ca.MX.sym("largest")
        tie = _MEAN * ca.sum1(values) / values.numel() + _SMOOTH * ca.sumsqr(moved) / moved.shape[1]
        below, bounds = t - values, [ca.vec(largest - moved), ca.vec(largest + moved)]
        return self._built(x, largest, t + tie, ca.mmax(values), [*rows, below, *bounds], 0)

    @cached_property
    def _step(self) -> dict[str, Any]:
        x, s, values, rows, moved = self._expressions
        largest = ca.MX.sym("largest")
        tie = _SMOOTH**2 * (ca.sum1(values) / values.numel() + ca.sumsqr(moved) / moved.shape[1])
        bounds = [ca.vec(s - moved), ca.vec(s + moved)]
        return self._built(x, largest, s + tie, ca.mmax(ca.fabs(ca.vec(moved))), [*rows, *bounds], 0)

    def _built(
        self, x: ca.MX, p: ca.MX, objective: ca.MX, level: ca.MX, rows: Sequence[ca.MX], least: float
    ) -> dict[str, Any]:
        """Solver, rows and their ends; the first of the rows are the points', the others are to be ``least``."""
        first, ends = rows[0], self._station.ends
        K = len(self.parameters)
        g = ca.vertcat(*rows)
        others = g.shape[0] - first.shape[0]
        lbg = np.concatenate([np.tile(ends[0], K), np.full(others, least)])
        ubg = np.concatenate([np.tile(ends[1], K), np.full(others, np.inf)])
        return {
            "solver": NonlinearSolver("path", {"x": x, "p": p, "f": objective, "g": g}, _OPTIONS),
            "g": ca.Function("rows", [x, p], [g]), "level": ca.Function("level", [x], [level]),
            "lbg": lbg, "ubg": ubg,
        }  # fmt: skip

    @cached_property
    def _expressions(self) -> tuple[ca.MX, ca.MX, ca.MX, list[ca.MX], ca.MX]:
        """Variables, the bound among them, objectives (K,), rows of the points, steps as they count (m, K − 1)."""
        K, n = len(self.parameters), self.optimisation_problem.robot.n
        x = ca.MX.sym("x", 5 + n * K)
        w, t, Q = x[:4], x[4], ca.reshape(x[5:], n, K)
        stations = self._station.call.map("stations", "serial", K, [0], [])
        main, extra, g = stations(w, Q, ca.DM(self.parameters.T))
        counted = np.flatnonzero(self.steps.counted).tolist()
        moved = (Q[counted, 1:] - Q[counted, :-1]) * ca.repmat(ca.DM(self.parts).T, len(counted), 1)
        return x, t, ca.vec(main + extra), [ca.vec(g)], moved
