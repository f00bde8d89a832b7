"""``PathSelector``: one posture for each point of a path, joined without jumps."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.errors import NoSolutionError
from posture_opt.numerics import Array
from posture_opt.selection.batches import usual_starts
from posture_opt.selection.engine import Engine
from posture_opt.selection.infeasible import explain_infeasibility, infeasible
from posture_opt.selection.joint_problem import JointOutcome, JointPoint
from posture_opt.selection.multistart import as_good, multistart
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.paths.motion import Motion, off_line
from posture_opt.selection.paths.naive import naive_motions
from posture_opt.selection.paths.path_candidates import PathCandidates, find_candidates
from posture_opt.selection.paths.path_problem import PathProblem
from posture_opt.selection.paths.path_solution import PathSolution
from posture_opt.selection.paths.step_graph import StepGraph
from posture_opt.selection.paths.task_path import TaskPath, stacked
from posture_opt.selection.relaxation import Reason
from posture_opt.selection.selector import PostureSelector, task_of
from posture_opt.selection.solution import HasTask
from posture_opt.selection.task_target import TaskTarget
from posture_opt.selection.tasks.path_task import PathTask

_TIMES = 3.0  # the smallest step that is possible: what is allowed where nothing is stated
_SEEDS = 4  # ways that the smooth problem starts from
_APART = math.radians(30.0)  # between two of them in a joint, or 0.5 m of a slide
_WORTH = 1.5  # times the best objective: ways up to there may still become the best
_OVER = 1e-9  # rad or m: by which a step may exceed its bound


@dataclass(frozen=True, eq=False)
class PathSelector:
    """The search for the postures along the path of one problem; ``selector`` builds what every point needs."""

    problem: HasTask
    selector: PostureSelector
    task: PathTask

    @classmethod
    def of(cls, problem: HasTask) -> PathSelector:
        """For a problem whose task follows a path.

        Raises:
            InputError: nothing uncertain, or a task that the arm cannot do.
        """
        task = path_task_of(problem)
        one_point: Any = replace(cast("Any", problem), task=task.model_copy(update={"path": None, "points": None}))
        return cls(problem, PostureSelector(one_point, compiled=False), task)

    @cached_property
    def path(self) -> TaskPath:
        """The points of the task, and those added between them."""
        return TaskPath.of(self.task)

    @cached_property
    def targets(self) -> list[TaskTarget]:
        """Those of the points."""
        return self.path.targets(self.selector.target, self.selector.reach)

    def solve(self, *, seed: int | None = None) -> PathSolution:
        """The motion whose largest critical spread is least.

        Raises:
            NoSolutionError: a point that no posture reaches, or no way from point to point with steps as small as
                asked; carries the nearest posture, or the motion of least largest step, and the reasons.
        """
        began = time.perf_counter()
        search = self._search(self.problem.solver.seed if seed is None else seed, began)
        smallest, calm = search.smallest_step
        largest = _TIMES * smallest if self.task.largest_step is None else self.task.largest_step
        if smallest > largest + _OVER:
            reasons = search.too_large_a_step(smallest, largest, calm)
            told = "\n".join(reason.message for reason in reasons)
            raise NoSolutionError(told, self._solution(search, calm, largest, began, reasons))
        return self._solution(search, search.best(largest), largest, began)

    def _search(self, seed: int, began: float) -> _MotionSearch:
        """The candidates of all points; where some have none that is clear, with rows that keep the arm clear.

        Raises:
            NoSolutionError: a point without any.
        """
        scene = self.problem.scene
        for guarded in (None, True):
            engine = self.selector.engine_of_all(self.targets, guarded)
            steps = JointSteps.of(engine.robot, engine.optimisation_problem.nlp.indifferent)
            found = find_candidates(engine, self.targets, steps, scene, np.random.default_rng(seed))
            if all(map(len, found.costs)) or engine.optimisation_problem.scene is not None or not scene.active:
                break
        for k, costs in enumerate(found.costs):
            if not len(costs):
                self._explain(engine, found.targets[k], k, began)
        guard = self.selector.engine_of_all(self.targets, True)
        return _MotionSearch(engine, guard, self.path, found, steps, scene)

    def _solution(
        self, search: _MotionSearch, motion: Motion, largest: float, began: float, reasons: Sequence[Reason] = ()
    ) -> PathSolution:
        naive = naive_motions(search.engine, search.found, search.steps, self.path, self.problem.scene)
        problem = search.engine.optimisation_problem
        notes = (*self.problem.notes, problem.axis_note(search.found.targets[0]), *self.selector.remarks())
        return PathSolution(
            problem=self.problem, optimisation_problem=problem, path=self.path, targets=search.found.targets,
            motion=motion, status="infeasible" if reasons else "optimal" if motion.optimal else "feasible",
            largest_step=largest, smallest_step=search.smallest_step[0], bound=search.bound,
            off_line=off_line(search.engine, motion.Q), naive=naive,
            candidates=tuple(map(len, search.found.costs)), seconds=time.perf_counter() - began, notes=notes,
            reasons=tuple(reasons),
        )  # fmt: skip

    def _explain(self, engine: Engine, target: TaskTarget, k: int, began: float) -> None:
        """Raises the error of a point that no posture does, with the reasons."""
        searched = multistart(engine, target, np.random.default_rng(self.problem.solver.seed), usual_starts(engine))
        why = explain_infeasibility(engine, searched)
        name = self.path.numbers[k]
        told = tuple(Reason(r.requirement, f"{name}: {r.message}", r.amount, r.unit) for r in why.reasons)
        told = told or (Reason(name, f"{name}: no posture was found that meets all requirements", 0.0, "1"),)
        why = replace(why, reasons=told)
        solution = infeasible(self.problem, engine, searched, why, time.perf_counter() - began)
        raise NoSolutionError("\n".join(reason.message for reason in told), solution)


def path_task_of(problem: HasTask) -> PathTask:
    """The task of a problem that follows a path."""
    task = task_of(problem)
    assert isinstance(task, PathTask), task.kind
    return task


@dataclass(frozen=True, eq=False)
class _MotionSearch:
    """The ways through the candidates of one path, and the smooth motions that they lead to."""

    engine: Engine
    guard: Engine
    path: TaskPath
    found: PathCandidates
    steps: JointSteps
    scene: Scene

    @cached_property
    def graph(self) -> StepGraph:
        return StepGraph(self.steps, self.found.postures, self.found.costs, self.path.parts)

    @cached_property
    def smooth(self) -> tuple[PathProblem, ...]:
        """Without rows that keep the arm clear, and with them: they are dear, and often nothing is in the way."""
        parameters, fixed = stacked(self.found.targets), np.zeros(4)
        problems = [self.engine.optimisation_problem]
        if self.guard is not self.engine and self.scene.active:
            problems.append(self.guard.optimisation_problem)
        return tuple(PathProblem(p, self.steps, parameters, self.path.parts, fixed, fixed) for p in problems)

    @property
    def bound(self) -> float:
        """σ_max [m] that no motion gets below at its worst point, as far as the best postures of that were found."""
        return float(np.sqrt(max(min(map(float, costs)) for costs in self.found.costs) * self.found.targets[0].scale))

    @cached_property
    def smallest_step(self) -> tuple[float, Motion]:
        """The least possible largest step between listed points, and a motion that has it."""
        start = self._motion(self.graph.motion(self.graph.smallest_step()[1]))
        if not self.engine.optimisation_problem.freedom:
            return start.largest_step, start
        smooth = self._smoothed(start, lambda problem, point: problem.least_step(point))
        best = smooth if smooth.feasible and smooth.largest_step < start.largest_step else start
        return best.largest_step, best

    def best(self, largest: float) -> Motion:
        """The best motion found with no step above ``largest``."""
        motions = [self._motion(Q) for Q in self._ways(largest)] + [self.smallest_step[1]]
        if self.engine.optimisation_problem.freedom:
            motions += [self._smoothed(m, lambda problem, point: problem.least_spread(point, largest)) for m in motions]
        able = [motion for motion in motions if motion.feasible and motion.largest_step <= largest + _OVER]
        best = min(motion.objective for motion in able)
        # The smooth problem trades the last digits of the worst point for better other ones.
        return min(able, key=lambda motion: (motion.objective > as_good(best), not motion.optimal, motion.objective))

    def _ways(self, largest: float) -> list[Array]:
        """The best way through the candidates, and the best ones that pass far from those before."""
        worst = self.graph.worst_costs(largest)
        sizes = np.cumsum([0, *map(len, self.found.costs)])
        middle = len(self.found.costs) // 2
        here = worst[sizes[middle] : sizes[middle + 1]]
        chosen: list[int] = []
        for k in np.argsort(here, kind="stable").tolist():
            near = self.steps.between(self.found.postures[middle][[k]], self.found.postures[middle][chosen])
            if here[k] <= _WORTH * here.min() and np.all(near > _APART) and np.isfinite(here[k]):
                chosen.append(k)
            if len(chosen) == _SEEDS:
                break
        ways = [self.graph.best_way(largest, float(here[k]), (middle, k)) for k in chosen]
        return [self.graph.motion(way) for way in ways if way is not None]

    def _smoothed(self, start: Motion, solved: Callable[[PathProblem, JointPoint], JointOutcome]) -> Motion:
        """Where the smooth problem leads to; it is solved with rows that keep the arm clear where it must be."""
        for problem in self.smooth:
            end = solved(problem, JointPoint(np.zeros(4), start.Q))
            motion = self._motion(end.point.Q, end.optimal)
            if motion.clear:
                break
        return motion

    def _motion(self, Q: Array, optimal: bool | None = None) -> Motion:
        Q, _ = self.steps.unwrapped(Q)
        certain = not self.engine.optimisation_problem.freedom if optimal is None else optimal
        return Motion.of(self.engine, self.found.targets, Q, self.steps.along(Q) * self.path.parts, self.scene, certain)

    def too_large_a_step(self, smallest: float, largest: float, calm: Motion) -> list[Reason]:
        """Between which points the joints have to move farther than they may, and what would do."""
        k = int(np.argmax(calm.steps))
        names = self.path.numbers
        joints = np.abs(calm.Q[k + 1] - calm.Q[k])
        joint = self.engine.robot.joints[int(np.argmax(np.where(self.steps.counted, joints, 0.0)))]
        mend = math.ceil(math.degrees(smallest) * 10 + 1e-6) / 10
        message = (
            f"from {names[k]} to {names[k + 1]} {joint.name} has to move by {math.degrees(smallest):.4g} deg, and "
            f"{math.degrees(largest):.4g} deg a step are allowed: set largest_step: {mend:g} deg, or list more points"
        )
        return [Reason("largest_step", message, smallest - largest, "rad")]
