"""One look of all figures, measured as they are rendered: one width, one type size, nothing cut off, told in grey."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from posture_opt.report.page.style import FONT, WIDTH

TELLS = 0.15  # of the way from black to white: what grey print tells apart
SLACK = 0.03  # inch: half a line or mark beyond its axes


def assert_style(name: str, figure: Figure) -> None:
    texts = [t for t in figure.findobj(Text) if isinstance(t, Text) and t.get_visible() and t.get_text().strip()]
    # Texts are drawn as they are written, numbers of logarithmic axes too, and so would be the marks of a formula.
    assert not [text for text in figure.findobj(Text) if "$" in text.get_text()], name  # type: ignore[attr-defined]
    assert {text.get_fontsize() for text in texts} == {FONT}, name
    box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    assert width == WIDTH, name
    assert min(box.x0, box.y0, width - box.x1, height - box.y1) > -SLACK, (name, box)
    handles = [h for legend in figure.legends for h in legend.legend_handles if isinstance(h, Line2D)]
    for a, b in combinations(handles, 2):
        assert shape(a) != shape(b) or abs(grey(a) - grey(b)) >= TELLS, (name, a.get_color(), b.get_color(), shape(a))


def shape(line: Line2D) -> tuple[Any, ...]:
    dashes = getattr(line, "_dash_pattern", None)
    return str(line.get_linestyle()), str(dashes), str(line.get_marker()), str(line.get_markerfacecolor()) == "none"


def grey(line: Line2D) -> float:
    return float(np.dot(to_rgb(line.get_color()), (0.299, 0.587, 0.114)))
