"""Terms of joint values: margin to their limits, values held, distance from a posture."""

from __future__ import annotations

import math
from itertools import chain
from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from posture_opt.errors import BadValueError, one_of
from posture_opt.robot.robot import Joint, Robot
from posture_opt.selection.terms.term import LowerBoundedTerm, Quantities, Stated, Term, joint_values
from posture_opt.units import Angle, JointQuantity, JointValue


class LimitMargin(LowerBoundedTerm):
    """Distance of every revolute joint that is not held from its limits [rad]: ``q_i − lower_i``, ``upper_i − q_i``.

    Each side is a row of its own, as the smaller of the two is not smooth. In ``subject_to`` both are at least
    ``at_least``. In ``minimize`` the sum of their squares is least in the middle of the ranges.
    """

    summary: ClassVar[str] = "distance of every revolute joint from its limits (at_least)"
    unit: ClassVar[str] = "rad"

    kind: Literal["limit_margin"]
    at_least: Angle = Field(0.0, description="distance of every revolute joint from both of its limits")

    def quantity(self, at: Quantities) -> ca.SX:
        # Both sides as rows of their own: the smaller of two is not smooth.
        sides = ((at.q[k] - joint.lower, joint.upper - at.q[k]) for k, joint in _free(at))
        return ca.vertcat(*chain.from_iterable(sides))

    def labels(self, at: Quantities) -> list[str]:
        names = [joint.name for _, joint in _free(at)]
        return [f"limit_margin of {name} ({side} limit)" for name in names for side in ("lower", "upper")]


def _free(at: Quantities) -> list[tuple[int, Joint]]:
    """The revolute joints that have a range, with their indices: a held one has its value as both limits."""
    joints = enumerate(at.robot.joints)
    return [(k, joint) for k, joint in joints if joint.type == "revolute" and joint.lower < joint.upper]


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
