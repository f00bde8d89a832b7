"""``ElasticProblem``: by how little a requirement must give for all the others to be met.

Every requirement – target, tool axis, joint limits, held joints, each term, each obstacle – can give by a slack, and
the sum of the slacks is minimised, each in its own scale (the elastic mode of Gill, Murray and Saunders 2005, SNOPT,
section 1.3). One nonlinear program serves every choice of what may give: slacks that may not are held at zero by their
bounds.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array
from posture_opt.selection.program.nlp import Nlp, Row
from posture_opt.selection.program.nonlinear_solver import NonlinearSolver
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.search.giving_scene import CLEARANCE, GivingScene
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE

TARGET, AXIS, LIMITS, HELD = "target", "tool_axis", "limits", "fixed_joints"
HELD_SLACK = (
    1e-10  # slack of what may not give: as a variable that is free it keeps IPOPT from counting too few of them
)
NORM_ROUNDING = 1e-7  # m or rad, squared: where the norm of a slack near zero is rounded off
MAX_ITERATIONS = 100
MAX_FRUITLESS_STARTS = 7  # starts: where none of them leads to a compromise, others seldom do
STARTS_THAT_AGREE = 3  # starts that come to the same least: others would too
COST_TOLERANCE = 1e-3  # of the cost
LIMIT_COST_FACTOR = 3.0  # times the cost: limits of joints are built in
WIDENED_LIMIT = 4 * np.pi  # rad or m: of a joint without its limits
ZERO_BOUND_SCALE = 0.1  # of a term whose bound is zero: the scale that its cost is measured in
_HEIGHT = f"{TARGET}.z"
"""The row that holds the tool point at the height of the target."""


@dataclass(frozen=True)
class Compromise:
    """A posture that meets some requirements only in part.

    Args:
        q: (n,) [rad or m].
        lacking: (G,) what each requirement lacks, in the order of `ElasticProblem.requirements` [unit].
        cost: the sum of what is lacking, each in its own scale.
        slacks: name of a requirement that gives -> by how much [unit]: of the target and of an obstacle's place (3,).
    """

    q: Array
    lacking: Array
    cost: float
    slacks: Mapping[str, Array]

    @property
    def met(self) -> bool:
        """Whether nothing is missing after all."""
        return bool(np.all(self.lacking <= ROW_TOLERANCE))


@dataclass(frozen=True)
class _Slack:
    """The slack of one requirement: a ``vector`` with a norm, or numbers that are not below zero.

    Args:
        scale: what a unit of it is [unit]; ``most`` is the largest that it may be [unit].
    """

    name: str
    size: int
    scale: float
    vector: bool = False
    most: float = math.inf


class ElasticProblem:
    """The elastic form of one optimisation problem: ``min Σ_k c_k s_k`` over postures and slacks ``s_k ≥ 0``.

    Args:
        problem: n joints.
        held: joint index -> value [rad or m] of joints that the task holds and that ``problem`` leaves free.

    Attributes:
        requirements: names of all that may give: the target, the tool axis, the limits, then held joints, terms, the
            rows of the cell, the places of its obstacles and its clearance.
    """

    def __init__(self, problem: OptimisationProblem, held: Mapping[int, float] | None = None) -> None:
        self._problem = problem
        self.held: dict[int, float] = dict(held or {})
        self.cell: GivingScene = GivingScene.of(problem)
        self.in_cell: tuple[str, ...] = tuple(row.name for row in self.cell.rows)
        terms = dict.fromkeys(row.requirement for row in self._term_rows)
        self.further: tuple[str, ...] = (*([HELD] if self.held else []), *terms, *self.in_cell)
        beside = (*self.cell.movable, *([CLEARANCE] if self.in_cell else []))
        self.requirements: tuple[str, ...] = (TARGET, AXIS, LIMITS, *self.further, *beside)

    def lacking(self, Q: Array, parameters: Array) -> Array:
        """What each requirement lacks, (N, G), at postures Q (N, n) [rad or m].

        Distance from the target [m], angle of the axis beyond the tilt [rad], the largest excess of a joint [rad, or
        the arm's size], the largest violation of a row [unit]; zero where it is met. Of an obstacle that is touched it
        is the depth at the surface, not what it would have to give.

        Args:
            parameters: (p,) of the target.
        """
        return np.asarray(self._lacking(Q, parameters, np.zeros(self._slack_count)))

    def cost(self, lacking: Array) -> Array:
        """The cost (…,) of what requirements lack, (…, G): ``Σ_k lacking_k / scale_k``."""
        return np.asarray(lacking @ (1.0 / self._scales))

    def least(
        self, parameters: Array, given: Collection[str], starts: Array, *, level: bool = False
    ) -> Compromise | None:
        """The best that IPOPT finds where only the requirements ``given`` may give; None where others are not met.

        Args:
            parameters: (p,) of the target.
            starts: (k, n) postures; the first that leads to one where nothing is missing ends the search.
            level: whether a target that gives stays at its height.
        """
        found: list[Compromise] = []
        for k, start in enumerate(starts):
            if not found and k == MAX_FRUITLESS_STARTS:
                break
            one = self._compromise(start, parameters, given, level)
            found += [] if one is None else [one]
            least = min((other.cost for other in found), default=math.inf)
            alike = sum(other.cost <= least * (1 + COST_TOLERANCE) for other in found)
            if alike == STARTS_THAT_AGREE or any(other.met for other in found):
                break
        return min(found, key=lambda other: other.cost, default=None)

    def _compromise(self, start: Array, parameters: Array, given: Collection[str], level: bool) -> Compromise | None:
        """Where IPOPT ends from one start; None where a requirement that may not give is not met there."""
        n = len(start)
        lower, upper = self._variable_bounds(given)
        if level:
            heights = n + np.flatnonzero([row.name == _HEIGHT for row in self._target_rows])  # its slacks are the first
            lower[heights], upper[heights] = -HELD_SLACK, HELD_SLACK
        low, high = self._row_bounds(parameters, given)
        x0 = np.clip(np.concatenate([start, self._needed(start, parameters, given)]), lower, upper)
        p = np.append(parameters, float(AXIS in given))
        found = self._solver.solve(x0, lower, upper, low, high, p=p).x
        q, slacks = found[:n], np.where(upper[n:] > HELD_SLACK, found[n:], 0.0)
        if LIMITS not in given:
            q = np.clip(q, lower[:n], upper[:n])
        if not np.all(np.isfinite(found)):
            return None
        lacking = np.asarray(self._lacking(q[None], parameters, slacks))[0]
        may = np.array([name in given for name in self.requirements])
        if np.any(lacking[~may] > ROW_TOLERANCE):
            return None
        return Compromise(q, lacking, float(self.cost(lacking)), self._by_name(slacks))

    def _by_name(self, slacks: Array) -> dict[str, Array]:
        """Slacks (s,) in their scales as those of the requirements [unit]."""
        ends = np.cumsum([slack.size for slack in self._slacks])
        parts = np.split(slacks, ends[:-1])
        return {slack.name: slack.scale * part for slack, part in zip(self._slacks, parts, strict=True)}

    def _needed(self, q: Array, parameters: Array, given: Collection[str]) -> Array:
        """The slacks that a posture needs: IPOPT starts where what may give has given enough."""
        lacking = dict(zip(self.requirements, self.lacking(q[None], parameters)[0], strict=True))
        parts = []
        for slack in self._slacks:
            if slack.name in self.cell.movable and slack.name in given:
                parts.append(self.cell.start_shift(self.cell.movable[slack.name], q) / slack.scale)
            else:
                parts.append(np.full(slack.size, 0.0 if slack.vector else lacking[slack.name] / slack.scale))
        return np.concatenate(parts)

    def _variable_bounds(self, given: Collection[str]) -> tuple[Array, Array]:
        """Bounds of joints and slacks: slacks that may not give are held next to zero, joints whose limits may give are
        freed.
        """
        lower, upper = (end.copy() for end in self._problem.nlp.variable_bounds)
        if LIMITS in given:
            lower, upper = np.full_like(lower, -WIDENED_LIMIT), np.full_like(upper, WIDENED_LIMIT)
        if HELD not in given:
            for k, value in self.held.items():
                lower[k] = upper[k] = value
        free = self._of_slacks([slack.name in given for slack in self._slacks])
        vector = self._of_slacks([slack.vector for slack in self._slacks])
        most = np.where(free > 0, self._of_slacks([slack.most / slack.scale for slack in self._slacks]), HELD_SLACK)
        least = np.where((free > 0) & (vector > 0), -np.inf, -HELD_SLACK)
        return np.concatenate([lower, least]), np.concatenate([upper, most])

    def _of_slacks(self, values: Collection[float]) -> Array:
        """A number of each requirement, repeated for each of its slacks."""
        return np.repeat(np.array(list(values), dtype=float), [slack.size for slack in self._slacks])

    def _row_bounds(self, parameters: Array, given: Collection[str]) -> tuple[Array, Array]:
        """Bounds of the rows; those of the tool axis are dropped where it may give: its angle is in the cost."""
        low, high = (np.asarray(end, dtype=float).ravel() for end in self._row_ends(parameters))
        dropped = {AXIS} & {*given} | {HELD} - {*given}  # held joints are bounds of the variables
        out = np.array([name in dropped for *_, name in self._rows])
        return np.where(out, -np.inf, low), np.where(out, np.inf, high)

    # --- the program ----------------------------------------------------------------------------------------------

    @cached_property
    def _target_rows(self) -> tuple[Row, ...]:
        """The rows that hold the tool point on its target."""
        return tuple(row for row in self._problem.nlp.rows if row.requirement == TARGET)

    @cached_property
    def _term_rows(self) -> tuple[Row, ...]:
        """The rows of the terms of ``subject_to``, and of the yaw."""
        return tuple(row for row in further_rows(self._problem.nlp) if row.requirement not in self.in_cell)

    @cached_property
    def _slacks(self) -> tuple[_Slack, ...]:
        """Of all requirements but the tool axis, whose angle is a cost of its own: the order of the variables."""
        size, n = self._problem.reach.radius, self._problem.robot.n
        every = [_Slack(TARGET, len(self._target_rows), size, vector=True), _Slack(LIMITS, n, 1.0)]
        every += [_Slack(HELD, len(self.held), 1.0)] if self.held else []
        terms = [name for name in self.further if name != HELD and name not in self.in_cell]
        every += [_Slack(name, 1, self._scale(name)) for name in terms]
        every += [_Slack(name, 1, size) for name in self.in_cell]
        every += [_Slack(name, 3, size, vector=True) for name in self.cell.movable]
        return (*every, *([_Slack(CLEARANCE, 1, size, most=self.cell.scene.margin)] if self.in_cell else []))

    @property
    def _slack_count(self) -> int:
        """Of the variables that are slacks."""
        return sum(slack.size for slack in self._slacks)

    @cached_property
    def _symbols(self) -> dict[str, ca.SX]:
        """The slacks as symbols, in their scales."""
        return {slack.name: ca.SX.sym(slack.name, slack.size) for slack in self._slacks}

    @cached_property
    def _scales(self) -> Array:
        """(G,) what a unit of cost is: the size of the arm, a radian, the bound of a term."""
        scales = {slack.name: slack.scale for slack in self._slacks} | {AXIS: 1.0, LIMITS: 1.0 / LIMIT_COST_FACTOR}
        return np.array([scales[name] for name in self.requirements])

    @cached_property
    def _joint_scales(self) -> list[float]:
        """(n,) a radian, or the size of the arm for a slide."""
        joints, radius = self._problem.robot.joints, self._problem.reach.radius
        return [1.0 if joint.type == "revolute" else radius for joint in joints]

    def _scale(self, name: str) -> float:
        """The largest finite bound of a term: what it lacks is measured in that."""
        rows = [row for row in self._problem.nlp.rows if row.requirement == name]
        ends = [abs(float(end)) for row in rows for end in (row.lower, row.upper) if end.is_constant()]
        return max((end for end in ends if np.isfinite(end)), default=0.0) or ZERO_BOUND_SCALE

    @cached_property
    def _facing(self) -> ca.SX:
        """Cosine of the angle between tool axis and direction; one where the axis is not asked for."""
        name = f"{AXIS}.facing"
        return next((row.expression for row in self._problem.nlp.rows if row.name == name), ca.SX(1))

    @property
    def _tilt(self) -> ca.SX:
        """The angle that the tool axis may lean by."""
        name = f"{AXIS}.sin2_tilt"
        upper = next((row.upper for row in self._problem.nlp.rows if row.name == name), ca.SX(0))
        return ca.asin(ca.fmin(ca.sqrt(upper), 1))

    @cached_property
    def _solver(self) -> NonlinearSolver:
        """IPOPT on the elastic program.

        The norms of shifts and the chord of the axis are rounded off at zero, where they have no slope.
        """
        nlp, axis_free = self._problem.nlp, ca.SX.sym("axis_free")
        cost = axis_free * ca.sqrt(2 * (1 - self._facing) + NORM_ROUNDING)
        for slack in self._slacks:
            symbols = self._symbols[slack.name]
            factor = LIMIT_COST_FACTOR if slack.name == LIMITS else 1.0
            cost += ca.sqrt(ca.sumsqr(symbols) + NORM_ROUNDING) if slack.vector else factor * ca.sum1(symbols)
        program = {
            "x": ca.vertcat(nlp.x, *self._symbols.values()),
            "p": ca.vertcat(nlp.p, axis_free),
            "f": cost,
            "g": ca.vertcat(ca.SX(0, 1), *(expression for expression, *_ in self._rows)),
        }
        options = {"ipopt.max_iter": MAX_ITERATIONS, "ipopt.tol": 1e-7, "ipopt.constr_viol_tol": 1e-8}
        return NonlinearSolver("elastic", program, options)

    @cached_property
    def _row_ends(self) -> ca.Function:
        """``p -> (lower, upper)`` of all rows."""
        ends = [
            ca.vertcat(ca.SX(0, 1), *side)
            for side in zip(*((low, high) for _, low, high, _ in self._rows), strict=True)
        ]
        return ca.Function("ends", [self._problem.nlp.p], ends)

    @cached_property
    def _rows(self) -> tuple[tuple[ca.SX, ca.SX, ca.SX, str], ...]:
        """(expression, lower, upper, requirement) with the slacks in them; each side of a further row by itself."""
        nlp, slacks, zero, infinite = self._problem.nlp, self._symbols, ca.SX(0), ca.SX(np.inf)
        size = self._problem.reach.radius
        rows: list[tuple[ca.SX, ca.SX, ca.SX, str]] = [
            (row.expression - size * slacks[TARGET][k], row.lower, row.upper, TARGET)
            for k, row in enumerate(self._target_rows)
        ]
        rows += [(row.expression, row.lower, row.upper, AXIS) for row in nlp.rows if row.requirement == AXIS]
        for row in self._term_rows:
            scale = self._scale(row.requirement)
            rows += [
                (margin / scale + slacks[row.requirement], zero, infinite, row.requirement) for margin in _margins(row)
            ]
        rows += [(margin, zero, infinite, name) for name, margin in self._cell_margins.items()]
        for k, (low, high) in enumerate(zip(*nlp.variable_bounds, strict=True)):
            scale = self._joint_scales[k]
            margins = [side * (nlp.x[k] - end) / scale for side, end in ((1, low), (-1, high)) if np.isfinite(end)]
            rows += [(margin + slacks[LIMITS][k], zero, infinite, LIMITS) for margin in margins]
        for i, (k, value) in enumerate(self.held.items()):
            off = (nlp.x[k] - value) / self._joint_scales[k]
            rows += [(side * off + slacks[HELD][i], zero, infinite, HELD) for side in (1, -1)]
        return tuple(rows)

    @cached_property
    def _cell_margins(self) -> dict[str, ca.SX]:
        """What each row of the cell has to spare [m], with the slacks of this program."""
        if not self.in_cell:
            return {}
        size, cell, slacks, scene = self._problem.reach.radius, self.cell, self._symbols, self.cell.scene
        count = range(len(scene.obstacles))
        row_of, place_of = ({k: name for name, k in names.items()} for names in (cell.obstacles, cell.movable))
        less = ca.vertcat(ca.SX(0, 1), *(slacks[row_of[k]] if k in row_of else ca.SX(0) for k in count))
        shifts = ca.horzcat(ca.SX(3, 0), *(slacks[place_of[k]] if k in place_of else ca.SX.zeros(3) for k in count))
        margins = ca.vertcat(*(row.margin for row in cell.rows))
        (margins,) = ca.substitute(
            [margins], [cell.less, cell.shifts, cell.clearance], [size * less, size * shifts, size * slacks[CLEARANCE]]
        )
        own = [0 if name in cell.obstacles else size * slacks[name] for name in self.in_cell]  # no obstacle's: a row's
        return {name: margins[i] + own[i] for i, name in enumerate(self.in_cell)}

    @cached_property
    def _lacking(self) -> BatchFunction:
        """``(q, p, slacks) -> (G,)`` what each requirement lacks: of the cell its slack and what is missing with it."""
        nlp, zero, slacks = self._problem.nlp, ca.SX(0), self._symbols
        off = [ca.fmax(ca.fmax(r.lower - r.expression, r.expression - r.upper), 0) for r in self._target_rows]
        angle = 2 * ca.asin(ca.fmin(ca.sqrt(ca.fmax(2 * (1 - self._facing), 0)) / 2, 1))
        lower, upper = nlp.variable_bounds
        beyond = ca.fmax(ca.fmax(ca.DM(lower) - nlp.x, nlp.x - ca.DM(upper)), 0) / ca.DM(self._joint_scales)
        amounts = {TARGET: ca.norm_2(ca.vertcat(zero, *off)), AXIS: ca.fmax(angle - self._tilt, 0)}
        amounts |= {LIMITS: ca.mmax(beyond), **dict.fromkeys(self.further, zero)}
        for k, value in self.held.items():
            amounts[HELD] = ca.fmax(amounts[HELD], ca.fabs(nlp.x[k] - value) / self._joint_scales[k])
        for row in self._term_rows:
            for margin in _margins(row):
                amounts[row.requirement] = ca.fmax(amounts[row.requirement], -margin)
        size = self._problem.reach.radius
        for name, margin in self._cell_margins.items():
            amounts[name] = size * slacks[name] + ca.fmax(-margin, 0)
        for name in self.requirements[3 + len(self.further) :]:
            amounts[name] = size * ca.norm_2(slacks[name])
        parts = ca.densify(ca.vertcat(*(amounts[name] for name in self.requirements)))
        function = ca.Function("lacking", [nlp.x, nlp.p, ca.vertcat(*slacks.values())], [parts])
        return BatchFunction(function, compiled=False)


def further_rows(nlp: Nlp) -> tuple[Row, ...]:
    """The rows of terms and obstacles: all but those of target and tool axis."""
    return tuple(row for row in nlp.rows if row.requirement not in (TARGET, AXIS))


def _margins(row: Row) -> list[ca.SX]:
    """What a row has to spare on each side that is bounded [unit]; negative where it is violated."""
    sides = ((1, row.lower), (-1, row.upper))
    return [side * (row.expression - end) for side, end in sides if not end.is_constant() or np.isfinite(float(end))]
