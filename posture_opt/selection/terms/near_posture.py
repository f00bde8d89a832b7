"""Term ``near_posture``: distance from a posture that the engineer prefers.

For a program that exists already, for cables, or for a place from which the arm comes.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from posture_opt.errors import BadValueError, one_of
from posture_opt.robot.robot import Robot
from posture_opt.selection.terms.term import Quantities, Stated, Term, joint_values
from posture_opt.units import Angle, JointQuantity, JointValue


class NearPosture(Term):
    """Root mean square difference of the named joints from ``posture`` [rad], or the difference of each of them.

    In the mean the stroke of a prismatic joint counts as the angle that moves the tool of the stretched arm as far:
    stroke / length of the arm. ``at_most: {JOINT: bound}`` bounds joints one by one, each in its own unit.
    """

    summary: ClassVar[str] = "distance from a posture: root mean square, or JOINT: bound (at_most, or weight)"
    unit: ClassVar[str] = "rad"

    kind: Literal["near_posture"]
    posture: Annotated[dict[str, JointValue], Field(min_length=1)] | str = Field(
        description="JOINT: value, of joints that count; or the name of a posture in the robot's srdf"
    )
    at_most: Annotated[Angle, Field(gt=0)] | Annotated[dict[str, JointValue], Field(min_length=1)] | None = Field(
        None, description="bound of the root mean square distance, or JOINT: its own bound"
    )

    @model_validator(mode="after")
    def _bounds_of_named_joints(self) -> NearPosture:
        for name, most in self._each().items():
            if name not in self.posture and not isinstance(self.posture, str):
                raise BadValueError(f"{name} has a bound and no place in posture", f"add {name} to posture")
            if most.value <= 0:
                raise BadValueError(f"the bound of {name} is not above zero", "write for example 10 deg")
        return self

    def _each(self) -> dict[str, JointQuantity]:
        return self.at_most if isinstance(self.at_most, dict) else {}

    def for_robot(self, robot: Robot, bounded: bool) -> NearPosture:
        """A posture that is named has the values of the robot's SRDF."""
        named = dict(robot.named_postures)
        if not isinstance(self.posture, str) or self.posture not in named:
            return self
        kinds = {joint.name: "angle" if joint.type == "revolute" else "length" for joint in robot.joints}
        values = {name: JointQuantity(value, kinds[name]) for name, value in named[self.posture]}
        return self.model_copy(update={"posture": values})

    def check(self, robot: Robot) -> None:
        wanted = self._wanted(robot)
        for joint in joint_values(self._each(), robot):
            if joint not in wanted:
                name = robot.joint_names[joint]
                raise BadValueError(f"{name} has a bound and no value in the posture", "leave its bound out")

    def _wanted(self, robot: Robot) -> dict[int, float]:
        """Index of each joint that counts -> its value [rad or m]."""
        if isinstance(self.posture, str):
            names = [name for name, _ in robot.named_postures]
            message = f"the robot has no posture called '{self.posture}'"
            raise BadValueError(message, one_of(self.posture, names, "postures") if names else "state robot: srdf")
        return joint_values(self.posture, robot)

    def quantity(self, at: Quantities) -> ca.SX:
        wanted = self._wanted(at.robot)
        if self._each():
            return ca.vertcat(*(at.q[joint] - wanted[joint] for joint in joint_values(self._each(), at.robot)))
        return self._distance(at, wanted)

    def cost(self, at: Quantities) -> ca.SX:
        return self._distance(at, self._wanted(at.robot)) ** 2

    @staticmethod
    def _distance(at: Quantities, wanted: dict[int, float]) -> ca.SX:
        """``sqrt(Σ ((q_i − w_i)/s_i)² / k)`` [rad], s the arm's length [m] of a slide, else 1; rounded at 0."""
        sizes = {"revolute": 1.0, "prismatic": max(at.robot.length, 1e-3)}
        differences = [(at.q[k] - value) / sizes[at.robot.joints[k].type] for k, value in wanted.items()]
        return ca.sqrt(ca.sumsqr(ca.vertcat(*differences)) / len(differences) + 1e-12)

    def labels(self, at: Quantities) -> list[str]:
        return [f"near_posture of {name}" for name in self._each()] or [self.kind]

    def bounds(self) -> tuple[float, float]:
        return -math.inf, self.at_most if isinstance(self.at_most, float) else math.inf

    def bounds_of(self, at: Quantities) -> list[tuple[float, float]]:
        if self._each():
            return [(-most.value, most.value) for most in self._each().values()]
        return super().bounds_of(at)

    def units_of(self, at: Quantities) -> list[str]:
        return [most.unit for most in self._each().values()] or super().units_of(at)

    def shown(self, value: float) -> float:
        return abs(value)

    def stated(self) -> list[Stated]:
        return [Stated(-math.inf, m.value, m.unit, name) for name, m in self._each().items()] or super().stated()
