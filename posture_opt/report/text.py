"""Reports as plain text: at most 100 columns, fit to be pasted into a mail."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from posture_opt.report.blocks import Block, Facts, Report, Table

if TYPE_CHECKING:
    from posture_opt.diagnosis.measurement_plan import MeasurementPlan
    from posture_opt.problem.accuracy_map import AccuracyMap
    from posture_opt.problem.problem import Problem
    from posture_opt.report.calibration_report import Learned
    from posture_opt.report.diagnosed import Diagnosed
    from posture_opt.selection.solution import Solution
    from posture_opt.selection.target_map import TargetMap
    from posture_opt.uncertainty.cloud import Cloud
    from posture_opt.uncertainty.spread import Spread

WIDTH = 100


def solution_text(problem: Problem, solution: Solution) -> str:
    """The report on a solution: problem, posture, spread, budget, alternatives, checks."""
    from posture_opt.report.solution_report import solution_report

    return render(solution_report(problem, solution))


def explain_text(problem: Problem, solution: Solution) -> str:
    """The nonlinear programme with bounds and values at the solution."""
    from posture_opt.report.explain import explain_report

    return render(explain_report(problem, solution))


def spread_text(problem: Problem, spread: Spread) -> str:
    """The report on the spread at one posture: posture, spread, budget, validity."""
    from posture_opt.report.spread_report import spread_report

    return render(spread_report(problem, spread))


def cloud_text(problem: Problem, cloud: Cloud) -> str:
    """The report on a Monte Carlo cloud beside the closed form."""
    from posture_opt.report.cloud_report import cloud_report

    return render(cloud_report(problem, cloud))


def calibration_text(problem: Problem, learned: Learned) -> str:
    """The report on a calibration: errors before and after, parameters, what the data leave open."""
    from posture_opt.report.calibration_report import calibration_report

    return render(calibration_report(problem, learned))


def diagnosis_text(problem: Problem, diagnosed: Diagnosed) -> str:
    """The report on a diagnosis: verdict, causes, what they bring, what stays open."""
    from posture_opt.report.diagnosis_report import diagnosis_report

    return render(diagnosis_report(problem, diagnosed))


def plan_text(problem: Problem, plan: MeasurementPlan) -> str:
    """The report on what to measure next: postures, what they bring, the order of their visit."""
    from posture_opt.report.plan_report import plan_report

    return render(plan_report(problem, plan))


def map_text(problem: Problem, found: TargetMap) -> str:
    """The report on a map of targets: best place, worst place, what the file's own gives away."""
    from posture_opt.report.map_report import map_report

    return render(map_report(problem, found))


def accuracy_text(problem: Problem, found: AccuracyMap) -> str:
    """The report on bias and spread over a grid of targets."""
    from posture_opt.report.accuracy_report import accuracy_report

    return render(accuracy_report(problem, found))


def render(report: Report) -> str:
    """A report as text, every line at most 100 columns wide."""
    title = textwrap.wrap(report.title, WIDTH) or ["Report"]
    parts = ["\n".join([*title, "=" * max(map(len, title))])]
    if report.lead:
        parts.append("\n".join(map(paragraph, report.lead)))
    parts += [_block(block) for block in report.blocks]
    return "\n\n".join(parts) + "\n"


def paragraph(text: str, indent: str = "") -> str:
    """Wrapped text."""
    return textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)


def _block(block: Block) -> str:
    texts = [_item(item) for item in block.items]
    # Sentences and facts stand close together, a table keeps a blank line on both sides.
    body = texts[0] if texts else ""
    for before, item, text in zip(block.items, block.items[1:], texts[1:], strict=False):
        apart = isinstance(item, Table) or isinstance(before, Table)
        body += ("\n\n" if apart else "\n") + text
    return f"{block.title}\n{'-' * len(block.title)}\n{body}"


def _item(item: str | Facts | Table) -> str:
    if isinstance(item, str):
        return paragraph(item)
    return _facts(item) if isinstance(item, Facts) else _table(item)


def _facts(facts: Facts) -> str:
    column = max((len(label) for label, _ in facts.rows), default=0) + 2
    lines = []
    for label, value in facts.rows:
        wrapped = textwrap.wrap(value, WIDTH - column, break_on_hyphens=False) or [""]
        lines += [f"{label:<{column}}{wrapped[0]}", *(" " * column + line for line in wrapped[1:])]
    return "\n".join(lines)


def _table(table: Table) -> str:
    text = _grid(table)
    if _width(text) <= WIDTH:
        return text
    turned = _grid(table.transposed())
    return turned if _width(turned) <= WIDTH else _grid(table, narrow=True)


def _grid(table: Table, narrow: bool = False) -> str:
    from tabulate import tabulate

    columns = len(table.headers)
    align = ["left" if k < table.text_columns else "right" for k in range(columns)]
    widest = max(8, (WIDTH - 2 * (columns - 1)) // columns) if narrow else None
    return tabulate(
        table.rows,
        headers=[*(textwrap.fill(h, widest) if widest else h for h in table.headers)],
        tablefmt="simple",
        disable_numparse=True,
        colalign=align if table.rows else None,
        maxcolwidths=widest,
    )


def _width(text: str) -> int:
    return max(map(len, text.splitlines()), default=0)
