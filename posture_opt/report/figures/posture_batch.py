"""The spread of the answers to many problems."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.report.page.colours import BLUE
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import styled
from posture_opt.statements.notation import length_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posture_opt.selection.posture_batch import PostureBatch

_MAX_LINEAR_RATIO = 30.0  # of the largest answer to the smallest: on a linear axis small ones would be one dot
_MAX_NAMED_PROBLEMS = 25  # problems that have room for their names


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
