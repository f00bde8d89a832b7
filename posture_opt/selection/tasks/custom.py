"""Task ``custom``: say which part of the spread counts, what the tool axis does, and what is made small."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.selection.tasks.task import Task
from posture_opt.uncertainty.clearance import Within


class Custom(Task):
    """A task made up in the file: ``within``, ``axis`` and ``criterion`` are keys like the others.

    ``criterion: none`` leaves the spread out of what is made small; it is reported all the same. What a task of the
    list cannot say, an objective of ``minimize`` terms alone, say, is a custom one.
    """

    touches: ClassVar[bool] = False
    summary: ClassVar[str] = "one of your own: within, axis, criterion, minimize and subject_to say what counts."

    kind: Literal["custom"]
    # Of other tasks these two belong to the class.
    within: Within = Field("all", description="which part of the spread counts: across the direction, along it, or all")  # type: ignore[misc]
    axis: Literal["aligned", "required", "free"] = Field(  # type: ignore[misc]
        "aligned", description="tool axis along the direction: where the arm can; always; or not asked for"
    )
