"""Which parameters the report and the figure of a measurement plan list."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from posture_opt.experiments.measurement_plan import MeasurementPlan

_EXACT = 1e-7  # m, rad: rounding of a covariance in which parameters are correlated


def is_listed(plan: MeasurementPlan, i: int) -> bool:
    """Whether parameter i can be determined, and is not as good as exact already."""
    return bool(plan.settled[i]) and not plan.before.std[i] < _EXACT
