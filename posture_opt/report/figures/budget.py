"""The error budget as bars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from posture_opt.report.parts import main_shares
from posture_opt.report.style import BLUE, LIGHT, new_figure, styled
from posture_opt.report.units_text import percent
from posture_opt.report.words import line_words, source_words

if TYPE_CHECKING:
    from posture_opt.uncertainty.budget import Share
    from posture_opt.uncertainty.spread import Spread


@styled
def plot_budget(spread: Spread, shares: Sequence[Share], axis: Any) -> Figure:
    """Share of every source in the variance along ``axis`` (3,), the largest on top, the small ones lumped."""
    arm = spread.tool_point.arm
    shown, rest = main_shares(shares)
    names = [source_words(s.parameter, arm) for s in shown]
    values = [s.share for s in shown]
    if rest:
        names.append(f"{len(rest)} others")
        values.append(sum(s.share for s in rest))
    figure = new_figure(6.4, 1.3 + 0.36 * len(names))
    axes = figure.add_subplot()
    colours = [BLUE] * len(shown) + [LIGHT] * bool(rest)
    axes.barh(range(len(names)), [100 * v for v in values], color=colours, height=0.68)
    for k, value in enumerate(values):
        end = (100 * max(value, 0.0), k)
        axes.annotate(percent(value), end, xytext=(4, 0), textcoords="offset points", va="center")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlim(min(0.0, 110 * min(values)), 113 * max(values))
    axes.set_xlabel(f"share of the variance along {line_words(axis)} [%]")
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    return figure
