"""Postures at targets without joint values, near the plan of the file's task, and what that task requires."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.errors import NoSolutionError
from posture_opt.model.chain import stretched
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.robot.posture import drawn_between
from posture_opt.selection.answer.other_postures import configurations
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.task_target import TaskTarget, spin_axis
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, TOLERANCE
from posture_opt.selection.search.multistart import until_found_often
from posture_opt.selection.search.search_outcome import DISTANCE_ROUNDING, is_clear
from posture_opt.selection.tasks.custom import Custom
from posture_opt.selection.tasks.workpiece import Direction
from posture_opt.selection.terms.joint_terms import NearPosture
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.task_spread import across_basis
from posture_opt.units import JointQuantity, number

_SEED = 0


class TargetTask(Custom):
    """Axis and terms of a file's task at one more target, with the least motion in place of its aim."""

    oriented: bool = False

    @property
    def heading(self) -> Direction | None:
        """Any, where the spin is held: each target has its own."""
        return (1.0, 0.0, 0.0) if self.oriented else None


def target_task(problem: ProblemData, near: Array, p: Array, *, spun: bool, free: bool = False) -> TargetTask:
    """Requirements of a problem's task at one more target p (3,) [m], world, near a posture (n,) [rad or m]."""
    joints = zip(problem.robot.joints, map(float, near), strict=True)
    dimensions = {"revolute": "angle", "prismatic": "length"}
    posture = {joint.name: JointQuantity(value, dimensions[joint.type]) for joint, value in joints}
    task, term = problem.task, NearPosture(kind="near_posture", posture=posture)
    axis = "free" if free else "aligned" if spun else "free" if task is None else task.axis_request
    asked = TargetTask(kind="custom", axis=axis, criterion="none", minimize=(term,), oriented=spun and not free)
    asked = asked.model_copy(update={"position": tuple(map(float, p)), "ordinary": 0.0})
    if task is None:
        return asked
    kept = {"direction": task.direction, "tool_axis": task.tool_axis, "subject_to": task.subject_to}
    return asked.model_copy(update={**kept, "tilt": 0.0 if spun else task.tilt})


@dataclass(frozen=True)
class Found:
    """Posture (n,) [rad or m] at one target, and why it is refused, if it is."""

    q: Array
    reason: str = ""


@dataclass
class TaskPostures:
    """Postures at targets, one after another from those of the plan."""

    problem: ProblemData  # whose task, cell and arm hold
    plan: Sequence[Solution]  # the answers at the stations of its task; empty where there is none
    oriented: bool  # whether targets state the orientation of the tool
    _first: Array | None = None
    _explained: int = 0
    _selectors: dict[int, PostureSelector] = field(default_factory=dict)

    def at(self, p: Array, R: Array | None, before: Array | None) -> Found:
        """Posture at a tool point p (3,) [m] and orientation R (3, 3), world, near the plan's nearest station."""
        selector, start, target = self._near(p, R)
        for guarded in (False, True):  # rows against collisions cost more, and seldom change the answer
            engine = selector.engine(target, guarded)
            for q in (start, *(() if before is None else (before,))):
                end = self._followed(engine, q, target)
                if end is not None:
                    return self._kept(end)
        return self._searched(selector, target, start)

    def branches(self, p: Array, R: Array | None) -> dict[tuple[str, ...], Array]:
        """Configuration -> posture (n,) in it at a target."""
        selector, reference, target = self._near(p, R)
        rng = np.random.default_rng(_SEED)
        engine, robot = selector.engine(target, guarded=True), self.problem.robot
        drawn = engine.ik.random_postures(200, rng)  # of eight configurations each is found then
        Q, errors = engine.ik.solve(drawn, engine.request(target, len(drawn), rng))
        led = Q[errors < TOLERANCE]
        led = led[np.argsort(np.abs(led - reference).max(axis=1), kind="stable")]
        nearest = dict(zip(configurations(robot, led[::-1]), led[::-1], strict=True))
        ends = [self._followed(engine, q, target) for q in nearest.values()]
        kept = [end for end in ends if end is not None]
        return dict(zip(configurations(robot, np.reshape(kept, (-1, robot.n))), kept, strict=True))

    def _searched(self, selector: PostureSelector, target: TaskTarget, start: Array) -> Found:
        first, longest = stretched(self.problem.robot)
        beyond = float(np.linalg.norm(target.lower - first)) - longest
        if beyond > 0:
            return Found(start, f"the target lies at least {number(1e3 * beyond, 4)} mm beyond the reach of the arm")
        if self._explained >= 3:  # a second each
            engine = selector.engine(target, guarded=True)
            found = until_found_often(engine, target, np.random.default_rng(_SEED)).found
            clear = [c.q for c in found if c.feasible and is_clear(self.problem.scene, c.q[None])[0]]
            unexplained = Found(start, "no posture that the task and the cell allow was found")
            return self._kept(clear[0]) if clear else unexplained
        try:
            return self._kept(selector.solve_target(target, _SEED, known=start).q)
        except NoSolutionError as error:
            self._explained += 1
            q = start if error.solution is None else error.solution.q
            return Found(np.asarray(q, dtype=float), "; ".join(str(error).splitlines()))

    def _kept(self, q: Array) -> Found:
        if not self.plan and self._first is None:
            self._first = q
            self._selectors.clear()
        return Found(q)

    def _followed(self, engine: Engine, q: Array, target: TaskTarget) -> Array | None:
        """(n,) nearest optimum that a posture (n,) leads to, where it is feasible and clear."""
        end = engine.polished(engine.candidates(q[None], target)[0], target)
        return end.q if end.feasible and is_clear(self.problem.scene, end.q[None])[0] else None

    def _near(self, p: Array, R: Array | None) -> tuple[PostureSelector, Array, TaskTarget]:
        """Search near the nearest station of the plan, the posture to be near to (n,), and the target."""
        places = [np.linalg.norm(station.spread.position - p) for station in self.plan]
        station = int(np.argmin(places)) if places else 0
        selector = self._selector(station, p)
        return selector, self._reference(station), self._target(selector, station, p, R)

    def _reference(self, station: int) -> Array:
        """(n,) posture to be near to: the plan's, the first target's, the middle of the ranges."""
        if self.plan:
            return np.asarray(self.plan[station].q)
        if self._first is not None:
            return self._first
        return np.asarray(np.mean(drawn_between(self.problem.robot), axis=0))

    def _selector(self, station: int, p: Array) -> PostureSelector:
        """The search for postures near one station, built for a first target p (3,) [m]."""
        if station not in self._selectors:
            spun = self.oriented or (bool(self.plan) and self.plan[station].target.spun)
            task = target_task(self.problem, self._reference(station), p, spun=spun)
            self._selectors[station] = selector_of(self.problem, task)
        return self._selectors[station]

    def _target(self, selector: PostureSelector, station: int, p: Array, R: Array | None) -> TaskTarget:
        """The target at p (3,), with the tool axis of the station, or of a wanted orientation R (3, 3)."""
        given = self.plan[station].target if self.plan else selector.target
        target = replace(given, lower=p, upper=p, clearance=float("nan"), scale=1.0)
        if R is None:
            return target
        tool_axis = selector.task.tool_axis
        axis = R @ np.array(tool_axis) / np.linalg.norm(tool_axis)
        basis = across_basis(axis, selector.reach.normal)
        return replace(target, axis=axis, axis_basis=basis, spin=R @ spin_axis(tool_axis), tilt=0.0)


def selector_of(problem: ProblemData, task: TargetTask) -> PostureSelector:
    """Search of a problem for one target of another task, with the sources that its terms ask for."""
    asked = any(term.part is not None or term.uses_orientation for term in task.subject_to)
    first = problem.robot.joints[0]
    trivial = {f"{first.name}.{'theta' if first.type == 'revolute' else 'd'}": 1e-6}  # a program has some spread
    sources = problem.sources if asked else Sources.independent(trivial)
    return PostureSelector(replace(problem, task=task, sources=sources), compiled=False, keeps_mounting=True)


def broken_requirements(problem: ProblemData, q: Array, kept: Array, rows: Codes) -> dict[int, str]:
    """Row -> the requirement of cell or task broken by q (N, n), of ``rows`` (k,); ``kept`` (N, n) [rad or m].

    A compensated posture may miss by some mrad what the planned, or given, one kept or leant on.
    """
    if not len(rows):
        return {}
    q, kept = q[rows], kept[rows]
    moved = (np.abs(q - kept).max(axis=1) > math.radians(5.0))[:, None]  # to another posture
    found = {**_broken_terms(problem, q, kept, moved), **_collisions(problem.scene, q, kept, moved)}
    return {int(rows[k]): reason for k, reason in found.items()}


def _collisions(scene: Scene, q: Array, kept: Array, moved: Mask) -> dict[int, str]:
    if not scene.active:
        return {}
    required, reasons = np.array(scene.required), {}
    least, now, before = required - DISTANCE_ROUNDING, scene.distances(q), scene.distances(kept)
    bad = (now < least) & ((before < least) | moved | (now < -1e-3))
    for k in np.flatnonzero(bad.any(axis=1)).tolist():
        pair = int(np.argmin(np.where(bad[k], now[k] - required, np.inf)))
        a, b = scene.pairs[pair]
        away, margin = (number(1e3 * float(v), 3) for v in (now[k, pair], required[pair]))
        near = f"{a} comes within {away} mm of {b}, and {margin} mm are required"
        reasons[k] = near if now[k, pair] > 0 else f"{a} and {b} overlap"
    return reasons


def _broken_terms(problem: ProblemData, q: Array, kept: Array, moved: Mask) -> dict[int, str]:
    """Postures that break a term of ``subject_to``, each with the one that it breaks most."""
    if problem.task is None or all(term.held(problem.robot) for term in problem.task.subject_to):
        return {}
    selector = selector_of(problem, target_task(problem, kept[0], np.zeros(3), spun=False, free=True))
    nlp, p = selector.engine(selector.target, guarded=False).optimisation_problem.nlp, selector.target.parameters
    (low, high), values = nlp.row_bounds(p), nlp.row_values(q, p)
    counted = np.array([bool(row.term) for row in nlp.rows])  # rows of the target count for nothing
    now, before = (
        np.where(counted, np.maximum(np.maximum(low - v, v - high), 0.0), 0.0)
        for v in (values, nlp.row_values(kept, p))
    )
    bad, reasons = (now > ROW_TOLERANCE) & ((before > ROW_TOLERANCE) | moved), {}
    for k in np.flatnonzero(bad.any(axis=1)).tolist():
        at = int(np.argmax(np.where(bad[k], now[k], 0.0)))
        row, value = nlp.rows[at], float(values[k, at])
        bound, word = (float(low[at]), "at least") if value < low[at] else (float(high[at]), "at most")
        units = {"m": (1e3, " mm"), "rad": (180 / math.pi, " deg"), "1": (1.0, "")}
        factor, unit = units.get(row.unit, (1.0, f" {row.unit}"))
        shown, asked = (f"{number(factor * row.shown(v), 4)}{unit}" for v in (value, bound))
        reasons[k] = f"{row.name} is {shown}, and {word} {asked} is required"
    return reasons
