"""Where the postures of targets without joint values come from: the plan of the file's task, and what it requires.

A target is one more place for the tool in the same cell: the tool axis, the terms and the obstacles of the task hold
there as they do for the plan, and of all postures that meet them the one nearest to the plan's is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from posture_opt.errors import NoSolutionError
from posture_opt.model.reach_bound import stretched
from posture_opt.numerics import Array
from posture_opt.robot.joint_ranges import drawn_between
from posture_opt.selection.answer.configurations import configurations
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.task_target import TaskTarget, spin_axis
from posture_opt.selection.search.batches import until_found_often
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.inverse_kinematics import TOLERANCE
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.selection.tasks.custom import Custom
from posture_opt.selection.tasks.direction import Direction
from posture_opt.selection.terms.near_posture import NearPosture
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.spread.task_spread import across_basis
from posture_opt.units import JointQuantity, number

_DIMENSIONS = {"revolute": "angle", "prismatic": "length"}
_ANY_SIGMA = 1e-6  # rad or m, of the first joint, where no row asks for the spread: a program has some spread
_SEED = 0
_BRANCH_STARTS = 200  # random postures that are led to a target: of eight configurations each is found then
_MAX_EXPLAINED = 3  # targets of which is asked what keeps the arm from them, a second each
_UNEXPLAINED = "no posture that the task and the cell allow was found"


class TargetTask(Custom):
    """What a task of a file requires at one more target: axis and terms, with the least motion in place of its aim."""

    oriented: bool = False

    @property
    def heading(self) -> Direction | None:
        """Any, where the spin is held: each target has its own."""
        return (1.0, 0.0, 0.0) if self.oriented else None


def target_task(problem: ProblemData, near: Array, p: Array, *, spun: bool, free: bool = False) -> TargetTask:
    """The requirements of the task of a problem, or none where it states none, at a target p (3,) [m], world.

    Args:
        near: (n,) posture to be near to [rad or m].
        spun: whether the spin of the tool is held, as by a wanted orientation.
        free: whether the tool axis may point anywhere, as where joint values say where it does.
    """
    joints = zip(problem.robot.joints, map(float, near), strict=True)
    posture = {joint.name: JointQuantity(value, _DIMENSIONS[joint.type]) for joint, value in joints}
    task, term = problem.task, NearPosture(kind="near_posture", posture=posture)
    axis = "free" if free else "aligned" if spun else "free" if task is None else task.axis_request
    asked = TargetTask(kind="custom", axis=axis, criterion="none", minimize=(term,), oriented=spun and not free)
    asked = asked.model_copy(update={"position": tuple(map(float, p))})
    if task is None:
        return asked
    kept = {"direction": task.direction, "tool_axis": task.tool_axis, "subject_to": task.subject_to}
    return asked.model_copy(update={**kept, "tilt": 0.0 if spun else task.tilt})


@dataclass(frozen=True)
class Found:
    """The posture (n,) [rad or m] at one target, and why the target is refused; empty where it is not."""

    q: Array
    reason: str = ""


@dataclass
class TaskPostures:
    """The postures at targets, found one after another from those of the plan.

    Args:
        problem: whose task, cell and arm hold.
        plan: the answers at the stations of its task; empty where there is none.
        oriented: whether targets state the orientation of the tool.
    """

    problem: ProblemData
    plan: Sequence[Solution]
    oriented: bool
    _first: Array | None = None
    _explained: int = 0
    _selectors: dict[int, PostureSelector] = field(default_factory=dict)

    def at(self, p: Array, R: Array | None, before: Array | None) -> Found:
        """The posture at a tool point p (3,) [m], world, near that of the nearest station of the plan.

        Args:
            R: (3, 3) wanted orientation of the tool, or any that the task allows.
            before: (n,) posture of the target before [rad or m].
        """
        station = self._nearest_station(p)
        selector, start = self._selector(station, p), self._reference(station)
        target = self._target(selector, station, p, R)
        for guarded in (False, True):  # rows against collisions cost more, and seldom change the answer
            engine = selector.engine(target, guarded)
            for q in (start, *(() if before is None else (before,))):
                end = _followed(engine, q, target)
                if end.feasible and is_clear(self.problem.scene, end.q[None])[0]:
                    return self._kept(end.q)
        return self._searched(selector, target, start)

    def branches(self, p: Array, R: Array | None) -> dict[tuple[str, ...], Array]:
        """Configuration -> the posture (n,) in it at a target; arguments as of `at`."""
        station = self._nearest_station(p)
        selector, reference = self._selector(station, p), self._reference(station)
        target, rng = self._target(selector, station, p, R), np.random.default_rng(_SEED)
        engine, robot = selector.engine(target, guarded=True), self.problem.robot
        Q, errors = engine.ik.solve(engine.ik.random_postures(_BRANCH_STARTS, rng),
                                    engine.request(target, _BRANCH_STARTS, rng))  # fmt: skip
        led = Q[errors < TOLERANCE]
        led = led[np.argsort(np.abs(led - reference).max(axis=1), kind="stable")]
        nearest = dict(zip(configurations(robot, led[::-1]), led[::-1], strict=True))
        ends = [_followed(engine, q, target) for q in nearest.values()]
        kept = [end.q for end in ends if end.feasible and is_clear(self.problem.scene, end.q[None])[0]]
        return dict(zip(configurations(robot, np.reshape(kept, (-1, robot.n))), kept, strict=True))

    def _searched(self, selector: PostureSelector, target: TaskTarget, start: Array) -> Found:
        """What random starts lead to; of the first targets that are out of reach, which requirement is in the way."""
        beyond = self._beyond(target.lower)
        if beyond > 0:
            return Found(start, f"the target lies at least {number(1e3 * beyond, 4)} mm beyond the reach of the arm")
        if self._explained >= _MAX_EXPLAINED:
            engine = selector.engine(target, guarded=True)
            found = until_found_often(engine, target, np.random.default_rng(_SEED)).found
            clear = [c.q for c in found if c.feasible and is_clear(self.problem.scene, c.q[None])[0]]
            return self._kept(clear[0]) if clear else Found(start, _UNEXPLAINED)
        try:
            return self._kept(selector.solve_target(target, _SEED, known=start).q)
        except NoSolutionError as error:
            self._explained += 1
            q = start if error.solution is None else error.solution.q
            return Found(np.asarray(q, dtype=float), "; ".join(str(error).splitlines()))

    def _beyond(self, p: Array) -> float:
        """How far a point (3,) lies beyond what the arm can stretch to [m]; below zero within."""
        first, longest = stretched(self.problem.robot)
        return float(np.linalg.norm(p - first)) - longest

    def _kept(self, q: Array) -> Found:
        """The posture, which further targets are near to where there is no plan."""
        if not self.plan and self._first is None:
            self._first = q
            self._selectors.clear()
        return Found(q)

    def _nearest_station(self, p: Array) -> int:
        """The station of the plan whose tool point is nearest; 0 without a plan."""
        return int(np.argmin(np.linalg.norm(self._places - p, axis=1))) if self.plan else 0

    @cached_property
    def _places(self) -> Array:
        """(K, 3) tool points of the stations [m], world."""
        return np.array([station.spread.position for station in self.plan])

    def _reference(self, station: int) -> Array:
        """The posture (n,) that targets are to be near to: the plan's, the first target's, the middle of the ranges."""
        if self.plan:
            return np.asarray(self.plan[station].q)
        if self._first is not None:
            return self._first
        low, high = drawn_between(self.problem.robot)
        return np.asarray((low + high) / 2)

    def _selector(self, station: int, p: Array) -> PostureSelector:
        """The search for postures near one station; built when it is first used, for a target such as p (3,) [m]."""
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
    """The search of a problem for one target of another task; sources of error are those that its terms ask for."""
    asked = any(term.part is not None or term.uses_orientation for term in task.subject_to)
    robot = problem.robot
    trivial = Sources.independent({f"{robot.joints[0].name}.{'theta' if robot.joints[0].type == 'revolute' else 'd'}":
                                   _ANY_SIGMA})  # fmt: skip
    sources = problem.sources if asked else trivial
    return PostureSelector(replace(problem, task=task, sources=sources), compiled=False, keeps_mounting=True)


def _followed(engine: Engine, q: Array, target: TaskTarget) -> CandidatePosture:
    """The nearest optimum that a posture (n,) leads to."""
    return engine.polished(engine.candidates(q[None], target)[0], target)
