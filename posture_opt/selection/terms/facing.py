"""Term ``facing``: the arm turns its front to the tool instead of reaching over its back."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from posture_opt.model.chain import Scalar, Vector, Walk, add, cos_sin, cross, dot, fixed_pose, scale, subtract
from posture_opt.robot.robot import Robot
from posture_opt.selection.terms.term import Quantities, Stated, Term
from posture_opt.units import Angle


class Facing(Term):
    """Angle φ about the first axis from the front of the arm to the tool point [rad], by its cosine.

    ``cos φ = f·r / |r|`` with the front f, and r the part across the axis of the way from the axis to the tool point.
    The front is the x axis of the base (ISO 9787), turned by the first joint. An arm has one where its first joint
    turns about the z axis of the base.
    """

    summary: ClassVar[str] = "angle about the first axis from the front of the arm to the tool point (at_most)"
    unit: ClassVar[str] = "rad"

    kind: Literal["facing"]
    at_most: Annotated[Angle, Field(gt=0, le=math.pi)] = Field(
        math.pi / 2, description="angle about the first axis from the front of the arm to the tool point"
    )

    def quantity(self, at: Quantities) -> ca.SX:
        return ca.SX(front_cosine(at.robot, at.walk, at.q[0])) if has_front(at.robot) else ca.SX(0, 1)

    def cost(self, at: Quantities) -> ca.SX:
        """``2 (1 − cos φ)``, the square of a small angle."""
        return 2 * (1 - self.quantity(at))

    def bounds(self) -> tuple[float, float]:
        return round(math.cos(self.at_most), 15), math.inf

    def stated(self) -> list[Stated]:
        return [Stated(-math.inf, self.at_most, self.unit)]

    def shown(self, value: float) -> float:
        return math.acos(min(max(value, -1.0), 1.0))


def has_front(robot: Robot) -> bool:
    """Whether the first joint turns about the z axis of the base, up to what corrections lean it by."""
    axes = fixed_pose(robot.factors[: robot.driven[0]])[:3, :3], fixed_pose(robot.base)[:3, 2]
    first = robot.factors[robot.driven[0]]
    return first.kind == "rotate" and abs(float(axes[0][:, first.axis] @ axes[1])) > 0.98


def front_cosine(robot: Robot, reached: Walk, turn: Scalar) -> Scalar:
    """``cos φ`` of `Facing` at a walk whose first joint is turned by ``turn`` [rad]; zero on the first axis."""
    screw, (x, y, z) = reached.screws[robot.driven[0]], fixed_pose(robot.base)[:3, 0].tolist()
    forward, c_s = (x, y, z), cos_sin(turn)
    front = add(scale(c_s[0], forward), scale(c_s[1], cross(screw.axis, forward)))
    way: Vector = subtract(reached.position, screw.origin)
    across = subtract(way, scale(dot(way, screw.axis), screw.axis))
    # Rounded off on the axis, where no side is in front: a micrometre
    return dot(front, across) / (dot(across, across) + 1e-12) ** 0.5
