"""Reports on the spread at one posture: in closed form, and a Monte Carlo cloud next to it.

Lengths of one report share the unit of the largest standard deviation. The exact covariance is the answer; the
first-order one and sampling intervals are shown next to it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from io import StringIO
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.page.save import Files
from posture_opt.report.parts import parts, task_parts
from posture_opt.report.results import figures_of, scene_of
from posture_opt.report.text.blocks import Block, Facts, Summary, Table
from posture_opt.report.text.words import line_words
from posture_opt.statements.notation import length, length_unit, lengths, percent, place
from posture_opt.uncertainty.clearance import PARTS
from posture_opt.uncertainty.regions import coverage_factor, deviation
from posture_opt.uncertainty.sampler import variance_intervals
from posture_opt.units import fixed, number

if TYPE_CHECKING:
    from posture_opt import Cloud, Spread
    from posture_opt.report.scene.arm_view import ArmView
    from posture_opt.selection.problem_data import ProblemData


def arm_block(problem: ProblemData, spread: Spread) -> Block:
    """The robot, the sources, and the task where there is one; of the task the short form has nothing."""
    seen, task = spread.for_task, problem.task
    asked = []
    if seen is not None and task is not None:
        asked = [*task_parts.task_facts(task, seen.direction), *task_parts.clearance_facts(seen)]
    every = (*problem.notes, *parts.frame_notes(problem.robot), *spread.source_notes)
    stated = (*parts.input_facts(problem), *parts.source_facts(problem), *parts.workpiece_facts(problem))
    robot = parts.robot_facts(problem)
    facts = (*robot, *asked, *stated, *parts.note_facts(every))
    return Block("Problem", (Facts(facts),), brief=(Facts((robot[0], *stated, *parts.brief_notes(problem, every))),))


def posture_block(spread: Spread) -> Block:
    """Joints and tool: value, limits and margin of each joint, then tool point and orientation in the world frame."""
    facts = (*parts.tool_facts(spread), *task_parts.lean_facts(spread))
    joints = ("Joints", parts.joint_values(spread.problem, spread.q))
    brief = (joints, *parts.nearest_limit(spread.robot, spread.q), *facts)
    table = parts.joint_table(spread.problem, spread.robot, spread.q)
    return Block("Posture", (table, Facts(facts)), figure="arm", brief=(Facts(brief),))


def spread_block(spread: Spread) -> Block:
    """Standard deviations along the axes, regions, mean shift, first order next to exact."""
    semi_axes = [float(s) for s in spread.ellipse.semi_axes[::-1]]
    unit, factor = length_unit(semi_axes)
    first = spread.covariance_first_order
    linear = [deviation(float(a @ first @ a), spread.covariance) for a in spread.axes[::-1]]
    rows = tuple(
        (line_words(a), *(number(v * factor, beside=semi_axes[0] * factor) for v in (s, f)))
        for a, s, f in zip(spread.axes[::-1], semi_axes, linear, strict=True)
    )
    headers = ("axis", f"standard deviation [{unit}]", f"first order [{unit}]")
    largest = math.sqrt(max(float(np.linalg.eigvalsh(first)[-1]), 0.0))
    facts = (
        *parts.ellipse_facts(spread, semi_axes),
        parts.mean_fact(spread, semi_axes),
        parts.first_order_fact(semi_axes[0], largest, semi_axes),
        parts.method_fact(spread),
        *parts.relative_fact(spread),
    )
    seen = spread.for_task
    task = () if seen is None else (Facts(tuple(task_parts.critical_rows(seen, semi_axes, "nominal point"))),)
    groups = spread.budget_groups if seen is None else seen.budget_groups
    brief = (*(task or (Facts(facts[:3]),)), Facts((task_parts.main_fact(groups),)))
    return Block("Spread of the tool point", (*task, Table(headers, rows), Facts(facts)), figure="cloud", brief=brief)


def covariance_table(C: Array) -> Table:
    """A (3, 3) covariance [m²] in mm², below a trace of (0.1 mm)² in µm²; entries that are rounding are 0."""
    unit, factor = ("µm", 1e6) if float(np.trace(C)) < 1e-8 else ("mm", 1e3)
    floor = 1e-12 * float(np.trace(C))
    largest = float(np.abs(C).max()) * factor**2
    entries = [[number(float(v) * factor**2, 4, largest) if abs(v) > floor else "0" for v in row] for row in C]
    rows = tuple((f"{name} [{unit}^2]", *row) for name, row in zip("xyz", entries, strict=True))
    return Table(("", "x", "y", "z"), rows)


def spread_facts(spread: Spread) -> tuple[tuple[str, str], ...]:
    """The posture and the spread of its tool point, in four lines; one more where there is a task."""
    seen = spread.for_task
    groups, axis, part = spread.budget_groups, "the longest axis", ""
    if seen is not None:
        groups, axis = seen.budget_groups, "the critical axis"
        part = f"{length(seen.critical.sigma_max)} {PARTS[seen.critical.within]}"
    first = groups[0]
    return (
        ("Posture", parts.joint_values(spread.problem, spread.q)),
        ("Tool point", place(spread.position)),
        ("Standard deviations", lengths([float(s) for s in spread.ellipse.semi_axes[::-1]])),
        *((("For the task", part),) if part else ()),
        ("Largest contribution", f"{task_parts.named(first.parameters)}, {percent(first.share)} of {axis}"),
    )


class SpreadPresenter(Presenter["Spread"]):
    """The spread at one posture in closed form."""

    stem = "spread"
    title = "Spread of the tool point"

    def summary(self) -> Summary:
        return Summary("Spread of the tool point at one posture", spread_facts(self.result))

    def blocks(self) -> Iterable[Block]:
        found, problem = self.result, self.problem
        table, title = (covariance_table(found.covariance),), "Covariance of the tool point, world frame"
        # A report with a task leaves the covariance out of its short form.
        covariance = Block(title, table, brief=() if found.for_task else None)
        yield from (arm_block(problem, found), posture_block(found), spread_block(found), covariance)
        if found.for_task is not None:
            yield task_parts.task_budget_block(problem, found.for_task)
        else:
            text = f"Contribution of each source to the variance along {line_words(found.axes[-1])}, the longest axis:"
            yield task_parts.budget_block(problem, found.budget_groups, text)

    def drawings(self) -> Drawings:
        found = self.result
        seen, cloud, solution = found.for_task, figures_of("cloud"), figures_of("solution")
        drawn: Drawings = {
            "cloud": partial(cloud.plot_simulated, found),
            "budget": partial(solution.plot_longest_axis_budget, found),
        }
        if seen is not None:
            # The cross-section of the ellipse in which the task counts it.
            drawn["cloud"] = partial(cloud.plot_cross_section, found, seen, origin="nominal point")
            drawn["budget"] = partial(solution.plot_task_budget, found, seen)
        return {"arm": partial(scene_of("arm_figure").plot_spread, found), **drawn}

    def view(self) -> ArmView:
        view: ArmView = scene_of("posture_views").spread_view(self.result)
        return view

    def columns(self) -> Columns:
        shares = self.result.budget
        return {"parameter": [share.parameter for share in shares], "share": [share.share for share in shares]}


def _axes_table(cloud: Cloud) -> Table:
    """Standard deviations ``sqrt(aᵀ C a)`` along the principal axes of the closed form, then along those of the
    task."""
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
    closed, sampled = [float(v) for v in cloud.spread.bias], [float(v) for v in cloud.bias]
    errors = [coverage_factor(0.95, 1) * float(v) for v in cloud.bias_error]
    unit, factor = length_unit([float(v) for v in cloud.spread.ellipse.semi_axes])
    decimals = max(0, 2 - math.floor(math.log10(max(max(errors) * factor, 1e-9))))
    rows = tuple(
        (axis, *(fixed(v * factor, decimals) for v in (c, s)), f"± {fixed(e * factor, decimals)}")
        for axis, c, s, e in zip("xyz", closed, sampled, errors, strict=True)
    )
    return Table(("mean shift along", f"closed form [{unit}]", f"simulated [{unit}]", "95 % interval"), rows)


class CloudPresenter(Presenter["Cloud"]):
    """A simulation next to the closed form; ``cloud.csv`` has the simulated tool points."""

    stem = "spread"
    title = "Simulated spread of the tool point"
    asked = "spread"
    delivers: ClassVar[tuple[str, ...]] = ("cloud.csv",)

    def summary(self) -> Summary:
        """Posture, tool point, standard deviations, their ratios to the closed form, coverage, success."""
        cloud = self.result
        low, high = (100 * share for share in cloud.coverage95_interval)
        posture, point, *_ = spread_facts(cloud.spread)
        sizes = lengths([math.sqrt(max(float(v), 0.0)) for v in cloud.eigenvalues[::-1]])
        facts = (
            posture,
            point,
            ("Standard deviations", sizes),
            ("Ratio to the closed form", ", ".join(fixed(float(ratio), 4) for ratio in cloud.ratio[::-1])),
            ("In its 95 % region", f"{100 * cloud.coverage95:.2f} % (sampling interval {low:.2f} to {high:.2f} %)"),
            *([] if cloud.success is None else [("Within the clearance", f"{100 * cloud.success:.2f} %")]),
        )
        return Summary(f"{cloud.n:,} simulated tool points at one posture, seed {cloud.seed}", facts)

    def blocks(self) -> Iterable[Block]:
        cloud = self.result
        tables = (covariance_table(cloud.covariance), covariance_table(cloud.spread.covariance))
        items = ("Simulated:", tables[0], "Closed form:", tables[1])
        facts = Facts((("Samples", f"{cloud.n:,}, seed {cloud.seed}"),))
        both = (_axes_table(cloud), _mean_table(cloud), facts)
        yield from (arm_block(self.problem, cloud.spread), posture_block(cloud.spread))
        yield Block("Simulation and closed form", both, figure="cloud")
        yield Block("Covariance of the tool point, world frame", items, brief=())

    def drawings(self) -> Drawings:
        return {
            "cloud": partial(figures_of("cloud").plot_cloud, self.result),
            "arm": partial(scene_of("arm_figure").plot_spread, self.result.spread),
        }

    def view(self) -> ArmView:
        view: ArmView = scene_of("posture_views").spread_view(self.result.spread)
        return view

    def columns(self) -> Columns:
        return parts.point_columns(self.result.points)

    def files(self) -> Files:
        """The simulated tool points (n, 3) in mm, world frame, to a nanometre."""
        text = StringIO()
        head = "x [mm], y [mm], z [mm]"
        np.savetxt(text, 1e3 * self.result.points, fmt="%.6f", delimiter=", ", header=head, comments="")
        return {"cloud.csv": text.getvalue().encode()}
