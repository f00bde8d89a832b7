"""Whether data determine the size of a cause: in every direction of its parameters, and not only in the best one."""

from __future__ import annotations

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.scores import levels
from posture_opt.numerics import Array

_RANK_TOLERANCE = 1e-12  # of unit columns: columns of one effect that are alike by rounding


def is_determined(values: Array, covariance: Array, columns: Array | None = None) -> bool:
    """Whether the 95 % confidence region of a size keeps clear of zero, were it as wide everywhere as it is at most.

    The size of parameters θ (k,) is how far they move the tool point, ``|B θ|``, and its error in the worst direction
    the largest singular value of ``B C^½``: ``|B θ| > √χ²_k · σ_max``. A region that is narrow in one direction keeps
    clear of zero however wide it is in another, and may hold a thousand times the size. One parameter is determined if
    it is 1.96 standard errors from zero. What has no standard error is no estimate.

    Args:
        values: θ [SI]; covariance: C (k, k) of them.
        columns: B (m, k), the tool points moved by one unit each; one for all, where they are not given.

    Example:
        >>> import numpy as np
        >>> is_determined(np.array([1.0]), np.array([[1.0]])), is_determined(np.array([3.0]), np.array([[1.0]]))
        (False, True)
        >>> is_determined(np.array([20.0, 24.0]), np.diag([1.0, 710.0**2]))  # 20 standard errors from zero
        False
    """
    from scipy.special import chdtri

    if not len(values) or not np.all(np.diag(covariance) > 0):
        return True
    B = np.eye(len(values)) if columns is None else columns
    size = float(np.linalg.norm(B @ values))
    return size**2 > float(chdtri(len(values), levels.SIZE_LEVEL)) * _largest_variance(covariance, B)


def _largest_variance(covariance: Array, columns: Array) -> float:
    """The largest eigenvalue of ``B C Bᵀ``, from the Gram matrix of B: C (k, k), B (m, k)."""
    gram = columns.T @ columns
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    values, V = np.linalg.eigh(gram / np.outer(scale, scale))
    root = V * np.sqrt(np.where(values > _RANK_TOLERANCE, values, 0.0)) * scale[:, None]
    return float(np.linalg.eigvalsh(root.T @ covariance @ root)[-1])


def determines(model: Fit, place: int) -> bool:
    """Whether the data of a fit determine the size of one of its effects, given the geometry and the other effects.

    The standard errors are those with shapes fitted too: a size that trades with its shape is not determined either.

    Args:
        place: of the effect among those of the model.
    """
    part = model.slices[place]
    return is_determined(model.x[part], model.covariance[part, part], model.effect_columns(place))


def undetermined(model: Fit) -> list[int]:
    """The places of the effects of a fit whose sizes the data do not determine."""
    return [place for place in range(len(model.effects)) if not determines(model, place)]
