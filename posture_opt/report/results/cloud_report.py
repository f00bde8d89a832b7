"""The report on a Monte Carlo cloud next to the closed form.

Each simulated number has its sampling interval: a closed form inside it agrees with the simulation as far as so many
samples can say.
"""

from __future__ import annotations

import math
from functools import partial
from io import StringIO
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.report.figures.arm import plot_spread
from posture_opt.report.figures.cloud import plot_cloud
from posture_opt.report.interactive.solution_postures import spread_view
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.results.spread_report import arm_block, covariance_table, posture_block, spread_facts
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.report.text.words import line_words
from posture_opt.statements.notation import length_unit, lengths
from posture_opt.uncertainty.regions.critical import PARTS
from posture_opt.uncertainty.regions.regions import coverage_factor, deviation
from posture_opt.uncertainty.simulation.sampling_errors import variance_intervals
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.report.interactive.arm_view import ArmView
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.uncertainty.simulation.cloud import Cloud


def comparison_block(cloud: Cloud) -> Block:
    """Standard deviations and mean of the sample with their sampling intervals, next to the closed form."""
    facts = Facts((("Samples", f"{cloud.n:,}, seed {cloud.seed}"),))
    return Block("Simulation and closed form", (_axes_table(cloud), _mean_table(cloud), facts), figure="cloud")


def _axes_table(cloud: Cloud) -> Table:
    """Standard deviations ``sqrt(aᵀ C a)`` along the principal axes of the closed form, then along those of the task.

    Columns: closed form, simulated, the 95 % interval of the latter, and the ratio simulated over closed form.
    """
    spread, seen = cloud.spread, cloud.spread.for_task
    axes = [(line_words(a), a, cloud) for a in spread.axes[::-1]]
    if seen is not None and seen.critical.within != "all":
        worst = ", worst axis" if len(seen.critical.covariance) > 1 else ""
        task = {f"{PARTS[seen.critical.within]}{worst}": seen.critical.worst_axis, PARTS["along"]: seen.direction}
        axes += [(words, a, cloud.seen) for words, a in task.items()]
    largest = float(spread.ellipse.semi_axes[-1])
    unit, factor = length_unit([largest])
    rows = []
    for words, a, sample in axes:
        closed, sampled = (deviation(float(a @ C @ a), C) for C in (sample.spread.covariance, sample.covariance))
        ends = variance_intervals(a[None], np.array([sampled**2]), sample.covariance_of_covariance)[0]
        sizes = (closed, sampled, *np.sqrt(np.maximum(ends, 0.0)))
        first, second, low, high = (number(float(size) * factor, 4, largest * factor) for size in sizes)
        rows.append((words, first, second, f"{low} to {high}", fixed(sampled / closed, 4) if closed > 0 else "-"))
    headers = ("standard deviation along", f"closed form [{unit}]", f"simulated [{unit}]", "95 % interval", "ratio")
    return Table(headers, tuple(rows))


def _mean_table(cloud: Cloud) -> Table:
    """Shift of the mean from the nominal tool point by axis: closed form, simulated, and its 95 % sampling interval."""
    closed, sampled = [float(v) for v in cloud.spread.bias], [float(v) for v in cloud.bias]
    errors = [coverage_factor(0.95, 1) * float(v) for v in cloud.bias_error]
    unit, factor = length_unit([float(v) for v in cloud.spread.ellipse.semi_axes])
    decimals = max(0, 2 - math.floor(math.log10(max(max(errors) * factor, 1e-9))))
    rows = tuple(
        (axis, *(fixed(v * factor, decimals) for v in (c, s)), f"± {fixed(e * factor, decimals)}")
        for axis, c, s, e in zip("xyz", closed, sampled, errors, strict=True)
    )
    return Table(("mean shift along", f"closed form [{unit}]", f"simulated [{unit}]", "95 % interval"), rows)


def points_csv(cloud: Cloud) -> bytes:
    """The simulated tool points (n, 3) in mm, world frame, to a nanometre."""
    text = StringIO()
    np.savetxt(text, 1e3 * cloud.points, fmt="%.6f", delimiter=", ", header="x [mm], y [mm], z [mm]", comments="")
    return text.getvalue().encode()


def _summary(cloud: Cloud) -> Summary:
    """Posture, tool point, standard deviations, their ratios to the closed form, coverage, probability of success."""
    low, high = (100 * share for share in cloud.coverage95_interval)
    posture, point, *_ = spread_facts(cloud.spread)
    sizes = lengths([math.sqrt(max(float(v), 0.0)) for v in cloud.eigenvalues[::-1]])
    ratios = ", ".join(fixed(float(ratio), 4) for ratio in cloud.ratio[::-1])
    facts: tuple[tuple[str, str], ...] = (
        posture,
        point,
        ("Standard deviations", sizes),
        ("Ratio to the closed form", ratios),
        ("In its 95 % region", f"{100 * cloud.coverage95:.2f} % (sampling interval {low:.2f} to {high:.2f} %)"),
    )
    if cloud.success is not None:
        facts = (*facts, ("Within the clearance", f"{100 * cloud.success:.2f} %"))
    return Summary(f"{cloud.n:,} simulated tool points at one posture, seed {cloud.seed}", facts)


class CloudPresenter(Presenter["Cloud"]):
    """A simulation next to the closed form; ``cloud.csv`` has the simulated tool points."""

    stem = "spread"
    delivers: ClassVar[tuple[str, ...]] = ("cloud.csv",)

    @property
    def problem(self) -> ProblemData:
        """The problem whose arm was simulated."""
        return problem_of(self.result.spread)

    def summary(self) -> Summary:
        return _summary(self.result)

    def document(self) -> Document:
        """Problem, posture, cloud next to closed form, both covariances."""
        cloud, problem = self.result, self.problem
        tables = (covariance_table(cloud.covariance), covariance_table(cloud.spread.covariance))
        items = ("Simulated:", tables[0], "Closed form:", tables[1])
        blocks = (
            arm_block(problem, cloud.spread),
            posture_block(cloud.spread),
            comparison_block(cloud),
            Block("Covariance of the tool point, world frame", items, brief=()),
        )
        return Document(problem.name or "Simulated spread of the tool point", cloud.statements, blocks)

    def drawings(self) -> Drawings:
        """The cloud with the closed form's ellipses, and the arm."""
        return {"cloud": partial(plot_cloud, self.result), "arm": partial(plot_spread, self.result.spread)}

    def view(self) -> ArmView:
        """The posture that was simulated."""
        return spread_view(self.result.spread)

    def columns(self) -> Columns:
        """The simulated tool points [mm], world frame, one row a sample."""
        return {f"{axis} [mm]": 1e3 * self.result.points[:, k] for k, axis in enumerate("xyz")}

    def files(self) -> Files:
        return {"cloud.csv": points_csv(self.result)}
