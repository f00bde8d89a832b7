"""``PlausibleRange``: the sizes that a cause can have on a real arm, each with where the figures are published."""

from __future__ import annotations

import math
from dataclasses import dataclass

from posture_opt.numerics import Json
from posture_opt.units import DIMENSIONS, shown

_STANDARD_ERRORS = 2.0
"""Standard errors by which an estimate may be outside of a range: 95 % of them are within."""


@dataclass(frozen=True)
class PlausibleRange:
    """Least and largest size of a cause on an arm.

    A cause beyond it is not refuted: it is then an error that looks like that cause, and ``needs`` says what would have
    to be true of the arm.

    Args:
        low, high: [SI].
        dimension: of both, a key of `DIMENSIONS` or ``ratio``.
        needs: what it would take for the cause to be real beyond the range; a clause without size.
        source: where the figures are published.
    """

    low: float
    high: float
    dimension: str
    needs: str
    source: str

    def holds(self, value: float, std: float) -> bool:
        """Whether a size [SI] is within the range, give or take two of its standard errors.

        Example:
            >>> expansion = PlausibleRange(5e-6, 30e-6, "per temperature", "", "")
            >>> expansion.holds(12e-6, 1e-6), expansion.holds(-250e-6, 10e-6)
            (True, False)
        """
        error = _STANDARD_ERRORS * std if math.isfinite(std) else 0.0
        return self.low - error <= value <= self.high + error

    def would_need(self, value: float) -> str:
        """What would have to be true for a cause of this size [SI] to be real."""
        if self.low == self.high == 0.0:
            return self.needs
        low, high = shown(self.low, self.dimension), shown(self.high, self.dimension)
        usual = f"{low} to {high}" if self.low > 0 else f"up to {high}"
        return f"{self.needs}: {shown(value, self.dimension)}, where {usual} is usual"

    def to_json(self) -> dict[str, Json]:
        """Ends of the range in SI units, with the source."""
        unit = "1" if self.dimension == "ratio" else DIMENSIONS[self.dimension][0]
        return {"low": self.low, "high": self.high, "unit": unit, "source": self.source}
