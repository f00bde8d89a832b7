"""The corrections of the geometry that data determine, and the one that no arm is built with."""

from __future__ import annotations

from dataclasses import dataclass

from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.parameters import Parameter

CERTAIN = 1.96
"""Standard errors that a certain difference has, at 95 %."""
_MANUFACTURING_TOLERANCES = {"rad": 5e-3, "m": 5e-3}  # rad, m, of new arms; a choice of taste
_MAX_OPEN_RATIO = 10.0  # times the standard error among what the data determine: the rest is open
_MAX_HELD_RATIO = 3.0  # times its standard error is that by the rows alone, of what no tolerance holds


@dataclass(frozen=True)
class Correction:
    """One geometric parameter of the fitted arm.

    Args:
        parameter: of the arm; ``value`` what it differs from the file by [rad or m], ``std`` its standard error.
    """

    parameter: Parameter
    value: float
    std: float

    @property
    def certain(self) -> bool:
        """Whether it differs from zero by 1.96 standard errors."""
        return abs(self.value) > CERTAIN * self.std

    @property
    def excess(self) -> float:
        """Times the tolerance of new arms that it is off at the least, within its error."""
        return (abs(self.value) - CERTAIN * self.std) / _MANUFACTURING_TOLERANCES[self.parameter.unit]

    @property
    def deviation(self) -> GeometricDeviation:
        """The cause that it is."""
        return GeometricDeviation.of(self.parameter)

    @property
    def is_zero(self) -> bool:
        """Whether it is the zero of a joint, which is set and no part."""
        return self.parameter.name.endswith(".theta")


def determined_corrections(calibration: Calibration, model: Fit) -> tuple[Correction, ...]:
    """The geometric parameters of the arm with its effects that the data determine.

    Left out are those whose standard error is mostly what the data leave open, or what a tolerance of parts holds: a
    zero of the last joint but one and the length behind it act alike, and the tighter tolerance decides which it is.
    """
    rows = zip(calibration.parameters, model.x, model.std, calibration.std, model.held_by_prior, strict=False)
    return tuple(
        Correction(p, float(x), float(std))
        for p, x, std, whole, held in rows
        if p.group == "geometry"
        and 0 < whole < _MAX_OPEN_RATIO * std  # what the data leave open has a small part in what they determine
        and held < _MAX_HELD_RATIO
    )


def largest_correction(corrections: tuple[Correction, ...]) -> Correction | None:
    """The certain correction that is hardest to build; None where none is certain."""
    return max((c for c in corrections if c.certain), key=lambda c: c.excess, default=None)
