"""One look for all figures: one width, one type size, legends; matplotlib loads with the first figure."""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial, wraps
from io import BytesIO
from typing import TYPE_CHECKING, Any, ParamSpec

from posture_opt.report.page.colours import GREY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

P = ParamSpec("P")

Look = dict[str, Any]
"""Keyword arguments of matplotlib: colours, widths, marks."""
MODEL_DASHES: Look = {
    "nominal": (0, (4, 1.5)), "calibrated": "-", "extended": (0, (1, 1)), "delivered": (0, (5, 1, 1, 1))
}  # fmt: skip
"""Of named models, for whoever sees no colours."""

DPI = 150
THUMBNAIL_DPI = 50
WIDTH = 8.0
"""Of every figure [inch]: a page scales them all alike, so that their type comes out in one size."""
FONT = 9.0
"""Of every text in a figure [pt]."""

STYLE: Look = (
    {"font.family": "DejaVu Sans"}  # travels with matplotlib
    | dict.fromkeys(("font.size", "figure.titlesize", "figure.labelsize", "legend.fontsize"), FONT)
    | dict.fromkeys(("axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize"), FONT)
    | {"legend.title_fontsize": FONT, "legend.frameon": False, "lines.linewidth": 1.8, "hatch.linewidth": 0.6}
    | {"axes.edgecolor": GREY, "axes.linewidth": 0.8, "axes.grid": True, "axes.axisbelow": True}
    | {"axes.spines.top": False, "axes.spines.right": False, "grid.color": "#E6E6E6", "grid.linewidth": 0.6}
    | {"xtick.color": "#404040", "ytick.color": "#404040", "figure.facecolor": "white", "savefig.facecolor": "white"}
    | {"figure.constrained_layout.use": True}
    | dict.fromkeys(("figure.constrained_layout.w_pad", "figure.constrained_layout.h_pad"), 0.08)
    | {"svg.fonttype": "path", "svg.hashsalt": "posture_opt"}
    | {"text.parse_math": False}  # a joint may be called $a_$
)


@contextmanager
def in_style() -> Iterator[None]:
    """Drawing in the style of the house; a letter that the font lacks, in a joint's name, say, is drawn as a box."""
    from matplotlib import rc_context

    with rc_context(STYLE), warnings.catch_warnings():  # type: ignore[arg-type]
        warnings.filterwarnings("ignore", "Glyph .* missing from")
        yield


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """A function that draws a figure, drawing it in the style of the house, its layout computed once and for all."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with in_style():
            figure = draw(*args, **kwargs)
            # Twice, because ticks follow from the first; by the layout engine alone: drawing takes as long again.
            for _ in range(2):
                if engine := figure.get_layout_engine():
                    engine.execute(figure)
            figure.set_layout_engine("none")
            return figure

    return drawn


def label_of(name: str) -> str:
    """A name as a label: matplotlib leaves those out of legends that begin with an underscore."""
    return f" {name}" if name.startswith("_") else name


def legend(figure: Figure, *, beside: bool = False) -> None:
    """One legend of all axes, each entry once: under them in as many columns as fit, or beside square ones."""
    from matplotlib.lines import Line2D

    entries: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            # Dots that are small because they are many are large in the legend.
            if isinstance(handle, Line2D) and handle.get_marker() == "." and handle.get_linestyle() == "None":
                handle = Line2D([], [], ls="none", marker="o", ms=4.5, mew=0, color=handle.get_color())
            entries.setdefault(label.lstrip(), handle)
    handles = list(entries.values())
    if beside:
        labels = [textwrap.fill(label, 34) for label in entries]
        figure.legend(handles, labels, loc="outside right upper", labelspacing=0.9)
    elif entries:
        # A mark with its gaps is 0.55 inch wide, a letter on the mean 0.56 times as wide as high.
        column = 0.55 + 0.56 * FONT / 72 * max(map(len, entries))
        rows = -(-len(entries) // min(max(int((WIDTH - 0.3) / column), 1), len(entries)))
        figure.legend(handles, list(entries), loc="outside lower center", ncols=-(-len(entries) // rows))


def image(figure: Figure, kind: str, dpi: int = DPI) -> bytes:
    """The figure as the bytes of a ``png`` (150 dpi) or ``svg`` file; the same figure gives the same bytes."""
    metadata = {"Date": None, "Creator": "posture_opt"} if kind == "svg" else {"Software": "posture_opt"}
    with in_style(), BytesIO() as file:
        figure.savefig(file, format=kind, dpi=dpi, metadata=metadata)
        return file.getvalue()


def new_figure(height: float) -> Figure:
    """An empty figure of the width of all and this height [inch]; of no window, and notebooks show it as a picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height))
    figure._repr_png_ = partial(_png_and_size, figure)  # type: ignore[attr-defined]
    return figure


def _png_and_size(figure: Figure) -> tuple[bytes, dict[str, Any]]:
    """The picture, and how wide it is to be shown [pixels at 100 an inch]."""
    width, height = (round(100 * float(size)) for size in figure.get_size_inches())
    return image(figure, "png"), {"width": width, "height": height}


def new_axes(height: float) -> tuple[Figure, Axes]:
    """A new figure with one pair of axes."""
    figure = new_figure(height)
    return figure, figure.add_subplot()


def square(axes: Axes, half: float, xlabel: str, ylabel: str) -> None:
    """Axes about the origin, as far as ``half`` either way."""
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal", xlabel=xlabel, ylabel=ylabel)


def name_rows(axes: Axes, names: Mapping[int, str]) -> None:
    """The names of horizontal bars, without ticks and lines."""
    axes.set_yticks(list(names), list(names.values()))
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
