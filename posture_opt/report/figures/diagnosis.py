"""A diagnosis: errors of each model row by row, and the periodogram of each joint with periodic errors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.scores.levels import FIRST_EFFECT_LEVEL
from posture_opt.diagnosis.scores.score_tests import log_p, scan_frequencies
from posture_opt.model.effects.base.multiples import cycles_text
from posture_opt.model.effects.cyclic_error import CyclicError
from posture_opt.numerics import Array, rms
from posture_opt.report.figures.axis_names import decimals
from posture_opt.report.figures.diagnosis_scores import critical_log_p
from posture_opt.report.figures.residuals import chosen_rows, dots_look
from posture_opt.report.measured_parts.diagnosis_tables import MODELS
from posture_opt.report.page.colours import BLUE, GREEN, GREY, MODEL_COLOURS
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import MODEL_DASHES, legend_below, styled
from posture_opt.units import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline


_MAX_DOTS = 1500
_FLOOR_SHARE = 0.8  # of the line of the noise: there the scale ends at the latest
_MAX_BINS = 30  # along the rows, for the course of the RMS
_MIN_BIN_ROWS = 5  # rows of such a bin

_MAX_JOINTS = 6  # joints
_OPEN_COLOUR = "#8c8c8c"  # grey with enough contrast for text
_BEFORE = "without this joint's periodic errors in the model"
_AFTER = "with all causes in the model: what is left above the dashed line is unexplained"
_CYCLE_TICKS = (3, 5, 10, 20, 50, 100, 200, 300)


@styled
def plot_errors(found: Diagnosis) -> Figure:
    """Lengths of the errors row by row in the order of measuring, and how many stay below which length.

    Errors [mm] are those of rows held out from each fit, on a logarithmic axis that both panels share. Lines in the
    left panel are the RMS of neighbouring rows: a line that rises is a drift. The right panel is the share of the rows
    below a length. The dashed grey line is the noise that no model can explain.
    """
    figure = new_figure(3.9)
    over, below = figure.subplots(1, 2, sharey=True, gridspec_kw={"width_ratios": (3, 2)})
    names = [name for name in MODELS if name != "extended" or found.fitted_effects]
    smallest = math.inf
    for name in names:
        lengths = 1e3 * np.linalg.norm(found.held[name].errors, axis=1)
        rows = chosen_rows(len(lengths), _MAX_DOTS)
        rms = 1e3 * found.errors[name].rms
        smallest = min(smallest, float(np.quantile(lengths, 0.02)))
        over.plot(rows + 1, lengths[rows], ".", color=MODEL_COLOURS[name], mew=0, **dots_look(len(rows)))
        over.plot(*_course(lengths), color=MODEL_COLOURS[name], ls=MODEL_DASHES[name], lw=2)
        below.step(
            100 * np.arange(1, len(lengths) + 1) / len(lengths), np.sort(lengths),
            color=MODEL_COLOURS[name], ls=MODEL_DASHES[name],
            label=f"{MODELS[name]}: RMS {number(rms)} mm",
        )  # fmt: skip
    noise = found.noise_floor
    floor = 1e3 * noise.rms
    if floor:
        for axes in (over, below):
            axes.axhline(floor, color=GREY, lw=1.2, ls="--", zorder=1)
        below.plot([], [], color=GREY, lw=1.2, ls="--", label=f"{noise.label}: RMS {number(floor)} mm")
        smallest = min(smallest, _FLOOR_SHARE * floor)
    over.set_yscale("log")
    over.set_ylim(bottom=smallest if smallest > 0 else None)
    decimals(over.yaxis)
    over.set(
        xlabel="row, in the order of measuring (lines: RMS of neighbours)",
        ylabel="position error of held-out rows [mm]",
    )
    below.set(xlabel="share of the rows below [%]", xlim=(0, 100))
    legend_below(figure)
    return figure


def _course(lengths: Array) -> tuple[Array, Array]:
    """Middles (k,) and RMS (k,) of neighbouring rows, in the order of the rows.

    Args:
        lengths: (N,) of errors [mm]; at most 30 groups of five rows or more.
    """
    parts = np.array_split(np.arange(len(lengths)), max(min(_MAX_BINS, len(lengths) // _MIN_BIN_ROWS), 1))
    return np.array([p.mean() + 1 for p in parts]), np.array([rms(lengths[p]) for p in parts])


@styled
def plot_periodogram(found: Diagnosis) -> Figure:
    """Share of the rest that each number of cycles explains, before its lines are named and after.

    Over cycles per revolution of the joint, logarithmic; the dashed line is the share that is significant in the whole
    search. A peak that is left above it in the second curve is not explained. In brackets stand lines of a size that
    the data leave open.
    """
    joints = found.periodic_joints[:_MAX_JOINTS]
    linearised, model = found.linearised, found.model
    chosen = [Candidate(e, linearised.sensitivities.columns(e)) for e in model.effects]
    line = critical_log_p(found.search.null, CyclicError.family)
    figure = new_figure(0.9 + 2.0 * len(joints))
    grid = figure.subplots(len(joints), 1, squeeze=False, sharex=True).ravel()
    after = linearised.baseline(chosen, flips=0)
    for axes, joint in zip(grid, joints, strict=True):
        name = found.model.residuals.data.joint_names[joint]
        mine = [s for s in chosen if s.what.spectral_lines and s.target == name]
        before = linearised.baseline([s for s in chosen if s not in mine], flips=0)
        cycles, share = _spectrum(found, before, joint)
        axes.plot(cycles, 100 * share, color=BLUE, lw=1.2, label=_BEFORE, zorder=3)
        cycles, share = _spectrum(found, after, joint)
        axes.plot(cycles, 100 * share, color=GREEN, lw=1.0, label=_AFTER, zorder=4)
        null = f"significant: {100 * FIRST_EFFECT_LEVEL:.1f} % of data sets reach it by chance"
        axes.axhline(100 * _share_of(line, before), color="black", lw=1.2, ls="--", label=null, zorder=5)
        for k, mark in enumerate(sorted(_marks(found, name))):
            _mark(axes, *mark, k)
        axes.set(title=name, ylabel="share explained [%]", xscale="log", ylim=(0, None))
    grid[-1].set_xticks(_CYCLE_TICKS, [f"{t:g}" for t in _CYCLE_TICKS])
    grid[-1].minorticks_off()
    grid[-1].set_xlabel("cycles per revolution of the joint")
    figure.suptitle("Share of the errors left that one sine wave in a joint's angle explains")
    legend_below(figure)
    return figure


def _spectrum(found: Diagnosis, baseline: ProjectedBaseline, joint: int) -> tuple[Array, Array]:
    """Cycles per revolution (k,) and the share (k,) of the residual sum of squares that each explains.

    Args:
        baseline: the model without the frequency that is scanned.
        joint: its number; its range in the data sets the finest frequency that can be resolved.
    """
    tangents = found.linearised.sensitivities
    q = found.model.residuals.data.q[:, joint]
    cycles = CyclicError.grid(float(np.ptp(q)))
    return cycles, scan_frequencies(baseline, tangents.joints[joint], q, cycles)[0] / float(baseline.rss[0])


def _share_of(line: float, baseline: ProjectedBaseline) -> float:
    """The share that one frequency must explain for its log p-value to be that of the line.

    Bisected in 40 steps; two degrees of freedom, those of a sine and a cosine.

    Args:
        line: critical log p-value of the family.
        baseline: the model without the frequency, for its degrees of freedom.
    """
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        value = float(log_p(np.array([middle]), np.array([1.0]), 2, baseline.freedom)[0])
        low, high = (low, middle) if value < line else (middle, high)
    return high


def _marks(found: Diagnosis, joint: str) -> list[tuple[float, str, bool]]:
    """Lines of a joint [cycles per revolution], each with its text and whether its size is open.

    Lines that are not told apart have one text, at the largest of them.
    """
    marks = []
    for finding in found.effects:
        error, open_part = finding.cause, finding.open_part
        if not isinstance(error, CyclicError) or error.joint != joint:
            continue
        band_of = {band[0]: band for band in error.bands(finding.sizes)}
        together = {i for band in band_of.values() for i in band[1:]}
        for i, cycles in enumerate(error.lines):
            text = "" if i in together else error.band_text(band_of.get(i, (i,)))
            marks.append((cycles, text, not finding.determined))
        marks += [(cycles, cycles_text(cycles), True) for cycles in (open_part.spectral_lines if open_part else ())]
    return marks


def _mark(axes: Axes, cycles: float, text: str, is_open: bool, k: int) -> None:
    """A line at a named frequency with its text, pale where its size is open; of neighbours the next is lower."""
    colour, dashes = (_OPEN_COLOUR, ":") if is_open else (GREY, "-")
    axes.axvline(cycles, color=colour, lw=0.8, ls=dashes, zorder=1)
    axes.annotate(
        f"({text})" if is_open and text else text, (cycles, 1.0), xycoords=("data", "axes fraction"),
        textcoords="offset points", xytext=(3, -10 - 10 * (k % 5)), color=colour if is_open else "black", zorder=6,
        bbox={"boxstyle": "square,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.85},
    )  # fmt: skip
