"""From a problem to its nonlinear program: variables, objective and named rows.

The variables are the joints. The target's numbers are parameters: one compiled program serves every target of its
kind.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np

from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.scene import Scene
from posture_opt.errors import InputError, Issue
from posture_opt.model.arm import Arm
from posture_opt.model.chain import Walk, stack
from posture_opt.numerics import Array, DerivedAgain
from posture_opt.robot.robot import Robot
from posture_opt.selection.program.nlp import Nlp, Row, Variable
from posture_opt.selection.program.task_target import PLANE_TOLERANCE, Reach, TaskTarget, spin_axis, target_symbols
from posture_opt.selection.tasks import Task
from posture_opt.selection.terms import criteria
from posture_opt.selection.terms.term import Quantities, Term
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.clearance import Within
from posture_opt.uncertainty.tool_point import Moments, ToolPoint

Alignment = Literal["exact", "loose", "free"]


@dataclass(frozen=True)
class OptimisationProblem(DerivedAgain):
    """Everything symbolic about selecting a posture for ``task`` with one kind of target."""

    tool_point: ToolPoint
    task: Task
    reach: Reach
    kind: str  # of the target: point, region or anywhere
    alignment: Alignment  # the tool axis held exactly, within ``reach.axis_slack``, or free
    in_plane: bool  # the direction lies in the plane of a planar arm
    scene: Scene | None = None  # what rows keep the arm clear of

    @property
    def arm(self) -> Arm:
        return self.tool_point.arm

    @property
    def robot(self) -> Robot:
        return self.tool_point.robot

    @property
    def axis_rows(self) -> int:
        """How many rows hold the tool axis along the direction: 0, 1 (it turns in a plane that holds both) or 2."""
        if self.alignment == "free":
            return 0
        return self.reach.axis_rank if self.alignment == "exact" else 2

    def fixed_along(self, target: TaskTarget) -> bool:
        """Whether no joint turns the tool axis, and it lies along the direction within the tilt."""
        angle = math.acos(max(-1.0, min(1.0, float(self.reach.axis @ target.axis))))
        return self.reach.axis_rank == 0 and angle <= target.tilt + self.reach.axis_slack

    def axis_note(self, target: TaskTarget) -> Statement:
        """What became of the request to have the tool axis along the direction."""
        if self.task.axis_request == "free":
            return state("selection.axis-free")
        if self.axis_rows:
            name = f"{'tilted' if target.tilt else 'held'}{'-at-yaw' if target.spun else ''}"
            return state(f"selection.axis-{name}", tilt=Quantity(target.tilt, "stated angle"))
        return state(f"selection.axis-{'given' if self.fixed_along(target) else 'impossible'}")

    def check_axis(self, target: TaskTarget) -> None:
        """Raise InputError where the arm cannot do with its tool axis what the task requires."""
        task = self.task
        if self.axis_rows or self.fixed_along(target):
            return
        if task.part is not None:
            message = "the length of a peg counts along the tool axis, which this arm cannot bring along the direction"
            hint = "name the tool_axis that it can, of a planar arm [1, 0, 0], or leave out the length"
            raise InputError(Issue(message, ("task", "length"), task.part.length, hint))
        if task.axis_request == "required":
            message = f"{task.kind} needs the tool axis along the direction, which this arm cannot give"
            hint = "use kind: insert, which does not constrain the tool orientation of such an arm"
            raise InputError(Issue(message, ("task", "kind"), task.kind, hint))

    @cached_property
    def flat(self) -> bool:
        """Whether nothing, neither a joint nor an error, ever moves the tool point out of the arm's plane."""
        normal = self.reach.normal
        return normal is not None and bool(ca.SX(self._moments.covariance @ ca.DM(normal)).is_zero())

    @property
    def across_rank(self) -> int:
        """2, or 1 where the direction lies in a plane that the tool point never leaves."""
        return 1 if self.flat and self.in_plane else 2

    @cached_property
    def _moments(self) -> Moments:
        """Mean and covariance of the tool point as expressions in joints and lever, world [m], [m²]."""
        # Correlated errors of a spatial arm have few nodes for their shared factors here: the graph stays small, the
        # covariance positive semidefinite and complete to fourth order in σ. The answer is reported in full.
        return self._seen.moments(ca.vertsplit(self.q))

    @cached_property
    def _seen(self) -> ToolPoint:
        return self.tool_point.seen_from(ca.vertsplit(self._symbols[1]["lever"]))

    @cached_property
    def q(self) -> ca.SX:
        """(n,) the joint values, as symbols [rad or m]."""
        return ca.vertcat(*(ca.SX.sym(name) for name in self.robot.joint_names))

    @cached_property
    def _symbols(self) -> tuple[ca.SX, dict[str, ca.SX]]:
        """Parameters (33,) of the target, and their parts by name."""
        return target_symbols()

    @cached_property
    def quantities(self) -> Quantities:
        """The symbolic quantities that objective and terms are made of."""
        moments = self._moments
        p = self._symbols[1]
        a = np.array(self.task.tool_axis) / np.linalg.norm(self.task.tool_axis)
        U = self.reach.directions
        position = ca.SX(moments.position)
        all_axes = ca.SX(U) if self.flat else ca.SX.eye(3)
        bases: dict[Within, ca.SX] = {
            "across": p["b1"] if self.across_rank == 1 else ca.horzcat(p["b1"], p["b2"]),
            "along": p["direction"],
            "all": all_axes,
        }
        return Quantities(
            tool_point=self._seen,
            walk=moments.walk,
            q=self.q,
            position=position,
            axis=_turned(moments.walk, a),
            frames=self._frames(moments.walk),
            covariance=ca.SX(moments.covariance),
            bias=ca.SX(moments.mean) - position,
            jacobian=ca.SX(U.T) @ ca.jacobian(position, self.q),
            bases=bases,
            within=self.task.within,
            part=self.task.part,
            yaw_lever=self.task.yaw_lever,
            clearance=p["clearance"],
            has_hole=self.task.clearance is not None,
        )

    def _frames(self, reached: Walk) -> ca.SX:
        """(3, n) where each link ends: the origin that the first factor of the next one starts from."""
        ends = np.cumsum([len(self.robot.base), *(len(link) for link in self.robot.links)])[1:]
        origins = [*(screw.origin for screw in reached.screws), reached.position]
        return ca.SX(ca.horzcat(*(ca.vertcat(*origins[end]) for end in ends)))

    @cached_property
    def nlp(self) -> Nlp:
        units = {"revolute": "rad", "prismatic": "m"}
        variables = tuple(Variable(j.name, units[j.type], j.lower, j.upper) for j in self.robot.joints)
        terms = self._objective_terms()
        objective = sum((expression for _, expression in terms), ca.SX(0))
        rows = (
            *self._target_rows(),
            *self._axis_rows(),
            *self._yaw_rows(),
            *self.clearance_rows(),
            *self._bound_rows(),
        )
        worst = self.quantities.variance
        return Nlp(self.q, self._symbols[0], variables, objective, tuple(rows), tuple(terms), worst)

    @cached_property
    def freedom(self) -> int:
        """Degrees of freedom left by target and tool axis, indifferent joints not counted."""
        equal = sum(row.equality for row in self.nlp.rows)
        held = [k for k, joint in enumerate(self.robot.joints) if joint.lower == joint.upper]
        return max(self.robot.n - len({*self.nlp.indifferent, *held}) - equal, 0)

    def _objective_terms(self) -> list[tuple[str, ca.SX]]:
        """Criterion over its scale (1e-9 m² would end a solver at once), and weighted ``minimize`` terms."""
        task, at = self.task, self.quantities
        for k, term in enumerate(task.minimize):
            self._values(term, "minimize", k)
        extra = [(f"{term.weight:g} x {term.kind}", term.weight * term.cost(at)) for term in task.minimize]
        if task.criterion == "none":
            return extra
        scale = self._symbols[1]["scale"]
        if task.criterion == "miss":
            main = ("log of the probability to miss the clearance", at.log_miss)
        else:
            measure = {"worst": criteria.worst, "trace": criteria.trace, "area": criteria.area}[task.criterion]
            main = (f"{task.criterion} of the spread {task.within}, over scale", at.largest(measure) / scale)
        return [main, *extra]

    def _target_rows(self) -> list[Row]:
        """An equality [m] per direction the tool point moves in (a third would be dependent), or a box."""
        at, p = self.quantities, self._symbols[1]
        if self.kind == "anywhere":
            return []
        if self.kind == "region":
            # Across the plane of an arm that leaves it by its corrections only, the box is as wide as they are.
            wider = (self.reach.plane_slack - PLANE_TOLERANCE) * np.linalg.norm(self.reach.normals, axis=1)
            return [
                Row(f"target.{c}", "m", at.position[k], p["lower"][k] - w, p["upper"][k] + w)
                for k, (c, w) in enumerate(zip("xyz", wider.tolist(), strict=True))
            ]
        rows = []
        for u in self.reach.directions.T:
            name = (
                "xyz"[int(np.argmax(np.abs(u)))]
                if np.max(np.abs(u)) > 1 - 1e-9
                else f"({u[0]:.3g}, {u[1]:.3g}, {u[2]:.3g})"
            )
            reached, wanted = ca.dot(ca.DM(u), at.position), ca.dot(ca.DM(u), p["lower"])
            rows.append(Row(f"target.{name}", "m", reached, wanted, wanted))
        return rows

    def _axis_rows(self) -> list[Row]:
        """Tool axis t along a: ``a₁·t = a₂·t = 0``, ``a·t ≥ 0``; with tilt ``(a₁·t)² + (a₂·t)² ≤ sin² tilt``."""
        if not self.axis_rows:
            return []
        at, p, zero = self.quantities, self._symbols[1], ca.SX(0)
        sideways = [ca.dot(p[a], at.axis) for a in ("a1", "a2")]
        slack = ca.SX(0.0 if self.alignment == "exact" else self.reach.axis_slack)
        facing = Row("tool_axis.facing", "1", ca.dot(p["axis"], at.axis), zero, ca.SX(math.inf))
        if self.task.tilt == 0:
            sideways = sideways[: self.axis_rows]
            return [Row(f"tool_axis.{k + 1}", "1", s, -slack, slack) for k, s in enumerate(sideways)] + [facing]
        tilt = ca.sumsqr(ca.vertcat(*sideways))
        return [Row("tool_axis.sin2_tilt", "1", tilt, ca.SX(-math.inf), p["sin_tilt"] ** 2), facing]

    def _yaw_rows(self) -> list[Row]:
        """Sine of the turn of the tool away from the wanted yaw, which is zero, and the side on which it faces."""
        if self.task.heading is None:
            return []
        p, zero = self._symbols[1], ca.SX(0)
        turned = _turned(self.quantities.walk, spin_axis(self.task.tool_axis))
        beside = ca.dot(ca.cross(p["spin"], p["axis"]), turned)
        facing = Row("yaw.facing", "1", ca.dot(p["spin"], turned), zero, ca.SX(math.inf))
        return [Row("yaw", "1", beside, zero, zero), facing]

    def clearance_rows(self, obstacles: Sequence[Obstacle] | None = None) -> list[Row]:
        """Lower bounds of distances, at least the margin [m]; ``obstacles`` may be smaller or moved by symbols."""
        if self.scene is None:
            return []
        margin, endless = ca.SX(self.scene.margin), ca.SX(math.inf)
        bounds = self.scene.rows(self.q, obstacles)
        return [Row(name, "m", bound, margin, endless, name, convex=True) for name, bound in bounds]

    def _bound_rows(self) -> list[Row]:
        """The terms of ``subject_to``, each entry over the size of its row."""
        rows = []
        for k, (name, term) in enumerate(bound_terms(self.task)):
            if term.held(self.robot):
                continue  # they are bounds of the joints
            at, size, shown = self.quantities, term.row_size, _shown_as(term)
            values = self._values(term, "subject_to", k)
            entries = zip(term.labels(at), term.units_of(at), values, term.bounds_of(at), strict=True)
            for label, unit, value, (low, high) in entries:
                rows.append(Row(label, unit, value / size, ca.SX(low / size), ca.SX(high / size), name, shown))
        return rows

    def _values(self, term: Term, section: str, place: int) -> list[ca.SX]:
        """The quantities of a term [unit], a row each; an InputError where no joint changes them."""
        values: list[ca.SX] = ca.vertsplit(ca.vec(term.quantity(self.quantities)))
        if not values:
            message = f"{term.kind} bounds nothing on this arm: no joint of it can change that"
            raise InputError(Issue(message, ("task", section, place), term.kind, "leave it out"))
        return values


def _turned(reached: Walk, vector: Array) -> ca.SX:
    """A vector (3,) of the tool frame in the world."""
    return ca.SX(stack([sum(float(vector[j]) * reached.columns[j][k] for j in range(3)) for k in range(3)]))


def _shown_as(term: Term) -> Callable[[float], float]:
    return lambda value: term.shown(value * term.row_size)


def bound_terms(task: Task) -> list[tuple[str, Term]]:
    """The terms of ``subject_to`` with the names of their requirements: kinds that recur are numbered."""
    kinds = [term.kind for term in task.subject_to]
    counts = [kinds[: k + 1].count(kind) for k, kind in enumerate(kinds)]
    names = [kind if kinds.count(kind) == 1 else f"{kind} ({n})" for kind, n in zip(kinds, counts, strict=True)]
    return list(zip(names, task.subject_to, strict=True))


def held_joints(robot: Robot, task: Task) -> dict[int, float]:
    """Joint index -> value [rad or m] of all that terms of the task hold."""
    return {joint: value for term in task.subject_to for joint, value in term.held(robot).items()}


def with_held_joints(arm: Arm, task: Task) -> Arm:
    """The arm whose joints that the task holds have their value as both limits: neither starts nor steps move them."""
    held = held_joints(arm.robot, task)
    if not held:
        return arm
    joints = tuple(
        replace(joint, lower=held[k], upper=held[k]) if k in held else joint for k, joint in enumerate(arm.robot.joints)
    )
    return replace(arm, robot=replace(arm.robot, joints=joints))


def released(robot: Robot, task: Task) -> Task:
    """The task without terms that hold joints, which an inquiry into a failure lets give."""
    return task.model_copy(update={"subject_to": tuple(term for term in task.subject_to if not term.held(robot))})
