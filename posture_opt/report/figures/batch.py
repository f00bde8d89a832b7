"""How two parameters vary together across a batch of robots, and the spread of the answers to many problems.

Parameters that vary together have one cause in production: a fixture, say, or a common tool.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.report.page.colours import BLUE, GREY, ORANGE, VERMILLION
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import legend_below, legend_beside, styled
from posture_opt.report.text.words import source_words
from posture_opt.statements.notation import length_unit
from posture_opt.uncertainty.regions.regions import Ellipsoid
from posture_opt.units import ERROR_UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.batch.batch_calibration import Batch
    from posture_opt.batch.batch_covariance import CorrelatedPair
    from posture_opt.selection.posture_batch import PostureBatch
    from posture_opt.selection.problem_data import ProblemData

_MAX_PANELS = 3
_MAX_LINEAR_RATIO = 30.0  # of the largest answer to the smallest: on a linear axis small ones would be one dot
_MAX_NAMED_PROBLEMS = 25  # problems that have room for their names


@styled
def plot_batch(problem: ProblemData, found: Batch) -> Figure:
    """The robots as points with their standard errors, and the ellipse that holds 95 % of the robots of the type.

    One panel for each pair whose correlation is significant, three at most; axes are deviations from nominal [deg or
    mm].
    """
    pairs = [pair for pair in found.pairs if pair.significant][:_MAX_PANELS] or list(found.pairs[:1])
    figure = new_figure({1: 5.0, 2: 4.6}.get(len(pairs), 3.8))
    for k, pair in enumerate(pairs):
        _panel(figure.add_subplot(1, len(pairs), k + 1), problem, found, pair)
    (legend_beside if len(pairs) == 1 else legend_below)(figure)
    return figure


def _panel(axes: Axes, problem: ProblemData, found: Batch, pair: CorrelatedPair) -> None:
    """One pair of parameters; the ellipse is that of the robots, the estimates' own errors subtracted.

    Dots are robots with one standard error either way. The ellipse is left out where one of both variances is zero. A
    dashed ellipse is the covariance that the file states; a plus is the nominal arm. Where both parameters have one
    unit, both axes have one scale.
    """
    i, j = found.names.index(pair.a), found.names.index(pair.b)
    written = [ERROR_UNITS[found.parameters[k].unit] for k in (i, j)]
    scale, units = np.array([factor for factor, _ in written]), [unit for _, unit in written]
    chosen = np.ix_([i, j], [i, j])
    points = found.estimates[:, [i, j]] * scale
    errors = np.array([np.sqrt(_variances(found, k, (pair.a, pair.b))) for k in range(len(points))]) * scale
    axes.axhline(0, color=GREY, lw=0.8)
    axes.axvline(0, color=GREY, lw=0.8)
    (x, y), (across, up) = points.T, errors.T
    axes.errorbar(x, y, up, across, fmt="o", color=BLUE, ms=5, elinewidth=1, label="robots, ± std. error")
    center, C = found.spread.mean[[i, j]] * scale, found.spread.covariance[chosen] * np.outer(scale, scale)
    ellipse = Ellipsoid(center, C)
    if ellipse.rank == 2:
        axes.plot(*ellipse.points(0.95).T, color=VERMILLION, label="95 % of the robots of the type")
    said = _stated(found, pair, (i, j))
    if said is not None:
        axes.plot(
            *Ellipsoid(np.zeros(2), said * np.outer(scale, scale)).points(0.95).T, "--", color=ORANGE, label="stated"
        )
    axes.plot(0, 0, "+", color="black", ms=10, mew=2, label="nominal")
    low, high = pair.interval
    axes.set_title(f"correlation {pair.correlation:.2f} ({low:.2f} to {high:.2f})")
    for which, name, unit in zip("xy", (pair.a, pair.b), units, strict=True):
        axes.set(**{f"{which}label": f"{source_words(name, problem.arm)}, off nominal [{unit}]"})
    if units[0] == units[1]:
        axes.set_aspect("equal", adjustable="datalim")


def _variances(found: Batch, robot: int, names: tuple[str, str]) -> list[float]:
    """Variances [rad² or m²] of both parameters of a robot, as its calibration states them.

    Args:
        robot: number of the robot in the batch.
        names: of both parameters.
    """
    calibration = found.calibrations[robot]
    place = {p.name: k for k, p in enumerate(calibration.parameters)}
    return [float(calibration.covariance[place[name], place[name]]) for name in names]


def _stated(found: Batch, pair: CorrelatedPair, index: tuple[int, int]) -> Any:
    """(2, 2) the covariance that the problem file states for a pair [rad² or m²]; None where it states none."""
    sigma = found.stated[list(index)]
    if not np.all(sigma > 0) or abs(pair.stated) >= 1:
        return None
    return np.outer(sigma, sigma) * [[1.0, pair.stated], [pair.stated, 1.0]]


@styled
def plot_posture_batch(found: PostureBatch) -> Figure:
    """Largest standard deviation of each problem that has a solution [µm or mm], the smallest at the top.

    Of several features or a path it is that of the worst one. Names are shown where there is room for them, and the
    axis is logarithmic where answers differ by orders of magnitude; problems without a solution are in the report only.
    """
    answers = sorted(found.solved, key=lambda answer: -answer.sigma_max)
    unit, factor = length_unit([answer.sigma_max for answer in answers] or [0.0])
    figure = new_figure(max(2.0, 0.25 * min(len(answers), _MAX_NAMED_PROBLEMS) + 1.2))
    axes = figure.add_subplot()
    axes.plot([factor * answer.sigma_max for answer in answers], range(len(answers)), "o", color=BLUE, ms=4)
    axes.set_ylim(-0.5, max(len(answers), 1) - 0.5)  # no dot on the frame
    if len(answers) <= _MAX_NAMED_PROBLEMS:
        axes.set_yticks(range(len(answers)), [answer.name for answer in answers])
    else:
        axes.set_ylabel("problems, in order")
    sizes = [answer.sigma_max for answer in answers if answer.sigma_max > 0]
    if sizes and max(sizes) > _MAX_LINEAR_RATIO * min(sizes):
        axes.set_xscale("log")
    else:
        axes.set_xlim(left=0)
    axes.set_xlabel(f"standard deviation that counts for the task [{unit}]")
    return figure
