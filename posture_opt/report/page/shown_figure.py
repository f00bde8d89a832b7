"""A figure that notebooks show as a picture without being asked to."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from posture_opt.report.page.style import image


class ShownFigure(Figure):
    """A figure of no window; matplotlib's own is shown by notebooks only after ``%matplotlib inline``."""

    def _repr_png_(self) -> tuple[bytes, dict[str, Any]]:
        """The picture, and how wide it is to be shown [pixels at 100 an inch]."""
        width, height = (round(100 * float(size)) for size in self.get_size_inches())
        return image(self, "png"), {"width": width, "height": height}
