"""How much better an answer could be: the price of each requirement that holds it, and a bound that no posture beats.

The multiplier λ of a row is what its end is worth in the objective. Where that is the scaled variance ``σ²/s``, one
unit of a requirement is worth ``λ s / (2σ) · d end/d unit`` of σ; else the program is solved again with both sides of
the end. Every price is held against a new solve: where several ends fix a posture, multipliers are not unique.

The bound: an error before any joint has moved – the base, the first joint – shifts the tool point by ``a × (x − o)``
(or ``a``), whatever the posture. By the law of total covariance ``B' C_fixed(x) B`` bounds the projected covariance
from below; errors of the workpiece are independent of the arm's, and are added.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.encoding import encoded
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array, Json, finite_or_none
from posture_opt.robot.robot import Robot
from posture_opt.selection.program.nlp import Row
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.elastic_problem import AXIS, TARGET
from posture_opt.selection.search.engine import Confirmation, Engine
from posture_opt.selection.solvers import Ends
from posture_opt.uncertainty.regions import deviation
from posture_opt.uncertainty.sources import of_workpiece, relative_twist, stated_name
from posture_opt.uncertainty.tool_point import ToolPoint

_LEAST_MULTIPLIER = 1e-5  # of the scaled objective: what is worth less changes no digit that is stated
_STEPS = {"rad": math.radians(1.0), "m": 1e-3}  # by which people loosen a requirement: a degree, a millimetre
_SIDES = "lower", "upper"


@dataclass(frozen=True)
class Price:
    """What one unit of a requirement is worth."""

    requirement: str  # tilt, region.x, JOINT.limits, JOINT.range, a term, or what is to be kept clear of
    value: float  # [m] of σ for each unit by which it is loosened
    unit: str  # of the requirement, SI
    side: str  # the end that holds, upper or lower
    step: float  # by what people would loosen it [unit]
    gain: float  # [m] of σ by that step, solved again; NaN without a solution

    def to_json(self) -> dict[str, Json]:
        after = {"loosened_by": self.step, "gain": finite_or_none(self.gain)}
        return {**encoded(self, "requirement value unit side"), "solved_again": after}


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


def prices_of(engine: Engine, target: TaskTarget, said: Confirmation | None, robot: Robot) -> tuple[Price, ...]:
    """Prices of what holds one posture that a new solve confirms, largest worth first; empty where IPOPT did not.

    The ends of joints that are not the limits of the ``robot`` are those of a range: measured, or ordinary.
    """
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

    for held in held_by(problem, target, said, robot) if sigma > 0 else []:
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


def held_by(problem: OptimisationProblem, target: TaskTarget, said: Confirmation, robot: Robot) -> list[Held]:
    """What holds a posture, most worth first: inequalities with a multiplier, and a tool axis without any tilt."""
    joined: dict[tuple[str, str, str, float], list[HeldEnd]] = {}
    for one in (*_axis(problem, said), *_rows(problem, target, said), *_limits(problem, said, robot)):
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
    """The requirement of a row, in its users' units, or None."""
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
    """Usual loosening of a bound: a degree, a millimetre, or a tenth of it, rounded down to a power of ten."""
    size = 1 - bound if row.unit == "probability" else abs(bound)
    usual = _STEPS.get(row.unit, math.inf)
    if row.unit in _STEPS and (size >= usual or not size):
        return usual
    return float(10.0 ** math.floor(math.log10(0.1 * size))) if size > 0 else 1.0


def _limits(problem: OptimisationProblem, said: Confirmation, robot: Robot) -> Iterator[Held]:
    for k, (variable, joint) in enumerate(zip(problem.nlp.variables, robot.joints, strict=True)):
        multiplier = float(said.bound_multipliers[k])
        if variable.lower < variable.upper and abs(multiplier) > _LEAST_MULTIPLIER:  # a joint that is held has none
            end = _end(False, k, multiplier)
            limit = (variable.upper == joint.upper) if end.upper else (variable.lower == joint.lower)
            name = f"{variable.name}.{'limits' if limit else 'range'}"
            yield Held(name, variable.unit, _SIDES[end.upper], _STEPS[variable.unit], (end,))


def _end(row: bool, index: int, multiplier: float) -> HeldEnd:
    upper = multiplier > 0
    return HeldEnd(row, index, upper, 1.0 if upper else -1.0, multiplier)


@dataclass(frozen=True)
class LowerBound:
    """A lower bound on the largest standard deviation, the source that sets it and its share."""

    sigma: float  # [m]
    source: str
    share: float
    point: Array  # (3,) in the target, where the bound is least
    radius: float  # distance [m] of that point from the source's axis, NaN of a shift


def lower_bound(tool_point: ToolPoint, target: TaskTarget, basis: Array) -> LowerBound | None:
    """The bound for the spread in ``basis`` (3, m), seen from the target's lever; over a region the least one."""
    fixed, (beside, shifts, errors) = _fixed_sources(tool_point), _workpiece_errors(tool_point)
    if not (fixed or beside) or target.kind == "anywhere":
        return None
    covariance = _conditional(tool_point.covariance, fixed)
    columns = _Levers.of(tool_point, fixed)
    point = _least(columns, covariance, target, basis) if fixed and target.kind == "region" else target.lower
    # At a region the lever of the workpiece is zero: its errors raise the bound by as much at every point.
    J, both = basis.T @ np.hstack([columns.at(point), shifts]), _joined(covariance, errors)
    values, vectors = np.linalg.eigh(J @ both @ J.T)
    sigma = deviation(float(values[-1]), _joined(columns.scale(covariance), shifts @ errors @ shifts.T))
    if sigma == 0:
        return None
    gains: dict[str, float] = {}
    names = [*(tool_point.names[k] for k in fixed), *map(stated_name, beside)]
    for name, gain in zip(names, (vectors[:, -1] @ J) ** 2 * np.diag(both), strict=True):
        gains[name] = gains.get(name, 0.0) + float(gain)
    source = max(gains, key=gains.__getitem__)
    first = names.index(source)
    radius = columns.radius(first, point) if first < len(fixed) else np.nan
    return LowerBound(sigma, source, gains[source] / sum(gains.values()), point, radius)


def _workpiece_errors(tool_point: ToolPoint) -> tuple[list[str], Array, Array]:
    """Errors of the workpiece: names, shift of the target by each (3, w), and covariance (w, w)."""
    linear = tool_point.linear
    if linear is None:
        return [], np.zeros((3, 0)), np.zeros((0, 0))
    rows = [k for k, name in enumerate(linear.names) if of_workpiece(name)]
    names = [linear.names[k] for k in rows]
    shifts = [relative_twist(name, tool_point.lever)[0] for name in names]
    return names, np.array(shifts, dtype=float).reshape(-1, 3).T, linear.covariance[np.ix_(rows, rows)]


def _joined(A: Array, B: Array) -> Array:
    return np.block([[A, np.zeros((len(A), len(B)))], [np.zeros((len(B), len(A))), B]])


@dataclass(frozen=True)
class _Levers:
    """Axes (k, 3), origins (k, 3) and turning ones of the fixed sources."""

    axes: Array
    origins: Array
    rotates: Array

    @classmethod
    def of(cls, tool_point: ToolPoint, fixed: list[int]) -> _Levers:
        factors = tool_point.robot.factors
        reached = walk(factors, factor_values(factors, [0.0] * tool_point.robot.n))
        screws = [reached.screws[tool_point.indices[k]] for k in fixed]
        return cls(
            np.array([s.axis for s in screws], dtype=float).reshape(-1, 3),
            np.array([s.origin for s in screws], dtype=float).reshape(-1, 3),
            np.array([s.rotates for s in screws], dtype=bool),
        )

    def at(self, point: Array) -> Array:
        """(3, k) derivative of the tool point."""
        turned = np.cross(self.axes, point - self.origins)
        return np.where(self.rotates[:, None], turned, self.axes).T

    def scale(self, covariance: Array) -> Array:
        """(k, k) variances [m²] with levers as long as the way to each source: what a bound is rounding beside."""
        ways = np.where(self.rotates, 1.0 + np.linalg.norm(self.origins, axis=1), 1.0)
        return np.asarray(np.diag(np.diag(covariance)) * ways**2)

    def radius(self, k: int, point: Array) -> float:
        return float(np.linalg.norm(np.cross(self.axes[k], point - self.origins[k]))) if self.rotates[k] else np.nan


def _fixed_sources(tool_point: ToolPoint) -> list[int]:
    """Sources whose axis no joint moves: all up to the first joint, and those along or about its own axis after it."""
    factors = tool_point.robot.factors
    first = next(i for i, factor in enumerate(factors) if factor.joint is not None)
    if factors[first].kind != "rotate":
        return [k for k, index in enumerate(tool_point.indices) if index <= first]
    last = first
    while last + 1 < len(factors) and factors[last + 1].axis == factors[first].axis and factors[last + 1].joint is None:
        last += 1
    return [k for k, index in enumerate(tool_point.indices) if index <= last]


def _conditional(covariance: Array, fixed: list[int]) -> Array:
    other = [k for k in range(len(covariance)) if k not in fixed]
    ff, fo, oo = covariance[np.ix_(fixed, fixed)], covariance[np.ix_(fixed, other)], covariance[np.ix_(other, other)]
    remaining = ff - fo @ np.linalg.pinv(oo) @ fo.T if other and np.any(fo) else ff
    # A finite rotation error scatters a little less than its linear lever says; stay below it.
    shrink = np.exp(-2 * np.diag(remaining).clip(0))
    return np.asarray(remaining * np.sqrt(np.outer(shrink, shrink)))


def _least(columns: _Levers, covariance: Array, target: TaskTarget, basis: Array) -> Array:
    def value(point: Array) -> float:
        J = basis.T @ columns.at(point)
        return float(np.linalg.eigvalsh(J @ covariance @ J.T)[-1])

    # The base axis is the usual least: start from the box's point nearest to it.
    point = np.clip(columns.origins[0], target.lower, target.upper)
    best, step = value(point), (target.upper - target.lower) / 2
    while np.max(step) > 1e-5:
        moves = [
            np.clip(point + sign * np.eye(3)[k] * step, target.lower, target.upper)
            for k in range(3)
            for sign in (1, -1)
        ]
        values = [value(move) for move in moves]
        if min(values) < best * (1 - 1e-9):
            best, point = min(values), moves[int(np.argmin(values))]
        else:
            step = step / 2
    return np.asarray(point)
