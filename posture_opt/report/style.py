"""One look for all figures: colours that colour-blind readers tell apart, units on the axes, no global state.

Colours: M. Okabe and K. Ito, "Color Universal Design" (2008).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from io import BytesIO
from typing import TYPE_CHECKING, Any, ParamSpec

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

P = ParamSpec("P")

ORANGE = "#E69F00"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#767676"
LIGHT = "#D9D9D9"
MODEL_COLOURS = {"nominal": ORANGE, "calibrated": BLUE, "extended": GREEN, "delivered": PURPLE}
"""Of named models, the same in every figure."""
COLOUR_MAP = "cividis"  # even in lightness, the same to colour-blind eyes

DPI = 150

STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # travels with matplotlib
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.labelsize": 10,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "xtick.color": "#404040",
    "ytick.color": "#404040",
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "posture_opt",
}


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """A function that draws a figure, drawing it in the style of the house."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        from matplotlib import rc_context

        with rc_context(STYLE):  # type: ignore[arg-type]
            return draw(*args, **kwargs)

    return drawn


def new_figure(width: float = 6.4, height: float = 4.8) -> Figure:
    """An empty figure [inch] that belongs to no window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height))


def legend_below(axes: Axes, columns: int = 2) -> None:
    """The legend under the axes, where it hides nothing."""
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=columns)


def legend_above(axes: Axes, columns: int = 2) -> None:
    """The legend over the axes: in space the labels of the axes hang out of them below."""
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=columns)


def image(figure: Figure, kind: str) -> bytes:
    """The figure as the bytes of a ``png`` (150 dpi) or ``svg`` file; the same figure gives the same bytes."""
    from matplotlib import rc_context

    metadata = {"Date": None, "Creator": "posture_opt"} if kind == "svg" else {"Software": "posture_opt"}
    with rc_context(STYLE), BytesIO() as file:  # type: ignore[arg-type]
        figure.savefig(file, format=kind, dpi=DPI, metadata=metadata, bbox_inches="tight", pad_inches=0.1)
        return file.getvalue()
