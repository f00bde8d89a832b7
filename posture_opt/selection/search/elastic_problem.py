"""``ElasticProblem``: by how little a requirement must give for all the others to be met; ``GivingScene``: the cell's.

Every requirement – target, tool axis, joint limits, held joints, terms, obstacles – can give by a slack, and the scaled
sum of slacks is minimised (elastic mode of Gill, Murray and Saunders 2005, SNOPT, section 1.3); slacks that may not
are held at zero by their bounds. Inside of a solid the distance has no slope that leads out, so the solid gives: every
face recedes by a slack, or all of it moves by one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import casadi as ca
import numpy as np

from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.scene import SELF_CLEARANCE_ROW, Scene, row_name
from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array, Mask
from posture_opt.selection.program.nlp import Nlp, NonlinearSolver, Row
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE

TARGET, AXIS, LIMITS, HELD = "target", "tool_axis", "limits", "fixed_joints"
HELD_SLACK = 1e-10  # of what may not give: as a free variable it keeps IPOPT from counting too few of them
NORM_ROUNDING = 1e-7  # m or rad, squared: where the norm of a slack near zero is rounded off
LIMIT_COST_FACTOR = 3.0  # times the cost: limits of joints are built in
WIDENED_LIMIT = 4 * np.pi  # rad or m: of a joint without its limits
_HEIGHT = f"{TARGET}.z"  # the row that holds the tool point at the height of the target


@dataclass(frozen=True)
class Compromise:
    """A posture that meets some requirements only in part."""

    q: Array  # (n,) [rad or m]
    lacking: Mapping[str, float]  # what each requirement lacks [unit]
    cost: float  # Σ lacking, each in its own scale
    slacks: Mapping[str, Array]  # what gives [unit]: target and place of an obstacle (3,)

    @property
    def met(self) -> bool:
        return not self.giving

    @property
    def giving(self) -> tuple[str, ...]:
        """The requirements that give."""
        return tuple(name for name, amount in self.lacking.items() if not amount <= ROW_TOLERANCE)


@dataclass(frozen=True)
class _Slack:
    """The slack of one requirement: a ``vector`` with a norm, or numbers that are not below zero."""

    name: str
    size: int
    scale: float  # [unit]
    vector: bool = False
    most: float = math.inf  # [unit]


class ElasticProblem:
    """The elastic form of a problem: ``min Σ_k c_k s_k`` over postures and slacks ``s_k ≥ 0``.

    ``held``: joint index -> value [rad or m] of joints that the task holds and ``problem`` leaves free. Requirements
    are the target, the tool axis, the limits, held joints, terms, rows of the cell, places and clearance of it.
    """

    def __init__(self, problem: OptimisationProblem, held: Mapping[int, float] | None = None) -> None:
        self._problem = problem
        self.held: dict[int, float] = dict(held or {})
        self.cell: GivingScene = GivingScene.of(problem)
        self.in_cell: tuple[str, ...] = tuple(self.cell.rows)
        terms = dict.fromkeys(row.requirement for row in self._term_rows)
        self.further: tuple[str, ...] = (*([HELD] if self.held else []), *terms, *self.in_cell)
        beside = (*self.cell.movable, *([CLEARANCE] if self.in_cell else []))
        self.requirements: tuple[str, ...] = (TARGET, AXIS, LIMITS, *self.further, *beside)

    def lacking(self, Q: Array, parameters: Array) -> Array:
        """(N, G) what each requirement lacks at postures Q (N, n) [rad or m], zero where it is met.

        Distance from the target [m], angle beyond the tilt [rad], largest excess of a joint [rad, or the arm's size],
        violation of a row [unit]; of an obstacle the depth at its surface.
        """
        return np.asarray(self._lacking(Q, parameters, np.zeros(sum(slack.size for slack in self._slacks))))

    def cost(self, lacking: Array) -> Array:
        """The cost (…,) of what requirements lack, (…, G): ``Σ_k lacking_k / scale_k``."""
        return np.asarray(lacking @ (1.0 / self._scales))

    def least(
        self, parameters: Array, given: Collection[str], starts: Array, *, level: bool = False
    ) -> Compromise | None:
        """The best from ``starts`` (k, n) where only ``given`` may give; ``level``: at the target's height."""
        found: list[Compromise] = []
        for k, start in enumerate(starts):
            if not found and k == 7:  # after 7 fruitless starts others seldom do
                break
            one = self._compromise(start, parameters, given, level)
            found += [] if one is None else [one]
            least = min((other.cost for other in found), default=math.inf)
            alike = sum(other.cost <= least * (1 + 1e-3) for other in found)
            if alike == 3 or any(other.met for other in found):
                break
        return min(found, key=lambda other: other.cost, default=None)

    def _compromise(self, start: Array, parameters: Array, given: Collection[str], level: bool) -> Compromise | None:
        """Where IPOPT ends from one start, or None if a requirement fails that may not give."""
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
        return self.compromise(q, lacking, self._by_name(slacks))

    def compromise(self, q: Array, lacking: Array, slacks: Mapping[str, Array]) -> Compromise:
        """A posture (n,) that lacks (G,)."""
        return Compromise(
            q, dict(zip(self.requirements, lacking.tolist(), strict=True)), float(self.cost(lacking)), slacks
        )

    def _by_name(self, slacks: Array) -> dict[str, Array]:
        """Slacks (s,) by requirement, from their scales to [unit]."""
        ends = np.cumsum([slack.size for slack in self._slacks])
        parts = np.split(slacks, ends[:-1])
        return {slack.name: slack.scale * part for slack, part in zip(self._slacks, parts, strict=True)}

    def _needed(self, q: Array, parameters: Array, given: Collection[str]) -> Array:
        lacking = dict(zip(self.requirements, self.lacking(q[None], parameters)[0], strict=True))
        parts = []
        for slack in self._slacks:
            if slack.name in self.cell.movable and slack.name in given:
                parts.append(self.cell.start_shift(self.cell.movable[slack.name], q) / slack.scale)
            else:
                parts.append(np.full(slack.size, 0.0 if slack.vector else lacking[slack.name] / slack.scale))
        return np.concatenate(parts)

    def _variable_bounds(self, given: Collection[str]) -> tuple[Array, Array]:
        """Slacks that may not give are held next to zero; joints whose limits may give are freed."""
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
        return np.repeat(np.array(list(values), dtype=float), [slack.size for slack in self._slacks])

    def _row_bounds(self, parameters: Array, given: Collection[str]) -> tuple[Array, Array]:
        low, high = (np.asarray(end, dtype=float).ravel() for end in self._row_ends(parameters))
        dropped = {AXIS} & {*given} | {HELD} - {*given}  # held joints are bounds of the variables
        out = np.array([name in dropped for *_, name in self._rows])
        return np.where(out, -np.inf, low), np.where(out, np.inf, high)

    # --- the program ----------------------------------------------------------------------------------------------

    @cached_property
    def _target_rows(self) -> tuple[Row, ...]:
        return tuple(row for row in self._problem.nlp.rows if row.requirement == TARGET)

    @cached_property
    def _term_rows(self) -> tuple[Row, ...]:
        """The rows of the terms of ``subject_to``, and of the yaw."""
        return tuple(row for row in further_rows(self._problem.nlp) if row.requirement not in self.in_cell)

    @cached_property
    def _slacks(self) -> tuple[_Slack, ...]:
        size, n = self._problem.reach.radius, self._problem.robot.n
        every = [_Slack(TARGET, len(self._target_rows), size, vector=True), _Slack(LIMITS, n, 1.0)]
        every += [_Slack(HELD, len(self.held), 1.0)] if self.held else []
        terms = [name for name in self.further if name != HELD and name not in self.in_cell]
        every += [_Slack(name, 1, self._scale(name)) for name in terms]
        every += [_Slack(name, 1, size) for name in self.in_cell]
        every += [_Slack(name, 3, size, vector=True) for name in self.cell.movable]
        return (*every, *([_Slack(CLEARANCE, 1, size, most=self.cell.scene.margin)] if self.in_cell else []))

    @cached_property
    def _symbols(self) -> dict[str, ca.SX]:
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
        rows = [row for row in self._problem.nlp.rows if row.requirement == name]
        ends = [abs(float(end)) for row in rows for end in (row.lower, row.upper) if end.is_constant()]
        return max((end for end in ends if np.isfinite(end)), default=0.0) or 0.1

    @cached_property
    def _facing(self) -> ca.SX:
        name = f"{AXIS}.facing"
        return next((row.expression for row in self._problem.nlp.rows if row.name == name), ca.SX(1))

    @property
    def _tilt(self) -> ca.SX:
        name = f"{AXIS}.sin2_tilt"
        upper = next((row.upper for row in self._problem.nlp.rows if row.name == name), ca.SX(0))
        return ca.asin(ca.fmin(ca.sqrt(upper), 1))

    @cached_property
    def _solver(self) -> NonlinearSolver:
        """IPOPT; norms of shifts and the chord of the axis are rounded off at zero, where they have no slope."""
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
        options = {"ipopt.max_iter": 100, "ipopt.tol": 1e-7, "ipopt.constr_viol_tol": 1e-8}
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
        margins = ca.vertcat(*cell.rows.values())
        (margins,) = ca.substitute(
            [margins], [cell.less, cell.shifts, cell.clearance], [size * less, size * shifts, size * slacks[CLEARANCE]]
        )
        own = [0 if name in cell.obstacles else size * slacks[name] for name in self.in_cell]  # no obstacle's: a row's
        return {name: margins[i] + own[i] for i, name in enumerate(self.in_cell)}

    @cached_property
    def _lacking(self) -> BatchFunction:
        """``(q, p, slacks) -> (G,)`` lacking amounts; of the cell the slack and the remainder."""
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
    """Rows of terms and obstacles."""
    return tuple(row for row in nlp.rows if row.requirement not in (TARGET, AXIS))


def _margins(row: Row) -> list[ca.SX]:
    """Margins of a row to its bounded sides [unit]; negative if violated."""
    sides = ((1, row.lower), (-1, row.upper))
    return [side * (row.expression - end) for side, end in sides if not end.is_constant() or np.isfinite(float(end))]


CLEARANCE = "clearance of the cell"  # the requirement that everything keeps the clearance of the cell
# What is left of an obstacle that is made smaller [m], half of its least thickness; where it must give more, it has
# to go.
LEAST_THICKNESS_M = 1e-3
_SHIFTS_TRIED_M = np.geomspace(2e-3, 4.0, 50)


def place_of(obstacle: str) -> str:
    return f"place of {obstacle}"


@dataclass(frozen=True)
class GivingScene:
    """The rows of a problem's cell, with the slacks of its k obstacles as symbols [m]."""

    problem: OptimisationProblem
    less: ca.SX  # (k,) how far the faces recede
    shifts: ca.SX  # (3, k) how far each moves, world
    clearance: ca.SX  # taken off the clearance of the cell

    @classmethod
    def of(cls, problem: OptimisationProblem) -> GivingScene:
        """The slacks of a problem's cell, if it has a scene."""
        k = 0 if problem.scene is None else len(problem.scene.obstacles)
        return cls(problem, ca.SX.sym("less", k), ca.SX.sym("shift", 3, k), ca.SX.sym("clearance"))

    @property
    def scene(self) -> Scene:
        assert self.problem.scene is not None
        return self.problem.scene

    @cached_property
    def rows(self) -> dict[str, ca.SX]:
        """Name of each row -> its margin [m], slacks included."""
        if self.problem.scene is None:
            return {}
        obstacles = self.scene.obstacles
        if not obstacles:  # of the arm to itself: the rows are there already
            given = [row for row in self.problem.nlp.rows if row.requirement == SELF_CLEARANCE_ROW]
            return {row.name: row.expression - row.lower + self.clearance for row in given}
        most = [self._most(obstacle) for obstacle in obstacles]
        beyond = {row_name(o.name): ca.fmax(self.less[k] - most[k], 0) for k, o in enumerate(obstacles)}
        giving = [
            obstacle.smaller(ca.fmin(self.less[k], most[k])).moved(ca.vertsplit(self.shifts[:, k]))
            for k, obstacle in enumerate(obstacles)
        ]
        return {
            row.name: row.expression - row.lower + self.clearance + beyond.get(row.name, 0)
            for row in self.problem.clearance_rows(giving)
        }

    @cached_property
    def obstacles(self) -> dict[str, int]:
        """Name of the row -> number of its obstacle, of all that have a row."""
        if self.problem.scene is None:
            return {}
        numbers = {row_name(obstacle.name): k for k, obstacle in enumerate(self.scene.obstacles)}
        return {name: numbers[name] for name in self.rows if name in numbers}

    @cached_property
    def movable(self) -> dict[str, int]:
        """`place_of` -> number of an obstacle that a move takes away; a wall has no end."""
        found = {k: self.scene.obstacles[k] for k in self.obstacles.values()}
        return {place_of(o.name): k for k, o in found.items() if np.isfinite(o.half_thickness)}

    def start_shift(self, k: int, q: Array) -> Array:
        """(3,) a short move [m] that takes obstacle k out of the way of the posture q (n,); zeros where none does."""
        scene, obstacle, chosen = self.scene, self.scene.obstacles[k], list(self.scene.against[k])
        start, end = (ends[0, chosen] for ends in scene.placed.segments(q[None]))
        ways = np.array([way for way in product((-1.0, 0.0, 1.0), repeat=3) if way != (0.0, 0.0, 0.0)])
        shifts = (ways / np.linalg.norm(ways, axis=1, keepdims=True))[:, None] * _SHIFTS_TRIED_M[:, None]
        back = shifts[:, :, None]
        away = obstacle.distance(start - back, end - back) - scene.placed.radii[chosen]
        clear: Mask = np.all(away >= scene.margin, axis=2)
        first = np.where(clear.any(axis=1), clear.argmax(axis=1), len(_SHIFTS_TRIED_M))
        way = int(np.argmin(first))
        return np.asarray(shifts[way, first[way]]) if first[way] < len(_SHIFTS_TRIED_M) else np.zeros(3)

    def _most(self, obstacle: Obstacle) -> float:
        """By how much an obstacle can be made smaller [m]; of one without end any length."""
        return min(max(obstacle.half_thickness - LEAST_THICKNESS_M, 0.0), 1e3)


def gives_enough(obstacles: Sequence[Obstacle], name: str, by: float) -> Obstacle | None:
    """The named obstacle made smaller [m], or None if too little is left."""
    obstacle = next(o for o in obstacles if o.name == name)
    return obstacle.smaller(by) if by <= obstacle.half_thickness - LEAST_THICKNESS_M else None
