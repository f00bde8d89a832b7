"""The best shape of a suspect near the grid point where it was found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.scores import Ground, surviving
from posture_opt.diagnosis.suspects import Suspect
from posture_opt.diagnosis.tangents import Tangents
from posture_opt.diagnosis.umbrellas import Umbrella, between
from posture_opt.model.effects import Effect

Array = NDArray[np.float64]

_RANGE = {"travel": 1.6, "constant": 1.6}  # factor either way on a geometric grid
_EVALUATIONS = 16


def refined(tangents: Tangents, ground: Ground, suspect: Suspect) -> Suspect:
    """The suspect at the shape, between the neighbours on its grid, that explains most of the ground's residuals."""
    effect = suspect.what
    if isinstance(effect, Umbrella):
        return _between(tangents, ground, suspect, effect)
    if not effect.shape or effect.target == "linear" or effect.kind == "slip":
        return suspect
    name = effect.shape[0]
    if name == "lsb":
        return suspect
    from scipy.optimize import minimize_scalar

    value = float(getattr(effect, name))
    low, high = _bracket(tangents, effect, name, value)

    def loss(trial: float) -> float:
        Z = tangents.columns(reshaped(effect, name, trial))
        basis, _ = surviving(ground, Z)
        return -float(np.sum((basis.T @ ground.e) ** 2))

    found = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"maxiter": _EVALUATIONS})
    if found.fun >= loss(value):
        return suspect
    better = reshaped(effect, name, float(found.x))
    return Suspect(better, tangents.columns(better), suspect.searched)


def _between(tangents: Tangents, ground: Ground, suspect: Suspect, umbrella: Umbrella) -> Suspect:
    near = [suspect, *(Suspect(u, Z, suspect.searched) for u, Z in between(tangents, umbrella))]
    return max(near, key=lambda s: float(np.sum((surviving(ground, s.Z)[0].T @ ground.e) ** 2)))


def _bracket(tangents: Tangents, effect: Effect, name: str, value: float) -> tuple[float, float]:
    if name == "cycles":
        q = tangents.residuals.data.q[:, tangents.residuals.robot.joint_names.index(effect.target)]
        step = 2 * np.pi / float(np.ptp(q)) / 3
        return value - step, value + step
    factor = _RANGE.get(name, 1.5)
    return value / factor, value * factor


def reshaped(effect: Effect, name: str, value: float) -> Effect:
    """The effect with another shape [SI]."""
    return effect.model_copy(update={name: value})
