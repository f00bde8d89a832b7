"""Whether an instrument scatters more than the arm errs: then a calibration can add little to the nominal arm."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.numerics import Json, rms


@dataclass(frozen=True)
class InstrumentScatter:
    """One reading: what is left of it after calibration, against what errors of the arm make of it.

    Args:
        scatter: standard deviation of a reading about the calibrated arm [unit].
        arm: RMS change of a reading by errors of the nominal arm, with free frames and places fitted [unit].
        unit: SI unit of both; ``noun`` what is read, in plural.
    """

    scatter: float
    arm: float
    unit: str
    noun: str

    @property
    def exceeds(self) -> bool:
        """Whether a reading says more of the instrument than of the arm."""
        return self.scatter > self.arm

    def to_json(self) -> dict[str, Json]:
        """The part ``instrument_scatter`` of ``calibration.json``."""
        return {"scatter": self.scatter, "arm": self.arm, "unit": self.unit, "exceeds_arm": self.exceeds}


def instrument_scatter(fit: Fit, x_nominal: np.ndarray) -> InstrumentScatter | None:
    """The scatter of the instrument beside the errors of the arm; None of positions, which show the arm as it is.

    Of variances s² after calibration and s₀² before, each per degree of freedom, the arm's part is ``√(s₀² − s²)``.

    Args:
        x_nominal: (k,) deviations with only free frames and places fitted [rad, m].
    """
    used = fit.residuals.take(np.flatnonzero(fit.kept))
    kind = used.data.kind
    if not kind.leaves_geometry_open:
        return None
    r = used.whitened(x_nominal)[: used.measured]
    before = float(r @ r) / max(len(r) - len(used.free), 1)
    sigma = rms(np.broadcast_to(used.row_sigma, len(used.data)))
    arm = sqrt(max(before - fit.variance, 0.0))
    unit = kind.unit if used.data.lever is None else "m"  # what a pixel is at the marker
    return InstrumentScatter(sigma * sqrt(fit.variance), sigma * arm, unit, kind.noun)
