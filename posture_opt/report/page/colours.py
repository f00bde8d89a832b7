"""The colours of figures and pages, by name and by what they mean.

Source: M. Okabe and K. Ito, "Color Universal Design" (2008): colour-blind readers can distinguish them. In grey print
the lines of a figure are distinguished by their dashes, marks by their shapes.
"""

from __future__ import annotations

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
