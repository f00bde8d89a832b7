"""How far an arm stretches: a bound on its reach that needs no search."""

from __future__ import annotations

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
