"""``Nlp``: the nonlinear program as a value with named variables and rows.

Names, units and bounds travel with the expressions: a report can say which requirement fails and by how much, and
``explain`` prints the program as it was solved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import TURN

_POINTS_OF_TURNS = 3  # at which whole turns are compared: random ones, so that one would nearly do


@dataclass(frozen=True)
class Variable:
    """A decision variable, a joint or a coordinate of the placement, with its bounds [unit]; equal ones fix it."""

    name: str
    unit: str
    lower: float
    upper: float


@dataclass(frozen=True)
class Row:
    """A constraint ``lower ≤ expression ≤ upper`` [unit]; the bounds may depend on the target's parameters.

    Args:
        term: the term or obstacle that it belongs to; the rows of target and tool axis say so in their names.
        shown: turns a value of the expression into what reports state.
        convex: the expression mostly bends upwards, as a distance does: its curvature makes the Lagrangian of a lower
            bound bend downwards, and a method that wants a positive definite Hessian leaves it out.
    """

    name: str
    unit: str
    expression: ca.SX
    lower: ca.SX
    upper: ca.SX
    term: str = ""
    shown: Callable[[float], float] = float
    convex: bool = False

    @property
    def equality(self) -> bool:
        """Whether both ends are one expression."""
        return bool(ca.is_equal(self.lower, self.upper, 2))

    @property
    def requirement(self) -> str:
        """What people may change: ``target``, ``tool_axis``, or the term."""
        return self.term or self.name.partition(".")[0]


@dataclass(frozen=True)
class Nlp:
    """``minimise objective(x, p)`` subject to the rows ``lower(p) ≤ g(x, p) ≤ upper(p)`` and to the bounds of x.

    Args:
        x: (n,) variables; ``p`` (33,) the parameters of the target.
        objective: of order one, the sum of ``terms``, each with its name, the task's own first.
        variance: [m²] along the worst axis of the spread that counts, whatever the criterion: what postures are
            compared by in words.
    """

    x: ca.SX
    p: ca.SX
    variables: tuple[Variable, ...]
    objective: ca.SX
    rows: tuple[Row, ...]
    terms: tuple[tuple[str, ca.SX], ...]
    variance: ca.SX

    @cached_property
    def g(self) -> ca.SX:
        """(m,) the expressions of all rows."""
        return ca.vertcat(*(row.expression for row in self.rows)) if self.rows else ca.SX(0, 1)

    def as_casadi(self) -> dict[str, ca.SX]:
        """The dictionary that ``casadi.nlpsol`` takes."""
        return {"x": self.x, "p": self.p, "f": self.objective, "g": self.g}

    @cached_property
    def variable_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) lower and upper bounds of the variables."""
        return np.array([v.lower for v in self.variables], float), np.array([v.upper for v in self.variables], float)

    @cached_property
    def indifferent(self) -> tuple[int, ...]:
        """Variables that neither the objective nor any row depends on: a spin about the tool axis, say.

        An inequality in one variable alone is a bound on it, and no reason to prefer a value within.
        """
        uses = [np.array(ca.which_depends(row.expression, self.x, 1, False)) for row in self.rows]
        equal = [row.equality for row in self.rows]
        matters = [used for used, one in zip(uses, equal, strict=True) if one or np.count_nonzero(used) > 1]
        matters.append(np.array(ca.which_depends(self.objective, self.x, 1, False)))
        return tuple(int(k) for k in np.flatnonzero(~np.any(matters, axis=0)))

    @cached_property
    def free(self) -> tuple[int, ...]:
        """Variables between unequal bounds that neither the objective nor an equality depends on.

        Other rows may: any of their values that meets those is as good.
        """
        held = [np.array(ca.which_depends(row.expression, self.x, 1, False)) for row in self.rows if row.equality]
        held.append(np.array(ca.which_depends(self.objective, self.x, 1, False)))
        lower, upper = self.variable_bounds
        return tuple(int(k) for k in np.flatnonzero(~np.any(held, axis=0) & (upper > lower)))

    @cached_property
    def unlike_turns(self) -> tuple[int, ...]:
        """Angles with more than a turn between their bounds whose turns the program tells apart.

        A distance from a posture or from a limit does so, and an error that does not repeat after a turn of the joint:
        objective or rows at ``x`` and ``x + 2π e_k`` differ, at some random points.
        """
        lower, upper = self.variable_bounds
        angles = np.array([variable.unit == "rad" for variable in self.variables])
        wide = np.flatnonzero(angles & (upper - lower > TURN))
        if not len(wide):
            return ()
        rng, values = np.random.default_rng(0), ca.Function("values", [self.x, self.p], [self.objective, self.g])
        batch = BatchFunction(values, compiled=False)
        x, p = rng.uniform(lower, upper, (_POINTS_OF_TURNS, len(lower))), rng.normal(size=(1, self.p.numel()))
        here = np.hstack(batch(x, p))
        turned = {int(k): np.hstack(batch(x + TURN * np.eye(len(lower))[k], p)) for k in wide}
        return tuple(k for k, there in turned.items() if not np.allclose(there, here, 1e-6, 1e-9, equal_nan=True))

    def row_bounds(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(m,) lower and upper bounds of the rows for one target."""
        low, high = self._row_bounds.one(parameters)
        return low, high

    @cached_property
    def _row_bounds(self) -> BatchFunction:
        """(p,) -> lower and upper bounds (m,) of the rows, interpreted: they are a few additions."""
        low, high = _stacked([row.lower for row in self.rows]), _stacked([row.upper for row in self.rows])
        return BatchFunction(ca.Function("row_bounds", [self.p], [low, high]), compiled=False)

    def ends(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Lower and upper ends of the variables (n,), then of the rows (m,) for one target."""
        return (*self.variable_bounds, *self.row_bounds(parameters))

    @cached_property
    def row_values(self) -> BatchFunction:
        """``(x (n,), p) -> g (m,)``, interpreted."""
        return BatchFunction(ca.Function("rows", [self.x, self.p], [ca.densify(self.g)]), compiled=False)

    def with_rows(self, chosen: Sequence[int]) -> Nlp:
        """The same program with the rows of these numbers alone."""
        return replace(self, rows=tuple(self.rows[k] for k in chosen))

    @cached_property
    def screen(self) -> ca.Function:
        """``(x, p) -> (objective, worst violation of a row, first term, variance)``: all that cheap starts need."""
        low, high = _stacked([row.lower for row in self.rows]), _stacked([row.upper for row in self.rows])
        beyond = ca.fmax(ca.fmax(low - self.g, self.g - high), 0) if self.rows else ca.SX.zeros(1)
        return ca.Function(
            "screen", [self.x, self.p], [self.objective, ca.mmax(beyond), self.terms[0][1], self.variance]
        )


def _stacked(bounds: Sequence[ca.SX]) -> ca.SX:
    """Bounds (m,) in one column, also where there are none."""
    return ca.vertcat(*bounds) if bounds else ca.SX(0, 1)


@dataclass(frozen=True)
class Values:
    """A nonlinear program at one posture and one target.

    Args:
        terms: (t,) parts of the objective.
        rows: (m,) values of the rows, between ``row_lower`` and ``row_upper`` (m,) where they are met.
    """

    terms: np.ndarray
    rows: np.ndarray
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
        """The sum of the terms."""
        return float(self.terms.sum())
