"""``Relaxation``: a change that would make a task possible, and the requirements that are missed without it.

Numbers in its sentences are rounded to the side that suffices: following the advice makes the task possible.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from posture_opt.collision.scene import SELF_CLEARANCE_ROW, row_name
from posture_opt.numerics import Array, Json
from posture_opt.robot.posture import Posture
from posture_opt.selection.program.nlp import Row
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import Reach, TaskTarget
from posture_opt.selection.search.elastic_problem import AXIS, LIMITS, TARGET, Compromise, ElasticProblem

YAW = "yaw"
"""The requirement to hold the spin of the tool."""
VISIBLE_EXCESS = 1e-6  # rad or m beyond a limit that is worth a word
MAIN_DIRECTION_COSINE = 0.9  # cosine: a move in about that direction


@dataclass(frozen=True)
class Reason:
    """One requirement that cannot be met.

    Args:
        requirement: its name: ``target``, ``tool_axis``, ``JOINT.limits``, or that of a term or obstacle.
        message: a sentence for reports.
        amount: by how much it fails, in ``unit``: m, rad, or that of the term.
    """

    requirement: str
    message: str
    amount: float
    unit: str


@dataclass(frozen=True)
class Relaxation:
    """A change that makes the task possible.

    Args:
        change: what to change, in words.
        reasons: what is missed until then.
        posture: joint name -> rad or m, which then does the task.
        cost: compares changes: a move in units of the arm's size, angles in rad, bounds relative to their size.
    """

    change: str
    reasons: tuple[Reason, ...]
    posture: dict[str, float]
    cost: float

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI."""
        return {"change": self.change, "reasons": [vars(reason) for reason in self.reasons], "posture": self.posture}


def relaxation(
    problem: OptimisationProblem, elastic: ElasticProblem, target: TaskTarget, names: Sequence[str], way: Compromise
) -> Relaxation:
    """The relaxation of the requirements ``names`` that a compromise shows to suffice.

    Args:
        elastic: the problem that the compromise solves, for the order of its requirements.
        names: of what is relaxed together; the changes are joined by "and".
        way: the posture (n,) [rad or m] and what it lacks.
    """
    posture = Posture(problem.robot, way.q)
    lacking = dict(zip(elastic.requirements, map(float, way.lacking), strict=True))
    words = _RelaxationWords(problem, elastic, target, way.q)
    parts = [part for name in names if lacking[name] > 0 for part in words.parts(name, lacking[name], len(names) > 1)]
    changes = list(dict.fromkeys(change for change, _ in parts))
    return Relaxation(" and ".join(changes), tuple(reason for _, reason in parts), posture, way.cost)


def plane_reason(reach: Reach, target: TaskTarget) -> Reason | None:
    """The reason why an arm that moves in a plane, or on a line, cannot reach a target outside of it; None where it
    can.

    The message has the distance [mm] and the shift of the target (3,), world frame, onto that plane.
    """
    if not reach.misses(target.lower, target.upper):
        return None
    shift = reach.outside(target.lower, target.upper)
    distance = float(np.linalg.norm(shift))
    message = (
        f"the target lies {distance * 1e3:.4g} mm outside the plane that this arm moves in: "
        f"move it by {millimetres(shift)}"
    )
    return Reason(TARGET, message, distance, "m")


@dataclass(frozen=True)
class _RelaxationWords:
    """The words for one compromise: what is missed at its posture q (n,), and what to change."""

    problem: OptimisationProblem
    elastic: ElasticProblem
    target: TaskTarget
    q: Array

    def parts(self, name: str, amount: float, beside_others: bool) -> list[tuple[str, Reason]]:
        """(what to change, what is missed) for each part of a requirement."""
        if name == TARGET:
            return [self._target(beside_others)]
        if name == AXIS:
            return [self._axis(amount)]
        return self._limits() if name == LIMITS else [self._further(name)]

    def _target(self, beside_others: bool) -> tuple[str, Reason]:
        """The shift [mm] that brings the target to the nearest point that the tool reaches."""
        point = np.array(self.problem.tool_point.walk(self.q.tolist())[0].position, dtype=float)
        gap = np.clip(point, self.target.lower, self.target.upper) - point
        distance = float(np.linalg.norm(gap))
        condition = "" if beside_others else self._condition()
        change = f"move the target by {millimetres(-gap)}{self._way(-gap)}"
        message = (
            f"the target is out of reach by {distance * 1e3:.4g} mm{condition}; the nearest point that the tool "
            f"reaches is {millimetres(point)}: {change}"
        )
        return change, Reason(TARGET, message, distance, "m")

    def _condition(self) -> str:
        """What holds at the nearest point, in addition to the limits of the joints."""
        axis = ["the tool axis along the direction"] if self.problem.axis_rows else []
        further = [name for name in self.elastic.further if name != SELF_CLEARANCE_ROW]
        conditions = [*axis, *(["all further requirements met"] if further else [])]
        return f" with {' and '.join(conditions)}" if conditions else ""

    def _way(self, shift: Array) -> str:
        """A word for the direction of a move, where there is one."""
        distance = float(np.linalg.norm(shift))
        screws = self.problem.tool_point.walk(self.q.tolist())[0].screws
        foot = np.array(screws[len(self.problem.robot.base)].origin, dtype=float)
        out = (self.target.lower + self.target.upper) / 2 - foot
        out[2] = 0.0
        if distance == 0 or not np.isfinite(out).all() or np.linalg.norm(out) < 1e-9:
            return ""
        along, up = float(shift @ out / np.linalg.norm(out)) / distance, float(shift[2]) / distance
        words = [(-along, "towards the base"), (along, "away from the base"), (up, "up"), (-up, "down")]
        cosine, word = max(words)
        return f", {distance * 1e3:.4g} mm{f' {word}' if cosine >= MAIN_DIRECTION_COSINE else ''}"

    def _axis(self, missing: float) -> tuple[str, Reason]:
        """The tilt that would do, rounded up to a tenth of a degree."""
        allowed = math.degrees(self.target.tilt)
        needed = allowed + math.degrees(missing)
        change = f"set tilt: {_up(needed, 1):g} deg"
        message = (
            f"at this target the tool axis comes no closer than {needed:.3g} deg to the direction, and "
            f"{allowed:.3g} deg are allowed; {change}, or move the target"
        )
        return f"{change} (now {allowed:.3g} deg)", Reason(AXIS, message, missing, "rad")

    def _limits(self) -> list[tuple[str, Reason]]:
        """Each joint that would have to leave its limits, and by how much."""
        parts = []
        for value, joint in zip(self.q, self.problem.robot.joints, strict=True):
            amount = max(joint.lower - value, value - joint.upper, 0.0)
            if amount > VISIBLE_EXCESS:
                bound = joint.lower if value < joint.lower else joint.upper
                wanted, limit, beyond = (shown(v, joint.unit) for v in (value, bound, amount))
                what = "target and tool axis" if self.problem.axis_rows else "target"
                message = (
                    f"{joint.name} would have to go to {wanted}, {beyond} beyond its limit {limit}, to meet the {what}"
                )
                change = f"let {joint.name} go to {wanted} (limit {limit})"
                parts.append((change, Reason(f"{joint.name}.limits", message, float(amount), joint.unit)))
        return parts

    def _further(self, name: str) -> tuple[str, Reason]:
        """The row of a term or obstacle that lacks most, ``max(lower − value, value − upper)``."""
        rows = [row for row in self.problem.nlp.rows if row.requirement == name]
        nlp = self.problem.nlp
        at = ca.Function("at", [nlp.x, nlp.p], [ca.vertcat(row.expression, row.lower, row.upper) for row in rows])
        values = [np.asarray(v, dtype=float).ravel().tolist() for v in at.call([self.q, self.target.parameters])]
        missing = [max(low - value, value - high) for value, low, high in values]
        k = int(np.argmax(missing))
        if rows[0].name == YAW:
            return self._yaw(values[0][0], values[1][0])
        return self._row(rows[k], missing[k], *values[k])

    def _yaw(self, sine: float, cosine: float) -> tuple[str, Reason]:
        """The yaw that the tool comes nearest to, from sine and cosine of what it is off by."""
        off = abs(math.atan2(sine, cosine))
        message = f"at this target the tool turns no nearer than {math.degrees(off):.4g} deg to the wanted yaw"
        change = f"change the yaw by {_up(math.degrees(off), 2):g} deg, or leave it out"
        return change, Reason(YAW, message, off, "rad")

    def _row(self, row: Row, missing: float, value: float, low: float, high: float) -> tuple[str, Reason]:
        """The bound that would do for a term, or the room that an obstacle has to make."""
        shown_value, bound = row.shown(value), row.shown(low if value < low else high)
        below = shown_value < bound
        reached, stated = shown(shown_value, row.unit), shown(bound, row.unit)
        if below:
            message = f"{row.name} is {reached} at most, and at least {stated} is required"
        else:
            message = f"{row.name} is {reached} at least, and at most {stated} is allowed"
        if row.name in self._obstacles:
            change = self._too_near(self._obstacles[row.name], missing, value, low)
            return change, Reason(row.name, message, missing, row.unit)
        key = "at_least" if below else "at_most"
        change = f"set {key} of {row.requirement} to {enough(shown_value, row.unit, below)} (now {stated})"
        return change, Reason(row.name, message, abs(shown_value - bound), row.unit)

    @property
    def _obstacles(self) -> dict[str, str]:
        """Name of a row of the cell -> of what has to make room."""
        scene = self.problem.scene
        if scene is None:
            return {}
        return {row_name(o.name): f"obstacle {o.name} must give" for o in scene.obstacles} | {
            SELF_CLEARANCE_ROW: "links that are not neighbours would have to give"
        }

    def _too_near(self, what: str, missing: float, value: float, margin: float) -> str:
        """How much room there must be; a smaller clearance is offered where there is any."""
        room = f"{what} {_up(missing * 1e3, 1):g} mm"
        if value <= 0:
            return room
        return f"{room}, or set clearance of the cell to {enough(value, 'm', True)} (now {shown(margin, 'm')})"


def _up(value: float, digits: int) -> float:
    """The value rounded up to so many decimals: the change must do."""
    return float(math.ceil(value * 10**digits - 1e-9) / 10**digits)


def enough(bound: float, unit: str, least: bool) -> str:
    """A bound that is met with it, rounded to the side that suffices: down for a least value, up for a largest one.

    >>> enough(0.0123456, "m", True), enough(0.0123456, "m", False)
    ('12.34 mm', '12.35 mm')
    """
    size = {"rad": math.degrees(1.0), "m": 1e3, "probability": 1e2}.get(unit, 1.0)
    digits = 3 - math.floor(math.log10(max(abs(bound) * size, 1e-12)))  # four of them
    rounded = (math.floor if least else math.ceil)(bound * size * 10**digits) / 10**digits
    return shown(rounded / size, unit)


def shown(value: float, unit: str) -> str:
    """A quantity [SI] with the unit that reports use: deg, mm, %.

    >>> shown(0.0125, "m"), shown(0.5, "probability")
    ('12.5 mm', '50 %')
    """
    if unit == "rad":
        return f"{math.degrees(value):.4g} deg"
    if unit == "probability":
        return f"{100 * value:.6g} %"
    return f"{value * 1e3:.4g} mm" if unit == "m" else f"{value:.4g} {unit}"


def millimetres(vector: Array) -> str:
    """A vector [m] in mm, to a tenth.

    >>> millimetres(np.array([0.1, -0.02, 0.0]))
    '(100.0, -20.0, 0.0) mm'
    """
    return "(" + ", ".join(f"{round(v * 1e3, 1) + 0.0:.1f}" for v in vector) + ") mm"
