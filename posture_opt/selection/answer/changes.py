"""What to change in a problem file for a compromise to meet every requirement, with the digits that are printed.

Every number is rounded to the side that suffices, and a little more is given in each further attempt: what is offered
has been solved as it is printed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from posture_opt.collision.cell import MOUNTING_PLANE
from posture_opt.numerics import Array
from posture_opt.selection.program.nlp import Row
from posture_opt.selection.program.optimisation_problem import OptimisationProblem, bound_terms
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.elastic_problem import (
    AXIS,
    CLEARANCE,
    HELD,
    LIMITS,
    TARGET,
    Compromise,
    ElasticProblem,
    gives_enough,
)
from posture_opt.selection.search.relaxation import (
    VISIBLE_EXCESS,
    YAW,
    Change,
    ChangedValue,
    decimals_for,
    exact_text,
    rounded,
    shown,
    stated_apart,
    stated_text,
    way_words,
)
from posture_opt.selection.tasks import Task


class Attempt(NamedTuple):
    """Share given beyond the least, and digits more than usual, of a written change."""

    more: float
    digits: int = 0


# In this order; the last ones are for what has one value that does, or must lie in a plane: rounding leaves both.
ATTEMPTS = (Attempt(0.0), Attempt(0.003), Attempt(0.02), Attempt(0.0, 4), Attempt(0.003, 3))
PLANE_DECIMALS = 1, 4, 7  # of a move in mm onto the plane of an arm


@dataclass(frozen=True)
class Changes:
    """The changes that the compromise ``way`` shows, for one attempt at their digits."""

    problem: OptimisationProblem
    task: Task  # as the file has it, with its held joints
    elastic: ElasticProblem  # solved by ``way``
    target: TaskTarget
    way: Compromise
    attempt: Attempt

    def of(self, names: Sequence[str]) -> tuple[Change, ...]:
        """Changes for the requirements ``names``; empty if one has no key for it."""
        found: list[Change] = []
        for name in names:
            changes = self._of_one(name)
            if not changes:
                return ()
            found += changes
        return tuple(found)

    def _of_one(self, name: str) -> list[Change]:
        makers: dict[str, Callable[[], list[Change]]] = {
            TARGET: self._target, AXIS: self._axis, LIMITS: self._limits, HELD: self._held,
            CLEARANCE: self._clearance, YAW: self._yaw,
        }  # fmt: skip
        if name in makers:
            return makers[name]()
        cell = self.elastic.cell
        if name in cell.movable:
            return self._moved(cell.movable[name], name)
        if name in self.elastic.in_cell:
            return self._smaller(cell.obstacles[name], name) if name in cell.obstacles else []
        return self._term(name)

    # --- the task -------------------------------------------------------------------------------------------------

    def _target(self) -> list[Change]:
        point = np.array(self.problem.tool_point.walk(self.way.q.tolist())[0].position, dtype=float)
        shift = self._vector(point - np.clip(point, self.target.lower, self.target.upper))
        return _moved_target(self.problem, self.target, self.way.q, shift)

    def _axis(self) -> list[Change]:
        tilt = self._up(self.target.tilt, self.way.lacking[AXIS], "rad")
        if self.task.heading is not None or tilt.value > math.pi / 2:
            return []
        words = f"set tilt: {tilt.text} (now {stated_apart(self.target.tilt, tilt.value, 'rad')})"
        return [Change(("task", "tilt"), tilt.value, tilt.text, words, looser=1)]

    def _yaw(self) -> list[Change]:
        heading = self.problem.task.heading
        assert heading is not None, "a row of the yaw"
        rows = [row for row in self.problem.nlp.rows if row.name.partition(".")[0] == YAW]
        sine, cosine = (value for value, *_ in self._values(rows))
        # The row's sine is h · (a × x), h the wanted heading, a the tool axis, x that of the tool: minus the sine of
        # the turn about a from h to x, which is against the world's turn where a points down.
        off, now = math.atan2(sine, cosine), math.atan2(heading[1], heading[0])
        turn = -off * math.copysign(1.0, self.target.axis[2])
        yaw = rounded(now + turn * (1 + self.attempt.more), "rad", 2 + self.attempt.digits, 1 if turn > 0 else -1)
        words = f"set yaw: {yaw.text} (now {stated_apart(now, yaw.value, 'rad')})"
        return [Change(("task", "yaw"), yaw.value, yaw.text, words)]

    def _held(self) -> list[Change]:
        changes = []
        for k, value in self.elastic.held.items():
            joint, off = self.problem.robot.joints[k], float(self.way.q[k] - value)
            if abs(off) > VISIBLE_EXCESS:
                there = self._beyond(value, off, joint.unit)
                key = ("task", "subject_to", self._holding(k), "values", joint.name)
                words = f"hold {joint.name} at {there.text} (now {stated_apart(value, there.value, joint.unit)})"
                changes.append(Change(key, there.value, there.text, words))
        return changes

    def _holding(self, joint: int) -> int:
        terms = self.task.subject_to
        return next(k for k, term in enumerate(terms) if joint in term.held(self.problem.robot))

    def _term(self, name: str) -> list[Change]:
        number = [known for known, _ in bound_terms(self.task)].index(name)
        term, rows = self.task.subject_to[number], [r for r in self.problem.nlp.rows if r.requirement == name]
        found: dict[tuple[str | int, ...], list[ChangedValue]] = {}
        bounds: dict[tuple[str | int, ...], str] = {}
        for k, (row, (value, low, high)) in enumerate(zip(rows, self._values(rows), strict=True)):
            if max(low - value, value - high) <= 0:
                continue
            reached, bound = row.shown(value), row.shown(low if value < low else high)
            side, word = (-1, "at_least") if reached < bound else (1, "at_most")
            joint = [term.stated()[k].joint] if isinstance(getattr(term, word), dict) else []
            key: tuple[str | int, ...] = ("task", "subject_to", number, word, *joint)
            given = reached + side * self.attempt.more * abs(reached - bound)
            digits = decimals_for(given, row.unit, 4 + self.attempt.digits)  # significant digits of a bound: 4
            found.setdefault(key, []).append(rounded(given, row.unit, digits, side))
            bounds[key] = f"{word} of {row.name if joint else name} to {{}} (now {stated_text(bound, row.unit)})"
        changes = []
        for key, options in found.items():
            loosest = (min if "at_least" in key else max)(options, key=lambda option: option.value)
            words = f"set {bounds[key].format(loosest.text)}"
            changes.append(Change(key, loosest.value, loosest.text, words, -1 if "at_least" in key else 1))
        return changes

    # --- the robot and the cell -----------------------------------------------------------------------------------

    def _limits(self) -> list[Change]:
        changes = []
        for value, joint in zip(self.way.q, self.problem.robot.joints, strict=True):
            off = float(value - np.clip(value, joint.lower, joint.upper))
            if abs(off) > VISIBLE_EXCESS:
                bound = joint.lower if off < 0 else joint.upper
                there = self._beyond(bound, off, joint.unit)
                ends = (there.value, joint.upper) if off < 0 else (joint.lower, there.value)
                text = [there.text if end == there.value else exact_text(end, joint.unit) for end in ends]
                words = f"let {joint.name} go to {there.text} (limit {stated_apart(bound, there.value, joint.unit)})"
                sides = (words, "") if off < 0 else ("", words)
                changes.append(Change(("robot", "joints", joint.name, "limits"), ends, text, words, sides=sides))
        return changes

    def _smaller(self, k: int, name: str) -> list[Change]:
        obstacles = self.elastic.cell.scene.obstacles
        before, key = obstacles[k], ("cell", "obstacles", obstacles[k].name)
        by = self._up(0.0, float(self.way.slacks[name][0]), "m")
        if before.name == MOUNTING_PLANE:
            return self._lower_mounting(by)
        after = gives_enough(obstacles, before.name, by.value)
        if after is None:
            return [Change(key, None, None, f"remove obstacle {before.name}")]
        changed = {field: getattr(after, field) for field in type(after).model_fields}
        changed = {field: value for field, value in changed.items() if value != getattr(before, field)}
        texts = {
            field: ([exact_text(v, "m") for v in value] if isinstance(value, tuple) else exact_text(value, "m"))
            for field, value in changed.items()
        }
        sizes = ", ".join(f"{f} {t if isinstance(t, str) else '[' + ', '.join(t) + ']'}" for f, t in texts.items())
        sides = " on every side" if math.isfinite(before.half_thickness) else ""
        words = f"obstacle {before.name} must give {by.text}{sides}: {sizes}"
        return [Change((*key, field), value, texts[field], words, looser=-1) for field, value in changed.items()]

    def _lower_mounting(self, by: ChangedValue) -> list[Change]:
        mounting = self.elastic.cell.scene.mounting
        if mounting is None or mounting.assumed:
            return []
        below = mounting.below + by.value
        text = exact_text(below, "m")
        words = f"state the mounting plane {text} below the base (now {stated_apart(mounting.below, below, 'm')})"
        return [Change(("cell", "mounting", "below"), below, text, words, looser=1)]

    def _moved(self, k: int, name: str) -> list[Change]:
        obstacle = self.elastic.cell.scene.obstacles[k]
        shift = self._vector(self.way.slacks[name])
        moved = np.array([part.value for part in shift])
        there = np.array(getattr(obstacle, "xyz", np.zeros(3))) + moved
        words = f"move obstacle {obstacle.name} by {_vector_words(shift)}, {shown(float(np.linalg.norm(moved)), 'm')}"
        return [_place(("cell", "obstacles", obstacle.name, "xyz"), there, words)]

    def _clearance(self) -> list[Change]:
        margin, less = self.elastic.cell.scene.margin, float(self.way.slacks[CLEARANCE][0])
        left = rounded(margin - less * (1 + self.attempt.more), "m", self._decimals(less, "m"), -1)
        if not 0 <= left.value < margin:
            return []
        words = f"set clearance of the cell to {left.text} (now {stated_apart(margin, left.value, 'm')})"
        return [Change(("cell", "clearance"), left.value, left.text, words, looser=-1)]

    # --- digits ---------------------------------------------------------------------------------------------------

    def _values(self, rows: Sequence[Row]) -> list[list[float]]:
        nlp = self.problem.nlp
        at = ca.Function("at", [nlp.x, nlp.p], [ca.vertcat(row.expression, row.lower, row.upper) for row in rows])
        return [np.asarray(v, dtype=float).ravel().tolist() for v in at.call([self.way.q, self.target.parameters])]

    def _decimals(self, amount: float, unit: str) -> int:
        return int(np.clip(decimals_for(amount, unit, 2), 1, 4)) + self.attempt.digits

    def _up(self, base: float, amount: float, unit: str) -> ChangedValue:
        return rounded(base + amount * (1 + self.attempt.more), unit, self._decimals(amount, unit), 1)

    def _beyond(self, value: float, off: float, unit: str) -> ChangedValue:
        """A value moved by no less than ``off``."""
        side = 1 if off > 0 else -1
        return rounded(value + off * (1 + self.attempt.more), unit, self._decimals(off, unit), side)

    def _vector(self, shift: Array) -> list[ChangedValue]:
        """A shift (3,) [m], each component rounded away from zero."""
        decimals = self._decimals(float(np.linalg.norm(shift)), "m")
        least = 0.5 * 10.0 ** -(decimals + 3)
        return [
            rounded(float(v) * (1 + self.attempt.more) if abs(v) > least else 0.0, "m", decimals, 1 if v > 0 else -1)
            for v in shift
        ]


def onto_plane(problem: OptimisationProblem, target: TaskTarget, q: Array, decimals: int) -> tuple[Change, ...]:
    """Move of the target onto the plane of an arm that stands in posture q (n,), with ``decimals`` of a millimetre."""
    shift = [rounded(float(v), "m", decimals) for v in problem.reach.outside(target.lower, target.upper)]
    return tuple(_moved_target(problem, target, q, shift))


def _moved_target(
    problem: OptimisationProblem, target: TaskTarget, q: Array, shift: Sequence[ChangedValue]
) -> list[Change]:
    moved = np.array([part.value for part in shift])
    words = f"move the target by {_vector_words(shift)}{way_words(problem, target, q, moved)}"
    if target.kind == "point":
        return [_place(("task", "position"), target.lower + moved, words)]
    ends = (("min", target.lower), ("max", target.upper))
    return [_place(("task", "region", key), end + moved, words) for key, end in ends]


def _place(key: tuple[str | int, ...], point: Array, words: str) -> Change:
    """A point (3,) [m] at a key."""
    return Change(key, tuple(float(v) for v in point), [exact_text(float(v), "m") for v in point], words)


def _vector_words(parts: Sequence[ChangedValue]) -> str:
    numbers = [part.text.split()[0] for part in parts]
    decimals = max(1, *(len(number.partition(".")[2]) for number in numbers))
    return "(" + ", ".join(f"{float(number) + 0.0:.{decimals}f}" for number in numbers) + ") mm"
