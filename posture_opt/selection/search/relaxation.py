"""``Relaxation``: a change that makes a task possible, and the requirements that are missed without it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from posture_opt.collision.scene import SELF_CLEARANCE_ROW
from posture_opt.numerics import Array, Json
from posture_opt.selection.program.nlp import Row
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import Reach, TaskTarget
from posture_opt.selection.search.change import Change
from posture_opt.selection.search.elastic_problem import AXIS, HELD, LIMITS, TARGET, Compromise, ElasticProblem

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
    """A change that makes the task possible: it was made and solved with the digits that are printed.

    Args:
        change: what to change, in words.
        reasons: what is missed until then.
        posture: joint name -> rad or m, which then does the task.
        cost: compares changes: a move in units of the arm's size, angles in rad, bounds relative to their size.
        changes: the keys of the problem file with their new values.
    """

    change: str
    reasons: tuple[Reason, ...]
    posture: dict[str, float]
    cost: float
    changes: tuple[Change, ...] = ()

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI; ``set`` maps keys of the problem file to what they would be, null where they would go."""
        return {
            "change": self.change,
            "reasons": [vars(reason) for reason in self.reasons],
            "posture": self.posture,
            "set": {change.path: change.text for change in self.changes},
        }


def plane_reason(reach: Reach, target: TaskTarget) -> Reason | None:
    """The reason why an arm that moves in a plane, or on a line, cannot reach a target outside of it; None where it
    can.
    """
    if not reach.misses(target.lower, target.upper):
        return None
    distance = float(np.linalg.norm(reach.outside(target.lower, target.upper)))
    message = f"the target lies {_plain(distance * 1e3)} mm outside the plane that this arm moves in"
    return Reason(TARGET, message, distance, "m")


@dataclass(frozen=True)
class Reasons:
    """The reasons that one compromise shows: what is missed at its posture.

    Args:
        elastic: the problem that the compromise ``way`` solves.
    """

    problem: OptimisationProblem
    elastic: ElasticProblem
    target: TaskTarget
    way: Compromise

    def of(self, names: Sequence[str]) -> tuple[Reason, ...]:
        """What is missed of the requirements ``names``, as far as anything is."""
        lacking = dict(zip(self.elastic.requirements, map(float, self.way.lacking), strict=True))
        return tuple(reason for name in names if lacking[name] > 0 for reason in self._of_one(name, lacking[name]))

    def _of_one(self, name: str, amount: float) -> list[Reason]:
        """What is missed of a requirement: of limits and held joints, of each joint."""
        if name == TARGET:
            return [self._target()]
        if name == AXIS:
            return [self._axis(amount)]
        if name == LIMITS:
            return self._limits()
        if name == HELD:
            return self._held()
        return [self._too_near(name, amount)] if name in self.elastic.in_cell else [self._term(name)]

    def _target(self) -> Reason:
        """How far the nearest point is that the tool reaches."""
        point = np.array(self.problem.tool_point.walk(self.way.q.tolist())[0].position, dtype=float)
        distance = float(np.linalg.norm(np.clip(point, self.target.lower, self.target.upper) - point))
        message = f"the target is out of reach by {_plain(distance * 1e3)} mm{self._condition()}"
        return Reason(TARGET, message, distance, "m")

    def _condition(self) -> str:
        """What holds at the nearest point, in addition to the limits of the joints."""
        axis = ["the tool axis along the direction"] if self.problem.axis_rows else []
        further = [name for name in self.elastic.further if name != SELF_CLEARANCE_ROW]
        conditions = [*axis, *(["all further requirements met"] if further else [])]
        return f" with {' and '.join(conditions)}" if conditions else ""

    def _axis(self, missing: float) -> Reason:
        """The angle that the tool axis comes to."""
        reached, allowed = shown_apart(self.target.tilt + missing, self.target.tilt, "rad")
        axis = ", ".join(f"{v:g}" for v in self.problem.task.tool_axis)
        message = (
            f"at this target the tool axis, [{axis}] of the tool frame, comes no closer than {reached} to the "
            f"direction, and {allowed} are allowed"
        )
        return Reason(AXIS, message, missing, "rad")

    def _limits(self) -> list[Reason]:
        """Each joint that would have to leave its limits, and by how much."""
        found = []
        for value, joint in zip(self.way.q, self.problem.robot.joints, strict=True):
            amount = max(joint.lower - value, value - joint.upper, 0.0)
            if amount > VISIBLE_EXCESS:
                bound = joint.lower if value < joint.lower else joint.upper
                wanted, limit, beyond = (shown(v, joint.unit) for v in (value, bound, amount))
                what = "target and tool axis" if self.problem.axis_rows else "target"
                message = (
                    f"{joint.name} would have to go to {wanted}, {beyond} beyond its limit {limit}, to meet the {what}"
                )
                found.append(Reason(f"{joint.name}.limits", message, float(amount), joint.unit))
        return found

    def _held(self) -> list[Reason]:
        """Each joint that would have to stand elsewhere."""
        found = []
        for k, value in self.elastic.held.items():
            joint, off = self.problem.robot.joints[k], abs(float(self.way.q[k] - value))
            if off > VISIBLE_EXCESS:
                message = (
                    f"{joint.name} is held at {shown(value, joint.unit)}, {shown(off, joint.unit)} from where the task "
                    f"can be done"
                )
                found.append(Reason(f"{HELD} of {joint.name}", message, off, joint.unit))
        return found

    def _term(self, name: str) -> Reason:
        """The row of a term that lacks most, ``max(lower − value, value − upper)``."""
        rows = [row for row in self.problem.nlp.rows if row.requirement == name]
        nlp = self.problem.nlp
        at = ca.Function("at", [nlp.x, nlp.p], [ca.vertcat(row.expression, row.lower, row.upper) for row in rows])
        called = at.call([self.way.q, self.target.parameters])
        values = [np.asarray(value, dtype=float).ravel().tolist() for value in called]
        if rows[0].name == YAW:
            off = abs(math.atan2(values[0][0], values[1][0]))
            message = f"at this target the tool turns no nearer than {math.degrees(off):.4g} deg to the wanted yaw"
            return Reason(YAW, message, off, "rad")
        k = int(np.argmax([max(low - value, value - high) for value, low, high in values]))
        return _row_reason(rows[k], *values[k])

    def _too_near(self, name: str, missing: float) -> Reason:
        """A distance of the cell: below zero by what an obstacle has to give for links to be clear of it.

        Where nothing overlaps it is the exact one, which may be more than the lower bound that is missed.
        """
        between, nearest, required = self.elastic.cell.scene.closest(name, self.way.q)
        bound = required - missing
        exact = bound < nearest < required and (nearest >= 0 or name == SELF_CLEARANCE_ROW)
        reached, needed = shown_apart(nearest if exact else bound, required, "m")
        pair = f", between {' and '.join(between)}" if name == SELF_CLEARANCE_ROW else ""
        message = f"{name} is {reached} at most, and at least {needed} is required{pair}"
        return Reason(name, message, missing, "m")


def _row_reason(row: Row, value: float, low: float, high: float) -> Reason:
    """What a row of a term reaches, and what is required."""
    reached, bound = row.shown(value), row.shown(low if value < low else high)
    reached_text, stated = shown_apart(reached, bound, row.unit)
    if reached < bound:
        message = f"{row.name} is {reached_text} at most, and at least {stated} is required"
    else:
        message = f"{row.name} is {reached_text} at least, and at most {stated} is allowed"
    return Reason(row.name, message, abs(reached - bound), row.unit)


def way_words(problem: OptimisationProblem, target: TaskTarget, q: Array, shift: Array) -> str:
    """Words for the direction of a move (3,) [m], where there are some.

    Args:
        q: (n,) a posture, for where the arm stands.
    """
    distance = float(np.linalg.norm(shift))
    screws = problem.tool_point.walk(q.tolist())[0].screws
    foot = np.array(screws[len(problem.robot.base)].origin, dtype=float)
    out = (target.lower + target.upper) / 2 - foot
    out[2] = 0.0
    if distance == 0 or not np.isfinite(out).all() or np.linalg.norm(out) < 1e-9:
        return ""
    along, up = float(shift @ out / np.linalg.norm(out)) / distance, float(shift[2]) / distance
    words = [(-along, "towards the base"), (along, "away from the base"), (up, "up"), (-up, "down")]
    cosine, word = max(words)
    return f", {word}" if cosine >= MAIN_DIRECTION_COSINE else ""


def stated_text(value: float, unit: str) -> str:
    """A bound [SI] as the file has it: a probability as a number, a singular value as a length.

    >>> stated_text(0.999, "probability"), stated_text(0.15, "m/rad")
    ('0.999', '150 mm')
    """
    return f"{value:.6g}" if unit == "probability" else shown(value, "m" if unit == "m/rad" else unit)


def shown(value: float, unit: str, digits: int = 4) -> str:
    """A quantity [SI] with the unit that reports use: deg, mm, %.

    >>> shown(0.0125, "m"), shown(0.5, "probability")
    ('12.5 mm', '50 %')
    """
    if unit == "rad":
        return f"{_plain(math.degrees(value), digits)} deg"
    if unit == "probability":
        return f"{_plain(100 * value, digits + 2)} %"
    return f"{_plain(value * 1e3, digits)} mm" if unit == "m" else f"{_plain(value, digits)} {unit}"


def _plain(value: float, digits: int = 4) -> str:
    """A number with so many significant digits or more, and no exponent where it is large."""
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e+" in text else text


def shown_apart(reached: float, bound: float, unit: str) -> tuple[str, str]:
    """Two quantities [SI] that differ, with as many digits as show that they do.

    >>> shown_apart(0.01719, 0.0172, "m"), shown_apart(0.017190001, 0.01719, "m")
    (('17.19 mm', '17.2 mm'), ('17.190001 mm', '17.19 mm'))
    """
    for digits in range(4, 16):
        texts = shown(reached, unit, digits), shown(bound, unit, digits)
        if texts[0] != texts[1]:
            break
    return texts


def stated_apart(stated: float, other: float, unit: str) -> str:
    """A stated quantity [SI] beside another value for it, with as many digits as show that they differ."""
    return shown_apart(stated, other, unit)[0]
