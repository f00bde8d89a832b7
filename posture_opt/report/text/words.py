"""Names of sources, regions and directions, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from posture_opt.selection.registered_tasks import part_words as part_words
from posture_opt.uncertainty.clearance import PARTS as PARTS
from posture_opt.uncertainty.sources import source_size as source_size
from posture_opt.uncertainty.sources import source_words as source_words
from posture_opt.units import fixed

Vector: TypeAlias = Sequence[float] | NDArray[np.float64]

CRITERIA = {
    "worst": "the largest standard deviation {part}",
    "trace": "the mean square error {part}",
    "area": "the area of the uncertainty ellipse {part}",
    "miss": "the probability of missing the clearance",
    "none": "no part of the spread {part}",
}
REGIONS = {0: "95 % region", 1: "95 % interval", 2: "95 % ellipse", 3: "95 % ellipsoid"}
"""What the 95 % region of a covariance of that rank is called."""
MODEL_NAMES = {
    "nominal": "before calibration",
    "calibrated": "calibrated",
    "extended": "with effects",
    "delivered": "as delivered",
}
"""Models of one arm, by their names in JSON."""
METHODS = {
    "exact": "closed form, exact for normally distributed errors",
    "exact, planar": "closed form, exact for normally distributed errors, correlated ones too",
    "exact given shared factors, integrated over them": (
        "exact for normally distributed errors given the factors that correlated ones share, integrated over these"
    ),
}


def direction_words(d: Vector) -> str:
    """A unit vector: along a coordinate axis by its name, else by its components."""
    for k, axis in enumerate("xyz"):
        if abs(abs(d[k]) - 1) < 1e-9:
            return f"{'+' if d[k] > 0 else '-'}{axis}"
    return f"({', '.join(fixed(v, 3) for v in d)})"


def line_words(d: Vector) -> str:
    """An axis without a sense: x, or its components."""
    return direction_words(d).lstrip("+-") if max(map(abs, d)) > 1 - 1e-9 else direction_words(d)


def roll_pitch_yaw(quaternion_wxyz: Vector) -> tuple[float, float, float]:
    """Angles about the fixed axes x, y, z [rad] of an orientation, as in ``rpy`` of the problem file."""
    w, x, y, z = quaternion_wxyz
    sine = max(-1.0, min(1.0, 2 * (w * y - z * x)))
    if abs(sine) > 1 - 1e-12:
        # Roll and yaw turn about one axis there: all of it is given to the yaw.
        return 0.0, math.copysign(math.pi / 2, sine), -2 * math.copysign(1, sine) * math.atan2(x, w)
    angles = (2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), (2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    # Half a turn is one orientation with two names.
    roll, yaw = (math.pi if a < -math.pi + 1e-6 else a for a in (math.atan2(*angle) for angle in angles))
    return roll, math.asin(sine), yaw
