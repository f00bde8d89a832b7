"""The candidates of a diagnosis: the causes of the model first, with their p-values in it, then the others.

Evidence is a ratio of log p-values: a candidate at 1 is as improbable by chance as the significance level allows,
corrected for the number of candidates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.diagnosis.scores.levels import FIRST_EFFECT_LEVEL
from posture_opt.model.effects.base.multiples import cycles_text
from posture_opt.numerics import TURN
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import Look, legend_below, styled
from posture_opt.report.text.words import p_value

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.diagnosis.scores.candidates import ScoredCandidate
    from posture_opt.diagnosis.scores.score_tests import NullDistribution

_MAX_CANDIDATES = 16  # rows
_TICK_SPACING = 0.09  # of the width of the axes
_EVIDENCE_TICKS = (0, 0.25, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)


@dataclass(frozen=True, eq=False)
class ScoredRow:
    """A candidate with its evidence by itself, and its p-value in the model if it is part of that.

    Args:
        scored: the candidate with its score on the calibrated arm.
        evidence: log p-value over the critical one of its family.
        p_value: of dropping it from the final model; None where it is not in it.
        label: of the cause that it is in the model, else its own.
    """

    scored: ScoredCandidate
    evidence: float
    p_value: float | None
    label: str

    @property
    def named(self) -> bool:
        """Whether the candidate is one of the catalogue, and no unnamed component."""
        return self.scored.candidate.named


def evidence(found: Diagnosis) -> list[tuple[ScoredCandidate, float]]:
    """Every candidate with its log p-value over the critical one of its family, the most significant first."""
    search = found.search
    scored = search.scored
    null = search.null
    lines = {family: critical_log_p(null, family) for family in {j.candidate.family for j in scored}}
    pairs = [(j, max(j.log_p / lines[j.candidate.family], 0.0)) for j in scored]
    return sorted(pairs, key=lambda pair: -pair[1])


def critical_log_p(null: NullDistribution, family: str) -> float:
    """The log p-value that a candidate of a family needs to be significant, corrected for the whole search.

    Bisected in the null distribution of the largest score, simulated for these postures.
    """
    low, high = -60.0, -1e-6
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if null.family_wise(middle, family) < FIRST_EFFECT_LEVEL else (low, middle)
    return low


def scored_rows(found: Diagnosis) -> tuple[list[ScoredRow], int]:
    """What is drawn, from the top, and how many candidates there are.

    Those of the model come first, wherever they rank, then the best others up to the largest number of rows.
    """
    rows = [ScoredRow(scored, value, *_in_model(scored, found)) for scored, value in evidence(found)]
    own = [row for row in rows if row.p_value is not None]
    others = [row for row in rows if row.p_value is None]
    return [*own, *others[: max(_MAX_CANDIDATES - len(own), 0)]], len(rows)


@styled
def plot_scores(found: Diagnosis) -> Figure:
    """Evidence of each candidate on the calibrated arm alone, with the line of the significance level.

    A cause that the others hide at first ranks low here: so those of the model come first, each with its p-value in
    it. The axis is the square root of the evidence: evidence spans from below 1 to hundreds.
    """
    rows, count = scored_rows(found)
    own = [row for row in rows if row.p_value is not None]
    others = rows[len(own) :]
    figure = new_figure(1.3 + 0.22 * (len(rows) + 3))
    axes = figure.add_subplot()
    right = 1.04 * max([*(math.sqrt(row.evidence) for row in rows), 1.5])
    names: dict[int, str] = {}
    at = 0
    for title, group in (
        ("In the model", own),
        (f"Not in the model: not significant beside it (best {len(others)} of {count - len(own)})", others),
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
    axes.annotate(
        f"significant beyond this line ({100 * FIRST_EFFECT_LEVEL:.1f} % by chance)", (1, at), xytext=(4, 0),
        textcoords="offset points", va="center", zorder=4,
    )  # fmt: skip
    axes.set_yticks(list(names), list(names.values()))
    axes.set(ylim=(at + 0.6, -0.7), xlim=(0, right))
    ticks = _spaced_ticks(right)
    axes.set_xticks([math.sqrt(t) for t in ticks], [f"{t:g}" for t in ticks])
    axes.set_xlabel("evidence of each cause tested alone: log p-value over that of the dashed line")
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    legend_below(figure)
    return figure


def _spaced_ticks(right: float) -> list[float]:
    """The values at the ticks, none so near to another that their texts touch; 0 and 1 are always there."""
    ticks: list[float] = [0, 1]
    for tick in _EVIDENCE_TICKS:
        at = math.sqrt(tick)
        if at <= right and all(abs(at - math.sqrt(other)) > _TICK_SPACING * right for other in ticks):
            ticks.append(tick)
    return sorted(ticks)


def _say(axes: Axes, k: int, text: str) -> None:
    """A text in a column behind the axes, where no bar and no line runs through it."""
    axes.annotate(
        text, (1, k), xycoords=("axes fraction", "data"), xytext=(4, 0), textcoords="offset points", va="center",
        ha="left", annotation_clip=False,
    )  # fmt: skip


def _look(row: ScoredRow) -> Look:
    """Dark is in the model, paler what shows beside the others only; hatched has no name in the catalogue."""
    if row.p_value is not None and row.evidence < 1:
        return {"color": "#7DB5A2", "label": "hidden by larger causes when tested alone"}
    if row.p_value is not None:
        return {"color": "#00664B", "label": "seen when tested alone"}
    if row.named:
        return {"color": "#B9D5E4", "label": "named cause"}
    return {"facecolor": "#F1DCE7", "hatch": "///", "label": "pattern without a name"}


def _in_model(scored: ScoredCandidate, found: Diagnosis) -> tuple[float | None, str]:
    """The p-value of dropping the candidate from the final model, None where it is not in it; and its label there.

    A line of a periodogram is in the model where the cyclic error of its joint has one that the data cannot separate
    from it: nearer than ``2π`` over the range of the joint. Unnamed components are never part of the model.
    """
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
