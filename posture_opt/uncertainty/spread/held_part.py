"""``HeldPart``: a straight part in the tool, a peg, whose far end errs by the tilt of the tool too."""

from __future__ import annotations

import math
from dataclasses import dataclass

from posture_opt.model.chain import Vector
from posture_opt.uncertainty.moments.tool_point import ToolPoint


@dataclass(frozen=True)
class HeldPart:
    """A peg: its tip is the tool point, its body goes back along the tool axis.

    Args:
        length: of what goes into the hole [m].
        axis: (3,) unit vector of the tool axis, tool frame.
        diameter: [m], and ``friction`` coefficient between peg and hole; NaN where not stated.
    """

    length: float
    axis: Vector
    diameter: float = math.nan
    friction: float = math.nan

    @property
    def offset(self) -> Vector:
        """(3,) from the tip to the top end, tool frame [m]."""
        x, y, z = self.axis
        return (-self.length * x, -self.length * y, -self.length * z)

    def behind(self, tip: ToolPoint) -> ToolPoint:
        """The top end of the peg whose tip is a tool point."""
        return tip.behind(self.offset)
