"""Task ``dispense``: lay a bead: the spread across it, height included, counts; tool axis held, stand-off."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.selection.tasks.path_task import SeamTask


class Dispense(SeamTask):
    """Dispensing along a line: sideways errors misplace the bead, errors of height change its width.

    So both directions across the line count: ``min max λ_max(Bᵀ C B)`` over the points, B (3, 2) across the tangent.
    """

    summary: ClassVar[str] = "lay a bead: the spread across it, height included, counts; tool axis held, stand-off."

    kind: Literal["dispense"]
