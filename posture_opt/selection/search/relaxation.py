"""``Relaxation``: a change that makes a task possible, written first with the digits that are printed, then solved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from posture_opt.collision.scene import SELF_CLEARANCE_ROW
from posture_opt.numerics import Array, Json
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.nlp import Row
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import Reach, TaskTarget
from posture_opt.selection.search.elastic_problem import AXIS, HELD, LIMITS, TARGET, Compromise, ElasticProblem
from posture_opt.units import JointQuantity

YAW = "yaw"  # the requirement to hold the spin of the tool
VISIBLE_EXCESS = 1e-6  # rad or m beyond a limit that is worth a word


@dataclass(frozen=True)
class Reason:
    """One requirement that cannot be met."""

    requirement: str  # target, tool_axis, JOINT.limits, a term or an obstacle
    message: str
    amount: float  # by how much it fails [unit]
    unit: str


@dataclass(frozen=True)
class Relaxation:
    """A change that makes the task possible: it was made and solved with the digits that are printed."""

    change: str  # in words
    reasons: tuple[Reason, ...]  # missed until then
    posture: dict[str, float]  # joint -> rad or m, which then does the task
    cost: float  # move in arm sizes, angle in rad, relative bound
    changes: tuple[Change, ...] = ()  # of keys of the problem file

    def to_json(self) -> dict[str, Json]:
        """SI; ``set`` maps keys of the problem file to new values, null for entries to remove."""
        return {
            "change": self.change,
            "reasons": [vars(reason) for reason in self.reasons],
            "posture": self.posture,
            "set": {change.path: change.text for change in self.changes},
        }


def plane_reason(reach: Reach, target: TaskTarget) -> Reason | None:
    if not reach.misses(target.lower, target.upper):
        return None
    distance = float(np.linalg.norm(reach.outside(target.lower, target.upper)))
    message = f"the target lies {_plain(distance * 1e3)} mm outside the plane that this arm moves in"
    return Reason(TARGET, message, distance, "m")


@dataclass(frozen=True)
class Reasons:
    """Requirements missed at the posture of the compromise ``way``."""

    problem: OptimisationProblem
    elastic: ElasticProblem
    target: TaskTarget
    way: Compromise

    def of(self, names: Sequence[str]) -> tuple[Reason, ...]:
        """Reasons of the requirements ``names``, if missed."""
        lacking = self.way.lacking
        return tuple(reason for name in names if lacking[name] > 0 for reason in self._of_one(name, lacking[name]))

    def _of_one(self, name: str, amount: float) -> list[Reason]:
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
        point = np.array(self.problem.tool_point.walk(self.way.q.tolist())[0].position, dtype=float)
        distance = float(np.linalg.norm(np.clip(point, self.target.lower, self.target.upper) - point))
        message = f"the target is out of reach by {_plain(distance * 1e3)} mm{self._condition()}"
        if distance > 5 * self.problem.robot.length > 0:
            message = f"the target is {distance:.3g} m out of reach; check its unit"
        return Reason(TARGET, message, distance, "m")

    def _condition(self) -> str:
        axis = ["the tool axis along the direction"] if self.problem.axis_rows else []
        further = [name for name in self.elastic.further if name != SELF_CLEARANCE_ROW]
        conditions = [*axis, *(["all further requirements met"] if further else [])]
        return f" with {' and '.join(conditions)}" if conditions else ""

    def _axis(self, missing: float) -> Reason:
        reached, allowed = shown_apart(self.target.tilt + missing, self.target.tilt, "rad")
        axis = ", ".join(f"{v:g}" for v in self.problem.task.tool_axis)
        nearest = f"comes no closer than {reached} to the direction, and {allowed} are allowed"
        message = f"at this target the tool axis, [{axis}] of the tool frame, {nearest}"
        return Reason(AXIS, message, missing, "rad")

    def _limits(self) -> list[Reason]:
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
        found = []
        for k, value in self.elastic.held.items():
            joint, off = self.problem.robot.joints[k], abs(float(self.way.q[k] - value))
            if off > VISIBLE_EXCESS:
                held, away = shown(value, joint.unit), shown(off, joint.unit)
                message = f"{joint.name} is held at {held}, {away} from where the task can be done"
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
        """A distance of the cell: below zero by what an obstacle must give; exact where nothing overlaps."""
        between, nearest, required = self.elastic.cell.scene.closest(name, self.way.q)
        bound = required - missing
        exact = bound < nearest < required and (nearest >= 0 or name == SELF_CLEARANCE_ROW)
        reached, needed = shown_apart(nearest if exact else bound, required, "m")
        pair = f", between {' and '.join(between)}" if name == SELF_CLEARANCE_ROW else ""
        message = f"{name} is {reached} at most, and at least {needed} is required{pair}"
        return Reason(name, message, missing, "m")


def _row_reason(row: Row, value: float, low: float, high: float) -> Reason:
    reached, bound = row.shown(value), row.shown(low if value < low else high)
    reached_text, stated = shown_apart(reached, bound, row.unit)
    if reached < bound:
        message = f"{row.name} is {reached_text} at most, and at least {stated} is required"
    else:
        message = f"{row.name} is {reached_text} at least, and at most {stated} is allowed"
    return Reason(row.name, message, abs(reached - bound), row.unit)


def way_words(problem: OptimisationProblem, target: TaskTarget, q: Array, shift: Array) -> str:
    """Words for the direction of a move (3,) [m], for an arm that stands in posture q (n,)."""
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
    return f", {word}" if cosine >= 0.9 else ""


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


# SI unit -> factor to the unit of files, and its name; a Jacobian's are lengths there, others are as they are.
_FILE_UNITS = {"m": (1e3, "mm"), "rad": (math.degrees(1.0), "deg"), "m/rad": (1e3, "mm")}


@dataclass(frozen=True)
class ChangedValue:
    """A number [SI] of exactly the digits that are printed, and its text."""

    value: float
    text: str


@dataclass(frozen=True)
class Change:
    """Another value at a key of the problem file."""

    key: tuple[str | int, ...]  # entries of a list by name or number
    value: Any  # SI, as the section holds it; None removes the entry
    text: Json  # as the file states it
    words: str
    looser: int = 0  # 1: larger asks for less; −1: smaller does; 0: a pair of limits, a place
    sides: tuple[str, str] = ("", "")  # of limits: words for the lower and for the upper one, where it changes

    @property
    def path(self) -> str:
        """The key in one word: ``task.tilt``."""
        return ".".join(map(str, self.key))

    def with_room_for(self, other: Change) -> Change:
        """The looser one of two changes at one key; of limits both."""
        if self.value is None or other.value is None:
            return self if self.value is None else other
        if self.key[0] == "robot":
            (low, high), (other_low, other_high) = self.value, other.value
            lower, upper = (self if low <= other_low else other), (self if high >= other_high else other)
            if lower is upper:
                return lower
            text, sides = [_pair(lower.text)[0], _pair(upper.text)[1]], (lower.sides[0], upper.sides[1])
            value, words = (lower.value[0], upper.value[1]), " and ".join(filter(None, sides))
            return replace(lower, value=value, text=text, words=words, sides=sides)
        return max(self, other, key=lambda change: change.looser * float(np.sum(change.value)))


def _pair(text: Json) -> Sequence[Json]:
    assert isinstance(text, list)
    return text


def rounded(value: float, unit: str, decimals: int, side: int = 0) -> ChangedValue:
    """A value [SI] with so many decimals in the unit of files, rounded up (side 1), down (−1) or to the nearest (0).

    >>> rounded(0.00683201, "m", 1, 1)
    ChangedValue(value=0.0069, text='6.9 mm')
    """
    factor, name = _FILE_UNITS.get(unit, (1.0, "" if unit in ("1", "probability") else unit))
    scaled = value * factor * 10**decimals
    # What is nearer than 1e-3 of the last digit is rounded to it
    whole = round(scaled) if abs(scaled - round(scaled)) <= 1e-3 or not side else None
    if whole is None:
        whole = math.ceil(scaled) if side > 0 else math.floor(scaled)
    number = whole / 10**decimals
    text = f"{number:.{max(decimals, 0)}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return ChangedValue(float(f"{number / factor:.15g}"), f"{'0' if text == '-0' else text} {name}".strip())


def decimals_for(value: float, unit: str, digits: int) -> int:
    """Decimals in the unit of files that show so many digits of a value [SI]."""
    size = abs(value) * _FILE_UNITS.get(unit, (1.0, ""))[0]
    return digits - 1 - math.floor(math.log10(max(size, 1e-9)))


def exact_text(value: float, unit: str) -> str:
    """A value [SI] as the file states it, to twelve digits.

    >>> exact_text(0.6931, "m")
    '693.1 mm'
    """
    factor, name = _FILE_UNITS.get(unit, (1.0, unit))
    return f"{value * factor + 0.0:.12g} {name}"


def with_changes(problem: ProblemData, changes: Sequence[Change]) -> ProblemData:
    """The problem with other values at some keys of its task, its cell and the joints of its robot."""
    for change in changes:
        section, *key = change.key
        if section == "robot":
            robot = _with_limits(problem.robot, str(key[1]), change.value)
            problem = replace(problem, arm=replace(problem.arm, robot=robot))
        else:
            problem = replace(problem, **{str(section): _with_value(getattr(problem, str(section)), key, change.value)})
    return problem


def _with_limits(robot: Robot, name: str, limits: tuple[float, float]) -> Robot:
    """The robot with other limits [rad or m] of one joint."""
    lower, upper = limits
    joints = tuple(replace(j, lower=lower, upper=upper) if j.name == name else j for j in robot.joints)
    return replace(robot, joints=joints)


def _with_value(section: Any, key: Sequence[str | int], value: Any) -> Any:
    """A section, or a list or mapping in it, with another value at a key; None removes an entry of a list."""
    head, *rest = key
    if isinstance(section, tuple):
        names = [k if isinstance(head, int) else entry.name for k, entry in enumerate(section)]
        at = names.index(head)
        if value is None and not rest:
            return section[:at] + section[at + 1 :]
        return (*section[:at], _with_value(section[at], rest, value) if rest else value, *section[at + 1 :])
    before = section.get(head) if isinstance(section, dict) else getattr(section, str(head))
    after = _with_value(before, rest, value) if rest else value
    if isinstance(before, JointQuantity) and isinstance(after, float):
        after = replace(before, value=after)
    return {**section, head: after} if isinstance(section, dict) else section.model_copy(update={str(head): after})
