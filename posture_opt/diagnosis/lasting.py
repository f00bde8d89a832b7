"""What outlasts the session of a fitted arm: the part to plan with, and to predict another session by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.extended import Extended
from posture_opt.model.effects import Effect

Array = NDArray[np.float64]


def lasting(model: Extended, with_time: bool = False) -> Extended:
    """The estimate without the effects that belong to their session, those of time kept if ``with_time``.

    Nothing is fitted again: what changed during the session is still in its data, and geometry and the other effects
    would take it up. So the arm is the one before it drifted or slipped, as certain as all were estimated together.
    """
    stays = [
        i for i, s in enumerate(model.suspects)
        if isinstance(s.what, Effect) and (s.what.for_planning or (with_time and "time" in s.what.needs))
    ]  # fmt: skip
    return model if len(stays) == len(model.suspects) else _part(model, stays)


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
