"""An empty figure of the house; matplotlib is loaded when the first one is made."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from posture_opt.report.page.style import WIDTH

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(height: float) -> Figure:
    """An empty figure of the width of all and this height [inch]; it belongs to no window, and notebooks show it."""
    shown = import_module("posture_opt.report.page.shown_figure")
    figure: Figure = shown.ShownFigure(figsize=(WIDTH, height))
    return figure
