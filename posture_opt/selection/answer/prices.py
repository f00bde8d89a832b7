"""``Price``: what one unit of a requirement that holds an answer back is worth in standard deviation.

The multiplier λ of a row is what its end is worth in the objective. Where that is the scaled variance ``σ²/s``, one
unit of what the user states is worth ``λ s / (2σ) · d end/d unit`` of σ. Where something else is minimised, σ is not
what the multiplier speaks of: then the program is solved again with both sides of the end, and σ compared.

Every price is held against a new solve with the requirement loosened a little. Where several ends fix a posture, their
multipliers are not unique, and what is not confirmed is not stated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.numerics import Json, finite_or_none
from posture_opt.selection.program.nlp import Row
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.confirmation import Confirmation
from posture_opt.selection.search.elastic_problem import AXIS, TARGET
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.solvers import Ends

_LEAST_MULTIPLIER = 1e-5  # of the scaled objective: what is worth less changes no digit that is stated
_CHECKED_CHANGE = 1e-5  # of σ: by which a requirement is loosened to see whether its price is right
_CHECKED_STEP = 0.1  # of a step that people take: what it is loosened by at most for that
_CHECKED_TOLERANCE = 0.03  # of a price: what it may differ by from that change, which is no derivative
_STEPS = {"rad": math.radians(1.0), "m": 1e-3}
"""By what people loosen a requirement [rad or m]: a degree, a millimetre."""
_BOUND_SHARE = 0.1  # of a bound: the largest step where these are larger than the bound itself, or of other units
_SLOPE_STEP = 1e-6  # of a bound, to see how what users state changes with it


@dataclass(frozen=True)
class Price:
    """What one unit of a requirement is worth.

    Args:
        requirement: ``tilt``, ``region.x``, ``JOINT.limits``, the name of a term or of what is to be kept clear of.
        value: [m] of σ for each ``unit`` by which it is loosened; negative where that makes σ larger, as it may where
            something else is minimised.
        unit: of the requirement, SI: ``rad``, ``m``, or that of a term.
        side: the end that holds, ``upper`` or ``lower``, of what is stated.
        step: by what people would loosen it [unit]; ``gain`` is what σ falls by then [m], by a new solve, or NaN.
    """

    requirement: str
    value: float
    unit: str
    side: str
    step: float
    gain: float

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI."""
        after = {"loosened_by": self.step, "gain": finite_or_none(self.gain)}
        stated = ("requirement", "value", "unit", "side")
        return {**{name: getattr(self, name) for name in stated}, "solved_again": after}


@dataclass(frozen=True)
class HeldEnd:
    """One end of a row or variable that holds an answer.

    Args:
        index: of the row, or of the variable where ``row`` is false.
        shift: change of that end for one unit by which the requirement is loosened; ``bend`` for its square.
        multiplier: of the scaled objective.
    """

    row: bool
    index: int
    upper: bool
    shift: float
    multiplier: float
    bend: float = 0.0


@dataclass(frozen=True)
class Held:
    """A requirement of an answer with its ends that hold; its price in the scaled objective is ``worth`` a unit."""

    requirement: str
    unit: str
    side: str
    step: float
    ends: tuple[HeldEnd, ...]

    @property
    def worth(self) -> float:
        """Decrease of the scaled objective for each unit."""
        return sum(end.multiplier * end.shift for end in self.ends)

    def loosened(self, ends: Ends, amount: float) -> Ends:
        """The ends of a program with this requirement loosened by ``amount`` units."""
        low, high, row_low, row_high = (np.array(end, dtype=float) for end in ends)
        for end in self.ends:
            both = (row_low, row_high) if end.row else (low, high)
            moved = amount * end.shift + amount**2 * end.bend
            if both[0][end.index] == both[1][end.index]:
                both[0][end.index] += moved
            both[int(end.upper)][end.index] += moved
        return low, high, row_low, row_high


def prices_of(engine: Engine, target: TaskTarget, said: Confirmation | None) -> tuple[Price, ...]:
    """The prices of what holds one posture, largest worth first; empty where IPOPT did not confirm it."""
    if said is None or not len(said.q) or said.differs:
        return ()
    return _Priced(engine, target, said).prices


@dataclass(frozen=True)
class _Priced:
    """The prices of one confirmed posture."""

    engine: Engine
    target: TaskTarget
    said: Confirmation

    @property
    def prices(self) -> tuple[Price, ...]:
        """Those that a new solve confirms."""
        held = held_by(self.engine.optimisation_problem, self.target, self.said) if self._sigma > 0 else []
        found = [(one, value) for one in held if (value := self._value(one)) is not None]
        return tuple(
            Price(one.requirement, value, one.unit, one.side, one.step, self._sigma - self._again(one, one.step))
            for one, value in found
        )

    @cached_property
    def _sigma(self) -> float:
        """σ [m] of the program at the posture."""
        return self.engine.screened(self.said.q[None], self.target.parameters)[0].sigma

    def _value(self, held: Held) -> float | None:
        """The price [m per unit]; None where solving again does not confirm it."""
        if not minimises_variance(self.engine.optimisation_problem):
            step = _CHECKED_STEP * held.step
            slope = (self._again(held, -step) - self._again(held, step)) / (2 * step)
            return slope if math.isfinite(slope) else None
        price = held.worth * self.target.scale / (2 * self._sigma)
        step = min(_CHECKED_STEP * held.step, _CHECKED_CHANGE * self._sigma / price)
        gain = (self._sigma - self._again(held, step)) / step
        return price if abs(gain - price) <= _CHECKED_TOLERANCE * price else None

    def _again(self, held: Held, amount: float) -> float:
        """σ [m] with a requirement loosened by ``amount`` units, from the posture; NaN where nothing is found."""
        parameters = self.target.parameters
        ends = held.loosened(self.engine.optimisation_problem.nlp.ends(parameters), amount)
        outcome = self.engine.confirming.solve(self.said.q, parameters, ends)
        return self.engine.screened(outcome.x[None], parameters)[0].sigma if outcome.optimal else math.nan


def minimises_variance(problem: OptimisationProblem) -> bool:
    """Whether the objective is the variance along the worst axis over its scale, and nothing else."""
    return problem.task.criterion == "worst" and not problem.task.minimize and not problem.task.yaw_lever


def held_by(problem: OptimisationProblem, target: TaskTarget, said: Confirmation) -> list[Held]:
    """What holds a posture, most worth first: inequalities with a multiplier, and a tool axis without any tilt."""
    every = [*_axis(problem, said), *_rows(problem, target, said), *_limits(problem, said)]
    joined: dict[tuple[str, str, str, float], list[HeldEnd]] = {}
    for one in every:
        joined.setdefault((one.requirement, one.unit, one.side, one.step), []).extend(one.ends)
    groups = (Held(*key, tuple(ends)) for key, ends in joined.items())
    return sorted(groups, key=lambda held: -abs(held.worth) * held.step)


def _axis(problem: OptimisationProblem, said: Confirmation) -> Iterator[Held]:
    """The tilt of a tool axis that is held without any: towards where that gains most, ``|λ|`` a rad.

    The rows are the sines of the angles about two axes.
    """
    rows = [k for k, row in enumerate(problem.nlp.rows) if row.requirement == AXIS and row.equality]
    size = float(np.linalg.norm(said.row_multipliers[rows]))
    if size > _LEAST_MULTIPLIER:
        multipliers = said.row_multipliers[rows].tolist()
        ends = tuple(HeldEnd(True, k, True, m / size, m) for k, m in zip(rows, multipliers, strict=True))
        yield Held("tilt", "rad", "upper", _STEPS["rad"], ends)


def _rows(problem: OptimisationProblem, target: TaskTarget, said: Confirmation) -> Iterator[Held]:
    """Inequalities with a multiplier."""
    low, high = problem.nlp.row_bounds(target.parameters)
    for k, row in enumerate(problem.nlp.rows):
        multiplier = float(said.row_multipliers[k])
        if row.equality or abs(multiplier) <= _LEAST_MULTIPLIER:
            continue
        upper = multiplier > 0
        end = HeldEnd(True, k, upper, 1.0 if upper else -1.0, multiplier)
        held = _row(row, end, float((high if upper else low)[k]), target)
        if held is not None:
            yield held


def _row(row: Row, end: HeldEnd, bound: float, target: TaskTarget) -> Held | None:
    """The requirement of one row in the units that users state it in; None where it is nobody's."""
    if row.requirement == TARGET:
        return Held(f"region.{row.name.partition('.')[2]}", row.unit, _side(end.upper), _STEPS["m"], (end,))
    if row.requirement == AXIS:
        if not target.tilt:
            return None  # the slack of an arm that cannot turn its tool at will
        slope, bend = math.sin(2 * target.tilt), math.cos(2 * target.tilt)  # of sin² tilt
        return Held("tilt", "rad", "upper", _STEPS["rad"], (replace(end, shift=slope, bend=bend),))
    step = _SLOPE_STEP * max(1.0, abs(bound))
    shown = (row.shown(bound + step) - row.shown(bound - step)) / (2 * step)
    if not shown:
        return None
    side = _side(end.upper if shown > 0 else not end.upper)
    return Held(
        row.requirement, row.unit, side, _step(row, row.shown(bound)), (replace(end, shift=end.shift / abs(shown)),)
    )


def _step(row: Row, bound: float) -> float:
    """What people would loosen a bound by: a degree, a millimetre, or a tenth of it, rounded down to a power of ten."""
    size = 1 - bound if row.unit == "probability" else abs(bound)
    usual = _STEPS.get(row.unit, math.inf)
    if row.unit in _STEPS and (size >= usual or not size):
        return usual
    return float(10.0 ** math.floor(math.log10(_BOUND_SHARE * size))) if size > 0 else 1.0


def _limits(problem: OptimisationProblem, said: Confirmation) -> Iterator[Held]:
    """Limits of joints with a multiplier; a joint that is held has none."""
    for k, variable in enumerate(problem.nlp.variables):
        multiplier = float(said.bound_multipliers[k])
        if variable.lower < variable.upper and abs(multiplier) > _LEAST_MULTIPLIER:
            upper = multiplier > 0
            end = HeldEnd(False, k, upper, 1.0 if upper else -1.0, multiplier)
            yield Held(f"{variable.name}.limits", variable.unit, _side(upper), _STEPS[variable.unit], (end,))


def _side(upper: bool) -> str:
    """Which end holds, as a word."""
    return "upper" if upper else "lower"
