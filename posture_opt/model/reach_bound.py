"""How far an arm stretches and folds: bounds on its reach that need no search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot


def stretched(robot: Robot) -> tuple[Array, float]:
    """(3,) the origin of the first joint [m], world, and a distance [m] from it that the tool point never exceeds.

    The distance is the sum of all lengths behind the first joint, slides at their longest: the triangle inequality.
    """
    first = robot.driven[0]
    reached = walk(robot.factors, factor_values(robot.factors, [0.0] * robot.n))
    lengths = sum(abs(factor.nominal) for factor in robot.factors[first:] if factor.kind == "translate")
    slides = sum(max(abs(j.lower), abs(j.upper)) for j in robot.joints if j.type == "prismatic")
    return np.array(reached.screws[first].origin, dtype=float), float(lengths + slides)


@dataclass(frozen=True)
class Shell:
    """Two spheres about the origin of the first joint: the tool point stays between them.

    Args:
        centre: (3,) [m], world.
        least, most: their radii [m].
    """

    centre: Array
    least: float
    most: float

    @classmethod
    def of(cls, robot: Robot) -> Shell:
        """The bounds of an arm by the triangle inequality, joint by joint from the tool to the base.

        The origins of neighbouring joints keep their distance ℓ as joints turn, so that a point that stays between a
        and b from one of them stays between ``max(ℓ − b, a − ℓ, 0)`` and ``ℓ + b`` from the next; a slide makes ℓ
        longer or shorter by its stroke. Joint limits and what bodies are in the way only make the reach smaller.
        """
        reached = walk(robot.factors, factor_values(robot.factors, [0.0] * robot.n))
        origins = [np.array(reached.screws[index].origin, dtype=float) for index in robot.driven]
        least, most, beyond = 0.0, 0.0, np.array(reached.position, dtype=float)
        for joint, origin in zip(reversed(robot.joints), reversed(origins), strict=True):
            length, stroke = float(np.linalg.norm(beyond - origin)), 0.0
            if joint.type == "prismatic":
                stroke = max(abs(joint.lower), abs(joint.upper))
            least, most = max(0.0, length - stroke - most, least - length - stroke), most + length + stroke
            beyond = origin
        return cls(origins[0], least, most)

    def misses(self, lower: Array, upper: Array, slack: float) -> bool:
        """Whether no point of the box (3,), (3,) [m], world, lies between the spheres, or within ``slack`` [m]."""
        nearest = np.linalg.norm(np.clip(self.centre, lower, upper) - self.centre)
        farthest = np.linalg.norm(np.maximum(np.abs(lower - self.centre), np.abs(upper - self.centre)))
        return bool(nearest > self.most + slack or farthest < self.least - slack)
