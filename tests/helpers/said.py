"""What a result says, by the ids of its statements."""

from __future__ import annotations

from posture_opt.result import Result
from posture_opt.statements import Statement


def said(result: Result) -> dict[str, Statement]:
    """Id -> the last statement of that id."""
    return {one.id: one for one in result.statements}
