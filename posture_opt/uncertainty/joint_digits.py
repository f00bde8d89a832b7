"""How many digits of joint values are worth writing: rounding must be small beside the scatter of the tool point.

With the columns ``J_j`` of the Jacobian, rounding by steps ``h_j`` moves the tool point by up to ``Σ_j |J_j| h_j / 2``
and with a standard deviation ``√(Σ_j |J_j|² h_j² / 12)``; where joints turn and slide, each kind may take half. The
scatter is the root mean square of the standard deviations along the three axes, ``√(tr C / 3)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from posture_opt.numerics import Array
from posture_opt.robot.robot import Joint
from posture_opt.statements.notation import joint_unit
from posture_opt.uncertainty.spread import HasSources
from posture_opt.uncertainty.tool_point import ToolPoint
from posture_opt.units import fixed

ROUNDING_SHARE = 0.01  # of the scatter by which rounding may move the tool point, every joint to the worse side


@dataclass(frozen=True)
class JointDigits:
    """The steps that joint values may be rounded to."""

    turn: float  # of revolute joints [rad]; slide: of prismatic ones [m]
    slide: float

    def decimals(self, joint: Joint, factor: float) -> int:
        """Decimals of a joint value in a unit of ``factor`` rad or m."""
        step = self.turn if joint.type == "revolute" else self.slide
        return max(0, math.ceil(-math.log10(step / factor) - 1e-9))

    def text(self, joint: Joint, value: float, factor: float) -> str:
        """A joint value [rad or m] as a number in a unit of ``factor`` rad or m."""
        return fixed(value / factor, self.decimals(joint, factor))


def joint_digits(problem: HasSources, postures: ArrayLike, share: float = ROUNDING_SHARE) -> JointDigits:
    """The digits that move the tool point by less than a ``share`` of its scatter at all postures (N, n) [rad or m]."""
    return _coarsest(problem, postures, 2 * share, lambda lengths: float(np.sum(lengths)))


def readable_digits(problem: HasSources, postures: ArrayLike) -> JointDigits:
    """The digits that people type in, at postures (N, n) [rad or m]; one decimal at least.

    Rounding moves the tool point by a standard deviation of 0.3 of its scatter, which grows by 5 %.
    """
    allowed = 0.3 * math.sqrt(12.0)
    found = _coarsest(problem, postures, allowed, lambda lengths: float(np.linalg.norm(lengths)))
    return JointDigits(min(found.turn, math.radians(0.1)), min(found.slide, 1e-4))


def readable_posture(problem: HasSources, q: ArrayLike) -> str:
    """A posture (n,) [rad or m] in one line with `readable_digits`: joint1 12.3 deg, joint2 120.0 mm."""
    digits, joints, texts = readable_digits(problem, q), problem.arm.robot.joints, []
    for joint, value in zip(joints, np.asarray(q, dtype=float), strict=True):
        unit, factor = joint_unit(joint.type)
        texts.append(f"{joint.name} {digits.text(joint, float(value), 1 / factor)} {unit}")
    return ", ".join(texts)


def _coarsest(problem: HasSources, postures: ArrayLike, allowed: float, total: Callable[[Array], float]) -> JointDigits:
    """The steps whose ``total`` for a kind of joints is its part of the ``allowed`` scatter; at most 1 deg or 1 mm."""
    types = np.array([joint.type for joint in problem.arm.robot.joints])
    steps: dict[str, float] = {"revolute": math.radians(1.0), "prismatic": 1e-3}
    for q in np.atleast_2d(np.asarray(postures, dtype=float)):
        reach = np.linalg.norm(np.asarray(problem.arm.jacobian(q), dtype=float)[:3], axis=0)
        for kind in set(types.tolist()):
            if (moved := total(reach[types == kind])) > 0:
                steps[kind] = min(steps[kind], allowed * scatter(problem, q) / len(set(types.tolist())) / moved)
    least = 1e-12  # [rad or m]: below it no controller, and no float of half a turn, has digits
    return JointDigits(max(steps["revolute"], least), max(steps["prismatic"], least))


def scatter(problem: HasSources, q: Array) -> float:
    """The standard deviation of the tool point that rounding is compared with at a posture (n,) [m]."""
    tool_point, values = ToolPoint.of(problem.arm, problem.sources), [float(value) for value in q]
    first = np.asarray(tool_point.pose_first_order(values, tool_point.walk(values)[0]), dtype=float)[:3, :3]
    return math.sqrt(max(float(np.trace(first)), 0.0) / 3) or 1e-4  # where none is stated
