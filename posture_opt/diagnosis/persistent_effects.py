"""What outlasts the session of a fitted arm: the part to plan with, and to predict another session by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.calibration.fit import Fit
from posture_opt.numerics import Array

_PLACE = ("base.x", "base.y", "base.z")


def persistent(fit: Fit, frames: Array, with_time: bool = False) -> Fit:
    """The estimate without the effects that belong to their session, those of time kept if ``with_time``.

    Nothing is fitted again: what changed during the session is still in its data, and geometry and the other effects
    would take it up. A joint that slipped is as it was before; a free base stands where it stood on average while it
    drifted or slipped. All is as certain as it was estimated together.

    Args:
        frames: (k, f) steps of what is free in the arm.
    """
    stays = [i for i, e in enumerate(fit.effects) if e.for_planning or (with_time and "time" in e.needs)]
    if len(stays) == len(fit.effects):
        return fit
    moved = np.zeros(len(fit.x)) if with_time else mean_displacement(fit, frames)
    return replace(fit, x=fit.x + moved).keeping(stays)


def mean_displacement(fit: Fit, frames: Array) -> Array:
    """The step (k,) of a free base that stands for what drifts and slips of it did on average [m]."""
    joints = fit.residuals.robot.joint_names
    drifts = [i for i, e in enumerate(fit.effects) if "time" in e.needs and e.target not in joints]
    names = [p.name for p in fit.residuals.parameters[: len(frames)]]
    base = [i for i, name in enumerate(names) if name in _PLACE and np.any(frames[i])]
    step = np.zeros(len(fit.x))
    if drifts and base:
        moved = np.sum([fit.effect_columns(i) @ fit.x[fit.slices[i]] for i in drifts], axis=0)
        step[base] = np.linalg.lstsq(fit.jacobian[:, base], moved, rcond=None)[0]
    return step


def covariance_at_shapes(fit: Fit) -> Array:
    """Covariance (k, k) of an estimate whose effects have their shapes held where they were found.

    The covariance of the estimate lets the shapes go: sine and cosine then lean on cycles that may differ too, and are
    less certain than their sum ever is in the data. Who holds the shape takes ``A C Aᵀ`` with ``A = [I, B⁺D]``: what an
    error of the shape does to the data, D, as far as the columns B of the effect can express it.
    """
    A = np.eye(len(fit.x))
    for i, shape in fit.shapes.items():
        B, D = fit.effect_columns(i), fit.jacobian[:, shape]
        A[shape, shape] = 0.0
        if np.any(D):
            A[fit.slices[i], shape] = np.linalg.lstsq(B, D, rcond=None)[0]
    return np.asarray(A @ fit.covariance @ A.T)
