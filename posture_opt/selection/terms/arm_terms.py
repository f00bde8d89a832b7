"""Terms of the arm as a whole: torque of gravity on its joints, height of its links."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from posture_opt.errors import BadValueError
from posture_opt.model.arm_state import ArmState
from posture_opt.robot.robot import Robot
from posture_opt.selection.terms.term import LowerBoundedTerm, Quantities, Stated, Term, joints_named
from posture_opt.units import Length, Torque

Bound = Annotated[Torque, Field(gt=0)]


class JointTorque(Term):
    """Torque of gravity on every revolute joint, arm at rest [N m]: links with their masses, and the payload.

    ``τ_i = Σ_k m_k (a_i × (x_k − o_i)) · g`` over the masses m_k at x_k behind joint i, with the joint's axis a_i
    through o_i and the payload at the tool point. Positive in the joint's positive direction. A bound holds for either
    sign; it is one number for all joints, or one for each joint that is named. Where ``subject_to`` states none, the
    efforts of the joints in a URDF are the bounds.
    """

    summary: ClassVar[str] = "torque of gravity on every revolute joint, payload included (at_most, or weight)"
    unit: ClassVar[str] = "N m"

    kind: Literal["joint_torque"]
    at_most: Bound | Annotated[dict[str, Bound], Field(min_length=1)] | None = Field(
        None, description="one bound for all joints, or JOINT: bound; by default those of a URDF"
    )

    def check(self, robot: Robot) -> None:
        if not ArmState(robot, [0.0] * robot.n).weighed:
            message = "masses or centres of mass of some links are not stated, so no torque is known"
            raise BadValueError(message, "add mass: 2.5 kg and com: [0 m, 0 m, 0 m] to the joints")
        for index in joints_named(self.at_most, robot) if isinstance(self.at_most, dict) else ():
            if robot.joints[index].type == "prismatic":
                name = robot.joints[index].name
                raise BadValueError(f"{name} is prismatic: it bears a force and no torque", "leave it out")

    def for_robot(self, robot: Robot, bounded: bool) -> JointTorque:
        """Without a bound of its own, each joint is bounded by its drive: ``effort`` in ``<limit>`` of a URDF."""
        rated = {joint.name: joint.effort for joint in robot.joints if joint.type == "revolute" and joint.effort > 0}
        return (
            self if self.at_most is not None or not rated or not bounded else self.model_copy(update={"at_most": rated})
        )

    def quantity(self, at: Quantities) -> ca.SX:
        return ca.vertcat(ca.SX(0, 1), *(ca.SX(at.state.torque(joint)) for joint in self._joints(at.robot)))

    def labels(self, at: Quantities) -> list[str]:
        return [f"joint_torque of {at.robot.joints[joint].name}" for joint in self._joints(at.robot)]

    def bounds(self) -> tuple[float, float]:
        most = (
            math.inf if self.at_most is None else max(self._each()) if isinstance(self.at_most, dict) else self.at_most
        )
        return -most, most

    def _joints(self, robot: Robot) -> list[int]:
        if isinstance(self.at_most, dict):
            return joints_named(self.at_most, robot)
        return [k for k, joint in enumerate(robot.joints) if joint.type == "revolute"]

    def _each(self) -> list[float]:
        """Bounds [N m] of the named joints in file order; empty for one bound of all."""
        return list(self.at_most.values()) if isinstance(self.at_most, dict) else []

    def bounds_of(self, at: Quantities) -> list[tuple[float, float]]:
        if isinstance(self.at_most, dict):
            return [(-most, most) for most in self._each()]
        return super().bounds_of(at)

    def stated(self) -> list[Stated]:
        each = self.at_most if isinstance(self.at_most, dict) else {"": self.bounds()[1]}
        return [Stated(-math.inf, most, self.unit, name) for name, most in each.items()]

    def shown(self, value: float) -> float:
        return abs(value)

    def scale(self, at: Quantities) -> float:
        """All weights on a lever as long as half of the arm."""
        weights = sum(float(mass) for _, mass, _ in at.state.loads)
        return max(weights * math.hypot(*at.robot.gravity) * at.robot.length / 2, 1.0)


class LinkHeight(LowerBoundedTerm):
    """Height (z in the world) of the end of every link that a joint can raise [m]; the tool point is not among them.

    The end of link i is the origin of the frame behind joint i, ``T_world_i[2, 3]``. Links are taken as lines without
    thickness: ``at_least`` has to hold half of their diameter too.
    """

    summary: ClassVar[str] = "height (world z) of the end of every link (at_least)"
    unit: ClassVar[str] = "m"
    size: ClassVar[float] = 0.1

    keeps_clear: ClassVar[bool] = True

    kind: Literal["link_height"]
    at_least: Length = Field(0.0, description="height of the end of every link, world z")

    def quantity(self, at: Quantities) -> ca.SX:
        return ca.vertcat(ca.SX(0, 1), *(at.frames[2, k] for k in self._moving(at)))

    def labels(self, at: Quantities) -> list[str]:
        return [f"link_height behind {at.robot.joints[k].name}" for k in self._moving(at)]

    def _moving(self, at: Quantities) -> list[int]:
        return [k for k in range(at.frames.shape[1]) if ca.depends_on(at.frames[2, k], at.q)]
