"""Periodograms of joints with periodic errors: what each frequency explains, and what noise alone does."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from posture_opt.diagnosis.candidates import Candidate
from posture_opt.diagnosis.levels import FIRST_EFFECT
from posture_opt.diagnosis.score_tests import log_p, scan_frequencies
from posture_opt.model.effects.cyclic_error import CyclicError
from posture_opt.report.diagnosed import Diagnosed
from posture_opt.report.figures.diagnosis import critical_log_p
from posture_opt.report.style import BLUE, GREEN, GREY, new_figure, styled

if TYPE_CHECKING:
    from posture_opt.diagnosis.score_tests import ProjectedBaseline

Floats = NDArray[np.float64]

_MOST = 6  # joints
_TICKS = (3, 5, 10, 20, 50, 100, 200, 300)


@styled
def plot_periodogram(diagnosed: Diagnosed) -> Figure:
    """Share of the rest that each number of cycles explains, before its lines are named and after."""
    joints = diagnosed.periodic_joints[:_MOST]
    linearised, model = diagnosed.linearised, diagnosed.diagnosis.model
    chosen = [Candidate(e, linearised.sensitivities.columns(e)) for e in model.effects]
    line = critical_log_p(diagnosed.diagnosis.search.null, CyclicError.family)
    figure = new_figure(9.0, 0.9 + 2.2 * len(joints))
    grid = figure.subplots(len(joints), 1, squeeze=False, sharex=True).ravel()
    after = linearised.baseline(chosen, flips=0)
    for axes, joint in zip(grid, joints, strict=True):
        name = diagnosed.residuals.data.joint_names[joint]
        mine = [s for s in chosen if s.what.spectral_line is not None and s.target == name]
        before = linearised.baseline([s for s in chosen if s not in mine], flips=0)
        cycles, share = _spectrum(diagnosed, before, joint)
        axes.plot(cycles, 100 * share, color=BLUE, lw=1.2, label="before its periodic errors are named", zorder=3)
        cycles, share = _spectrum(diagnosed, after, joint)
        axes.plot(cycles, 100 * share, color=GREEN, lw=1.0, label="with all named effects", zorder=4)
        null = f"noise alone reaches this line in {100 * FIRST_EFFECT:.1f} % of data sets"
        axes.axhline(100 * _share_of(line, before), color="black", lw=1.2, ls="--", label=null, zorder=5)
        for k, frequency in enumerate(sorted(s.what.spectral_line or 0.0 for s in mine)):
            _mark(axes, frequency, k)
        axes.set(title=name, ylabel="explains [%]", xscale="log", ylim=(0, None))
    grid[-1].set_xticks(_TICKS, [f"{t:g}" for t in _TICKS])
    grid[-1].minorticks_off()
    grid[-1].set_xlabel("cycles per revolution")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _spectrum(diagnosed: Diagnosed, baseline: ProjectedBaseline, joint: int) -> tuple[Floats, Floats]:
    tangents = diagnosed.linearised.sensitivities
    q = diagnosed.residuals.data.q[:, joint]
    cycles = CyclicError.grid(float(np.ptp(q)))
    return cycles, scan_frequencies(baseline, tangents.joints[joint], q, cycles)[0] / float(baseline.rss[0])


def _share_of(line: float, baseline: ProjectedBaseline) -> float:
    """The share that one frequency must explain for its log p-value to be that of the line."""
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        value = float(log_p(np.array([middle]), np.array([1.0]), 2, baseline.freedom)[0])
        low, high = (low, middle) if value < line else (middle, high)
    return high


def _mark(axes: Any, cycles: float, k: int) -> None:
    """A line with its number, the one beside it lower."""
    axes.axvline(cycles, color=GREY, lw=0.8, ls=":", zorder=1)
    at = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "xytext": (3, -10 - 10 * (k % 3))}
    axes.annotate(f"{cycles:.4g}", (cycles, 1.0), fontsize=8, **at)
