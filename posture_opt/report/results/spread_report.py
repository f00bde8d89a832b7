"""The report on the spread at one posture, in closed form.

Lengths of the whole report share the unit of the largest standard deviation. The exact covariance is the answer; the
first-order one is shown next to it.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.parts.budget_parts import budget_block, group_words, main_fact
from posture_opt.report.parts.parts import (
    brief_notes,
    ellipse_facts,
    first_order_fact,
    frame_notes,
    input_facts,
    joint_table,
    joint_values,
    mean_fact,
    method_fact,
    nearest_limit,
    note_facts,
    relative_fact,
    robot_facts,
    source_facts,
    tool_facts,
    validity_sentence,
    workpiece_facts,
)
from posture_opt.report.parts.task_parts import (
    beside_target,
    clearance_facts,
    critical_size,
    lean_facts,
    spread_lead,
    task_budget_block,
    task_facts,
    task_items,
)
from posture_opt.report.results.drawing_files import figures_of, views_of
from posture_opt.report.text.blocks import Block, Facts, Item, Report, Summary, Table
from posture_opt.report.text.words import line_words, part_words
from posture_opt.statements.notation import length, length_unit, lengths, percent, place
from posture_opt.uncertainty.regions.regions import deviation
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.report.interactive.arm_view import ArmView
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.uncertainty.spread.spread import Spread
    from posture_opt.uncertainty.spread.task_spread import TaskSpread


def spread_report(spread: Spread) -> Report:
    """Problem, posture, spread, covariance, budget."""
    problem = problem_of(spread)
    blocks = (
        arm_block(problem, spread),
        posture_block(spread),
        spread_block(spread),
        covariance_block(spread),
        spread_budget_block(problem, spread),
    )
    return Report(problem.name or "Spread of the tool point", lead(spread), blocks)


def lead(spread: Spread) -> tuple[str, ...]:
    """The standard deviation, in the part that the task counts where there is one, and the probability of success."""
    seen = spread.for_task
    if seen is None:
        largest = length(float(spread.ellipse.semi_axes[-1]))
        return (f"Standard deviation of the tool point: {largest} (worst axis).",)
    return spread_lead(seen)


def arm_block(problem: ProblemData, spread: Spread) -> Block:
    """The robot, the sources, and the task where there is one.

    The short form has the robot, the distance from the target, inputs of effects, sources and notes.
    """
    seen = spread.for_task
    task = problem.task
    asked = [] if seen is None or task is None else [
        *task_facts(task, seen.direction), *clearance_facts(seen), *beside_target(spread),
    ]  # fmt: skip
    every = (*problem.notes, *frame_notes(problem.robot), *spread.notes)
    facts = (
        *robot_facts(problem),
        *asked,
        *input_facts(problem),
        *source_facts(problem),
        *workpiece_facts(problem),
        *note_facts(every),
    )
    short = (
        facts[0],
        *beside_target(spread),
        *input_facts(problem),
        *source_facts(problem),
        *workpiece_facts(problem),
        *brief_notes(problem, every),
    )
    return Block("Problem", (Facts(facts),), brief=(Facts(short),))


def posture_block(spread: Spread) -> Block:
    """Joints and tool: value, limits and margin of each joint, then tool point and orientation in the world frame."""
    facts = (*tool_facts(spread), *lean_facts(spread))
    brief = (("Joints", joint_values(spread.problem, spread.q)), *nearest_limit(spread.robot, spread.q), *facts)
    return Block(
        "Posture",
        (joint_table(spread.problem, spread.robot, spread.q), Facts(facts)),
        figure="arm",
        brief=(Facts(brief),),
    )


def spread_block(spread: Spread) -> Block:
    """Standard deviations along the axes, regions, mean shift, first order next to exact.

    One row a principal axis of the exact covariance C, longest first: ``sqrt(eigenvalue)`` and the first-order
    ``sqrt(aᵀ J Σ Jᵀ a)`` along the same axis a. What the task counts comes before the table; whether the linear
    ellipse may be used comes last.
    """
    semi_axes = [float(s) for s in spread.ellipse.semi_axes[::-1]]
    unit, factor = length_unit(semi_axes)
    first = spread.covariance_first_order
    linear = [deviation(float(a @ first @ a), spread.covariance) for a in spread.axes[::-1]]
    rows = tuple(
        (line_words(a), *(number(v * factor, beside=semi_axes[0] * factor) for v in (s, f)))
        for a, s, f in zip(spread.axes[::-1], semi_axes, linear, strict=True)
    )
    headers = ("axis", f"standard deviation [{unit}]", f"first order [{unit}]")
    largest = math.sqrt(max(float(np.linalg.eigvalsh(spread.covariance_first_order)[-1]), 0.0))
    facts = (
        *ellipse_facts(spread, semi_axes),
        mean_fact(spread, semi_axes),
        first_order_fact(semi_axes[0], largest, semi_axes),
        method_fact(spread),
        *relative_fact(spread),
    )
    task, valid = task_items(spread, semi_axes), validity_sentence(spread)
    items: tuple[Item, ...] = (*task, Table(headers, rows), Facts(facts), valid)
    seen = spread.for_task
    groups = spread.budget_groups if seen is None else seen.budget_groups
    contributions = Facts((main_fact(spread.tool_point.arm, groups),))
    brief: tuple[Item, ...] = (*(task or (Facts(facts[:3]), valid)), contributions)
    return Block("Spread of the tool point", items, figure="cloud", brief=brief)


def covariance_block(spread: Spread) -> Block:
    """The covariance (3, 3), world frame; left out of the short form where a task counts a part of it only."""
    table = covariance_table(spread.covariance)
    return Block("Covariance of the tool point, world frame", (table,), brief=() if spread.for_task else None)


def covariance_table(C: Array) -> Table:
    """A (3, 3) covariance [m²] in mm² or µm².

    Squares of small numbers are smaller still: below a trace of (0.1 mm)² the table is in µm². Entries below 1e-12 of
    the trace are rounding and shown as 0.
    """
    # Squares of small numbers are smaller still: below 0.1 mm the table is in µm².
    unit, factor = ("µm", 1e6) if float(np.trace(C)) < 1e-8 else ("mm", 1e3)
    floor = 1e-12 * float(np.trace(C))
    largest = float(np.abs(C).max()) * factor**2
    entries = [[number(float(v) * factor**2, 4, largest) if abs(v) > floor else "0" for v in row] for row in C]
    rows = tuple((f"{name} [{unit}^2]", *row) for name, row in zip("xyz", entries, strict=True))
    return Table(("", "x", "y", "z"), rows)


def spread_budget_block(problem: ProblemData, spread: Spread) -> Block:
    """The error budget along the longest axis, or along the critical axis of the task."""
    if spread.for_task is not None:
        return task_budget_block(problem, spread.for_task)
    text = f"Contribution of each source to the variance along {line_words(spread.axes[-1])}, the longest axis:"
    return budget_block(problem, spread.budget_groups, text)


def spread_facts(spread: Spread) -> tuple[tuple[str, str], ...]:
    """The posture and the spread of its tool point, in four lines; one more where there is a task."""
    seen = spread.for_task
    first, axis = (
        (spread.budget_groups[0], "the longest axis") if seen is None else (seen.budget_groups[0], "the critical axis")
    )
    task = () if seen is None else (("For the task", _critical_words(seen)),)
    return (
        ("Posture", joint_values(spread.problem, spread.q)),
        ("Tool point", place(spread.position)),
        ("Standard deviations", lengths([float(s) for s in spread.ellipse.semi_axes[::-1]])),
        *task,
        (
            "Largest contribution",
            f"{group_words(first, spread.tool_point.arm)}, {percent(first.share)} of {axis}",
        ),
    )


def _critical_words(seen: TaskSpread) -> str:
    """Standard deviation of the part that the task counts, and which part that is."""
    return f"{critical_size(seen.critical)} {part_words(seen.critical.within, seen.kind)}"


class SpreadPresenter(Presenter["Spread"]):
    """The spread at one posture in closed form."""

    stem = "spread"

    def summary(self) -> Summary:
        """Posture, tool point, standard deviations, largest contribution."""
        return Summary("Spread of the tool point at one posture", spread_facts(self.result))

    def document(self) -> Report:
        """The whole report."""
        return spread_report(self.result)

    def drawings(self) -> Drawings:
        """The arm, a small cloud with the ellipse, the budget of the axis that counts most.

        With a task, the second figure is the cross-section of the ellipse in which the task counts it.
        """
        found = self.result
        seen, arm = found.for_task, partial(figures_of("arm").plot_spread, found)
        if seen is None:
            return {
                "arm": arm,
                "cloud": partial(figures_of("cloud").plot_simulated, found),
                "budget": partial(figures_of("solution").plot_longest_axis_budget, found),
            }
        return {
            "arm": arm,
            "cloud": partial(figures_of("cloud").plot_cross_section, found, seen, origin="nominal point"),
            "budget": partial(figures_of("solution").plot_task_budget, found, seen),
        }

    def view(self) -> ArmView:
        """The posture that was asked for."""
        view: ArmView = views_of("solution_postures").spread_view(self.result)
        return view

    def columns(self) -> Columns:
        """The error budget of the longest axis: parameter and share of the variance (their sum is 1)."""
        shares = self.result.budget
        return {"parameter": [share.parameter for share in shares], "share": [share.share for share in shares]}
