"""What an ordinary posture is: away from the limits of its joints, its front to the tool, the elbow of six joints up.

The margin narrows the ranges of the joints, which the search draws its starts from; the others are terms.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.model.chain import (
    Scalar,
    Vector,
    Walk,
    add,
    cos_sin,
    cross,
    dot,
    factor_values,
    fixed_pose,
    scale,
    subtract,
    walk,
)
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.tasks import Task
from posture_opt.selection.terms.joint_terms import LimitMargin
from posture_opt.selection.terms.term import LowerBoundedTerm, Quantities

_MARGIN = math.radians(5.0)  # room to approach, retract and touch up from there
_RANGE_SHARE = 0.1  # of a short range that either margin takes at most
_PARALLEL = 0.98  # cosine: corrections lean axes by less


class _Posed(LowerBoundedTerm):
    """A quantity of ordinary postures that is not below zero."""

    at_least: float = 0.0

    @staticmethod
    @abstractmethod
    def fits(robot: Robot) -> bool:
        """Whether an arm has the quantity."""

    @staticmethod
    @abstractmethod
    def value(robot: Robot, reached: Walk, first: Scalar) -> Scalar:
        """The quantity at a walk, with the value of the first joint."""

    def quantity(self, at: Quantities) -> ca.SX:
        return ca.SX(self.value(at.robot, at.walk, at.q[0]))


class Facing(_Posed):
    """Cosine of the angle about the first axis from the front of the arm to the tool point.

    The front is the x axis of the base (ISO 9787), turned by the first joint.
    """

    unit: ClassVar[str] = "rad"

    kind: Literal["facing"] = "facing"

    @staticmethod
    def fits(robot: Robot) -> bool:
        """Whether the first joint turns about the z axis of the base."""
        first, at = robot.factors[robot.driven[0]], fixed_pose(robot.factors[: robot.driven[0]])
        return first.kind == "rotate" and abs(float(at[:3, first.axis] @ fixed_pose(robot.base)[:3, 2])) > _PARALLEL

    @staticmethod
    def value(robot: Robot, reached: Walk, first: Scalar) -> Scalar:
        """``f·r / |r|``: front f, and r the part of the way from the first axis to the tool that is across it."""
        screw, (x, y, z) = reached.screws[robot.driven[0]], fixed_pose(robot.base)[:3, 0].tolist()
        c, s = cos_sin(first)
        front = add(scale(c, (x, y, z)), scale(s, cross(screw.axis, (x, y, z))))
        across = _without(subtract(reached.position, screw.origin), screw.axis)
        return dot(front, across) / (dot(across, across) + 1e-12) ** 0.5  # on the axis no side is in front

    def shown(self, value: float) -> float:
        return math.acos(min(max(value, -1.0), 1.0))


class ElbowUp(_Posed):
    """Height [m] of the elbow above the line from shoulder to wrist, along the z axis of the base."""

    unit: ClassVar[str] = "m"

    kind: Literal["elbow_up"] = "elbow_up"

    @staticmethod
    def fits(robot: Robot) -> bool:
        """Whether six joints turn, the second and the third about parallel axes across the first."""
        if robot.n != 6 or any(joint.type != "revolute" for joint in robot.joints):
            return False
        first, second, third, *_ = _axes(robot, walk(robot.factors, factor_values(robot.factors, [0.3] * 6)))
        return bool(abs(dot(second, third)) > _PARALLEL and abs(dot(first, second)) < 1 - _PARALLEL)

    @staticmethod
    def value(robot: Robot, reached: Walk, first: Scalar) -> Scalar:
        """``e·u − (e·l)(l·u) / l·l`` in the plane across the second axis: way e to the elbow, l to the wrist, up u."""
        o, (_, second, _, _, fifth, _) = [reached.screws[i].origin for i in robot.driven], _axes(robot, reached)
        # Of a spherical wrist the point in which the last axes meet, at right angles
        wrist = add(o[4], scale(dot(subtract(o[5], o[4]), fifth), fifth))
        elbow, line = (_without(subtract(point, o[1]), second) for point in (o[2], wrist))
        up = fixed_pose(robot.base)[:3, 2].tolist()
        return dot(elbow, up) - dot(elbow, line) * dot(line, up) / (dot(line, line) + 1e-12)


def _axes(robot: Robot, reached: Walk) -> list[Vector]:
    return [reached.screws[i].axis for i in robot.driven]


def _without(vector: Vector, axis: Vector) -> Vector:
    """The part of a vector across a unit axis."""
    return subtract(vector, scale(dot(vector, axis), axis))


@dataclass(frozen=True)
class OrdinaryRule:
    """The ranges of the joints (n,) [rad or m] that ordinary postures are in, and the terms that they meet besides."""

    lower: Array
    upper: Array
    terms: tuple[_Posed, ...]
    values: ca.Function  # q (n,) -> the quantities of the terms

    @classmethod
    def of(cls, task: Task, arm: Arm) -> OrdinaryRule:
        """The rule for a task, whose own ``limit_margin`` replaces that of the rule.

        All postures of an arm of two joints, as drawn on paper, are ordinary.
        """
        robot, q = arm.robot, ca.SX.sym("q", arm.robot.n)
        spatial, stated = robot.n > 2, any(isinstance(term, LimitMargin) for term in task.subject_to)
        lower, upper = np.array(robot.lower), np.array(robot.upper)
        turns = np.array([joint.type == "revolute" for joint in robot.joints]) & spatial & (not stated)
        margin = np.where(turns, np.minimum(_MARGIN, _RANGE_SHARE * (upper - lower)), 0.0)
        kinds: list[type[Facing] | type[ElbowUp]] = [Facing, ElbowUp] if spatial and Facing.fits(robot) else []
        terms = tuple(kind() for kind in kinds if kind.fits(robot))
        reached = arm.walk(q)
        values = ca.vertcat(ca.SX(0, 1), *(term.value(robot, reached, q[0]) for term in terms))
        return cls(lower + margin, upper - margin, terms, ca.Function("ordinary", [q], [values]))

    def met(self, q: Array) -> bool:
        """Whether a posture (n,) [rad or m] is ordinary."""
        inside = np.all((q >= self.lower - ROW_TOLERANCE) & (q <= self.upper + ROW_TOLERANCE))
        return bool(inside) and bool(np.all(np.asarray(self.values(q)) >= -ROW_TOLERANCE))

    def narrowed(self, arm: Arm) -> Arm:
        """The arm whose joints have the ranges of the rule as limits."""
        ranges = zip(arm.robot.joints, self.lower.tolist(), self.upper.tolist(), strict=True)
        joints = tuple(replace(joint, lower=low, upper=high) for joint, low, high in ranges)
        return replace(arm, robot=replace(arm.robot, joints=joints))


def costs_at_most(share: float, objective: float, best: float) -> bool:
    """Whether an objective is within a share of the best one, as standard deviations: variances go by their square."""
    return objective <= best + ((1.0 + share) ** 2 - 1.0) * abs(best)
