"""What a large file was thinned to, how the rest of it is predicted, and whether more rows would have helped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.cross_validation import position_errors
from posture_opt.calibration.estimation.error_statistics import Statistics
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.thinning import Thinning
from posture_opt.numerics import Array, Json

_SAMPLED_ROWS = 2000  # rows: enough for the mean of what parameters do to the tool


@dataclass(frozen=True, eq=False)
class LargeFile:
    """The rows of a file that taught a model, and those that judge it.

    Args:
        thinning: which rows were used.
        models: position errors of the rows left out, by model [m].
        uncertainty: root mean square of what the standard errors of the fit move the tool by [m]; of n times as many
            rows it would be smaller by √n.
    """

    thinning: Thinning
    models: Mapping[str, Statistics]
    uncertainty: float

    @classmethod
    def of(cls, thinning: Thinning, models: Mapping[str, tuple[Residuals, Array]], fit: Fit) -> LargeFile:
        """The rows that are left out, predicted by models, each residuals and deviations (k,).

        ``fit`` is the one in question.
        """
        clocked, rest = thinning.clocked, thinning.rest
        errors = {
            name: position_errors(residuals.of_data(clocked).take(rest), x) for name, (residuals, x) in models.items()
        }
        groups = thinning.blocks[rest]
        judged = {name: Statistics.of(e, groups) for name, e in errors.items()}
        return cls(thinning, judged, tool_uncertainty(fit))

    @property
    def left(self) -> float:
        """Root mean square error of the last model on the rows left out [m]."""
        return list(self.models.values())[-1].rms

    def to_json(self) -> dict[str, Json]:
        """The part ``thinned`` of a document."""
        return {
            **self.thinning.to_json(),
            "left_out": {name: statistics.to_json() for name, statistics in self.models.items()},
            "fit_uncertainty_rms": self.uncertainty,
        }


def tool_uncertainty(fit: Fit) -> float:
    """Root mean square over the rows of what the standard errors of a fit move the tool by [m]: ``√ tr(J C Jᵀ)``."""
    used = fit.residuals
    some = used.take(np.unique(np.linspace(0, len(used.data) - 1, _SAMPLED_ROWS).astype(np.intp)))
    J = some.residuals_and_jacobian(fit.x)[1][: some.measured].reshape(len(some.data), some.block, -1)
    L = some.metres(J[:, : len(some.axes)]) @ fit.directions
    return float(np.sqrt(np.einsum("nij,jk,nik->", L, fit.C, L, optimize=True) / len(some.data)))
