"""The best shape of a suspect near the grid point where it was found."""

from __future__ import annotations

import numpy as np

from posture_opt.calibration.effect_sensitivities import EffectSensitivities
from posture_opt.diagnosis import levels
from posture_opt.diagnosis.candidates import Candidate
from posture_opt.diagnosis.score_tests import ProjectedBaseline, projected_basis
from posture_opt.diagnosis.unnamed_components import UnnamedComponent, finer_phases
from posture_opt.model.effects import Effect
from posture_opt.model.effects.slip import STEPS, Slip
from posture_opt.numerics import Array

_RANGE = {"travel": 1.6, "constant": 1.6}  # factor either way on a geometric grid


def refine_shape(sensitivities: EffectSensitivities, baseline: ProjectedBaseline, candidate: Candidate) -> Candidate:
    """The suspect at the shape, between the neighbours on its grid, that explains most of the ground's residuals."""
    effect = candidate.what
    if isinstance(effect, UnnamedComponent):
        return _between(sensitivities, baseline, candidate, effect)
    if isinstance(effect, Slip):
        return _moment(sensitivities, baseline, candidate, effect)
    if not effect.shape or effect.target == "linear":
        return candidate
    name = effect.shape[0]
    if name == "lsb":
        return candidate
    from scipy.optimize import minimize_scalar

    value = float(getattr(effect, name))
    low, high = _bracket(sensitivities, effect, name, value)

    def loss(trial: float) -> float:
        return -_gain(baseline, sensitivities.columns(with_shape(effect, name, trial)))

    found = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"maxiter": levels.SHAPE_EVALUATIONS})
    if found.fun >= loss(value):
        return candidate
    better = with_shape(effect, name, float(found.x))
    return Candidate(better, sensitivities.columns(better), candidate.searched)


def _between(
    sensitivities: EffectSensitivities, baseline: ProjectedBaseline, candidate: Candidate, component: UnnamedComponent
) -> Candidate:
    near = [candidate, *(Candidate(u, Z, candidate.searched) for u, Z in finer_phases(sensitivities, component))]
    return max(near, key=lambda s: _gain(baseline, s.Z))


def _moment(
    sensitivities: EffectSensitivities, baseline: ProjectedBaseline, candidate: Candidate, slip: Slip
) -> Candidate:
    """The slip between the two rows, no further off than the next moments of the grid, where it explains most.

    Any moment between two rows is the same column. Where rows are many, some are tried first, and then those beside
    the best of them: what a slip explains falls off to both sides of its moment.
    """
    times = np.unique(np.asarray(sensitivities.site.inputs.time, dtype=float))
    step = float(np.ptp(times)) / STEPS
    near = (times[:-1] < slip.moment + step) & (times[1:] > slip.moment - step)
    between_rows = ((times[:-1] + times[1:]) / 2)[near]

    def gain(k: int) -> float:
        return _gain(baseline, sensitivities.columns(with_shape(slip, "moment", float(between_rows[k]))))

    count = len(between_rows)
    stride = max(count // levels.MOMENTS_TRIED, 1)
    some = max(range(stride // 2, count, stride), key=gain)
    best = max(range(max(some - stride + 1, 0), min(some + stride, count)), key=gain)
    if gain(best) < _gain(baseline, candidate.Z):
        return candidate
    better = with_shape(slip, "moment", float(between_rows[best]))
    return Candidate(better, sensitivities.columns(better), candidate.searched)


def _gain(baseline: ProjectedBaseline, Z: Array) -> float:
    """What columns (m, k) explain of the ground's residuals."""
    return float(np.sum((projected_basis(baseline, Z)[0].T @ baseline.e) ** 2))


def _bracket(sensitivities: EffectSensitivities, effect: Effect, name: str, value: float) -> tuple[float, float]:
    if name == "cycles":
        q = sensitivities.residuals.data.q[:, sensitivities.residuals.robot.joint_names.index(effect.target)]
        step = 2 * np.pi / float(np.ptp(q)) / 3
        return value - step, value + step
    factor = _RANGE.get(name, 1.5)
    return value / factor, value * factor


def with_shape(effect: Effect, name: str, value: float) -> Effect:
    """The effect with another shape [SI]."""
    return effect.model_copy(update={name: value})
