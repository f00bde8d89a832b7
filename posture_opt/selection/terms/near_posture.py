"""Term ``near_posture``: distance from a posture that the engineer likes."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from posture_opt.errors import InputError, Issue
from posture_opt.selection.terms.term import BoundedTerm, Quantities
from posture_opt.units import Angle


class NearPosture(BoundedTerm):
    """Root mean square difference of the named revolute joints from ``posture`` [rad]."""

    summary: ClassVar[str] = "root mean square distance from a posture (at_most, or weight)"
    unit: ClassVar[str] = "rad"

    kind: Literal["near_posture"]
    posture: Annotated[dict[str, Angle], Field(min_length=1)]
    at_most: Annotated[Angle, Field(gt=0)] | None = None

    def quantity(self, at: Quantities) -> ca.SX:
        names = at.robot.joint_names
        unknown = [name for name in self.posture if name not in names]
        if unknown:
            mend = f"the joints are {', '.join(names)}"
            raise InputError(
                Issue(f"near_posture names {', '.join(unknown)}, no joint of this arm", ("task",), mend=mend)
            )
        differences = [at.q[names.index(name)] - value for name, value in self.posture.items()]
        return ca.sqrt(ca.sumsqr(ca.vertcat(*differences)) / len(differences) + 1e-12)

    def bounds(self) -> tuple[float, float]:
        return -math.inf, math.inf if self.at_most is None else self.at_most

    def scale(self, at: Quantities) -> float:
        return 1.0
