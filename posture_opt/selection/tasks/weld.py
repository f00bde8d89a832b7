"""Task ``weld``: weld a seam: the spread across it, height included, counts; tool axis held, stand-off."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.selection.tasks.path_task import SeamTask


class Weld(SeamTask):
    """Welding along a seam: sideways errors miss the joint, errors of height change arc and heat.

    So both directions across the seam count, as of ``dispense``, and an error along the seam does not.
    """

    summary: ClassVar[str] = "weld a seam: the spread across it, height included, counts; tool axis held, stand-off."

    kind: Literal["weld"]
