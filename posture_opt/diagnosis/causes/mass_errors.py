"""Standard errors of what is compliant under a load: they carry the uncertainty of the masses that make the load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.numerics import Array

_RELATIVE_SIGMA = 0.05
"""Relative σ of each mass that a file states: cables, covers and grease are in no table of the maker; a choice."""
_STEP = 0.1
"""Relative step of a mass for the difference of columns, which are linear in it but for the lost motion of a load."""


def with_mass_errors(fit: Fit) -> Fit:
    """The same estimate with what the errors of stated masses do to it: ``C + Σ_k s_k s_kᵀ``.

    ``s_k = −σ A⁺ ∂(Z θ)/∂ln m_k`` with A all columns of the fit and Z those of the effects that rest on masses, of size
    θ: parameters that are not estimated, but considered. Where payloads differ, these determine the sizes, and s_k is
    small.

    Source: Tapley, Schutz, Born (2004), Statistical Orbit Determination, section 6.2.
    """
    loaded = [i for i, effect in enumerate(fit.effects) if "masses" in effect.asks]
    if not loaded:
        return fit
    A, inverse = fit.jacobian @ fit.directions, np.linalg.pinv(fit.minimum.R, rcond=1e-14)
    robot, now = fit.residuals.robot, _shift(fit, fit, loaded)
    steps = []
    for k, joint in enumerate(robot.joints):
        if not joint.mass > 0:
            continue
        joints = (*robot.joints[:k], replace(joint, mass=(1 + _STEP) * joint.mass), *robot.joints[k + 1 :])
        heavier = fit.residuals.of_robot(replace(robot, joints=joints), fit.residuals.parameters)
        change = (_shift(fit, replace(fit, residuals=heavier), loaded) - now) * _RELATIVE_SIGMA / _STEP
        steps.append(-inverse @ (inverse.T @ (A.T @ change)))
    S = np.array(steps).reshape(len(steps), A.shape[1])
    return replace(fit, C=fit.C + S.T @ S)


def _shift(fit: Fit, loads: Fit, effects: list[int]) -> Array:
    """(m,) what effects of a fit do to its residuals under the masses of another."""
    sensitivities = EffectSensitivities(loads.residuals, loads.x)
    moved = [sensitivities.columns(fit.effects[i]) @ fit.x[fit.slices[i]] for i in effects]
    return np.asarray(np.sum(moved, axis=0)[: fit.residuals.measured])
