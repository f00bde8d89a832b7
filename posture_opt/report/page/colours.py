"""The colours of figures and pages, by name and by what they mean.

Source: M. Okabe and K. Ito, "Color Universal Design" (2008): colour-blind readers can distinguish them. In grey print,
dashes and marks distinguish lines.
"""

from __future__ import annotations

import numpy as np

from posture_opt.numerics import Array

ORANGE = "#E69F00"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#767676"
LIGHT = "#D9D9D9"

CLEARANCE_COLOUR = GREEN
"""The play of a hole about its target."""
LIMIT_COLOUR = VERMILLION
"""What must not be passed: a height that is kept, a bound."""
MODEL_COLOURS = {"nominal": ORANGE, "calibrated": BLUE, "extended": GREEN, "delivered": PURPLE}
"""Of named models, the same in every figure."""
COLOUR_MAP = "cividis"
"""Of maps: even in lightness, the same to colour-blind eyes."""


def mapped_colours(values: Array, low: float, high: float) -> Array:
    """(..., 3) red, green and blue, 0 to 255, of values (...) on the colour map from ``low`` to ``high``.

    >>> mapped_colours(np.array([0.0, 1.0]), 0.0, 1.0).astype(int).tolist()
    [[0, 34, 78], [254, 232, 56]]
    """
    import matplotlib as mpl

    share = (values - low) / max(high - low, 1e-300)
    return np.round(255 * mpl.colormaps[COLOUR_MAP](np.clip(share, 0.0, 1.0))[..., :3])
