"""What outlasts the session of a fitted arm: the part to plan with, and to predict another session by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.calibration.effect_sensitivities import EffectSensitivities
from posture_opt.diagnosis.extended_fit import Extended, shape_column
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array

_PLACE = ("base.x", "base.y", "base.z")


def persistent(model: Extended, frames: Array, with_time: bool = False) -> Extended:
    """The estimate without the effects that belong to their session, those of time kept if ``with_time``.

    Nothing is fitted again: what changed during the session is still in its data, and geometry and the other effects
    would take it up. A joint that slipped is as it was before; a free base stands where it stood on average while it
    drifted or slipped. All is as certain as it was estimated together.

    Args:
        frames: (k, f) steps of what is free in the arm.
    """
    stays = [
        i for i, s in enumerate(model.suspects)
        if isinstance(s.what, Effect) and (s.what.for_planning or (with_time and "time" in s.what.needs))
    ]  # fmt: skip
    if len(stays) == len(model.suspects):
        return model
    part = _part(model, stays)
    return replace(part, x=part.x + (np.zeros(len(part.x)) if with_time else halfway(model, frames)))


def halfway(model: Extended, frames: Array) -> Array:
    """The step (k,) of a free base that stands for what drifts and slips of it did on average [m]."""
    joints = model.residuals.robot.joint_names
    drifts = [
        i for i, s in enumerate(model.suspects)
        if isinstance(s.what, Effect) and "time" in s.what.needs and s.target not in joints
    ]  # fmt: skip
    base = [i for i, p in enumerate(model.residuals.parameters) if p.name in _PLACE and np.any(frames[i])]
    step = np.zeros(len(model.x))
    if drifts and base:
        rows = len(model.residuals.data) * model.residuals.block
        moved = np.sum([model.suspects[i].Z @ model.theta[model.slices[i]] for i in drifts], axis=0)
        step[base] = np.linalg.lstsq(model.residuals.both(model.x)[1][:rows, base], moved, rcond=None)[0]
    return step


def _part(model: Extended, places: list[int]) -> Extended:
    """Some effects of an estimate, with their part of its covariance."""
    g, slices, smooth = model.directions.shape[1], model.slices, list(model.shape_std)
    theta = [k for i in places for k in range(slices[i].start, slices[i].stop)]
    shapes = [g + len(model.theta) + smooth.index(i) for i in places if i in smooth]
    kept = [*range(g), *(g + k for k in theta), *shapes]
    return replace(
        model,
        suspects=tuple(model.suspects[i] for i in places),
        theta=model.theta[theta],
        covariance=model.covariance[np.ix_(kept, kept)],
    )


def covariance_at_shapes(model: Extended) -> Array:
    """Covariance (directions, theta) of effects whose shapes are held where they were found.

    The covariance of the estimate lets the shapes go: sine and cosine then lean on cycles that may differ too, and are
    less certain than their sum ever is in the data. Who holds the shape takes ``A C Aᵀ`` with ``A = [I, B⁺D]``: what an
    error of the shape does to the data, D, as far as the columns B of the effect can express it.
    """
    g, t = model.directions.shape[1], len(model.theta)
    A = np.eye(g + t, len(model.covariance))
    tangents = EffectSensitivities(model.residuals, model.x)
    for column, i in enumerate(model.shape_std, start=g + t):
        suspect, part = model.suspects[i], model.slices[i]
        D = shape_column(tangents, suspect, model.theta[part])
        if D.shape[1]:
            A[g + part.start : g + part.stop, column] = np.linalg.lstsq(suspect.Z, D[:, 0], rcond=None)[0]
    return np.asarray(A @ model.covariance @ A.T)
