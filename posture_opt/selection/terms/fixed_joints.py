"""Term ``fixed_joints``: joints that do not move, a locked axis or one that cables hold."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from posture_opt.errors import BadValueError
from posture_opt.robot.robot import Robot
from posture_opt.selection.terms.term import Quantities, Stated, Term, joint_values
from posture_opt.units import JointValue


class FixedJoints(Term):
    """Named joints at given values [rad or m]: ``q_i = v_i``; the search never moves them, random starts included.

    It is no row of the program but a pair of equal bounds on a variable: the freedom of the arm is smaller, and
    nothing has to be solved for. A value beyond the joint's limits is refused, and so is an arm that is held
    altogether.
    """

    summary: ClassVar[str] = "joints that are held at given values, JOINT: value (in subject_to)"
    unit: ClassVar[str] = "1"

    kind: Literal["fixed_joints"]
    values: Annotated[dict[str, JointValue], Field(min_length=1)] = Field(
        description="JOINT: the value that it is held at"
    )

    @property
    def subjects(self) -> dict[tuple[str, ...], str]:
        return {(self.kind, name): f"the value of {name}" for name in self.values}

    def check(self, robot: Robot) -> None:
        held = joint_values(self.values, robot, within_limits=True)
        if len(held) == robot.n:
            raise BadValueError("all joints are held: there is no posture to choose", "leave one of them free")

    def held(self, robot: Robot) -> dict[int, float]:
        return joint_values(self.values, robot)

    def quantity(self, at: Quantities) -> ca.SX:
        return ca.vertcat(*(at.q[joint] - value for joint, value in self.held(at.robot).items()))

    def labels(self, at: Quantities) -> list[str]:
        return [f"fixed_joints of {name}" for name in self.values]

    def bounds(self) -> tuple[float, float]:
        return 0.0, 0.0

    def stated(self) -> list[Stated]:
        return [Stated(given.value, given.value, given.unit, name) for name, given in self.values.items()]
