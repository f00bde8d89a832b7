"""The block of checks: what was gained, what cannot be gained, and how sure one may be."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from posture_opt.report.blocks import Block, Facts
from posture_opt.report.units_text import count, length, number, percent
from posture_opt.report.words import CRITERIA, PARTS, source_words

if TYPE_CHECKING:
    from posture_opt.selection.search_statistics import Sweep
    from posture_opt.selection.solution import Solution

SMALL_GAIN = 0.05
"""Below this gain over a typical posture at a fixed target, placing the workpiece is what helps."""


def checks_block(solution: Solution) -> Block:
    """Gain, lower bound, what the search did lest a better posture be missed, time."""
    rows = [*_gain(solution), *_lower_bound(solution), *_search(solution)]
    rows.append(("Time", f"{solution.statistics.seconds:.2f} s"))
    return Block("Checks", (*ranking_sentence(solution), Facts(tuple(rows)), *_advice(solution)))


def ranking_sentence(solution: Solution) -> tuple[str, ...]:
    """By what postures are ranked where it is not the scatter that is told of them."""
    task = solution.optimisation_problem.task
    if task.criterion == "worst" and not task.minimize:
        return ()
    asked = " and ".join([CRITERIA[task.criterion].format(part=PARTS[task.within]), *(t.kind for t in task.minimize)])
    told = f"the largest standard deviation {PARTS[task.within]}"
    return (f"Postures are ranked by {asked.replace('_', ' ')}; the scatter told of them here is {told}.",)


def _gain(solution: Solution) -> list[tuple[str, str]]:
    typical, worst = solution.statistics.typical, solution.statistics.worst
    if not (math.isfinite(typical) and math.isfinite(worst)):
        return []
    return [
        (
            "Gain",
            f"{_less(solution.gain_over(typical))} a typical posture that does it too ({_size(solution, typical)})",
        ),
        ("", f"{_less(solution.gain_over(worst))} the worst one that was found ({_size(solution, worst)})"),
    ]


def _size(solution: Solution, sigma: float, digits: int = 3) -> str:
    """A scatter, all of the block in the unit of the largest."""
    statistics = solution.statistics
    return length(sigma, digits, (solution.critical.sigma_max, statistics.typical, statistics.worst))


def _less(gain: float) -> str:
    if abs(gain) < 5e-4:
        return "the same scatter as"
    return f"{percent(abs(gain))} {'less' if gain > 0 else 'more'} scatter than"


def _lower_bound(solution: Solution) -> list[tuple[str, str]]:
    bound = solution.lower_bound
    if bound is None:
        return []
    arm = solution.optimisation_problem.arm
    where = "at this target" if solution.target.kind == "point" else "anywhere in this box"
    lever = f" on a lever of {length(bound.radius, 4)}" if math.isfinite(bound.radius) and bound.radius > 0 else ""
    share = "alone sets it" if bound.share > 0.995 else f"makes {percent(bound.share)} of it"
    source = f"the {source_words(bound.source, arm)}{lever} {share}"
    return [("Lower bound", f"{where} no posture can get below {_size(solution, bound.sigma)}: {source}"),
            ("", _above(solution.critical.sigma_max / bound.sigma))]  # fmt: skip


def _above(ratio: float) -> str:
    if ratio > 2:
        return f"the answer is {number(ratio, 2)} times this bound"
    if ratio < 1.0005:
        return "the answer lies on this bound"
    return f"the answer lies {percent(ratio - 1)} above this bound"


def _search(solution: Solution) -> list[tuple[str, str]]:
    e = solution.statistics
    text = (
        f"{count(e.tried, 'random start')} led towards the target, {e.starts} arrived, {e.feasible} of these meet "
        f"every requirement; the best {e.polished} improved to a local optimum, {min(e.converged, e.polished)} of them "
        "confirmed by the solver"
    )
    rows = [("Search", text)]
    optima = count(e.distinct, "distinct optimum", "distinct optima")
    rows.append(("", f"{optima}; the best one was found by {e.hits} of {count(e.polished, 'local search')}"))
    if e.sweep is not None:
        rows.append(("Sweep", _sweep(solution, e.sweep)))
    return rows


def _sweep(solution: Solution, sweep: Sweep) -> str:
    text = f"{sweep.over}: {count(sweep.points, 'posture')}, {sweep.feasible} of them feasible"
    sigma, answer = solution.statistics.sweep_sigma, solution.critical.sigma_max
    if not math.isfinite(sigma):
        return text
    # Where something else than the largest scatter is made small, a worse posture may well scatter less.
    better = sigma < answer * (1 - 1e-6)
    found = "less scatter, but not a better posture by what is asked" if better else "nothing better"
    return f"{text}; found {found} (its best: {_size(solution, sigma, 4)})"


def _advice(solution: Solution) -> tuple[str, ...]:
    typical = solution.statistics.typical
    if solution.target.kind != "point" or not math.isfinite(typical):
        return ()
    gain = solution.gain_over(typical)
    if gain >= SMALL_GAIN:
        return ()
    return (
        f"At this fixed target the posture matters little: a typical one does {_almost(gain)}. If the workpiece may be "
        "moved, more is to be won by placing it: write region: {min: [...], max: [...]} in the task, in place of "
        "position: [...].",
    )


def _almost(gain: float) -> str:
    return "as well" if gain < 5e-4 else f"only {percent(gain)} worse"
