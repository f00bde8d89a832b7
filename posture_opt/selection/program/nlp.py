"""``Nlp``: the nonlinear program with named variables and rows; ``NonlinearSolver``: IPOPT, one solve at a time.

IPOPT: Wächter and Biegler, Mathematical Programming 106 (2006) 25–57, with the linear solver MUMPS of CasADi's wheel.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from posture_opt.interrupts import interruptible
from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import TURN, Array


@dataclass(frozen=True)
class Variable:
    """A decision variable, a joint or a coordinate of the placement, with its bounds [unit]; equal ones fix it."""

    name: str
    unit: str
    lower: float
    upper: float


@dataclass(frozen=True)
class Row:
    """A constraint ``lower ≤ expression ≤ upper`` [unit]; the bounds may depend on the target's parameters."""

    name: str
    unit: str
    expression: ca.SX
    lower: ca.SX
    upper: ca.SX
    term: str = ""  # the term or obstacle it belongs to; rows of target and axis say so by name
    shown: Callable[[float], float] = float  # from a value of the expression to what reports state
    convex: bool = False  # bends upwards, as a distance: a method that wants a positive definite Hessian leaves it out

    @property
    def equality(self) -> bool:
        return bool(ca.is_equal(self.lower, self.upper, 2))

    @property
    def requirement(self) -> str:
        """What people may change: ``target``, ``tool_axis``, or the term."""
        return self.term or self.name.partition(".")[0]


@dataclass(frozen=True)
class Nlp:
    """``minimise objective(x, p)`` subject to rows ``lower(p) ≤ g(x, p) ≤ upper(p)`` and to the bounds of x."""

    x: ca.SX  # (n,)
    p: ca.SX  # (33,) parameters of the target
    variables: tuple[Variable, ...]
    objective: ca.SX  # of order one, the sum of ``terms``
    rows: tuple[Row, ...]
    terms: tuple[tuple[str, ca.SX], ...]  # by name, the task's own first
    variance: ca.SX  # [m²] along the worst axis that counts, whatever the criterion

    @cached_property
    def g(self) -> ca.SX:
        """(m,) the expressions of all rows."""
        return ca.vertcat(ca.SX(0, 1), *(row.expression for row in self.rows))

    @property
    def row_ends(self) -> list[ca.SX]:
        """Lower and upper bounds (m,) of all rows as expressions in p."""
        return [ca.vertcat(ca.SX(0, 1), *(getattr(row, end) for row in self.rows)) for end in ("lower", "upper")]

    def as_casadi(self) -> dict[str, ca.SX]:
        """The dictionary that ``casadi.nlpsol`` takes."""
        return {"x": self.x, "p": self.p, "f": self.objective, "g": self.g}

    @cached_property
    def variable_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) lower and upper bounds of the variables."""
        return np.array([v.lower for v in self.variables], float), np.array([v.upper for v in self.variables], float)

    @cached_property
    def indifferent(self) -> tuple[int, ...]:
        """Variables without effect on objective and rows; an inequality in one variable alone is a bound on it."""
        uses = [np.array(ca.which_depends(row.expression, self.x, 1, False)) for row in self.rows]
        equal = [row.equality for row in self.rows]
        matters = [used for used, one in zip(uses, equal, strict=True) if one or np.count_nonzero(used) > 1]
        matters.append(np.array(ca.which_depends(self.objective, self.x, 1, False)))
        return tuple(int(k) for k in np.flatnonzero(~np.any(matters, axis=0)))

    @cached_property
    def free(self) -> tuple[int, ...]:
        """Variables between unequal bounds without effect on objective and equalities."""
        held = [np.array(ca.which_depends(row.expression, self.x, 1, False)) for row in self.rows if row.equality]
        held.append(np.array(ca.which_depends(self.objective, self.x, 1, False)))
        lower, upper = self.variable_bounds
        return tuple(int(k) for k in np.flatnonzero(~np.any(held, axis=0) & (upper > lower)))

    @cached_property
    def unlike_turns(self) -> tuple[int, ...]:
        """Angles over a turn wide whose turns matter: values at ``x`` and ``x + 2π e_k`` differ at random points."""
        lower, upper = self.variable_bounds
        angles = np.array([variable.unit == "rad" for variable in self.variables])
        wide = np.flatnonzero(angles & (upper - lower > TURN))
        if not len(wide):
            return ()
        rng, values = np.random.default_rng(0), ca.Function("values", [self.x, self.p], [self.objective, self.g])
        batch = BatchFunction(values, compiled=False)
        x, p = rng.uniform(lower, upper, (3, len(lower))), rng.normal(size=(1, self.p.numel()))
        here = np.hstack(batch(x, p))
        turned = {int(k): np.hstack(batch(x + TURN * np.eye(len(lower))[k], p)) for k in wide}
        return tuple(k for k, there in turned.items() if not np.allclose(there, here, 1e-6, 1e-9, equal_nan=True))

    def row_bounds(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(m,) lower and upper bounds of the rows for one target."""
        low, high = self._row_bounds.one(parameters)
        return low, high

    @cached_property
    def _row_bounds(self) -> BatchFunction:
        """(p,) -> lower and upper bounds (m,) of the rows, interpreted: a few additions."""
        return BatchFunction(ca.Function("row_bounds", [self.p], self.row_ends), compiled=False)

    def ends(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Lower and upper ends of the variables (n,), then of the rows (m,) for one target."""
        return (*self.variable_bounds, *self.row_bounds(parameters))

    @cached_property
    def row_values(self) -> BatchFunction:
        """``(x (n,), p) -> g (m,)``, interpreted."""
        return BatchFunction(ca.Function("rows", [self.x, self.p], [ca.densify(self.g)]), compiled=False)

    def with_rows(self, chosen: Sequence[int]) -> Nlp:
        """The program with these rows alone."""
        return replace(self, rows=tuple(self.rows[k] for k in chosen))

    @cached_property
    def screen(self) -> ca.Function:
        """``(x, p) -> (objective, worst violation of a row, first term, variance)``: all that cheap starts need."""
        low, high = self.row_ends
        beyond = ca.fmax(ca.fmax(low - self.g, self.g - high), 0) if self.rows else ca.SX.zeros(1)
        return ca.Function(
            "screen", [self.x, self.p], [self.objective, ca.mmax(beyond), self.terms[0][1], self.variance]
        )


@dataclass(frozen=True)
class Values:
    """A nonlinear program at one posture and one target."""

    terms: np.ndarray  # (t,)
    rows: np.ndarray  # (m,)
    row_lower: np.ndarray
    row_upper: np.ndarray

    @classmethod
    def of(cls, nlp: Nlp, q: np.ndarray, parameters: np.ndarray) -> Values:
        """The nonlinear program evaluated at ``q`` (n,) and the target's ``parameters``."""
        terms = ca.vertcat(*(expression for _, expression in nlp.terms))
        evaluated = ca.Function("values", [nlp.x, nlp.p], [terms, nlp.g])(q, parameters)
        numbers, rows = (np.asarray(value, dtype=float).ravel() for value in evaluated)
        return cls(numbers, rows, *nlp.row_bounds(parameters))

    @property
    def objective(self) -> float:
        return float(self.terms.sum())


_OPTIONS: dict[str, Any] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",  # no banner
    "print_time": False,
    "calc_lam_p": False,  # the multipliers of the parameters cost one more evaluation and nobody reads them
}


# MUMPS, which solves IPOPT's linear systems, keeps data in global variables: of all threads, one may solve.
_ONE_AT_A_TIME = threading.RLock()

if hasattr(os, "register_at_fork"):  # what another thread held goes on being held in a child, where nobody lets go
    os.register_at_fork(after_in_child=_ONE_AT_A_TIME._at_fork_reinit)  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Outcome:
    """One local solve, with multipliers of the scaled objective, positive at upper ends: ``∇f + Jᵀλ + z = 0``."""

    x: Array  # (n,) where it ended
    optimal: bool  # Solve_Succeeded; a merely acceptable point is not
    message: str
    iterations: int
    row_multipliers: Array  # (m,)
    bound_multipliers: Array  # (n,)
    residual: float = math.nan  # the largest one of the optimality conditions, scaled


class NonlinearSolver:
    """``min f(x, p)`` subject to bounds on x and g(x, p), by IPOPT; threads may share it and solve in turn."""

    def __init__(self, name: str, program: Mapping[str, Any], options: Mapping[str, Any]) -> None:
        with _ONE_AT_A_TIME:
            self._function = ca.nlpsol(name, "ipopt", dict(program), {**_OPTIONS, **options})

    def solve(self, x0: Array, lower: Array, upper: Array, row_lower: Array, row_upper: Array, p: Any = ()) -> Outcome:
        """The local optimum from ``x0`` (n,); equal bounds fix a variable; other threads wait."""
        with _ONE_AT_A_TIME, interruptible():
            found = self._function(x0=x0, p=p, lbx=lower, ubx=upper, lbg=row_lower, ubg=row_upper)
            stats = self._function.stats()
        x, rows, bounds = (np.asarray(found[name]).ravel() for name in ("x", "lam_g", "lam_x"))
        message = str(stats["return_status"])
        return Outcome(x, message == "Solve_Succeeded", message, int(stats["iter_count"]), rows, bounds)

    def residual(
        self, found: Outcome, lower: Array, upper: Array, row_lower: Array, row_upper: Array, p: Any = ()
    ) -> float:
        """Largest residual of the optimality conditions, evaluated here and not taken from the solver.

        ``max(|∇f + Jᵀλ + z|/s, |(λ, z)|·room/s, violation)``, ``s = max(100, mean |(λ, z)|)/100`` (Wächter and Biegler
        2006, eqs. 5 and 6); ``room`` is the way to the end that a multiplier belongs to.
        """
        slope = np.asarray(self._function.get_function("nlp_grad_f")(found.x, p)[1]).ravel()
        g, jacobian = self._function.get_function("nlp_jac_g")(found.x, p)
        free = lower < upper  # the solver takes the others as numbers
        stationarity = (slope + np.asarray(jacobian.T @ found.row_multipliers).ravel() + found.bound_multipliers)[free]
        value, low, high = (
            np.concatenate(pair) for pair in ((np.asarray(g).ravel(), found.x), (row_lower, lower), (row_upper, upper))
        )
        y = np.concatenate([found.row_multipliers, np.where(free, found.bound_multipliers, 0.0)])
        room = np.maximum(np.where(y > 0, high - value, value - low), 0.0)
        ended = np.isfinite(room)  # where there is no end, a multiplier is what is left of a barrier
        complementarity = np.abs(y[ended]) * room[ended]
        violation = np.maximum(low - value, value - high)
        scale = max(100.0, float(np.mean(np.abs(y)))) / 100.0  # s_max of IPOPT
        scaled = max(np.max(np.abs(stationarity), initial=0.0), np.max(complementarity, initial=0.0)) / scale
        return float(max(scaled, np.max(violation, initial=0.0)))
