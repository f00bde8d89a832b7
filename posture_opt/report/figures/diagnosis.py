"""The figures of a diagnosis: errors of three models on one scale, and the score of every candidate."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from posture_opt.diagnosis.levels import FIRST_EFFECT
from posture_opt.report.diagnosed import MODELS, Diagnosed
from posture_opt.report.figures.residuals import chosen_rows
from posture_opt.report.style import BLUE, GREEN, GREY, ORANGE, PURPLE, legend_below, new_figure, styled
from posture_opt.report.units_text import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from posture_opt.diagnosis.candidates import ScoredCandidate
    from posture_opt.diagnosis.score_tests import NullDistribution

Floats = NDArray[np.float64]

COLOURS = {"nominal": ORANGE, "calibrated": BLUE, "extended": GREEN}
_MOST = 25  # candidates
_SAME = 0.3  # cycles per revolution
_DOTS = 1500
_MANY = 400  # rows: then dots are small
_BELOW = 0.8  # of the line of the noise: there the scale ends at the latest
_DECADES = 2.5  # more of them need no ticks between
_BINS = 30  # along the rows, for the course of the RMS
_FEW = 5  # rows of such a bin
_TICKS = (0, 0.25, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)


@styled
def plot_errors(diagnosed: Diagnosed) -> Figure:
    """Lengths of the errors row by row in the order of measuring, and how many stay below which length."""
    found = diagnosed.diagnosis
    figure = new_figure(9.6, 4.4)
    over, below = figure.subplots(1, 2, sharey=True, gridspec_kw={"width_ratios": (3, 2)})
    names = [name for name in MODELS if name != "extended" or diagnosed.effects]
    smallest = math.inf
    for name in names:
        lengths = 1e3 * np.linalg.norm(found.held[name].errors, axis=1)
        rows = chosen_rows(len(lengths), _DOTS)
        rms = 1e3 * found.errors[name].rms
        smallest = min(smallest, float(np.quantile(lengths, 0.02)))
        size = 6 if len(rows) < _MANY else 3
        over.plot(rows + 1, lengths[rows], ".", color=COLOURS[name], ms=size, alpha=0.55, mew=0)
        over.plot(*_course(lengths), color=COLOURS[name], lw=2)
        below.step(
            100 * np.arange(1, len(lengths) + 1) / len(lengths), np.sort(lengths), color=COLOURS[name],
            label=f"{MODELS[name]}: RMS {number(rms)} mm",
        )  # fmt: skip
    floor = 1e3 * diagnosed.floor[0]
    if floor:
        for axes in (over, below):
            axes.axhline(floor, color=GREY, lw=1.2, ls="--", zorder=1)
        below.plot([], [], color=GREY, lw=1.2, ls="--", label=f"noise alone: RMS {number(floor)} mm")
        smallest = min(smallest, _BELOW * floor)
    over.set_yscale("log")
    over.set_ylim(bottom=smallest if smallest > 0 else None)
    _decimals(over)
    over.set(
        xlabel="row, in the order of measuring (lines: RMS of neighbours)",
        ylabel="position error where it was not seen [mm]",
    )
    below.set(xlabel="share of the rows below [%]", xlim=(0, 100))
    legend_below(below, 2)
    return figure


def _decimals(axes: Axes) -> None:
    """Ticks of a logarithmic scale as plain decimals; between decades where there are few of these."""
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = axes.get_ylim()
    few = high / low < 10**_DECADES
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if few else (1,)))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def _course(lengths: Floats) -> tuple[Floats, Floats]:
    """RMS of neighbouring rows along the rows."""
    parts = np.array_split(np.arange(len(lengths)), max(min(_BINS, len(lengths) // _FEW), 1))
    return np.array([p.mean() + 1 for p in parts]), np.array([np.sqrt(np.mean(lengths[p] ** 2)) for p in parts])


def evidence(diagnosed: Diagnosed) -> list[tuple[ScoredCandidate, float]]:
    """Every candidate with its log p-value over the critical one of its family, the most significant first."""
    scored = diagnosed.diagnosis.search.scored
    found = diagnosed.diagnosis.search
    null = found.initial_null or found.null
    lines = {family: critical_log_p(null, family) for family in {j.candidate.family for j in scored}}
    pairs = [(j, max(j.log_p / lines[j.candidate.family], 0.0)) for j in scored]
    return sorted(pairs, key=lambda pair: -pair[1])


def critical_log_p(null: NullDistribution, family: str) -> float:
    """The log p-value that a candidate of a family needs to be significant, corrected for the whole search."""
    low, high = -60.0, -1e-6
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if null.family_wise(middle, family) < FIRST_EFFECT else (low, middle)
    return low


@styled
def plot_scores(diagnosed: Diagnosed) -> Figure:
    """Evidence of each candidate on the calibrated arm alone, with the line of the significance level."""
    pairs = evidence(diagnosed)
    scored = [j for j, _ in pairs[:_MOST]]
    # Evidence spans from a little to hundreds of times what noise does: its root shows both ends.
    size = [math.sqrt(value) for _, value in pairs[:_MOST]]
    ends = [_chosen(j, diagnosed) for j in scored]
    figure = new_figure(8.4, 1.4 + 0.24 * max(len(scored), 4))
    axes = figure.add_subplot()
    for k, (j, width, end) in enumerate(zip(scored, size, ends, strict=True)):
        colour = (GREEN if end else BLUE) if j.candidate.named else PURPLE
        axes.barh(
            k, width, height=0.72, color=colour, zorder=2, edgecolor="white", lw=0.5,
            hatch="///" if end and not j.candidate.named else None,
        )  # fmt: skip
    axes.axvline(1, color="black", lw=1.2, ls="--", zorder=3)
    nameless = any(end and not j.candidate.named for j, end in zip(scored, ends, strict=True))
    handles = _handles(
        any(end and j.candidate.named for j, end in zip(scored, ends, strict=True)), nameless, FIRST_EFFECT
    )
    axes.set_yticks(range(len(scored)), [j.candidate.what.label for j in scored], fontsize=9)
    axes.set_ylim(max(len(scored), 4) - 0.5, -0.5)
    right = 1.04 * max([*size, 1.5])
    ticks = [t for t in _TICKS if math.sqrt(t) <= right and (t in (0, 1) or math.sqrt(t) > 0.12 * right)]
    axes.set_xticks([math.sqrt(t) for t in ticks], [f"{t:g}" for t in ticks], fontsize=9)
    axes.set_xlim(0, right)
    axes.set_xlabel("evidence of each by itself: log p-value over that of the line")
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    if len(pairs) > len(scored):
        axes.set_title(f"the first {len(scored)} of {len(pairs)} candidates", fontsize=10)
    figure.legend(*handles, loc="outside lower center", ncols=2)
    return figure


def _chosen(scored: ScoredCandidate, diagnosed: Diagnosed) -> bool:
    """Whether the candidate is part of the final model; a line of a periodogram as that very line."""
    cycles = getattr(scored.candidate.what, "cycles", None)
    return any(
        (what.kind, what.target) == scored.candidate.key
        and (cycles is None or abs(getattr(what, "cycles", 0.0) - cycles) < _SAME)
        for what in (
            *diagnosed.diagnosis.model.effects,
            *(s.what for s in diagnosed.diagnosis.search.chosen if not s.named),
        )
    )


def _handles(named: bool, nameless: bool, level: float) -> tuple[list[Any], list[str]]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    line = Line2D([], [], color="black", ls="--", lw=1.2)
    entries = [
        *([(Patch(color=GREEN), "named in the final model")] if named else []),
        (Patch(color=BLUE), "a cause of the catalogue"),
        (Patch(color=PURPLE), "an unnamed component"),
        *([(Patch(fc=PURPLE, hatch="///", ec="white"), "an unnamed component of the final model")] if nameless else []),
        (line, f"noise alone reaches this line in {100 * level:.1f} % of data sets"),
    ]
    return [e[0] for e in entries], [e[1] for e in entries]
