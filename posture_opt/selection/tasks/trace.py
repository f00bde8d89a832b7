"""Task ``trace``: follow a line: the spread across the direction of travel counts, the tool axis is free."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.selection.tasks.path_task import PathTask
from posture_opt.uncertainty.clearance import Within


class Trace(PathTask):
    """Following a path, or passing one point along ``direction``: the spread across the way of travel is made small.

    An error along the way shifts a point on the line that is drawn anyway. The tool axis is free, unless the path's
    file says where it points.
    """

    within: ClassVar[Within] = "across"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "free"
    summary: ClassVar[str] = "follow a line: the spread across the direction of travel counts, the tool axis is free."

    kind: Literal["trace"]
