"""``ConfirmingSolver``: the solver of a problem started at an optimum, with the rows that could matter there.

A row that keeps the arm clear of an obstacle is a large expression, and its second derivatives are larger. Most of them
are far from their ends at an optimum: they are left out, and the end is held against all of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeAlias

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.program.nlp import Nlp
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.solvers import Ends, Outcome, Polish, Solver

NEAR_ROW_M = 0.02
"""Distance from its end [m] up to which a row that keeps the arm clear takes part from the beginning."""

_Rows: TypeAlias = tuple[int, ...]


class ConfirmingSolver:
    """Solves a nonlinear program from postures that are optima, or nearly so.

    Args:
        nlp: n variables, m rows.
    """

    def __init__(self, nlp: Nlp, solver: Solver) -> None:
        self._nlp, self._solver = nlp, solver
        self._built: dict[_Rows, Polish] = {}

    def solvable(self, parameters: Array) -> bool:
        """Whether there are no more equalities than variables, which is what an interior-point method takes."""
        low, high, row_low, row_high = self._nlp.ends(parameters)
        return int(np.count_nonzero(row_low == row_high)) <= int(np.count_nonzero(low < high))

    def solve(self, q: Array, parameters: Array, ends: Ends | None = None) -> Outcome:
        """Where the solver ends from q (n,) [rad or m]; multipliers (m,) and (n,), zero of rows that took no part.

        Args:
            parameters: (p,) of the target.
            ends: of variables and rows, where they are not those of the target.
        """
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
        """The solver with some rows, built when they first take part together."""
        if rows not in self._built:
            whole = len(rows) == len(self._nlp.rows)
            nlp = self._nlp if whole else self._nlp.with_rows(rows)
            self._built[rows] = self._solver.build(nlp, confirms=True)
        return self._built[rows]
