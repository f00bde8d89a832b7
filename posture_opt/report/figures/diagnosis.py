"""A diagnosis: scores of the candidates, errors of each model row by row, periodograms of the joints.

Evidence is a ratio of log p-values: a candidate at 1 is as improbable by chance as the significance level allows,
corrected for the number of candidates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.scores.levels import EFFECT_LEVEL
from posture_opt.diagnosis.scores.score_tests import log_p, scan_frequencies
from posture_opt.model.effects.base.multiples import cycles_text
from posture_opt.model.effects.cyclic_error import CyclicError
from posture_opt.numerics import TURN, Array, rms
from posture_opt.report.figures.cloud import decimals
from posture_opt.report.figures.residuals import chosen_rows, dots_look
from posture_opt.report.page.colours import BLUE, GREEN, GREY, MODEL_COLOURS
from posture_opt.report.page.style import MODEL_DASHES, Look, legend, name_rows, new_axes, new_figure, styled
from posture_opt.report.parts.diagnosis_tables import MODELS
from posture_opt.statements import p_value
from posture_opt.units import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.diagnosis.scores.candidates import ScoredCandidate
    from posture_opt.diagnosis.scores.score_tests import NullDistribution, ProjectedBaseline

_EVIDENCE_TICKS = (0, 0.25, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)


@dataclass(frozen=True, eq=False)
class ScoredRow:
    """A candidate with its evidence by itself, and its p-value in the model if it is part of that."""

    named: bool
    evidence: float
    p_value: float | None
    label: str


def critical_log_p(null: NullDistribution, family: str) -> float:
    """The log p-value that a candidate of a family needs to be significant, corrected for the whole search."""
    low, high = -60.0, -1e-6
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if null.family_wise(middle, family) < EFFECT_LEVEL else (low, middle)
    return low


def scored_rows(found: Diagnosis) -> tuple[list[ScoredRow], int]:
    """What is drawn, the causes of the model first, then the most significant others; how many candidates there are."""
    scored, null = found.search.scored, found.search.null
    lines = {family: critical_log_p(null, family) for family in {j.candidate.family for j in scored}}
    pairs = [(j, max(j.log_p / lines[j.candidate.family], 0.0)) for j in scored]
    ordered = sorted(pairs, key=lambda pair: -pair[1])
    rows = [ScoredRow(j.candidate.named, value, *_in_model(j, found)) for j, value in ordered]
    own = [row for row in rows if row.p_value is not None]
    others = [row for row in rows if row.p_value is None]
    return [*own, *others[: max(16 - len(own), 0)]], len(rows)


@styled
def plot_scores(found: Diagnosis) -> Figure:
    """Evidence of each candidate on the calibrated arm alone, with the line of the significance level. A cause that the
    others hide at first ranks low here: so those of the model come first, each with its p-value in it. The axis is the
    square root of the evidence: evidence spans from below 1 to hundreds."""
    rows, count = scored_rows(found)
    own = [row for row in rows if row.p_value is not None]
    others = rows[len(own) :]
    figure, axes = new_axes(1.3 + 0.22 * (len(rows) + 3))
    right = 1.04 * max([*(math.sqrt(row.evidence) for row in rows), 1.5])
    names: dict[int, str] = {}
    at = 0
    for title, group in (
        ("In the model", own),
        (f"Not in the model (best {len(others)} of {count - len(own)})", others),
    ):
        if not group:
            continue
        heading = axes.annotate(title, (0.01, at), xycoords=("figure fraction", "data"), weight="bold", va="center")
        heading.set_in_layout(False)
        for k, row in enumerate(group, at + 1):
            axes.barh(k, math.sqrt(row.evidence), height=0.74, zorder=2, edgecolor="white", lw=0.5, **_look(row))
            names[k] = row.label
            if row.p_value is not None:
                _say(axes, k, p_value(row.p_value))
        at += len(group) + 1
    if own:
        _say(axes, 0, "p in the model")
    axes.plot([1, 1], [-0.6, at], color="black", lw=1.2, ls="--", zorder=3)
    text = f"significant beyond this line ({100 * EFFECT_LEVEL:.1f} % by chance)"
    axes.annotate(text, (1, at), xytext=(4, 0), textcoords="offset points", va="center", zorder=4)
    name_rows(axes, names)
    axes.set(ylim=(at + 0.6, -0.7), xlim=(0, right))
    ticks: list[float] = [0, 1]
    for tick in _EVIDENCE_TICKS:  # none so near to another that their texts touch
        x = math.sqrt(tick)
        if x <= right and all(abs(x - math.sqrt(other)) > 0.09 * right for other in ticks):
            ticks.append(tick)
    axes.set_xticks([math.sqrt(t) for t in ticks], [f"{t:g}" for t in ticks])
    axes.set_xlabel("evidence of each cause tested alone (1: the dashed line)")
    legend(figure)
    return figure


def _say(axes: Axes, k: int, text: str) -> None:
    """A text in a column behind the axes, where no bar and no line runs through it."""
    offset: Look = {"xytext": (4, 0), "textcoords": "offset points", "va": "center", "annotation_clip": False}
    axes.annotate(text, (1, k), xycoords=("axes fraction", "data"), ha="left", **offset)


def _look(row: ScoredRow) -> Look:
    if row.p_value is not None and row.evidence < 1:
        return {"color": "#7DB5A2", "label": "hidden by larger causes when tested alone"}
    if row.p_value is not None:
        return {"color": "#00664B", "label": "seen when tested alone"}
    if row.named:
        return {"color": "#B9D5E4", "label": "named cause"}
    return {"facecolor": "#F1DCE7", "hatch": "///", "label": "pattern without a name"}


def _in_model(scored: ScoredCandidate, found: Diagnosis) -> tuple[float | None, str]:
    """The p-value of dropping the candidate from the final model, None where it is not in it; and its label there."""
    what = scored.candidate.what
    cycles = getattr(what, "cycles", None)
    for finding in found.effects:
        if finding.place is None or finding.kind != scored.candidate.kind or finding.target != scored.candidate.target:
            continue
        if cycles is None:
            return finding.p_value, what.label
        data = found.model.residuals.data
        resolved = TURN / max(float(np.ptp(data.q[:, data.joint_names.index(finding.target)])), 1e-3)
        nearest = min(finding.cause.spectral_lines, key=lambda k: abs(k - cycles))
        if abs(nearest - cycles) < resolved:
            return finding.p_value, f"{what.title} ({what.target}, {cycles_text(nearest)} cycles per revolution)"
    return None, what.label


_OPEN_COLOUR = "#8c8c8c"  # grey with enough contrast for text
_BEFORE = "without this joint's periodic errors in the model"
_AFTER = "with all causes in the model: what is left above the dashed line is unexplained"
_CYCLE_TICKS = (3, 5, 10, 20, 50, 100, 200, 300)


@styled
def plot_errors(found: Diagnosis) -> Figure:
    """Lengths of the errors row by row in the order of measuring, and how many stay below which length. Errors [mm] are
    those of rows held out from each fit, on a logarithmic axis that both panels share. Lines in the left panel are the
    RMS of neighbouring rows: a line that rises is a drift."""
    figure = new_figure(3.9)
    over, below = figure.subplots(1, 2, sharey=True, gridspec_kw={"width_ratios": (3, 2)})
    names = [name for name in MODELS if name != "extended" or found.fitted_effects]
    smallest = math.inf
    for name in names:
        lengths = 1e3 * np.linalg.norm(found.held[name].errors, axis=1)
        rows = chosen_rows(len(lengths), 1500)
        smallest = min(smallest, float(np.quantile(lengths, 0.02)))
        over.plot(rows + 1, lengths[rows], ".", color=MODEL_COLOURS[name], mew=0, **dots_look(len(rows)))
        # The course is the RMS of at most 30 groups of five rows or more.
        groups = np.array_split(np.arange(len(lengths)), max(min(30, len(lengths) // 5), 1))
        course = [g.mean() + 1 for g in groups], [rms(lengths[g]) for g in groups]
        over.plot(*course, color=MODEL_COLOURS[name], ls=MODEL_DASHES[name], lw=2)
        below.step(
            100 * np.arange(1, len(lengths) + 1) / len(lengths), np.sort(lengths),
            color=MODEL_COLOURS[name], ls=MODEL_DASHES[name],
            label=f"{MODELS[name]}: RMS {number(1e3 * found.errors[name].rms)} mm",
        )  # fmt: skip
    noise = found.noise_floor
    floor = 1e3 * noise.rms
    if floor:
        for axes in (over, below):
            axes.axhline(floor, color=GREY, lw=1.2, ls="--", zorder=1)
        below.plot([], [], color=GREY, lw=1.2, ls="--", label=f"{noise.label}: RMS {number(floor)} mm")
        # The scale ends at 0.8 of the line of the noise at the latest.
        smallest = min(smallest, 0.8 * floor)
    over.set_yscale("log")
    over.set_ylim(bottom=smallest if smallest > 0 else None)
    decimals(over.yaxis)
    over.set_xlabel("row, in the order of measuring (lines: RMS of neighbours)")
    over.set_ylabel("position error of held-out rows [mm]")
    below.set(xlabel="share of the rows below [%]", xlim=(0, 100))
    legend(figure)
    return figure


@styled
def plot_periodogram(found: Diagnosis) -> Figure:
    """Share of the rest that each number of cycles explains, before its lines are named and after. Over cycles per
    revolution of the joint, logarithmic; the dashed line is the share that is significant in the whole search. A peak
    that is left above it in the second curve is not explained."""
    joints = found.periodic_joints[:6]
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
        null = f"significant: {100 * EFFECT_LEVEL:.1f} % of data sets reach it by chance"
        # The share that one frequency must explain for its log p-value to be that of the line, bisected; two degrees of
        # freedom, those of a sine and a cosine.
        low, high = 0.0, 1.0
        for _ in range(40):
            middle = (low + high) / 2
            value = float(log_p(np.array([middle]), np.array([1.0]), 2, before.freedom)[0])
            low, high = (low, middle) if value < line else (middle, high)
        axes.axhline(100 * high, color="black", lw=1.2, ls="--", label=null, zorder=5)
        for k, mark in enumerate(sorted(_marks(found, name))):
            _mark(axes, *mark, k)
        axes.set(title=name, ylabel="share explained [%]", xscale="log", ylim=(0, None))
    grid[-1].set_xticks(_CYCLE_TICKS, [f"{t:g}" for t in _CYCLE_TICKS])
    grid[-1].minorticks_off()
    grid[-1].set_xlabel("cycles per revolution of the joint")
    figure.suptitle("Share of the errors left that one sine wave in a joint's angle explains")
    legend(figure)
    return figure


def _spectrum(found: Diagnosis, baseline: ProjectedBaseline, joint: int) -> tuple[Array, Array]:
    """Cycles per revolution (k,) and the share (k,) of the residual sum of squares that each explains."""
    tangents = found.linearised.sensitivities
    q = found.model.residuals.data.q[:, joint]
    cycles = CyclicError.grid(float(np.ptp(q)))
    return cycles, scan_frequencies(baseline, tangents.joints[joint], q, cycles)[0] / float(baseline.rss[0])


def _marks(found: Diagnosis, joint: str) -> list[tuple[float, str, bool]]:
    """Lines of a joint [cycles per revolution], each with its text and whether its size is open."""
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
    colour, dashes = (_OPEN_COLOUR, ":") if is_open else (GREY, "-")
    axes.axvline(cycles, color=colour, lw=0.8, ls=dashes, zorder=1)
    axes.annotate(
        f"({text})" if is_open and text else text, (cycles, 1.0), xycoords=("data", "axes fraction"),
        textcoords="offset points", xytext=(3, -10 - 10 * (k % 5)), color=colour if is_open else "black", zorder=6,
        bbox={"boxstyle": "square,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.85},
    )  # fmt: skip
