"""What reports say of a spread as the task sees it: error budget, 95 % region, probability of success.

Shares are of the variance along one axis: they add up to 100 %, and a share of 60 % removed leaves 63 % of σ.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.report.page.presenter import problem_of
from posture_opt.report.parts.parts import lean, sigma_of
from posture_opt.report.text.blocks import Block, Table
from posture_opt.report.text.words import CRITERIA, REGIONS, direction_words, line_words
from posture_opt.selection.registered_tasks import part_words
from posture_opt.statements.notation import angle, length, lengths, percent, probability, stated_length
from posture_opt.uncertainty.budget import SHARE_TOLERANCE, ShareGroup
from posture_opt.uncertainty.regions import Ellipsoid
from posture_opt.uncertainty.sources import source_size, source_words
from posture_opt.units import fixed, shown

if TYPE_CHECKING:
    from posture_opt import Spread, Task
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.uncertainty.clearance import Critical
    from posture_opt.uncertainty.task_spread import TaskSpread

_MAX_NAMED_SOURCES = 3  # sources of a group that are named


def budget_block(problem: ProblemData, groups: Sequence[ShareGroup], sentence: str) -> Block:
    """Where a variance comes from: the sentence that says which, the shares, and what a line of several sources is."""
    together = any(len(group.parameters) > 1 for group in main_groups(groups)[0])
    note = ("Sources on one line are correlated and partly cancel: only their combined share is meaningful.",)
    table = budget_table(problem.arm, groups, sigma_of(problem))
    items = (sentence, table, *(note if together else ()))
    return Block("Error budget", items, figure="budget", brief=())


def main_fact(groups: Sequence[ShareGroup]) -> tuple[str, str]:
    """The largest contributions in one line: at most three sources with their shares of the variance [%]."""
    largest = [
        f"{named(group.parameters)} {_share(group.share)}" for group in groups[:_MAX_NAMED_SOURCES] if group.share > 0
    ]
    return "Main contributions", ", ".join(largest) or "none"


def main_groups(groups: Sequence[ShareGroup]) -> tuple[list[ShareGroup], list[ShareGroup]]:
    """The lines that are shown one by one, and those that are lumped: none or at least two."""
    # Below 1 % of the variance, sources are lumped.
    shown = [group for group in groups if group.share >= 0.01][:12] or list(groups[:1])
    rest = [group for group in groups if group not in shown]
    return ([*shown, *rest], []) if len(rest) == 1 else (shown, rest)


def budget_table(arm: Arm, groups: Sequence[ShareGroup], sigma: Mapping[str, float]) -> Table:
    """Shares of the sources in a variance, cumulated; the small ones lumped; ``sigma`` [rad or m]."""
    shown, rest = main_groups(groups)
    rows, total = [], 0.0
    for group in shown:
        total += group.share
        (first, *others) = group.parameters
        size = "" if others else source_size(first, sigma.get(first, math.nan), arm)
        words = named([source_words(name, arm) for name in group.parameters])
        shares = _share(group.share), percent(total)
        rows.append((f"{words} (correlated)" if others else words, named(group.parameters), size, *shares))
    if rest:
        lumped = sum(group.share for group in rest)
        rows.append((others_words(rest), "", "", _share(lumped), percent(total + lumped)))
    return Table(("source", "parameter", "standard deviation", "share", "cumulative"), tuple(rows), text_columns=2)


def others_words(groups: Sequence[ShareGroup]) -> str:
    """How many sources are lumped."""
    return f"{sum(len(group.parameters) for group in groups)} others"


def named(parameters: Sequence[str]) -> str:
    """Names as the file has them, the first few of many."""
    more = len(parameters) - _MAX_NAMED_SOURCES
    return ", ".join([*parameters[:_MAX_NAMED_SOURCES], *([f"{more} more"] if more > 0 else [])])


def _share(share: float) -> str:
    return percent(0.0 if -SHARE_TOLERANCE < share < 0 else share)


_PART_NAMES = {"across": "Across", "along": "Along", "all": "In space"}


def task_facts(task: Task, direction: Array) -> list[tuple[str, str]]:
    """Kind and direction of a task."""
    return [("Task", f"{task.kind} - {task.summary}"), ("Direction", f"{direction_words(direction)} in the world")]


def minimised_words(task: Task) -> tuple[str, ...]:
    """What is minimised: the spread, unless the task leaves it out, and the further terms together."""
    spread = CRITERIA[task.criterion].format(part=part_words(task.within, task.kind))
    if task.yaw_lever:
        spread = f"{spread}, plus the yaw error on a lever of {stated_length(task.yaw_lever)}"
    if task.part is not None:
        spread = f"{spread}, of the worse end of the peg"
    further = ", ".join(f"{term.kind} (weight {term.weight:g})" for term in task.minimize)
    return tuple(words for words in (spread if task.criterion != "none" else "", further) if words)


def clearance_facts(seen: TaskSpread) -> list[tuple[str, str]]:
    """The peg and the clearance, where the task states them."""
    facts = []
    if seen.peg is not None:
        part = seen.peg.part
        text = f"{stated_length(part.length)} long, tip at the tool point"
        if part.diameter > 0:
            text = f"{text}; diameter {stated_length(part.diameter)}, friction {part.friction:g}"
        facts.append(("Peg", text))
    if seen.clearance > 0:
        facts.append(("Clearance", f"{stated_length(seen.clearance)} (radial)"))
    return facts


def lean_facts(spread: Spread) -> list[tuple[str, str]]:
    """How far the tool of an arm in space is from pointing along the direction, where the task asks for that."""
    seen, task = spread.for_task, problem_of(spread).task
    if seen is None or task is None or task.axis == "free" or len(spread.basis) == 2:
        return []
    leaning = math.degrees(lean(spread, task.tool_axis, seen.direction))
    # Less than 0.05 deg is the rounding of joint values as people type them.
    beyond = leaning > math.degrees(task.tilt) + 0.05
    return [("Tool axis", f"tilted {fixed(leaning)} deg from the task direction")] if beyond else []


def critical_size(critical: Critical, of: str = "") -> str:
    """The largest standard deviation in the part that counts: 0.248 mm (worst axis)."""
    worst = "worst axis" if len(critical.covariance) > 1 else ""
    said = ", ".join(filter(None, (of, worst)))
    return f"{length(critical.sigma_max)} ({said})" if said else length(critical.sigma_max)


def critical_rows(seen: TaskSpread, among: list[float], origin: str) -> list[tuple[str, str]]:
    """The standard deviations across and along, the 95 % region, the distance from ``origin``, and the probability."""

    def long(metres: float) -> str:
        return length(metres, among=among)

    critical, within = seen.critical, seen.critical.within
    worst_axis, several = line_words(critical.worst_axis), len(critical.covariance) > 1
    name = f"{_PART_NAMES[within]}{', worst axis' * several}"
    rows = [(name, f"{long(critical.sigma_max)} standard deviation, along {worst_axis}")]
    if within == "across":
        rows.append(("Along", f"{long(seen.sigma_along)} standard deviation (not critical for this task)"))
    region = Ellipsoid(np.zeros(len(critical.covariance)), critical.covariance)
    if within != "all" and region.rank:
        half = [float(s) for s in region.region(0.95)[::-1][: region.rank]]
        size = f"semi-axes {lengths(half, among=among)}" if region.rank == 2 else f"± {long(half[0])}"
        rows.append((f"{REGIONS[region.rank]} {within}", f"{size} ({region.factor(0.95):.3f} σ)"))
    where = "" if within == "all" else f" {part_words(within, seen.kind)}"
    rows.append(("95 % radius", f"{long(critical.radius95)} from the {origin}{where}, mean shift included"))
    if seen.expanded is not None and seen.expansion is not None:  # U = k u
        along, worst = map(long, seen.expanded)
        share = f"k = {seen.expansion:g}, coverage {100 * math.erf(seen.expansion / math.sqrt(2)):.3g} %"
        rows.append(("Expanded uncertainty", f"U = {along} along {direction_words(seen.direction)} ({share})"))
        rows.append(("", f"U = {worst} along {worst_axis}, the worst direction"))
    if seen.yaw is not None:
        rows.append(("Yaw", f"{angle(seen.yaw.sigma)} standard deviation about the direction"))
        if lever := seen.yaw.lever:
            moved = f"{long(lever * seen.yaw.sigma)} (lever {stated_length(lever)})"
            rows.append(("Corners", f"{long(seen.yaw.corner)} RMS error; the yaw contributes {moved}"))
    if seen.peg is not None:
        for name, end in (("Tip", seen.peg.tip), ("Top end", seen.peg.top)):
            rows.append((name, f"{long(end.sigma_max)} standard deviation (worst axis)"))
        rows.append(("Tilt", f"{shown(seen.peg.tilt_sigma, 'angle')} standard deviation (worst axis)"))
        for name, risk in (("Two-point contact", seen.peg.two_point_contact), ("Wedging", seen.peg.wedging)):
            if risk is not None:
                p = "< 1e-6" if risk.probability < 1e-6 else f"{100 * risk.probability:.2g} %"
                rows.append((name, f"at a tilt above {shown(risk.angle, 'angle')}: probability {p}"))
    if seen.success_probability is not None:
        limit = f"{'both ends within the ' * (seen.peg is not None)}clearance {stated_length(seen.clearance)}"
        rows.append(("Success probability", f"{probability(seen.success_probability)} ({limit})"))
    return rows


def task_budget_block(problem: ProblemData, seen: TaskSpread) -> Block:
    """Where the scatter along the worst axis that counts comes from."""
    axis = line_words(seen.critical.worst_axis)
    text = f"Contribution of each source to the variance along {axis}, the critical axis:"
    return budget_block(problem, seen.budget_groups, text)
