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

_LEAST_VARIANCE = 1e-8
"""Of the step of a column of unit length, which is one where the rows show it: less is that of one they do not show."""


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
        seen = [_Seen.of(linear, spread, g) for g in parts]
        for g, part in zip(parts, seen, strict=True):
            step[g] = part.shown(step[g] + linear.z[g]) - linear.z[g]  # of what these rows do not show nothing is known
        judged = residual_indices(judged_rows(residuals, left_out), block)
        A = linear.U[judged] @ linear.K
        r = linear.r[judged] + A @ step
        whole[left_out] = positions_of(residuals, r, left_out)
        for i, (g, part) in enumerate(zip(parts, seen, strict=True)):
            less = spread @ part.weights(step[g] + linear.z[g])
            without[i, left_out] = positions_of(residuals, r - A @ less, left_out)
    return LeftOut(whole, without)


@dataclass(frozen=True, eq=False)
class _Seen:
    """What the rows of a fold show of a part, its columns counted in units of their length in all rows.

    A slip after which all rows are left out is not shown, nor would its estimate from all rows be a prediction.

    Args:
        lengths: (p,) of the columns; ``root`` (p, r) of the covariance of their steps in that unit.
        Q, variances: (p, d) directions that are shown, and the variance of each (d,).
    """

    lengths: Array
    root: Array
    Q: Array
    variances: Array

    @classmethod
    def of(cls, linear: LinearModel, spread: Array, part: Codes) -> _Seen:
        """Of a part, with the root of the covariance of all steps."""
        lengths = np.maximum(np.linalg.norm(linear.K[:, part], axis=0), 1e-300)
        root = lengths[:, None] * spread[part]
        values, Q = np.linalg.eigh(root @ root.T)
        kept = values > _LEAST_VARIANCE
        return cls(lengths, root, Q[:, kept], values[kept])

    def shown(self, sizes: Array) -> Array:
        """(p,) sizes as far as they are shown."""
        return np.asarray(self.Q @ (self.Q.T @ (self.lengths * sizes)) / self.lengths)

    def weights(self, sizes: Array) -> Array:
        """(r,) by which the root of the covariance gives what sizes (p,) that become zero take along."""
        return np.asarray(self.root.T @ (self.Q @ (self.Q.T @ (self.lengths * sizes) / self.variances)))
