"""``FitRequest``: what a calibration or a diagnosis was asked."""

from __future__ import annotations

from dataclasses import dataclass

from posture_opt.calibration.parameters import CalibrationProblem
from posture_opt.measurements.measurements import Measurements


@dataclass(frozen=True, eq=False, repr=False)
class FitRequest:
    """The arm as it is stated, what was measured, and what to make of it.

    Args:
        folds: of the cross-validation.
        test: other measurements that are predicted, with base and tool fitted again if ``refit_frames``.
        plan: whether the task is planned again with the arm that is found, when that is asked for.
        seed: of that plan; None for the problem's.
    """

    problem: CalibrationProblem
    data: Measurements
    folds: int = 5
    test: Measurements | None = None
    refit_frames: bool = False
    plan: bool = True
    seed: int | None = None
