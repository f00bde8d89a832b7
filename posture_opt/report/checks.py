"""The block of checks: what was gained, what cannot be gained, and how sure one may be."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from posture_opt.report.blocks import Block, Facts
from posture_opt.report.units_text import count, length, number, percent
from posture_opt.report.words import CRITERIA, PARTS, source_words

if TYPE_CHECKING:
    from posture_opt.selection.solution import Solution
    from posture_opt.selection.sweep import Sweep

SMALL_GAIN = 0.05
"""Below this gain over a typical posture at a fixed place, placing the workpiece is what helps."""


def checks_block(solution: Solution) -> Block:
    """Gain, floor, evidence that no better posture was missed, time."""
    rows = [*_gain(solution), *_floor(solution), *_evidence(solution)]
    rows.append(("Time", f"{solution.evidence.seconds:.2f} s"))
    return Block("Checks", (*ranking_sentence(solution), Facts(tuple(rows)), *_advice(solution)))


def ranking_sentence(solution: Solution) -> tuple[str, ...]:
    """By what postures are ranked where it is not the scatter that is told of them."""
    task = solution.programme.task
    if task.criterion == "worst" and not task.minimize:
        return ()
    asked = " and ".join([CRITERIA[task.criterion].format(part=PARTS[task.within]), *(t.kind for t in task.minimize)])
    told = f"the largest standard deviation {PARTS[task.within]}"
    return (f"Postures are ranked by {asked.replace('_', ' ')}; the scatter told of them here is {told}.",)


def _gain(solution: Solution) -> list[tuple[str, str]]:
    typical, worst = solution.evidence.typical, solution.evidence.worst
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
    evidence = solution.evidence
    return length(sigma, digits, (solution.critical.sigma_max, evidence.typical, evidence.worst))


def _less(gain: float) -> str:
    if abs(gain) < 5e-4:
        return "the same scatter as"
    return f"{percent(abs(gain))} {'less' if gain > 0 else 'more'} scatter than"


def _floor(solution: Solution) -> list[tuple[str, str]]:
    floor = solution.floor
    if floor is None:
        return []
    arm = solution.programme.arm
    where = "at this place" if solution.goal.kind == "point" else "anywhere in this box"
    lever = f" on a lever of {length(floor.radius, 4)}" if math.isfinite(floor.radius) and floor.radius > 0 else ""
    share = "alone sets it" if floor.share > 0.995 else f"makes {percent(floor.share)} of it"
    source = f"the {source_words(floor.source, arm)}{lever} {share}"
    return [("Floor", f"{where} no posture can get below {_size(solution, floor.sigma)}: {source}"),
            ("", _above(solution.critical.sigma_max / floor.sigma))]  # fmt: skip


def _above(ratio: float) -> str:
    if ratio > 2:
        return f"the answer is {number(ratio, 2)} times this floor"
    if ratio < 1.0005:
        return "the answer lies on this floor"
    return f"the answer lies {percent(ratio - 1)} above this floor"


def _evidence(solution: Solution) -> list[tuple[str, str]]:
    e = solution.evidence
    text = (
        f"{count(e.tried, 'random start')} led towards the target, {e.starts} arrived, {e.feasible} of these meet "
        f"every requirement; the best {e.polished} improved to a local optimum, {min(e.converged, e.polished)} of them "
        "confirmed by the solver"
    )
    rows = [("Search", text)]
    rows.append(("", f"{count(e.distinct, 'distinct optimum', 'distinct optima')}; the best one was hit {e.hits} times"
                     f" out of {e.polished}"))  # fmt: skip
    if e.sweep is not None:
        rows.append(("Sweep", _sweep(solution, e.sweep)))
    return rows


def _sweep(solution: Solution, sweep: Sweep) -> str:
    text = f"{sweep.over}: {count(sweep.points, 'posture')}, {sweep.feasible} of them feasible"
    sigma, answer = solution.evidence.sweep_sigma, solution.critical.sigma_max
    if not math.isfinite(sigma):
        return text
    # Where something else than the largest scatter is made small, a worse posture may well scatter less.
    better = sigma < answer * (1 - 1e-6)
    found = "less scatter, but not a better posture by what is asked" if better else "nothing better"
    return f"{text}; found {found} (its best: {_size(solution, sigma, 4)})"


def _advice(solution: Solution) -> tuple[str, ...]:
    typical = solution.evidence.typical
    if solution.goal.kind != "point" or not math.isfinite(typical):
        return ()
    gain = solution.gain_over(typical)
    if gain >= SMALL_GAIN:
        return ()
    return (
        f"At this fixed place the posture matters little: a typical one does {_almost(gain)}. If the workpiece may be "
        "moved, more is to be won by placing it: write region: {min: [...], max: [...]} in the task, in place of "
        "position: [...].",
    )


def _almost(gain: float) -> str:
    return "as well" if gain < 5e-4 else f"only {percent(gain)} worse"
