"""``Confirmation``: what the solver of the problem says of an optimum; ``ConfirmingSolver`` asks it.

A row that keeps the arm clear of an obstacle is a large expression, and its second derivatives are larger. Rows far
from their ends at an optimum are left out, and the end is checked against all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from posture_opt.numerics import Array, Json, finite_or_none
from posture_opt.selection.program.nlp import Nlp
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.solvers import Ends, Outcome, Polish, Solver


@dataclass(frozen=True)
class Confirmation:
    """What a solver says of an optimum."""

    name: str
    iterations: int  # over all postures that went through it
    kkt: float  # largest scaled residual of the optimality conditions
    agrees: float  # relative difference of σ from what it was given
    taken: bool = False  # its end is the answer, as it is better
    q: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    row_multipliers: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    bound_multipliers: Array = field(default_factory=lambda: np.zeros(0), repr=False)

    @property
    def differs(self) -> bool:
        return not self.agrees <= 1e-6

    @property
    def refutes(self) -> bool:
        """Whether the solver left what it was given for something visibly else that is not the answer."""
        return not self.taken and self.agrees > 1e-3  # visible in three digits

    def to_json(self) -> dict[str, Json]:
        """What the part ``solver`` of a document says of it."""
        kkt, agrees = finite_or_none(self.kkt), finite_or_none(self.agrees)
        return {"name": self.name, "iterations": self.iterations, "kkt": kkt, "agrees": agrees}


UNCONFIRMED_JSON: dict[str, Json] = {"name": "search", "iterations": 0, "kkt": None, "agrees": None}
"""The same of an answer that the search alone gave."""


def joined_confirmation(every: Sequence[Confirmation | None]) -> Confirmation | None:
    """What is said of several answers together: the largest residual and difference; None unless it is said of all."""
    known = [one for one in every if one is not None]
    if not known or len(known) < len(every):
        return None
    kkt, agrees = (float(np.max([getattr(one, name) for one in known])) for name in ("kkt", "agrees"))
    return Confirmation(
        known[0].name, sum(one.iterations for one in known), kkt, agrees, any(one.taken for one in known)
    )


NEAR_ROW_M = 0.02
"""Distance from its end [m] up to which a row that keeps the arm clear takes part from the beginning."""

_Rows: TypeAlias = tuple[int, ...]


class ConfirmingSolver:
    """Solves a nonlinear program from postures that are optima, or nearly so."""

    def __init__(self, nlp: Nlp, solver: Solver) -> None:
        self._nlp, self._solver = nlp, solver
        self._built: dict[_Rows, Polish] = {}

    def solvable(self, parameters: Array) -> bool:
        """Whether there are no more equalities than variables, which is what an interior-point method takes."""
        low, high, row_low, row_high = self._nlp.ends(parameters)
        return int(np.count_nonzero(row_low == row_high)) <= int(np.count_nonzero(low < high))

    def solve(self, q: Array, parameters: Array, ends: Ends | None = None) -> Outcome:
        """Where the solver ends from q (n,) [rad or m]; multipliers (m,) and (n,), zero of rows that took no part."""
        low, high, row_low, row_high = self._nlp.ends(parameters) if ends is None else ends
        chosen = self._beyond(q, parameters, row_low + NEAR_ROW_M, row_high - NEAR_ROW_M)
        chosen |= {k for k, row in enumerate(self._nlp.rows) if not row.convex}
        while True:
            rows = tuple(sorted(chosen))
            kept = np.array(rows, dtype=int)
            found = self._polish(rows)(q, parameters, (low, high, row_low[kept], row_high[kept]))
            missed = self._beyond(found.x, parameters, row_low - ROW_TOLERANCE, row_high + ROW_TOLERANCE) - chosen
            if not missed:
                break
            chosen |= missed
        multipliers = np.zeros(len(self._nlp.rows))
        multipliers[kept] = found.row_multipliers
        return replace(found, row_multipliers=multipliers)

    def _beyond(self, q: Array, parameters: Array, low: Array, high: Array) -> set[int]:
        """The rows whose values are outside of (m,) ends."""
        if not any(row.convex for row in self._nlp.rows):
            return set()
        value = self._nlp.row_values.one(q, parameters)
        return {int(k) for k in np.flatnonzero((value < low) | (value > high))}

    def _polish(self, rows: _Rows) -> Polish:
        if rows not in self._built:
            whole = len(rows) == len(self._nlp.rows)
            nlp = self._nlp if whole else self._nlp.with_rows(rows)
            self._built[rows] = self._solver.build(nlp, confirms=True)
        return self._built[rows]
