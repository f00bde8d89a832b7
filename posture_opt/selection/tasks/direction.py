"""``Direction``: three numbers that point somewhere, of any length.

Users write [0, 0, -1] or [1, 1, 0] alike; what computes with a direction normalises it.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator

from posture_opt.errors import BadValueError


def _nonzero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """The vector as it is, unless its length is below 1e-12.

    Raises:
        BadValueError: it points nowhere.
    """
    if math.hypot(*vector) < 1e-12:
        raise BadValueError("a direction of length zero points nowhere", "write for example [0, 0, -1]")
    return vector


Direction = Annotated[tuple[float, float, float], AfterValidator(_nonzero)]
