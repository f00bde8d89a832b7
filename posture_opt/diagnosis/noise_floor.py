"""``NoiseFloor``: the error that no model of the arm can explain, from repeats or from the instrument as stated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.scores import levels
from posture_opt.measurements.repeats import Contrasts
from posture_opt.numerics import rms_length
from posture_opt.selection.problem_data import ProblemData


@dataclass(frozen=True)
class NoiseFloor:
    """RMS length of an error that no model can explain.

    Args:
        rms: [m] of the length of the position error, all measured axes together; 0 where it is not known.
        repeated: whether repeats of postures show it; else it is that of the instrument as stated, and how far the
            arm itself scatters is not known.
        source: what is stated: an instrument, or the touch of a point.
        stated: the floor by what is stated [m], beside that of repeats; 0 where it is not known.
    """

    rms: float
    repeated: bool
    source: Literal["instrument", "touch"] = "instrument"
    stated: float = 0.0

    @property
    def label(self) -> str:
        """Its name in tables and figures."""
        return "measurement noise" if self.repeated else f"{self.source} as stated"

    @classmethod
    def of(cls, problem: ProblemData, model: Fit, contrasts: Contrasts) -> NoiseFloor:
        """The noise floor of measurements.

        ``sqrt(mean |d|²)`` of the contrasts d between repeats of one posture and target, each scaled to the variance of
        one reading; where there are too few, σ √k for k measured axes.

        Args:
            model: the fitted arm; ``contrasts`` the differences between repeats of its data.
        """
        residuals = model.residuals
        e = model.whitened.reshape(-1, residuals.block)[:, : len(residuals.axes)] * residuals.sigma
        source: Literal["instrument", "touch"] = "touch" if residuals.data.touches else "instrument"
        stated = position_sigma(problem, residuals.data) * float(np.sqrt(e.shape[1]))
        if len(contrasts) * e.shape[1] < levels.MIN_REPEAT_FREEDOM:
            return cls(stated, False, source, stated)
        differences = contrasts.differences(e) / np.sqrt(contrasts.reading)[:, None]
        return cls(rms_length(differences), True, source, stated)

    def held_out(self, model: Fit, rounds: int) -> float:
        """The floor [m] with what it costs to fit many parameters to few numbers.

        Rows left out are predicted with the errors of a fit to the others: ``noise · sqrt(1 + k / m)`` for k parameters
        fitted to m numbers.

        Args:
            rounds: of the cross-validation.
        """
        numbers = len(model.residuals.data) * len(model.residuals.axes)
        return self.rms * float(np.sqrt(1 + model.count / (numbers * (1 - 1 / max(rounds, 2)))))
