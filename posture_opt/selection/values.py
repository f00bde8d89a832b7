"""What the programme is worth at one posture, in numbers: for printing it beside its bounds."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from posture_opt.selection.nlp import Nlp

Floats = np.ndarray


@dataclass(frozen=True)
class Values:
    """Terms of the objective (t,), rows (m,) and their bounds (m,) at one posture and one goal."""

    terms: Floats
    rows: Floats
    row_lower: Floats
    row_upper: Floats

    @classmethod
    def of(cls, nlp: Nlp, q: Floats, parameters: Floats) -> Values:
        """The programme evaluated at ``q`` (n,) and the goal's ``parameters``."""
        terms = ca.vertcat(*(expression for _, expression in nlp.terms))
        evaluated = ca.Function("values", [nlp.x, nlp.p], [terms, nlp.g])(q, parameters)
        numbers, rows = (np.asarray(value, dtype=float).ravel() for value in evaluated)
        return cls(numbers, rows, *nlp.row_bounds(parameters))

    @property
    def objective(self) -> float:
        """The sum of the terms."""
        return float(self.terms.sum())
