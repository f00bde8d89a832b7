"""Whether data determine the size of a cause: all directions of its parameters together, not only the best one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.scores import levels
from posture_opt.model.effects.base.gravity_load import GravityLoaded
from posture_opt.numerics import Array


def is_determined(values: Array, covariance: Array, columns: Array | None = None) -> bool:
    """Whether a size is larger than its error is at 95 %, all directions of its parameters together.

    The size of parameters θ (k,) is how far they move the tool points, ``|B θ|``, and its error that of a random
    ``B e``: ``|B θ|² > t χ²_{ν, 0.95} / ν`` with ``t = tr M``, ``ν = t² / tr M²`` and ``M = B C Bᵀ``. A size whose
    error is large in a single direction, however well all others are known, is none: it is at least 1.96 times its
    error in the worst one. What has no standard error is no estimate.

    Args:
        values: θ [SI]; covariance: C (k, k) of them.
        columns: B (m, k), the tool points moved by one unit each; one for all, where they are not given.

    Source: Satterthwaite (1946), the distribution of sums of squares of unequal variances.

    Example:
        >>> import numpy as np
        >>> is_determined(np.array([1.0]), np.array([[1.0]])), is_determined(np.array([3.0]), np.array([[1.0]]))
        (False, True)
        >>> is_determined(np.array([20.0, 24.0]), np.diag([1.0, 710.0**2]))  # 20 standard errors from zero
        False
    """
    from scipy.special import chdtri

    own = np.flatnonzero(np.diag(covariance) > 0)
    B = (np.eye(len(values)) if columns is None else columns)[:, own]
    scale = np.sqrt(np.diag(covariance)[own])
    z, gram = values[own] / scale, scale[:, None] * (B.T @ B) * scale
    M = covariance[np.ix_(own, own)] / np.outer(scale, scale) @ gram  # it has the eigenvalues of B C Bᵀ
    trace = float(np.trace(M))
    if not trace > 0:
        return True
    freedom = max(trace**2 / float(np.sum(M * M.T)), 1.0)
    return float(z @ gram @ z) > trace / freedom * float(chdtri(freedom, levels.SIZE_LEVEL))


def determined_parts(model: Fit, place: int) -> tuple[int, ...]:
    """Which parts of an effect have a size that the data of a fit determine, given geometry and all other parts.

    A slow line that trades with the geometry leaves fast ones of the same joint as sure as they are. Where no part is
    sure by itself, as of lines next to each other, all of them are if their sum is. The standard errors are those with
    shapes fitted too: a size that trades with its shape is not determined either.

    Args:
        place: of the effect among those of the model.
    """
    own, B = model.slices[place], model.effect_columns(place)
    x, C = model.x[own], model.covariance[own, own]
    parts = model.effects[place].size_parts
    sure = tuple(i for i, p in enumerate(parts) if is_determined(x[p], C[p, p], B[:, p]))
    return tuple(range(len(parts))) if not sure and determines_all(model, place) else sure


def determines_all(model: Fit, place: int) -> bool:
    """Whether the data of a fit determine the size of an effect as a whole, all its parts together."""
    part = model.slices[place]
    return is_determined(model.x[part], model.covariance[part, part], model.effect_columns(place))


def stated_parts(model: Fit, place: int) -> tuple[int, ...]:
    """The parts of an effect whose sizes are determined as they are stated; what they do to the tool may be so alone.

    Of unknown loads the turn about its mean is stated: a mean turn, which they share with an offset of the joint, moves
    the tool too.
    """
    parts, effect = determined_parts(model, place), model.effects[place]
    if not parts or not (isinstance(effect, GravityLoaded) and effect.unstated_loads):
        return parts
    size, std = turn_about_mean(model, place, parts)
    return parts if is_determined(np.array([size]), np.array([[std**2]])) else ()


def turn_about_mean(model: Fit, place: int, parts: Sequence[int]) -> tuple[float, float]:
    """Root mean square of the turn that parts of an effect make about its mean, and its standard error [rad].

    ``√(θᵀMθ)``, M (k, k) the covariance of the turns by one unit of each parameter, summed over axes where they have
    some; the error to first order. A mean turn is an offset of the joint.
    """
    own = places_of_parts(model, place, parts)
    turns = turns_of(model, place)[:, :, [k - model.slices[place].start for k in own]]
    values, C = model.x[own], model.covariance[np.ix_(own, own)]
    centred = (turns - turns.mean(axis=1, keepdims=True)).reshape(-1, turns.shape[-1])
    M = centred.T @ centred / turns.shape[1]
    size = float(np.sqrt(values @ M @ values))
    return size, float(np.sqrt(values @ M @ C @ M @ values)) / size if size else 0.0


def turns_of(model: Fit, place: int) -> Array:
    """(axes, N, k) turn of its joint by one unit of each parameter of an effect [rad].

    Of what acts on no joint it is that of the tool, about three axes.
    """
    state = EffectSensitivities(model.residuals, model.x).state
    ones, rows = model.effects[place].sensitivities(state), np.zeros(len(model.residuals.data))
    joints = np.stack([rows + sum(one.joints.values()) for one in ones], axis=-1)
    if np.any(joints):
        return joints[None]
    return np.stack([np.stack([rows + one.twist[1][axis] for one in ones], axis=-1) for axis in range(3)])


def places_of_parts(model: Fit, place: int, parts: Sequence[int]) -> list[int]:
    """Where in the parameters (k,) of a fit those of some parts of an effect are."""
    first, every = model.slices[place].start, model.effects[place].size_parts
    return [first + k for i in parts for k in range(every[i].start, every[i].stop)]


def determines(model: Fit, place: int) -> bool:
    """Whether the data of a fit determine the size of one of its effects, or of parts of it."""
    return bool(determined_parts(model, place))


def undetermined(model: Fit) -> list[int]:
    """The places of the effects of a fit whose sizes the data do not determine."""
    return [place for place in range(len(model.effects)) if not determines(model, place)]
