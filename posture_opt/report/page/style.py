"""One look for all figures: one width and one type size, colours that colour-blind readers can distinguish.

The colours themselves are in :mod:`posture_opt.report.page.colours`.
"""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from io import BytesIO
from typing import TYPE_CHECKING, Any, ParamSpec

from posture_opt.report.page.colours import GREY

if TYPE_CHECKING:
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
_LETTER_WIDTH_INCH = 0.56 * FONT / 72  # mean width of a letter [inch]
_HANDLE_WIDTH_INCH = 0.55  # of a legend: width of a mark with its gaps [inch]
_DOT_SIZE_PT = 4.5  # of a legend: size of the mark of many small dots [pt]
_LEGEND_LETTERS = 34  # letters of a line of a legend next to the axes

STYLE: Look = {
    "font.family": "DejaVu Sans",  # travels with matplotlib
    "font.size": FONT,
    "axes.titlesize": FONT,
    "axes.labelsize": FONT,
    "figure.titlesize": FONT,
    "figure.labelsize": FONT,
    "xtick.labelsize": FONT,
    "ytick.labelsize": FONT,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "legend.fontsize": FONT,
    "legend.title_fontsize": FONT,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "hatch.linewidth": 0.6,
    "xtick.color": "#404040",
    "ytick.color": "#404040",
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.w_pad": 0.08,
    "figure.constrained_layout.h_pad": 0.08,
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "text.parse_math": False,  # a joint may be called $a_$
    "svg.hashsalt": "posture_opt",
}


@contextmanager
def in_style() -> Iterator[None]:
    """Drawing in the style of the house; a letter that the font lacks, in a joint's name, say, is drawn as a box."""
    from matplotlib import rc_context

    with rc_context(STYLE), warnings.catch_warnings():  # type: ignore[arg-type]
        warnings.filterwarnings("ignore", "Glyph .* missing from")
        yield


def label_of(name: str) -> str:
    """A name as a label: matplotlib leaves those out of legends that begin with an underscore."""
    return f" {name}" if name.startswith("_") else name


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """A function that draws a figure, drawing it in the style of the house, its layout computed once and for all.

    Constrained layout places axes and legends while drawing; afterwards the places are fixed, so that PNG, SVG and
    notebooks show the same picture.
    """

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with in_style():
            return _settled(draw(*args, **kwargs))

    return drawn


def _settled(figure: Figure) -> Figure:
    """The figure with fixed places: the second time, because ticks follow from the first; files would do so again.

    The layout alone is computed, by the engine that drawing would ask: drawing itself takes as long again.
    """
    for _ in range(2):
        if engine := figure.get_layout_engine():
            engine.execute(figure)
    figure.set_layout_engine("none")
    return figure


def legend_below(figure: Figure, entries: Mapping[str, Any] | None = None) -> None:
    """One legend of all axes under them, each entry once, in as many columns as fit.

    Args:
        entries: label -> handle; None: all that is labelled in the figure.
    """
    entries = legend_entries(figure) if entries is None else entries
    if not entries:
        return
    column = _HANDLE_WIDTH_INCH + _LETTER_WIDTH_INCH * max(map(len, entries))
    columns = min(max(int((WIDTH - 0.3) / column), 1), len(entries))
    rows = -(-len(entries) // columns)
    figure.legend(
        [_handle(h) for h in entries.values()],
        list(entries),
        loc="outside lower center",
        ncols=-(-len(entries) // rows),
    )


def legend_beside(figure: Figure, entries: Mapping[str, Any] | None = None) -> None:
    """One legend to the right of axes that are about as wide as high, long entries on several lines.

    Args:
        entries: label -> handle; None: all that is labelled in the figure.
    """
    entries = legend_entries(figure) if entries is None else entries
    labels = [textwrap.fill(label, _LEGEND_LETTERS) for label in entries]
    figure.legend([_handle(h) for h in entries.values()], labels, loc="outside right upper", labelspacing=0.9)


def _handle(handle: Any) -> Any:
    """A handle for the legend: dots that are small because they are many are large in it."""
    from matplotlib.lines import Line2D

    if not isinstance(handle, Line2D) or handle.get_marker() != "." or handle.get_linestyle() != "None":
        return handle
    return Line2D([], [], ls="none", marker="o", ms=_DOT_SIZE_PT, mew=0, color=handle.get_color())


def legend_entries(figure: Figure) -> dict[str, Any]:
    """Label -> handle of all that is labelled in any of the axes, once."""
    found: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label.lstrip(), handle)
    return found


def image(figure: Figure, kind: str, dpi: int = DPI) -> bytes:
    """The figure as the bytes of a ``png`` (150 dpi) or ``svg`` file; the same figure gives the same bytes.

    Dates and versions are left out of the metadata, so that files can be compared between runs.
    """
    metadata = {"Date": None, "Creator": "posture_opt"} if kind == "svg" else {"Software": "posture_opt"}
    with in_style(), BytesIO() as file:
        figure.savefig(file, format=kind, dpi=dpi, metadata=metadata)
        return file.getvalue()
