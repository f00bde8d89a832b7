"""The figure of a section, in the look of the program's own."""

from __future__ import annotations

import math
from typing import Any

from benchmarks.results.section import Chart, Section
from posture_opt.report.page.colours import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILLION
from posture_opt.report.page.style import legend, new_figure, styled

COLOURS = (BLUE, ORANGE, GREEN, PURPLE, VERMILLION)
MARKERS = ("o", "s", "^", "D", "v")
DASHES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)), "-")


@styled
def drawn(section: Section, chart: Chart) -> Any:
    """Bars beside words, lines over numbers."""
    words = isinstance(section.rows[0][0], str)
    figure = new_figure(0.9 + 0.3 * len(section.rows) * len(chart.numbers) if words else 3.4)
    axes = figure.add_subplot()
    (_bars if words else _lines)(axes, section, chart)
    if len(chart.numbers) > 1:
        legend(figure)
    return figure


def _bars(axes: Any, section: Section, chart: Chart) -> None:
    height = 0.8 / len(chart.numbers)
    for k, column in enumerate(chart.numbers):
        shown = [(i, row[column]) for i, row in enumerate(section.rows) if row[column] is not None]
        places = [i + height * (k - (len(chart.numbers) - 1) / 2) for i, _ in shown]
        bars = axes.barh(places, [v for _, v in shown], 0.9 * height, color=COLOURS[k], label=section.headers[column])
        axes.bar_label(bars, [format(v, section.formats[column]) for _, v in shown], padding=3)
    axes.set_yticks(range(len(section.rows)), [row[0] for row in section.rows])
    axes.invert_yaxis()
    axes.grid(False, axis="y")
    axes.set_xlabel(chart.label)
    for i, row in enumerate(section.rows):
        if all(row[column] is None for column in chart.numbers):
            axes.text(0.01, i, "not measured", transform=axes.get_yaxis_transform(), va="center", color=GREY)
    if chart.logarithmic:
        _decades(axes, [row[k] for row in section.rows for k in chart.numbers if row[k] is not None])
    else:
        axes.margins(x=0.12)


def _decades(axes: Any, values: list[float]) -> None:
    """A logarithmic axis of whole decades that begins below every bar and leaves room for its number."""
    axes.set_xscale("log")
    axes.set_xlim(10 ** (math.floor(math.log10(min(values)) - 0.3)), 4 * max(values))
    axes.xaxis.set_major_formatter("{x:,g}")
    axes.minorticks_off()


def _lines(axes: Any, section: Section, chart: Chart) -> None:
    for k, column in enumerate(chart.numbers):
        shown = [(row[0], row[column]) for row in section.rows if row[column] is not None]
        look = {"color": COLOURS[k], "marker": MARKERS[k], "ls": DASHES[k], "label": section.headers[column]}
        axes.plot([x for x, _ in shown], [y for _, y in shown], **look)
    x = [row[0] for row in section.rows]
    axes.set_xlabel(section.headers[0])
    axes.set_ylabel(chart.label)
    if max(x) > 20 * min(x):
        axes.set_xscale("log")
    axes.set_xticks(x, [f"{value:,}".replace(",", " ") for value in x], minor=False)
    axes.minorticks_off()
    if chart.logarithmic:
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0)
