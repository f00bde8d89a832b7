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
_STEPS = {"rad": math.radians(1.0), "m": 1e-3}  # by which people loosen a requirement: a degree, a millimetre
_SIDES = "lower", "upper"


@dataclass(frozen=True)
class Price:
    """What one unit of a requirement is worth."""

    requirement: str  # tilt, region.x, JOINT.limits, a term, or what is to be kept clear of
    value: float  # [m] of σ for each unit by which it is loosened
    unit: str  # of the requirement, SI
    side: str  # the end that holds, upper or lower
    step: float  # by what people would loosen it [unit]
    gain: float  # [m] of σ by that step, solved again; NaN without a solution

    def to_json(self) -> dict[str, Json]:
        after = {"loosened_by": self.step, "gain": finite_or_none(self.gain)}
        stated = ("requirement", "value", "unit", "side")
        return {**{name: getattr(self, name) for name in stated}, "solved_again": after}


@dataclass(frozen=True)
class HeldEnd:
    """One end of a row or variable that holds an answer."""

    row: bool  # a row, else a variable
    index: int
    upper: bool
    shift: float  # of the end for one unit of the requirement
    multiplier: float  # of the scaled objective
    bend: float = 0.0  # of the end for the square of a unit


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
    """Prices of what holds one posture that a new solve confirms, largest worth first; empty where IPOPT did not."""
    if said is None or not len(said.q) or said.differs:
        return ()
    problem, parameters, found = engine.optimisation_problem, target.parameters, []
    sigma = engine.screened(said.q[None], parameters)[0].sigma
    task = problem.task
    of_variance = task.criterion == "worst" and not task.minimize and not task.yaw_lever

    def again(held: Held, amount: float) -> float:
        """σ [m] with a requirement loosened by ``amount`` units, from the posture; NaN where nothing is found."""
        ends = held.loosened(problem.nlp.ends(parameters), amount)
        outcome = engine.confirming.solve(said.q, parameters, ends)
        return engine.screened(outcome.x[None], parameters)[0].sigma if outcome.optimal else math.nan

    for held in held_by(problem, target, said) if sigma > 0 else []:
        step = 0.1 * held.step  # at most a tenth of a step that people take
        if of_variance:
            value = held.worth * target.scale / (2 * sigma)
            step = min(step, 1e-5 * sigma / value)
            confirmed = abs((sigma - again(held, step)) / step - value) <= 0.03 * value  # the change is no derivative
        else:
            value = (again(held, -step) - again(held, step)) / (2 * step)
            confirmed = math.isfinite(value)
        if confirmed:
            gain = sigma - again(held, held.step)
            found.append(Price(held.requirement, value, held.unit, held.side, held.step, gain))
    return tuple(found)


def held_by(problem: OptimisationProblem, target: TaskTarget, said: Confirmation) -> list[Held]:
    """What holds a posture, most worth first: inequalities with a multiplier, and a tool axis without any tilt."""
    joined: dict[tuple[str, str, str, float], list[HeldEnd]] = {}
    for one in (*_axis(problem, said), *_rows(problem, target, said), *_limits(problem, said)):
        joined.setdefault((one.requirement, one.unit, one.side, one.step), []).extend(one.ends)
    groups = (Held(*key, tuple(ends)) for key, ends in joined.items())
    return sorted(groups, key=lambda held: -abs(held.worth) * held.step)


def _axis(problem: OptimisationProblem, said: Confirmation) -> Iterator[Held]:
    """The tilt of a tool axis held without any, towards where it gains most, ``|λ|`` a rad; rows are sines."""
    rows = [k for k, row in enumerate(problem.nlp.rows) if row.requirement == AXIS and row.equality]
    multipliers = said.row_multipliers[rows]
    size = float(np.linalg.norm(multipliers))
    if size > _LEAST_MULTIPLIER:
        ends = (HeldEnd(True, k, True, m / size, m) for k, m in zip(rows, multipliers.tolist(), strict=True))
        yield Held("tilt", "rad", "upper", _STEPS["rad"], tuple(ends))


def _rows(problem: OptimisationProblem, target: TaskTarget, said: Confirmation) -> Iterator[Held]:
    ends = problem.nlp.row_bounds(target.parameters)
    for k, row in enumerate(problem.nlp.rows):
        multiplier = float(said.row_multipliers[k])
        if not row.equality and abs(multiplier) > _LEAST_MULTIPLIER:
            end = _end(True, k, multiplier)
            held = _row(row, end, float(ends[end.upper][k]), target)
            yield from [] if held is None else [held]


def _row(row: Row, end: HeldEnd, bound: float, target: TaskTarget) -> Held | None:
    """The requirement of one row in the units that users state it in; None where it is nobody's."""
    if row.requirement == TARGET:
        return Held(f"region.{row.name.partition('.')[2]}", row.unit, _SIDES[end.upper], _STEPS["m"], (end,))
    if row.requirement == AXIS:
        if not target.tilt:
            return None  # the slack of an arm that cannot turn its tool at will
        slope, bend = math.sin(2 * target.tilt), math.cos(2 * target.tilt)  # of sin² tilt
        return Held("tilt", "rad", "upper", _STEPS["rad"], (replace(end, shift=slope, bend=bend),))
    near = 1e-6 * max(1.0, abs(bound))
    shown = (row.shown(bound + near) - row.shown(bound - near)) / (2 * near)
    if not shown:
        return None
    end = replace(end, shift=end.shift / abs(shown))
    return Held(row.requirement, row.unit, _SIDES[end.upper == (shown > 0)], _step(row, row.shown(bound)), (end,))


def _step(row: Row, bound: float) -> float:
    """What people would loosen a bound by: a degree, a millimetre, or a tenth of it, rounded down to a power of ten."""
    size = 1 - bound if row.unit == "probability" else abs(bound)
    usual = _STEPS.get(row.unit, math.inf)
    if row.unit in _STEPS and (size >= usual or not size):
        return usual
    return float(10.0 ** math.floor(math.log10(0.1 * size))) if size > 0 else 1.0


def _limits(problem: OptimisationProblem, said: Confirmation) -> Iterator[Held]:
    for k, variable in enumerate(problem.nlp.variables):
        multiplier = float(said.bound_multipliers[k])
        if variable.lower < variable.upper and abs(multiplier) > _LEAST_MULTIPLIER:  # a joint that is held has none
            end = _end(False, k, multiplier)
            yield Held(f"{variable.name}.limits", variable.unit, _SIDES[end.upper], _STEPS[variable.unit], (end,))


def _end(row: bool, index: int, multiplier: float) -> HeldEnd:
    upper = multiplier > 0
    return HeldEnd(row, index, upper, 1.0 if upper else -1.0, multiplier)
