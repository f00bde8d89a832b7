"""The table of a report on what would help: which change leaves how much of the spread."""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch
from typing import TYPE_CHECKING

from posture_opt.model.arm import Arm
from posture_opt.report.text.blocks import Block, Table
from posture_opt.report.text.words import source_size
from posture_opt.selection.answer.improvements import CalibratedArm, HalvedSigma, Improvement, MovedPart
from posture_opt.statements.notation import (
    length,
    length_unit,
    percent,
    quantity,
    shift,
    stated_angle,
    stated_length,
)
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.selection.answer.prices import Price
    from posture_opt.selection.problem_data import ProblemData

_MAX_ROWS = 6
_MIN_GAIN = 0.005  # a smaller gain is none
_MAX_PRICES = 4
_MIN_WORTH = 1e-4  # of the standard deviation: what a degree or a millimetre is worth, to be worth a word


def improvements_block(
    problem: ProblemData, changes: Sequence[Improvement], prices: Sequence[Price], sigma: float, part: str
) -> Block:
    """What would lower the standard deviation of the answer, most gain first; empty where nothing would.

    Args:
        prices: of the requirements that hold the answer back.
        sigma: the standard deviation [m].
        part: of the spread that counts, ``across the direction``.
    """
    shown = [change for change in changes if change.gain >= _MIN_GAIN][:_MAX_ROWS]
    worth = price_words(prices, sigma)
    if not shown:
        return Block("What would help", worth)
    unit, factor = length_unit([sigma])  # that of the answer, in the whole report
    rows = [(_words(c, problem.arm), number(c.sigma_max * factor, 3), percent(c.gain)) for c in shown]
    table = Table(("change", f"σ {part} [{unit}]", "reduction"), tuple(rows))
    return Block("What would help", (table, *worth, *_notes(problem, shown)))


def price_words(prices: Sequence[Price], sigma: float) -> tuple[str, ...]:
    """What a degree or a millimetre of the requirements that hold the answer is worth, in one sentence or none.

    Args:
        sigma: the standard deviation of the answer [m].
    """
    shown = [price for price in prices if price.gain >= _MIN_WORTH * sigma][:_MAX_PRICES]
    if not shown:
        return ()
    gains = [price.gain for price in shown]
    parts = [f"{length(price.gain, 2, gains)} with {_loosened(price)}" for price in shown]
    return (f"Loosening a requirement that holds the answer lowers σ by {', by '.join(parts)} (solved again).",)


def _loosened(price: Price) -> str:
    """By what a requirement is loosened: 1 deg more tilt."""
    write = {"rad": stated_angle, "m": stated_length}.get(price.unit)
    step = quantity(price.step, price.unit) if write is None else write(price.step)
    owner, _, end = price.requirement.rpartition(".")
    if end == "limits":
        return f"{step} beyond the {price.side} limit of {owner}"
    if owner == "region":
        return f"{step} more region in {'-' if price.side == 'lower' else '+'}{end}"
    return f"{step} {'more' if price.side == 'upper' else 'less'} {price.requirement}"


def most_helpful(problem: ProblemData, changes: Sequence[Improvement], sigma: float) -> str:
    """The change that lowers the standard deviation ``sigma`` [m] the most, in a clause; empty where nothing does."""
    best = max(changes, key=lambda change: change.gain, default=None)
    if best is None or best.gain < _MIN_GAIN:
        return ""
    unit, factor = length_unit([sigma])
    return f"{_words(best, problem.arm)}: {number(factor * best.sigma_max)} {unit}, {percent(best.gain)} less"


@singledispatch
def _words(change: Improvement, arm: Arm) -> str:
    """A change in words, with its size."""
    raise NotImplementedError(type(change))


@_words.register
def _halved(change: HalvedSigma, arm: Arm) -> str:
    halved = source_size(change.parameter, change.sigma / 2, arm)
    return f"halve σ of {change.parameter} (to {halved})"


@_words.register
def _calibrated(change: CalibratedArm, arm: Arm) -> str:
    assumed = ", assumed" if change.assumed else ""
    return f"calibrate the arm at {change.postures} postures (instrument σ {length(change.instrument)}{assumed})"


@_words.register
def _moved(change: MovedPart, arm: Arm) -> str:
    return f"move the part by {shift(change.shift)}"


def _notes(problem: ProblemData, shown: Sequence[Improvement]) -> tuple[str, ...]:
    """What the table takes for granted."""
    sources = problem.sources
    notes = []
    if any(isinstance(change, CalibratedArm) for change in shown):
        notes.append(
            "Calibration removes constant errors (uncertainty: sigma); list errors that change from repeat to repeat "
            "under uncertainty: scatter."
        )
    elif sources.scatter.any() and not sources.constant.any():
        of_arm = "" if problem.workpiece_sources.empty else " of the arm"
        notes.append(f"Calibration would not help: all stated errors{of_arm} change from repeat to repeat.")
    if any(isinstance(change, HalvedSigma) for change in shown):
        notes.append("Reductions from a smaller σ are those in the same posture; a new search may gain more.")
    return tuple(notes)
