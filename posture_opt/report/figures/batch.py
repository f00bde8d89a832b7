"""How two parameters vary together across a batch of robots, and the spread of the answers to many problems.

Parameters that vary together have one cause in production: a fixture, say, or a common tool.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.page.colours import BLUE, GREY, ORANGE, VERMILLION
from posture_opt.report.page.style import legend, new_axes, new_figure, styled
from posture_opt.statements.notation import length_unit
from posture_opt.uncertainty.regions import Ellipsoid
from posture_opt.uncertainty.sources import source_words
from posture_opt.units import ERROR_UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt import Batch, PostureBatch
    from posture_opt.batch.batch_covariance import CorrelatedPair
    from posture_opt.selection.problem_data import ProblemData

_MAX_NAMED_PROBLEMS = 25  # problems that have room for their names


@styled
def plot_batch(problem: ProblemData, found: Batch) -> Figure:
    """The robots as points with their standard errors, and the ellipse that holds 95 % of the robots of the type.
    One panel for each pair whose correlation is significant, three at most; axes are deviations from nominal [deg
    or mm]."""
    pairs = [pair for pair in found.pairs if pair.significant][:3] or list(found.pairs[:1])
    figure = new_figure({1: 5.0, 2: 4.6}.get(len(pairs), 3.8))
    for k, pair in enumerate(pairs):
        _panel(figure.add_subplot(1, len(pairs), k + 1), problem, found, pair)
    legend(figure, beside=len(pairs) == 1)
    return figure


def _panel(axes: Axes, problem: ProblemData, found: Batch, pair: CorrelatedPair) -> None:
    """One pair of parameters; the ellipse is that of the robots, the estimates' own errors subtracted."""
    i, j = found.names.index(pair.a), found.names.index(pair.b)
    written = [ERROR_UNITS[found.parameters[k].unit] for k in (i, j)]
    scale, units = np.array([factor for factor, _ in written]), [unit for _, unit in written]
    chosen = np.ix_([i, j], [i, j])
    points = found.estimates[:, [i, j]] * scale
    variances = [  # of both parameters of each robot, as its calibration states them [rad² or m²]
        [float(c.covariance[k, k]) for k in ([p.name for p in c.parameters].index(name) for name in (pair.a, pair.b))]
        for c in found.calibrations
    ]
    errors = np.sqrt(variances) * scale
    axes.axhline(0, color=GREY, lw=0.8)
    axes.axvline(0, color=GREY, lw=0.8)
    (x, y), (across, up) = points.T, errors.T
    axes.errorbar(x, y, up, across, fmt="o", color=BLUE, ms=5, elinewidth=1, label="robots, ± std. error")
    center, C = found.spread.mean[[i, j]] * scale, found.spread.covariance[chosen] * np.outer(scale, scale)
    ellipse = Ellipsoid(center, C)
    if ellipse.rank == 2:
        axes.plot(*ellipse.points(0.95).T, color=VERMILLION, label="95 % of the robots of the type")
    sigma = found.stated[[i, j]] * scale
    if np.all(sigma > 0) and abs(pair.stated) < 1:
        stated = np.outer(sigma, sigma) * [[1.0, pair.stated], [pair.stated, 1.0]]
        axes.plot(*Ellipsoid(np.zeros(2), stated).points(0.95).T, "--", color=ORANGE, label="stated")
    axes.plot(0, 0, "+", color="black", ms=10, mew=2, label="nominal")
    low, high = pair.interval
    axes.set_title(f"correlation {pair.correlation:.2f} ({low:.2f} to {high:.2f})")
    for which, name, unit in zip("xy", (pair.a, pair.b), units, strict=True):
        axes.set(**{f"{which}label": f"{source_words(name, problem.arm)}, off nominal [{unit}]"})
    if units[0] == units[1]:
        axes.set_aspect("equal", adjustable="datalim")


@styled
def plot_posture_batch(found: PostureBatch) -> Figure:
    """Largest standard deviation of each problem that has a solution [µm or mm], the smallest at the top. Of several
    features or a path it is that of the worst one. Names are shown where there is room for them, and the axis is
    logarithmic where answers differ by orders of magnitude; problems without a solution are in the report only."""
    answers = sorted(found.solved, key=lambda answer: -answer.sigma_max)
    unit, factor = length_unit([answer.sigma_max for answer in answers] or [0.0])
    figure, axes = new_axes(max(2.0, 0.25 * min(len(answers), _MAX_NAMED_PROBLEMS) + 1.2))
    axes.plot([factor * answer.sigma_max for answer in answers], range(len(answers)), "o", color=BLUE, ms=4)
    axes.set_ylim(-0.5, max(len(answers), 1) - 0.5)  # no dot on the frame
    if len(answers) <= _MAX_NAMED_PROBLEMS:
        axes.set_yticks(range(len(answers)), [answer.name for answer in answers])
    else:
        axes.set_ylabel("problems, in order")
    sizes = [answer.sigma_max for answer in answers if answer.sigma_max > 0]
    # Where answers differ more, the small ones would be one dot on a linear axis.
    if sizes and max(sizes) > 30.0 * min(sizes):
        axes.set_xscale("log")
    else:
        axes.set_xlim(left=0)
    axes.set_xlabel(f"standard deviation that counts for the task [{unit}]")
    return figure
