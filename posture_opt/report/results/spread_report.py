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
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.parts.budget_parts import budget_block, main_fact, named
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
    workpiece_facts,
)
from posture_opt.report.parts.task_parts import (
    clearance_facts,
    lean_facts,
    task_budget_block,
    task_facts,
    task_items,
)
from posture_opt.report.results.drawing_files import figures_of, views_of
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.report.text.words import line_words
from posture_opt.statements.notation import length, length_unit, lengths, percent, place
from posture_opt.uncertainty.regions.critical import PARTS
from posture_opt.uncertainty.regions.regions import deviation
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.report.interactive.arm_view import ArmView
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.uncertainty.spread.spread import Spread


def arm_block(problem: ProblemData, spread: Spread) -> Block:
    """The robot, the sources, and the task where there is one; of the task the short form has nothing."""
    seen, task = spread.for_task, problem.task
    asked = [] if seen is None or task is None else [*task_facts(task, seen.direction), *clearance_facts(seen)]
    every = (*problem.notes, *frame_notes(problem.robot), *spread.source_notes)
    stated = (*input_facts(problem), *source_facts(problem), *workpiece_facts(problem))
    robot = robot_facts(problem)
    facts = (*robot, *asked, *stated, *note_facts(every))
    return Block("Problem", (Facts(facts),), brief=(Facts((robot[0], *stated, *brief_notes(problem, every))),))


def posture_block(spread: Spread) -> Block:
    """Joints and tool: value, limits and margin of each joint, then tool point and orientation in the world frame."""
    facts = (*tool_facts(spread), *lean_facts(spread))
    brief = (("Joints", joint_values(spread.problem, spread.q)), *nearest_limit(spread.robot, spread.q), *facts)
    table = joint_table(spread.problem, spread.robot, spread.q)
    return Block("Posture", (table, Facts(facts)), figure="arm", brief=(Facts(brief),))


def spread_block(spread: Spread) -> Block:
    """Standard deviations along the axes, regions, mean shift, first order next to exact.

    One row a principal axis of the exact covariance C, longest first: ``sqrt(eigenvalue)`` and the first-order
    ``sqrt(aᵀ J Σ Jᵀ a)`` along the same axis a. What the task counts comes before the table.
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
    largest = math.sqrt(max(float(np.linalg.eigvalsh(first)[-1]), 0.0))
    facts = (
        *ellipse_facts(spread, semi_axes),
        mean_fact(spread, semi_axes),
        first_order_fact(semi_axes[0], largest, semi_axes),
        method_fact(spread),
        *relative_fact(spread),
    )
    task, seen = task_items(spread, semi_axes), spread.for_task
    groups = spread.budget_groups if seen is None else seen.budget_groups
    brief = (*(task or (Facts(facts[:3]),)), Facts((main_fact(groups),)))
    return Block("Spread of the tool point", (*task, Table(headers, rows), Facts(facts)), figure="cloud", brief=brief)


def covariance_table(C: Array) -> Table:
    """A (3, 3) covariance [m²] in mm², below a trace of (0.1 mm)² in µm²; entries that are rounding are 0."""
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
    (first, *_), axis = (
        (spread.budget_groups, "the longest axis") if seen is None else (seen.budget_groups, "the critical axis")
    )
    part = "" if seen is None else f"{length(seen.critical.sigma_max)} {PARTS[seen.critical.within]}"
    return (
        ("Posture", joint_values(spread.problem, spread.q)),
        ("Tool point", place(spread.position)),
        ("Standard deviations", lengths([float(s) for s in spread.ellipse.semi_axes[::-1]])),
        *((("For the task", part),) if part else ()),
        ("Largest contribution", f"{named(first.parameters)}, {percent(first.share)} of {axis}"),
    )


class SpreadPresenter(Presenter["Spread"]):
    """The spread at one posture in closed form."""

    stem = "spread"

    def summary(self) -> Summary:
        """Posture, tool point, standard deviations, largest contribution."""
        return Summary("Spread of the tool point at one posture", spread_facts(self.result))

    def document(self) -> Document:
        """Problem, posture, spread, covariance, budget; the covariance is left out of the short form of a task."""
        found, problem = self.result, self.problem
        table, title = (covariance_table(found.covariance),), "Covariance of the tool point, world frame"
        blocks = (
            arm_block(problem, found),
            posture_block(found),
            spread_block(found),
            Block(title, table, brief=() if found.for_task else None),
            spread_budget_block(problem, found),
        )
        return Document(problem.name or "Spread of the tool point", found.statements, blocks)

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
