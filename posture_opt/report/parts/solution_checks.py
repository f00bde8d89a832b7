"""How sure one may be of a solution: what was gained and searched, and the optimisation problem with its values."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.text.blocks import Block, Facts, Report, Table
from posture_opt.report.text.words import CRITERIA, part_words, source_words
from posture_opt.selection.program.nlp import Values
from posture_opt.selection.program.task_target import FREE, SIZES, TaskTarget
from posture_opt.selection.search.confirmation import AGREEMENT
from posture_opt.statements.notation import count, length, percent, quantity
from posture_opt.units import UNKNOWN, number

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.program.nlp import Nlp, Row
    from posture_opt.selection.search.confirmation import Confirmation
    from posture_opt.selection.search.search_statistics import Sweep

SMALL_GAIN = 0.05
"""Below this gain over a typical posture something else is what helps: at a fixed target, placing the workpiece."""
NO_GAIN = 5e-4  # and below this there is none
GOOD_PROBABILITY = 0.99  # of success: below, another posture may have better ones
_MAX_BOUND_RATIO = 100.0  # times: a bound that is farther below the answer says nothing about it
_LENGTH_PARAMETERS = ("lower", "upper", "clearance", "lever")
_PARAMETER_MEANINGS = {
    "lower": "box of the target, lower corner",
    "upper": "box of the target, upper corner",
    "direction": "direction of the task",
    "b1": "first axis across it",
    "b2": "second axis across it",
    "clearance": "clearance of the hole",
    "sin_tilt": "sine of the tilt that is allowed",
    "scale": "variance that the objective is divided by",
    "axis": "where the tool axis is to point",
    "a1": "first axis across that",
    "a2": "second axis across that",
    "spin": "where the y axis of the tool is to point",
    "lever": "from the origin of the workpiece to the target",
}
_AXIS_PARAMETERS = ("axis", "a1", "a2")


def checks_block(solution: Solution) -> Block:
    """Gain, lower bound, what the search did lest a better posture be missed, time."""
    rows = [*gain_facts(solution), *_most_manipulable(solution), *_lower_bound(solution), *_search(solution)]
    rows.append(("Time", f"{solution.statistics.seconds:.2f} s"))
    advice = _advice(solution)
    return Block("Checks", (*ranking_sentence(solution), Facts(tuple(rows)), *advice), brief=advice)


def ranking_sentence(solution: Solution) -> tuple[str, ...]:
    """What postures are ranked by, where that is not the standard deviation that is stated."""
    task = solution.optimisation_problem.task
    if task.criterion == "worst" and not task.minimize:
        return ()
    spread = [CRITERIA[task.criterion].format(part=part_words(task.within, task.kind))] * (task.criterion != "none")
    asked = " and ".join([*spread, *(term.kind for term in task.minimize)])
    listed = f"the largest standard deviation {part_words(task.within, task.kind)}"
    return (f"Postures are ranked by {asked.replace('_', ' ')}; the value listed is {listed}.",)


def gain_facts(solution: Solution) -> list[tuple[str, str]]:
    """The standard deviation beside that of a typical posture, and of the worst; nothing where none was compared."""
    typical, worst = solution.statistics.typical, solution.statistics.worst
    if not (math.isfinite(typical) and math.isfinite(worst)):
        return []
    return [
        ("Gain", f"{_less(solution.gain_over(typical))} a typical feasible posture ({_size(solution, typical)})"),
        ("", f"{_less(solution.gain_over(worst))} the worst feasible posture found ({_size(solution, worst)})"),
    ]


def _most_manipulable(solution: Solution) -> list[tuple[str, str]]:
    """The spread in the posture of greatest manipulability."""
    other = solution.most_manipulable
    if other is None or solution.critical.sigma_max <= 0:
        return []
    more = other.sigma_max / solution.critical.sigma_max - 1
    size = "the same standard deviation"
    if abs(more) >= NO_GAIN:
        size = f"{_size(solution, other.sigma_max)}, {percent(abs(more))} {'higher' if more > 0 else 'lower'}"
    return [("Manipulability", f"the posture of greatest manipulability has {size}")]


def _size(solution: Solution, sigma: float, digits: int = 3) -> str:
    """A scatter, all of the block in the unit of the largest."""
    statistics = solution.statistics
    return length(sigma, digits, (solution.critical.sigma_max, statistics.typical, statistics.worst))


def _less(gain: float) -> str:
    """A relative gain in words."""
    if abs(gain) < NO_GAIN:
        return "the same standard deviation as"
    return f"{percent(abs(gain))} {'lower' if gain > 0 else 'higher'} standard deviation than"


def _lower_bound(solution: Solution) -> list[tuple[str, str]]:
    """The bound that no posture beats, the source that sets it, and how far the answer is above."""
    bound = solution.lower_bound
    if bound is None or solution.critical.sigma_max > _MAX_BOUND_RATIO * bound.sigma:
        return []
    arm = solution.optimisation_problem.arm
    where = "at this target" if solution.target.kind == "point" else "anywhere in this box"
    lever = f" (lever {length(bound.radius, 4)})" if math.isfinite(bound.radius) and bound.radius > 0 else ""
    share = "alone" if bound.share > 0.995 else f"to {percent(bound.share)}"
    source = f"set by {source_words(bound.source, arm)}{lever} {share}"
    return [("Lower bound", f"{_size(solution, bound.sigma)} for any posture {where}, {source}"),
            ("", _above(solution.critical.sigma_max / bound.sigma))]  # fmt: skip


def _above(ratio: float) -> str:
    """How far the answer is above its bound."""
    if ratio > 2:
        return f"this posture is at {number(ratio, 2)} times the bound"
    if ratio < 1.0005:
        return "this posture attains the bound"
    return f"this posture is {percent(ratio - 1)} above the bound"


def _search(solution: Solution) -> list[tuple[str, str]]:
    """Starts, optima, and how often the best was found."""
    e = solution.statistics
    text = (
        f"{count(e.tried, 'random start')}, {e.starts:,} reached the target, {e.feasible:,} of these meet all "
        "requirements"
    )
    optima = count(e.distinct, "distinct optimum", "distinct optima")
    found = f"{optima}; the best was found by {e.hits} of {count(e.polished, 'local search', 'local searches')}"
    again = f", in {e.recurred} of {e.batches} independent batches" if e.batches > 1 else ""
    proof = "a local optimum" if solution.status == "optimal" else "not confirmed as a local optimum"
    rows = [("Search", text), ("", found + again), ("", f"the result is {proof}, the best of these searches")]
    if e.confirmation is not None:
        rows.append(("", confirmation_words(e.confirmation)))
    if e.sweep is not None:
        rows.append(("Sweep", _sweep(solution, e.sweep)))
    return rows


def confirmation_words(said: Confirmation) -> str:
    """What IPOPT says of the answer: whether it ends there too, in how many iterations, and how exactly."""
    effort = count(said.iterations, "iteration")
    if not said.differs:
        return f"confirmed by IPOPT in {effort}: the same standard deviation within {100 * AGREEMENT:g} %"
    if math.isnan(said.agrees):
        return f"IPOPT found no optimum from there ({count(said.iterations, 'iteration')})"
    other = "IPOPT found a better posture, which is the answer" if said.taken else "IPOPT ended at a worse posture"
    return f"{other}: the standard deviation differs by {percent(said.agrees)} ({effort})"


def _sweep(solution: Solution, sweep: Sweep) -> str:
    """What a systematic sweep found beside the random starts."""
    text = f"{sweep.over}: {count(sweep.points, 'posture')}, {sweep.feasible:,} of them feasible"
    sigma, answer = solution.statistics.sweep_sigma, solution.critical.sigma_max
    if not math.isfinite(sigma):
        return text
    # Where another criterion is minimised, a worse posture may well have the smaller standard deviation.
    better = sigma < answer * (1 - 1e-6)
    found = "some have a smaller standard deviation, none is better by the criterion" if better else "no better one"
    return f"{text}, {found} (best: {_size(solution, sigma)})"


def _advice(solution: Solution) -> tuple[str, ...]:
    """What else may help."""
    return (*_advice_on_criterion(solution), *_advice_on_place(solution))


def _advice_on_criterion(solution: Solution) -> tuple[str, ...]:
    """What is minimised is a standard deviation; the posture with the highest probability may be another."""
    p_success, task = solution.success_probability, solution.optimisation_problem.task
    if p_success is None or p_success > GOOD_PROBABILITY or task.criterion != "worst" or task.minimize or task.part:
        return ()
    return (f"To maximise the probability of success ({percent(p_success)}) instead, add criterion: miss to the task.",)


def _advice_on_place(solution: Solution) -> tuple[str, ...]:
    """To move the workpiece where the posture matters little."""
    typical = solution.statistics.typical
    if solution.target.kind != "point" or not math.isfinite(typical):
        return ()
    gain = solution.gain_over(typical)
    if gain >= SMALL_GAIN:
        return ()
    return (
        f"At this fixed target the posture matters little: a typical one is {_almost(gain)}. Moving the workpiece may "
        "gain more: write region: {min: [...], max: [...]} in the task, in place of position: [...].",
    )


def _almost(gain: float) -> str:
    """How much worse a typical posture is."""
    return "as good" if gain < NO_GAIN else f"only {percent(gain)} worse"


def explain_report(solution: Solution) -> Report:
    """The nonlinear program as it was solved."""
    nlp = solution.optimisation_problem.nlp
    values = Values.of(nlp, solution.q, solution.target.parameters)
    lead = (
        f"Minimise the objective over {len(nlp.variables)} joint values, subject to the bounds of the joints and to "
        f"{len(nlp.rows)} rows; values at the {'nearest' if solution.status == 'infeasible' else 'best'} posture.",
    )
    blocks = (
        Block("Objective", (_objective(nlp, values),)),
        Block("Variables", (_variables(nlp, solution.q),)),
        Block("Rows", (_rows(nlp, values) if nlp.rows else "None: the tool point is free.",)),
        Block(
            "Parameters of the target", (_parameters(solution.target, not solution.problem.workpiece_sources.empty),)
        ),
    )
    return Report(f"Nonlinear program of: {solution.problem.name}", lead, blocks)


def _objective(nlp: Nlp, values: Values) -> Table:
    """Terms of the objective with their values."""
    rows = [(name, _plain(float(value))) for (name, _), value in zip(nlp.terms, values.terms, strict=True)]
    return Table(("term", "value"), (*rows, ("objective", _plain(values.objective))))


def _variables(nlp: Nlp, q: Array) -> Table:
    """Joint values between their limits."""
    rows = tuple(
        (v.name, *(quantity(float(x), v.unit) for x in (v.lower, value, v.upper)), _binding(v.lower, value, v.upper))
        for v, value in zip(nlp.variables, q, strict=True)
    )
    return Table(("variable", "at least", "value", "at most", ""), rows)


def _rows(nlp: Nlp, values: Values) -> Table:
    """Rows between their ends."""
    rows = tuple(
        (row.name, *_end_texts(row, float(low), float(value), float(high)), _binding(low, value, high))
        for row, low, value, high in zip(nlp.rows, values.row_lower, values.rows, values.row_upper, strict=True)
    )
    return Table(("row", "at least", "value", "at most", ""), rows)


def _end_texts(row: Row, low: float, value: float, high: float) -> list[str]:
    """Lower end, value and upper end in words: sizes without a sign, the probability of success for a miss."""
    ends = [row.shown(low), row.shown(high)]
    if ends[0] == ends[1] and low < high:
        ends[0] = -math.inf
    return [quantity(text, row.unit) for text in (min(ends), row.shown(value), max(ends))]


def _binding(low: float, value: float, high: float) -> str:
    """Whether a value is at an end, or beyond."""
    tolerance = 1e-6
    if value < low - tolerance or value > high + tolerance:
        return "violated"
    if low == high:
        return "met"
    return "at its bound" if min(value - low, high - value) < tolerance else ""


def _parameters(target: TaskTarget, levered: bool) -> Table:
    """Parameters of the target with their meaning, but for those that say nothing here.

    Args:
        levered: whether the workpiece errs, so that the lever counts.
    """
    rows, at = [], 0
    along = np.array_equal(target.axis, target.direction)  # then the tool axis is stated above
    hidden = (
        *(_AXIS_PARAMETERS if along else ()),
        *(() if target.spun else ("spin",)),
        *(() if levered else ("lever",)),
    )
    for name, size in SIZES.items():
        entries = [float(v) for v in target.parameters[at : at + size]]
        at += size
        if name in hidden:
            continue
        rows.append((name, _PARAMETER_MEANINGS[name], _entries(name, entries)))
    return Table(("parameter", "is", "value"), tuple(rows), text_columns=2)


def _entries(name: str, entries: list[float]) -> str:
    """Numbers of a parameter in its unit."""
    if name in _LENGTH_PARAMETERS:
        return ", ".join("free" if abs(v) >= FREE else quantity(v, "m") for v in entries)
    if name == "scale":
        return f"{_plain(entries[0] * 1e6)} mm^2"
    return ", ".join(f"{v + 0.0:.4g}" for v in entries)


def _plain(value: float) -> str:
    """A number without a unit."""
    return f"{value:.6g}" if math.isfinite(value) else UNKNOWN
