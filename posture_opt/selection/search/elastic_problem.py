"""``ElasticProblem``: by how little a requirement must give for all the others to be met.

Every requirement – target, tool axis, joint limits, each term, each obstacle – can give by a slack, and the sum of the
slacks is minimised, each in its own scale (the elastic mode of Gill, Murray and Saunders 2005, SNOPT, section 1.3). One
nonlinear program serves every choice of what may give: slacks that may not are held at zero by their bounds.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array, Mask
from posture_opt.selection.program.nlp import Nlp, Row
from posture_opt.selection.program.nonlinear_solver import NonlinearSolver
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE

TARGET, AXIS, LIMITS = "target", "tool_axis", "limits"
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


@dataclass(frozen=True)
class Compromise:
    """A posture that meets some requirements only in part.

    Args:
        q: (n,) [rad or m].
        lacking: (G,) what each requirement lacks, in the order of `ElasticProblem.requirements` [unit].
        cost: the sum of what is lacking, each in its own scale.
    """

    q: Array
    lacking: Array
    cost: float

    @property
    def met(self) -> bool:
        """Whether nothing is missing after all."""
        return bool(np.all(self.lacking <= ROW_TOLERANCE))


class ElasticProblem:
    """The elastic form of one optimisation problem: ``min Σ_k c_k s_k`` over postures and slacks ``s_k ≥ 0``.

    Args:
        problem: n joints.

    Attributes:
        requirements: names of all that may give: the target, the tool axis, the limits, then terms and obstacles.
    """

    def __init__(self, problem: OptimisationProblem) -> None:
        self._problem = problem
        further = dict.fromkeys(row.requirement for row in further_rows(problem.nlp))
        self.requirements: tuple[str, ...] = (TARGET, AXIS, LIMITS, *further)

    @property
    def further(self) -> tuple[str, ...]:
        """The requirements without target, tool axis and limits: terms and obstacles."""
        return self.requirements[3:]

    def lacking(self, Q: Array, parameters: Array) -> Array:
        """What each requirement lacks, (N, G), at postures Q (N, n) [rad or m].

        Distance from the target [m], angle of the axis beyond the tilt [rad], the largest excess of a joint [rad, or
        the arm's size], the largest violation of a row [unit]; zero where it is met.

        Args:
            parameters: (p,) of the target.
        """
        return np.asarray(self._lacking(Q, parameters))

    def cost(self, lacking: Array) -> Array:
        """The cost (…,) of what requirements lack, (…, G): ``Σ_k lacking_k / scale_k``."""
        return np.asarray(lacking @ (1.0 / self._scales))

    def least(self, parameters: Array, given: Collection[str], starts: Array) -> Compromise | None:
        """The best that IPOPT finds where only the requirements ``given`` may give; None where others are not met.

        Args:
            parameters: (p,) of the target.
            starts: (k, n) postures; the first that leads to one where nothing is missing ends the search.
        """
        found: list[Compromise] = []
        for k, start in enumerate(starts):
            if not found and k == MAX_FRUITLESS_STARTS:
                break
            one = self._compromise(start, parameters, given)
            found += [] if one is None else [one]
            least = min((other.cost for other in found), default=math.inf)
            alike = sum(other.cost <= least * (1 + COST_TOLERANCE) for other in found)
            if alike == STARTS_THAT_AGREE or any(other.met for other in found):
                break
        return min(found, key=lambda other: other.cost, default=None)

    def _compromise(self, start: Array, parameters: Array, given: Collection[str]) -> Compromise | None:
        """Where IPOPT ends from one start; None where a requirement that may not give is not met there."""
        may = np.array([name in given for name in self.requirements])
        lower, upper = self._variable_bounds(may)
        low, high = self._row_bounds(parameters, may)
        x0 = np.concatenate([start, np.clip(self._needed(start, parameters), lower[len(start) :], upper[len(start) :])])
        p = np.append(parameters, float(may[1]))
        found = self._solver.solve(x0, lower, upper, low, high, p=p).x
        q = found[: len(start)]
        if not may[2]:
            q = np.clip(q, *self._problem.nlp.variable_bounds)
        if not np.all(np.isfinite(q)):
            return None
        lacking = self.lacking(q[None], parameters)[0]
        if np.any(lacking[~may] > ROW_TOLERANCE):
            return None
        return Compromise(q, lacking, float(self.cost(lacking)))

    def _needed(self, q: Array, parameters: Array) -> Array:
        """The slacks that a posture needs: IPOPT starts where what may give has given enough."""
        lacking = self.lacking(q[None], parameters)[0] / self._scales
        shift = np.zeros(self._slack_sizes[0][1])
        return np.concatenate([shift, *(np.full(size, lacking[k]) for k, size in self._slack_sizes[1:])])

    def _variable_bounds(self, may: Mask) -> tuple[Array, Array]:
        """Bounds of joints and slacks: slacks that may not give are held next to zero, joints whose limits may give are
        freed.
        """
        lower, upper = self._problem.nlp.variable_bounds
        if may[2]:
            lower, upper = np.full_like(lower, -WIDENED_LIMIT), np.full_like(upper, WIDENED_LIMIT)
        free = np.concatenate([np.full(size, may[k]) for k, size in self._slack_sizes])
        most = np.where(free, np.inf, HELD_SLACK)
        least = np.where(free & (np.arange(len(free)) < self._slack_sizes[0][1]), -np.inf, -HELD_SLACK)
        return np.concatenate([lower, least]), np.concatenate([upper, most])

    def _row_bounds(self, parameters: Array, may: Mask) -> tuple[Array, Array]:
        """Bounds of the rows; those of the tool axis are dropped where it may give: its angle is in the cost."""
        low, high = (np.asarray(end, dtype=float).ravel() for end in self._row_ends(parameters))
        if may[1]:
            of_axis = np.array([name == AXIS for *_, name in self._rows])
            low, high = np.where(of_axis, -np.inf, low), np.where(of_axis, np.inf, high)
        return low, high

    # --- the program ----------------------------------------------------------------------------------------------

    @cached_property
    def _target_rows(self) -> tuple[Row, ...]:
        """The rows that hold the tool point on its target."""
        return tuple(row for row in self._problem.nlp.rows if row.requirement == TARGET)

    @cached_property
    def _slack_sizes(self) -> tuple[tuple[int, int], ...]:
        """(which requirement, how many slacks): a shift of the target, one of every limit, one of the others each."""
        further = range(3, len(self.requirements))
        return (0, len(self._target_rows)), (2, self._problem.robot.n), *((k, 1) for k in further)

    @cached_property
    def _slacks(self) -> dict[int, ca.SX]:
        """The slacks as symbols, by the number of their requirement."""
        return {k: ca.SX.sym(self.requirements[k], size) for k, size in self._slack_sizes}

    @cached_property
    def _scales(self) -> Array:
        """(G,) what a unit of cost is: the size of the arm, a radian, the bound of a term."""
        return np.array(
            [self._problem.reach.radius, 1.0, 1.0 / LIMIT_COST_FACTOR, *(self._scale(name) for name in self.further)]
        )

    @cached_property
    def _joint_scales(self) -> list[float]:
        """(n,) a radian, or the size of the arm for a slide."""
        joints, radius = self._problem.robot.joints, self._problem.reach.radius
        return [1.0 if joint.type == "revolute" else radius for joint in joints]

    def _scale(self, name: str) -> float:
        """The largest finite bound of a term or obstacle: what it lacks is measured in that."""
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

        The norm of the shift and the chord of the axis are rounded off at zero, where they have no slope.
        """
        nlp, slacks, axis_free = self._problem.nlp, self._slacks, ca.SX.sym("axis_free")
        chord, shift = ca.sqrt(2 * (1 - self._facing) + NORM_ROUNDING), ca.sqrt(ca.sumsqr(slacks[0]) + NORM_ROUNDING)
        cost = axis_free * chord + shift / self._scales[0] + LIMIT_COST_FACTOR * ca.sum1(slacks[2])
        cost += ca.sum1(ca.vertcat(ca.SX(0), *(slacks[k] for k, _ in self._slack_sizes[2:])))
        program = {
            "x": ca.vertcat(nlp.x, *slacks.values()),
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
        nlp, slacks, zero, infinite = self._problem.nlp, self._slacks, ca.SX(0), ca.SX(np.inf)
        shifted = enumerate(self._target_rows)
        rows: list[tuple[ca.SX, ca.SX, ca.SX, str]] = [
            (row.expression - slacks[0][k], row.lower, row.upper, TARGET) for k, row in shifted
        ]
        rows += [(row.expression, row.lower, row.upper, AXIS) for row in nlp.rows if row.requirement == AXIS]
        for row in further_rows(nlp):
            k = self.requirements.index(row.requirement)
            for margin in _margins(row):
                rows.append((margin / self._scales[k] + slacks[k], zero, infinite, row.requirement))
        for k, (low, high) in enumerate(zip(*nlp.variable_bounds, strict=True)):
            scale = self._joint_scales[k]
            margins = [side * (nlp.x[k] - end) / scale for side, end in ((1, low), (-1, high)) if np.isfinite(end)]
            rows += [(margin + slacks[2][k], zero, infinite, LIMITS) for margin in margins]
        return tuple(rows)

    @cached_property
    def _lacking(self) -> BatchFunction:
        """``(q, p) -> (G,)`` what each requirement lacks."""
        nlp, zero = self._problem.nlp, ca.SX(0)
        off = [ca.fmax(ca.fmax(r.lower - r.expression, r.expression - r.upper), 0) for r in self._target_rows]
        angle = 2 * ca.asin(ca.fmin(ca.sqrt(ca.fmax(2 * (1 - self._facing), 0)) / 2, 1))
        lower, upper = nlp.variable_bounds
        beyond = ca.fmax(ca.fmax(ca.DM(lower) - nlp.x, nlp.x - ca.DM(upper)), 0) / ca.DM(self._joint_scales)
        worst = dict.fromkeys(self.further, zero)
        for row in further_rows(nlp):
            for margin in _margins(row):
                worst[row.requirement] = ca.fmax(worst[row.requirement], -margin)
        parts = [ca.norm_2(ca.vertcat(zero, *off)), ca.fmax(angle - self._tilt, 0), ca.mmax(beyond), *worst.values()]
        return BatchFunction(ca.Function("lacking", [nlp.x, nlp.p], [ca.densify(ca.vertcat(*parts))]), compiled=False)


def further_rows(nlp: Nlp) -> tuple[Row, ...]:
    """The rows of terms and obstacles: all but those of target and tool axis."""
    return tuple(row for row in nlp.rows if row.requirement not in (TARGET, AXIS))


def _margins(row: Row) -> list[ca.SX]:
    """What a row has to spare on each side that is bounded [unit]; negative where it is violated."""
    sides = ((1, row.lower), (-1, row.upper))
    return [side * (row.expression - end) for side, end in sides if not end.is_constant() or np.isfinite(float(end))]
