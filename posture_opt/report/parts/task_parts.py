"""What reports say of a spread as the task sees it: across or along, its 95 % region, its probability of success."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.page.presenter import problem_of
from posture_opt.report.parts.budget_parts import budget_block
from posture_opt.report.parts.parts import lean
from posture_opt.report.text.blocks import Block, Facts
from posture_opt.report.text.words import CRITERIA, REGIONS, direction_words, line_words, part_words
from posture_opt.statements.notation import angle, length, lengths, probability, stated_length
from posture_opt.uncertainty.regions.regions import Ellipsoid
from posture_opt.units import fixed, shown

if TYPE_CHECKING:
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.selection.tasks import Task
    from posture_opt.uncertainty.regions.critical import Critical
    from posture_opt.uncertainty.spread.peg_spread import PegSpread
    from posture_opt.uncertainty.spread.spread import Spread
    from posture_opt.uncertainty.spread.task_spread import TaskSpread

_TARGET_TOLERANCE_M = 1e-4  # m: a tool point that is farther from the target of the task stands at another place
_MIN_PROBABILITY = 1e-6
_TILT_TOLERANCE_DEG = 0.05  # deg: less is the rounding of joint values as people type them
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


def _peg_rows(peg: PegSpread, among: list[float]) -> list[tuple[str, str]]:
    """Both ends of the peg, its tilt, and what the tilt may do."""
    ends = (("Tip", peg.tip), ("Top end", peg.top))
    rows = [(name, f"{length(end.sigma_max, among=among)} standard deviation (worst axis)") for name, end in ends]
    rows.append(("Tilt", f"{shown(peg.tilt_sigma, 'angle')} standard deviation (worst axis)"))
    risks = (("Two-point contact", peg.two_point_contact), ("Wedging", peg.wedging))
    for name, risk in risks:
        if risk is not None:
            probable = _tilt_probability(risk.probability)
            rows.append((name, f"at a tilt above {shown(risk.angle, 'angle')}: probability {probable}"))
    return rows


def _yaw_rows(seen: TaskSpread, among: list[float]) -> list[tuple[str, str]]:
    """The rotation about the direction, and what a corner of the part makes of it."""
    if seen.yaw is None:
        return []
    rows = [("Yaw", f"{angle(seen.yaw.sigma)} standard deviation about the direction")]
    if seen.yaw.lever:
        moved, corner = (length(v, among=among) for v in (seen.yaw.lever * seen.yaw.sigma, seen.yaw.corner))
        lever = stated_length(seen.yaw.lever)
        rows.append(("Corners", f"{corner} RMS error; the yaw contributes {moved} (lever {lever})"))
    return rows


def _expanded_rows(seen: TaskSpread, among: list[float]) -> list[tuple[str, str]]:
    """What is stated with a measured value: U = k u."""
    if seen.expanded is None or seen.expansion is None:
        return []
    along, worst = (length(v, among=among) for v in seen.expanded)
    share = f"k = {seen.expansion:g}, coverage {100 * math.erf(seen.expansion / math.sqrt(2)):.3g} %"
    axis = line_words(seen.critical.worst_axis)
    return [
        ("Expanded uncertainty", f"U = {along} along {direction_words(seen.direction)} ({share})"),
        ("", f"U = {worst} along {axis}, the worst direction"),
    ]


def _tilt_probability(p: float) -> str:
    return "< 1e-6" if p < _MIN_PROBABILITY else f"{100 * p:.2g} %"


def lean_facts(spread: Spread) -> list[tuple[str, str]]:
    """How far the tool of an arm in space is from pointing along the direction, where the task asks for that."""
    seen, task = spread.for_task, problem_of(spread).task
    if seen is None or task is None or task.axis == "free" or len(spread.basis) == 2:
        return []
    leaning = math.degrees(lean(spread, task.tool_axis, seen.direction))
    beyond = leaning > math.degrees(task.tilt) + _TILT_TOLERANCE_DEG
    return [("Tool axis", f"tilted {fixed(leaning)} deg from the task direction")] if beyond else []


def critical_size(critical: Critical, of: str = "") -> str:
    """The largest standard deviation in the part that counts: 0.248 mm (worst axis)."""
    worst = "worst axis" if len(critical.covariance) > 1 else ""
    said = ", ".join(filter(None, (of, worst)))
    return f"{length(critical.sigma_max)} ({said})" if said else length(critical.sigma_max)


def critical_rows(seen: TaskSpread, among: list[float], origin: str) -> list[tuple[str, str]]:
    """The standard deviations across and along, the 95 % region, the distance from ``origin``, and the probability."""
    critical = seen.critical
    m, within = len(critical.covariance), critical.within
    largest = length(critical.sigma_max, among=among)
    worst = f"{largest} standard deviation, along {line_words(critical.worst_axis)}"
    rows = [(f"{_PART_NAMES[within]}, worst axis" if m > 1 else _PART_NAMES[within], worst)]
    if within == "across":
        along = length(seen.sigma_along, among=among)
        rows.append(("Along", f"{along} standard deviation (not critical for this task)"))
    if within != "all":
        rows += _region_row(critical, among)
    radius = length(critical.radius95, among=among)
    where = "" if within == "all" else f" {part_words(within, seen.kind)}"
    rows.append(("95 % radius", f"{radius} from the {origin}{where}, mean shift included"))
    rows += _expanded_rows(seen, among) + _yaw_rows(seen, among)
    if seen.peg is not None:
        rows += _peg_rows(seen.peg, among)
    if seen.success_probability is not None:
        which = "both ends within the " if seen.peg is not None else ""
        clearance = stated_length(seen.clearance)
        rows.append(("Success probability", f"{probability(seen.success_probability)} ({which}clearance {clearance})"))
    return rows


def _region_row(critical: Critical, among: list[float]) -> list[tuple[str, str]]:
    region = Ellipsoid(np.zeros(len(critical.covariance)), critical.covariance)
    if not region.rank:
        return []
    half = [float(s) for s in region.region(0.95)[::-1][: region.rank]]
    size = f"semi-axes {lengths(half, among=among)}" if region.rank == 2 else f"± {length(half[0], among=among)}"
    return [(f"{REGIONS[region.rank]} {critical.within}", f"{size} ({region.factor(0.95):.3f} σ)")]


def task_budget_block(problem: ProblemData, seen: TaskSpread) -> Block:
    """Where the scatter along the worst axis that counts comes from."""
    axis = line_words(seen.critical.worst_axis)
    text = f"Contribution of each source to the variance along {axis}, the critical axis:"
    return budget_block(problem, seen.budget_groups, text)


def task_items(spread: Spread, among: list[float]) -> tuple[Facts, ...]:
    """The facts of the task for a report on one posture; nothing without a task."""
    seen = spread.for_task
    return () if seen is None else (Facts(tuple(critical_rows(seen, among, "nominal point"))),)
