"""Term ``link_height``: keep the arm above the table.

A cheap stand-in for an obstacle, for arms whose shape is not known: it looks at points, not at bodies.
"""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field

from posture_opt.selection.terms.term import LowerBoundedTerm, Quantities
from posture_opt.units import Length


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
