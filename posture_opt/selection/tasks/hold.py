"""Task ``hold``: hold a part still: the spread in every direction counts, the tool axis is held."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.selection.tasks.task import Task
from posture_opt.uncertainty.clearance import Within


class Hold(Task):
    """Holding a part for a screw or a camera: the worst of all directions is made small, depth included.

    ``λ_max(C)`` of the whole covariance (3, 3); of a planar arm in its plane.
    """

    within: ClassVar[Within] = "all"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "aligned"
    touches: ClassVar[bool] = False
    summary: ClassVar[str] = "hold a part still: the spread in every direction counts, the tool axis is held."

    kind: Literal["hold"]
