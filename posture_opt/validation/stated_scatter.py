"""What sections and effects say of the scatter of the joints from repeat to repeat, before any data are asked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from posture_opt.calibration.parameters import CalibrationProblem
from posture_opt.model.effects import NoiseEffect
from posture_opt.robot.robot import Robot
from posture_opt.uncertainty.repeatability import joint_sigmas

_ROUNDING = 1e-6  # of a variance


@dataclass(frozen=True)
class JointScatter:
    """Standard deviations of the joints' errors from repeat to repeat.

    Args:
        sigma: JOINT.theta or JOINT.d -> standard deviation [rad or m], above 0.
        of_effects: the part of it that effects of the problem, or effects that were named, say.
        instrument: standard deviation of a measured coordinate [m] that was taken off before.
        measured: whether the data say so; else it is what the problem file states.
        note: a sentence on where it comes from.
    """

    sigma: Mapping[str, float] = field(default_factory=dict)
    instrument: float = 0.0
    measured: bool = False
    note: str = ""
    of_effects: Mapping[str, float] = field(default_factory=dict)

    @property
    def beside(self) -> dict[str, float]:
        """``sigma`` without the part of the effects, where something is left."""
        parts = {name: s**2 - self.of_effects.get(name, 0.0) ** 2 for name, s in self.sigma.items()}
        return {name: math.sqrt(v) for name, v in parts.items() if v > _ROUNDING * self.sigma[name] ** 2}


def stated_scatter(problem: CalibrationProblem) -> JointScatter:
    """What the problem states of the joints' scatter, without that of its effects."""
    sources, own = problem.sources, scatter_of_effects(problem.robot, problem.effects)
    total = dict(zip(sources.names, map(float, np.sqrt(np.diag(sources.scatter))), strict=True))
    visit = {name: s for name, s in total.items() if s > 0}
    if visit:
        return JointScatter(
            JointScatter(visit, of_effects=own).beside,
            note="scatter of the joints as stated: the data do not tell it",
        )
    joints, staying = joint_errors(problem.robot), np.sqrt(np.diag(sources.constant))
    sigma = {name: float(s) for name, s in zip(sources.names, staying, strict=True) if name in joints and s > 0}
    if sigma:
        return JointScatter(
            sigma, note="the σ's of the joints, as stated, taken for their scatter: the data do not tell it"
        )
    sheet = problem.robot.repeatability
    if sheet is not None:
        found = joint_sigmas(problem.robot, sheet.value)
        sigma = dict(zip(found.names, map(float, found.sigma), strict=True))
        return JointScatter(sigma, note="scatter of the joints from the data sheet: the data do not tell it")
    return JointScatter(note="the data tell no scatter of the joints, and none is stated")


def scatter_of_effects(robot: Robot, effects: Sequence[object]) -> dict[str, float]:
    """JOINT.theta or JOINT.d -> σ from repeat to repeat that effects state [rad or m]."""
    total: dict[str, float] = {}
    for effect in effects:
        total = plus(total, effect.scatter(robot)) if isinstance(effect, NoiseEffect) else total
    return total


def plus(one: Mapping[str, float], other: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations of independent errors, added by name."""
    return {name: math.hypot(one.get(name, 0.0), other.get(name, 0.0)) for name in (*one, *other)}


def scatter_beside(problem: CalibrationProblem, name: str, own: float, said: float) -> float:
    """The σ of a joint of which effects say ``said``, ``own`` of it part of what the problem states."""
    visit = dict(zip(problem.sources.names, np.diag(problem.sources.scatter), strict=True)).get(name, 0.0)
    return math.sqrt(max(float(visit) - own**2, 0.0) + said**2)


def joint_errors(robot: Robot) -> tuple[str, ...]:
    """(n,) the names of the joint values' errors, JOINT.theta or JOINT.d."""
    factors = robot.factors
    return tuple(factors[i].parameter for i in robot.driven)
