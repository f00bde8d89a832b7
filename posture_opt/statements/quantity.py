"""``Quantity``: a number with its standard error and dimension, which formats itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from posture_opt.statements import notation
from posture_opt.units import DIMENSIONS, SHOWN, fixed, number, plus_minus, shown

LEAST_P = 1e-6
"""p-values below this are printed as less than it."""
UNLIKELY = 0.05
"""Family-wise p-value below which noise is no explanation."""


@dataclass(frozen=True)
class Quantity:
    """A value in SI units with its standard error.

    Args:
        value: of the quantity, [SI]; angles in rad, lengths in m, shares and probabilities as fractions.
        dimension: a key of ``DIMENSIONS`` of `posture_opt.units`, or one of ``STYLES``.
        std: its standard error, in the same unit; None where it has none.

    Example:
        >>> print(Quantity(2.61e-4, "angle", 1.2e-5), Quantity(0.0123, "length"), Quantity(0.31, "share"))
        0.261 ± 0.012 mrad 12.3 mm 31 %
    """

    value: float
    dimension: str = "length"
    std: float | None = None

    def __str__(self) -> str:
        """Unit by dimension and size, digits from the standard error."""
        style = STYLES.get(self.dimension)
        if style is not None and (self.std is None or self.dimension not in SHOWN):
            return style[1](self.value)
        std = math.nan if self.std is None else self.std
        if self.dimension in SHOWN or self.dimension == "length":
            return shown(self.value, self.dimension, std)
        return plus_minus(self.value, std, unit=self.unit.replace("*", " "))

    @property
    def unit(self) -> str:
        """The SI unit; ``1`` of a number without one."""
        if self.dimension in STYLES:
            return STYLES[self.dimension][0]
        return DIMENSIONS[self.dimension][0] if self.dimension in DIMENSIONS else "1"

    def to_json(self) -> dict[str, float | str | None]:
        """Value, standard error and unit, as documents have them."""
        return {"value": self.value, "std": self.std, "unit": self.unit}


def p_value(p: float) -> str:
    """A p-value for a table: "0.012", "9e-06", "< 1e-6".

    >>> p_value(0.0123), p_value(0.31), p_value(1e-9)
    ('0.012', '0.31', '< 1e-6')
    """
    return "< 1e-6" if p < LEAST_P else f"{p:.2g}" if p < UNLIKELY else f"{p:.2f}"


def p_words(p: float) -> str:
    """A p-value in a sentence: "p = 0.012", "p < 1e-6"."""
    return f"p {p_value(p)}" if p < LEAST_P else f"p = {p_value(p)}"


STYLES: dict[str, tuple[str, Callable[[float], str]]] = {
    # dimension -> SI unit, how a value without standard error is written
    "length": ("m", notation.length),
    "stated length": ("m", notation.stated_length),
    "coordinate": ("m", lambda metres: f"{fixed(metres * 1e3)} mm"),
    "angle": ("rad", notation.angle_error),
    "joint angle": ("rad", notation.angle),
    "stated angle": ("rad", notation.stated_angle),
    "share": ("1", notation.percent),
    "probability": ("1", notation.probability),
    "p": ("1", p_words),
    "speed": ("m/s", lambda speed: f"{number(speed * 1e3)} mm/s"),
    "duration": ("s", lambda seconds: f"{number(seconds)} s"),
    "number": ("1", number),
}
"""Dimensions with a style of their own, beside those of files."""
