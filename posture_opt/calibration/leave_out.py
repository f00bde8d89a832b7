"""What held-out rows lose when a part of a fitted arm is left out and everything else is fitted again.

Every fold has one linear model of all columns. To leave some of them out is to hold their steps at zero, and what that
makes of all others follows from their covariance: no column is fitted a second time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.cross_validation import Folds, judged_rows, positions_of, refit_of_fold, residual_indices
from posture_opt.calibration.estimation.linear_model import LinearModel
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.numerics import Array, Codes, rms_length


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Errors on held-out rows with everything in the model, and with each part left out and all else fitted again.

    Args:
        whole: (N, axes) [m] with everything.
        without: (parts, N, axes) [m].
    """

    whole: Array
    without: Array

    @property
    def gains(self) -> Array:
        """(parts,) relative drop of the RMS by each part, ``1 − RMS_whole / RMS_without``."""
        whole = rms_length(self.whole)
        return np.array([1 - whole / max(rms_length(e), 1e-300) for e in self.without])


def leave_out(residuals: Residuals, linear: LinearModel, folds: Folds, parts: Sequence[Codes]) -> LeftOut:
    """Errors of the rows of each fold by the model fitted to the others, whole and without some of its columns.

    With the estimate ``z`` of a fold and its covariance ``C`` (for residuals of variance one) the estimate under
    ``z_g = 0`` is ``z − C[:, g] C[g, g]⁻¹ z_g`` (Lawson, Hanson 1974, chapter 22).

    Args:
        linear: of the whole arm; parts: indices of the columns that are left out together, each part by itself.
    """
    n, axes, block = len(residuals.data), len(residuals.axes), residuals.block
    whole, without = np.zeros((n, axes)), np.zeros((len(parts), n, axes))
    every = np.arange(linear.K.shape[1])
    for left_out in folds:
        theirs = residual_indices(left_out, block)
        step, spread = refit_of_fold(linear, linear.r, every, theirs)
        judged = residual_indices(judged_rows(residuals, left_out), block)
        A = linear.U[judged] @ linear.K
        r = linear.r[judged] + A @ step
        whole[left_out] = positions_of(residuals, r, left_out)
        for i, g in enumerate(parts):
            C = spread @ spread[g].T
            less = C @ np.linalg.lstsq(C[g], step[g] + linear.z[g], rcond=1e-12)[0]
            without[i, left_out] = positions_of(residuals, r - A @ less, left_out)
    return LeftOut(whole, without)
