"""Term ``limit_margin``: distance of the revolute joints from their limits."""

from __future__ import annotations

from itertools import chain
from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field

from posture_opt.robot.robot import Joint
from posture_opt.selection.terms.term import LowerBoundedTerm, Quantities
from posture_opt.units import Angle


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
