"""As many standard deviations of joints as the errors determine: one for all turning joints, or one each.

The choice is that of BIC (Schwarz 1978): m − 1 further σ's have to raise twice the log-likelihood by (m − 1) log n.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from posture_opt.errors import InsufficientDataError
from posture_opt.numerics import Array, Mask
from posture_opt.validation.joint_variances import JointVariances, estimate_joint_variances

_MIN_LEVER_SHARE = 0.1  # of the longest of a turning joint


def likeliest_variances(
    errors: Array, known: Array, columns: Array, names: tuple[str, ...], instrument: float, *, fit: bool
) -> JointVariances | None:
    """One σ for all turning joints, unless the likelihood speaks clearly for one each (Schwarz 1978).

    ``None`` where the errors do not determine it. Joints that move what was measured little share the common σ.

    Args:
        errors: (N, d) about zero [m]; ``known`` (N, d, d) part of their covariance [m²].
        columns: (N, d, n) shift of the tool point by a unit of each joint's error [m/rad, m/m].
        instrument: σ of a coordinate [m]; a start where ``fit``.

    Returns:
        σ of every joint; of the common model the same for all turning joints.
    """
    try:
        common = estimate_joint_variances(
            errors, columns, instrument=instrument, fit_instrument=fit, equal=True, names=names, known=known
        )
    except InsufficientDataError:
        return None
    if not common.determined.all():
        return None
    strong = _strong_joints(columns, names)
    turning = sum(not name.endswith(".d") for name, own in zip(names, strong, strict=True) if own)
    if turning < 2:
        return common
    weak = columns[:, :, ~strong] * common.sigma[~strong]
    known_part = known + weak @ np.swapaxes(weak, -1, -2)
    own = [name for name, s in zip(names, strong, strict=True) if s]
    try:
        each = estimate_joint_variances(
            errors, columns[:, :, strong], instrument=instrument, fit_instrument=fit, names=own, known=known_part
        )
    except InsufficientDataError:
        return common
    clear = 2 * (each.log_likelihood - common.log_likelihood) > (turning - 1) * math.log(errors.size)
    if not (clear and each.determined.all()):
        return common
    sigma, std, interval = common.sigma.copy(), common.std.copy(), common.interval.copy()
    sigma[strong], std[strong], interval[strong] = _allowed_sigmas(each), each.std, each.interval
    return replace(each, names=names, sigma=sigma, std=std, interval=interval)


def _allowed_sigmas(noise: JointVariances) -> Array:
    """(n,) σ's to predict with: where the data allow none, half of the most that they allow.

    That is the root mean square of a half normal whose 95 % end it is. A likeliest σ of zero would predict a region
    without thickness, and little data find one often.
    """
    low, high = noise.interval.T
    return np.where((low <= 0) & np.isfinite(high), np.maximum(noise.sigma, high / 2), noise.sigma)


def _strong_joints(columns: Array, names: tuple[str, ...]) -> Mask:
    """(n,) which joints move what was measured far enough to have a σ of their own.

    The last joint of an arm turns the tool point a little about itself: asked alone, it would have to swing by degrees
    to explain what others leave.
    """
    lever = np.sqrt(np.mean(np.sum(columns**2, axis=1), axis=0))
    turning = np.array([not name.endswith(".d") for name in names])
    return np.asarray(~turning | (lever > _MIN_LEVER_SHARE * lever[turning].max(initial=0.0)))
