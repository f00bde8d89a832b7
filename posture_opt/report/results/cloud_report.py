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

from posture_opt.numerics import Array
from posture_opt.report.figures.arm import plot_spread
from posture_opt.report.figures.cloud import plot_cloud
from posture_opt.report.interactive.solution_postures import spread_view
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts.parts import validity_sentence
from posture_opt.report.results.spread_report import arm_block, covariance_table, posture_block, spread_facts
from posture_opt.report.text.blocks import Block, Facts, Report, Summary, Table
from posture_opt.report.text.words import line_words, part_words
from posture_opt.statements.notation import length_unit, lengths, stated_length
from posture_opt.uncertainty.regions.regions import coverage_factor, deviation
from posture_opt.uncertainty.simulation.sampling_errors import variance_intervals
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt.report.interactive.arm_view import ArmView
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.uncertainty.simulation.cloud import Cloud


def cloud_report(cloud: Cloud) -> Report:
    """Problem, posture, cloud next to closed form, covariance."""
    spread, problem = cloud.spread, problem_of(cloud.spread)
    blocks = (arm_block(problem, spread), posture_block(spread), comparison_block(cloud), covariance_block(cloud))
    return Report(problem.name or "Simulated spread of the tool point", lead(cloud), blocks)


def lead(cloud: Cloud) -> tuple[str, ...]:
    """How many samples lie where the closed form expects them, and how many do what the task asks.

    The second line is left out where no task or no clearance is stated.
    """
    agree = f"{100 * cloud.coverage95:.2f} % of {cloud.n:,} simulated tool points lie in the predicted 95 % region."
    seen = cloud.spread.for_task
    if seen is None or cloud.success is None or seen.success_probability is None:
        return (agree,)
    clearance, closed = stated_length(seen.clearance), _percent(seen.success_probability)
    counted = f"Probability of success (clearance {clearance}): {_percent(cloud.success)} simulated"
    return agree, f"{counted}, {closed} predicted."


def _percent(share: float) -> str:
    """A share that was counted, with two decimals: the digits that thousands of samples support."""
    return f"{100 * share:.2f} %"


def comparison_block(cloud: Cloud) -> Block:
    """Standard deviations, mean and coverage of the sample with their sampling intervals.

    Two tables, of standard deviations and of the mean shift; then the share of tool points in the predicted 95 %
    region, the probability of success, and whether the linear ellipse may be used at this posture.
    """
    low, high = cloud.coverage95_interval
    inside = low <= 0.95 <= high
    interval = f"sampling interval {100 * low:.2f} to {100 * high:.2f} %"
    facts = (
        ("Samples", f"{cloud.n:,}, seed {cloud.seed}"),
        ("In the 95 % region", f"{100 * cloud.coverage95:.2f} % ({interval})"),
        ("", _verdict(inside, cloud.coverage95)),
        *_success_facts(cloud),
    )
    items = (_axes_table(cloud), _mean_table(cloud), Facts(facts), validity_sentence(cloud.spread))
    return Block("Simulation and closed form", items, figure="cloud")


def _verdict(inside: bool, coverage: float) -> str:
    """What the share in the predicted region says: agreement, or a distribution that is not normal."""
    if inside:
        return "the interval contains 95 %: simulation and closed form agree"
    side = "fewer" if coverage < 0.95 else "more"
    return f"{side} than 95 %: the tool points are not exactly normally distributed, see below"


def _success_facts(cloud: Cloud) -> tuple[tuple[str, str], ...]:
    """The counted probability next to that of the closed form; nothing without a clearance."""
    seen, interval = cloud.spread.for_task, cloud.success_interval
    if seen is None or cloud.success is None or interval is None or seen.success_probability is None:
        return ()
    low, high = (f"{100 * share:.2f}" for share in interval)
    counted = f"{_percent(cloud.success)} (sampling interval {low} to {high} %)"
    agrees = interval[0] <= seen.success_probability <= interval[1]
    says = f"{_percent(seen.success_probability)} predicted, {'inside' if agrees else 'outside'} this interval"
    return ("Within the clearance", counted), ("", says)


def _axes_table(cloud: Cloud) -> Table:
    """Standard deviations along the principal axes of the closed form, longest first, then along those of the task.

    Columns: closed form, simulated, the 95 % interval of the latter, and the ratio simulated over closed form.
    """
    intervals = [[math.sqrt(max(float(v), 0.0)) for v in pair] for pair in cloud.eigenvalue_intervals[::-1]]
    sampled = [math.sqrt(max(float(v), 0.0)) for v in cloud.eigenvalues[::-1]]
    closed = [float(v) for v in cloud.spread.ellipse.semi_axes[::-1]]
    unit, factor = length_unit([*sampled, *closed])
    axes, ratios = cloud.spread.axes[::-1], [float(v) for v in cloud.ratio[::-1]]
    rows = tuple(
        (line_words(a), *_beside([c, s, *pair], closed[0], factor), fixed(ratio, 4))
        for a, c, s, pair, ratio in zip(axes, closed, sampled, intervals, ratios, strict=True)
    )
    rows += tuple((words, *_task_cells(cloud.seen, axis, factor)) for words, axis in _task_axes(cloud))
    headers = ("standard deviation along", f"closed form [{unit}]", f"simulated [{unit}]", "95 % interval", "ratio")
    return Table(headers, rows)


def _task_axes(cloud: Cloud) -> tuple[tuple[str, Array], ...]:
    """The axes of the task that are worth a row: the worst one of the part that counts, and the direction.

    Nothing where the task counts all directions alike: the principal axes say that already.
    """
    seen = cloud.spread.for_task
    if seen is None or seen.critical.within == "all":
        return ()
    part = part_words(seen.critical.within, seen.kind)
    worst = ", worst axis" if len(seen.critical.covariance) > 1 else ""
    rows = [(f"{part}{worst}", seen.critical.worst_axis)]
    return tuple(rows if seen.critical.within == "along" else [*rows, (part_words("along", seen.kind), seen.direction)])


def _task_cells(cloud: Cloud, axis: Array, factor: float) -> tuple[str, str, str, str]:
    """Closed form, simulated, interval and ratio along one axis.

    Args:
        axis: (3,) unit vector, world frame; the standard deviation along it is ``sqrt(aᵀ C a)``.
        factor: from m to the unit of the table.
    """
    closed, sampled = (deviation(float(axis @ C @ axis), C) for C in (cloud.spread.covariance, cloud.covariance))
    pair = variance_intervals(axis[None], np.array([sampled**2]), cloud.covariance_of_covariance)[0]
    ends = [math.sqrt(max(float(v), 0.0)) for v in pair]
    ratio = fixed(sampled / closed, 4) if closed > 0 else "-"
    return *_beside([closed, sampled, *ends], float(cloud.spread.ellipse.semi_axes[-1]), factor), ratio


def _beside(sizes: list[float], largest: float, factor: float) -> tuple[str, str, str]:
    """Closed form, simulated, and the interval of the latter, with the digits of the largest of the table.

    Args:
        sizes: closed form, simulated, lower and upper end [m]; ``largest`` [m] of the table.
        factor: from m to the unit of the table.
    """
    closed, sampled, low, high = (number(size * factor, 4, largest * factor) for size in sizes)
    return closed, sampled, f"{low} to {high}"


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


def covariance_block(cloud: Cloud) -> Block:
    """Both covariances (3, 3), world frame, in mm² or µm²; left out of the short form."""
    tables = (covariance_table(cloud.covariance), covariance_table(cloud.spread.covariance))
    items = ("Simulated:", tables[0], "Closed form:", tables[1])
    return Block("Covariance of the tool point, world frame", items, brief=())


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
        facts = (*facts, ("Within the clearance", _percent(cloud.success)))
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

    def document(self) -> Report:
        return cloud_report(self.result)

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
