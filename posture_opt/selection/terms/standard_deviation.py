"""``StandardDeviationTerm``: what the terms share that keep a standard deviation below a bound.

A bound of some µm would disappear in a solver's tolerance of 1e-6; so the row is divided by the bound itself.
"""

from __future__ import annotations

import math

from posture_opt.selection.terms.term import Quantities, Term

_USUAL = 1e-3  # m or rad: where no bound says what is large


class StandardDeviationTerm(Term):
    """A standard deviation σ [m or rad] with an upper bound: the row is ``σ/at_most ≤ 1``."""

    at_most: float | None = None

    def bounds(self) -> tuple[float, float]:
        return -math.inf, math.inf if self.at_most is None else self.at_most

    @property
    def row_size(self) -> float:
        return self.at_most or _USUAL

    def scale(self, at: Quantities) -> float:
        return self.at_most or _USUAL
