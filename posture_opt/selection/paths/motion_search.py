"""``MotionSearch``: the ways through the candidates of a path, and the smooth motions that they lead to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.numerics import Array, Codes, DerivedAgain
from posture_opt.selection.answer.placement import PlacementRange
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.paths.motion import Motion
from posture_opt.selection.paths.path_candidates import PathCandidates, held
from posture_opt.selection.paths.step_graph import StepGraph
from posture_opt.selection.paths.task_path import TaskPath
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.multistart import as_good
from posture_opt.selection.search.relaxation import Reason
from posture_opt.selection.stations.stations_problem import (
    Station,
    StationsOutcome,
    StationsPoint,
    StationsProblem,
    StationSteps,
)

MAX_ITERATIONS = 200  # of IPOPT in one smooth problem
_MAX_IDLE_SOLVES = 2  # smooth problems in a row that bring nothing
_MAX_START_WAYS = 3  # ways that the smooth problem starts from
_MIN_DISTANCE_RAD = math.radians(30.0)  # between two of them in a joint, or 0.5 m of a slide
_FINAL_IK_STEPS = 3  # of inverse kinematics, from an error of 1e-7: they are quadratic
_MAX_COST_RATIO = 1.5  # times the best objective: ways up to there may still become the best
STEP_TOLERANCE_RAD = 1e-9
"""By which a step may exceed its bound [rad or m]: rounding."""


@dataclass(frozen=True, eq=False)
class MotionSearch(DerivedAgain):
    """The search among the candidates of one path.

    Args:
        engine: of the points; ``guard`` has rows that keep the arm clear of the ``scene``.
    """

    engine: Engine
    guard: Engine
    path: TaskPath
    found: PathCandidates
    steps: JointSteps
    scene: Scene

    def within_limits(self) -> MotionSearch:
        """The same search, joints that would leave their limits by going on turning compared as they are."""
        _, beyond = self.steps.unwrapped(self.graph.motion(self.graph.smallest_step()[1]))
        if not len(beyond):
            return self
        steps = replace(self.steps, wide=self.steps.wide & ~np.isin(np.arange(len(self.steps.wide)), beyond))
        return replace(self, steps=steps, found=self.found.turned(steps)).within_limits()

    @cached_property
    def graph(self) -> StepGraph:
        """The candidates with the steps between them."""
        return StepGraph(self.steps, self.found.postures, self.found.costs, self.path.parts)

    @cached_property
    def smooth(self) -> tuple[StationsProblem, ...]:
        """Without rows that keep the arm clear, and with them: they are dear, and often nothing is in the way."""
        problems = [self.engine.optimisation_problem]
        if self.guard is not self.engine and self.scene.active:
            problems.append(self.guard.optimisation_problem)
        return tuple(smooth_problem(p, self.steps, self.found.targets, self.path) for p in problems)

    def bound(self, motion: Motion) -> float:
        """σ_max [m] that no motion gets below at its worst point, as far as its best posture was found.

        NaN where something else is minimised.
        """
        task = self.engine.optimisation_problem.task
        if task.criterion != "worst" or task.minimize:
            return math.nan
        pairs = zip(self.found.costs, motion.objectives.tolist(), strict=True)
        worst = max(min(float(np.min(costs)), own) for costs, own in pairs)
        return float(np.sqrt(worst * self.found.targets[0].scale))

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
        """The best motion found with no step above ``largest`` [rad or m].

        Of ways through the candidates and of the smooth motions that they lead to; feasible ones before others.
        """
        motions = [self._motion(Q) for Q in self._ways(largest)] + [self.smallest_step[1]]
        if not self.engine.optimisation_problem.freedom:
            motions = [self._on_path(motion) for motion in motions]
        else:
            motions += self._spread_made_least(sorted(motions, key=lambda motion: motion.objective), largest)
        able = [motion for motion in motions if motion.feasible and motion.largest_step <= largest + STEP_TOLERANCE_RAD]
        best = min(motion.objective for motion in able)
        # The smooth problem trades the last digits of the worst point for better other ones.
        return min(able, key=lambda motion: (motion.objective > as_good(best), not motion.optimal, motion.objective))

    def _spread_made_least(self, starts: list[Motion], largest: float) -> list[Motion]:
        """Where the smooth problem leads to from the starts, best first, until nothing can be better."""
        least = max(float(np.min(costs)) for costs in self.found.costs)
        ends: list[Motion] = []
        idle = 0
        for start in starts:
            ends.append(self._smoothed(start, lambda problem, point: problem.solve(point, largest)))
            able = [end.objective for end in ends if end.feasible and end.optimal]
            better = len(able) > 1 and as_good(able[-1]) < min(able[:-1])
            idle = 0 if better or len(able) < 2 else idle + 1
            if (able and abs(min(able) - least) <= as_good(least) - least) or idle == _MAX_IDLE_SOLVES:
                break
        return ends

    def _ways(self, largest: float) -> list[Array]:
        """The best way through the candidates, and the best ones that pass far from those before.

        Far at the point that costs most on the best way, or else in the middle.
        """
        worst, count = self.graph.worst_costs(largest), len(self.found.costs)
        sizes = np.cumsum([0, *map(len, self.found.costs)])
        best = self.graph.best_way(largest, float(worst.min())) if np.isfinite(worst.min()) else None
        if best is None:
            return []
        costs = [float(cost[k]) for cost, k in zip(self.found.costs, best, strict=True)]
        ways = [best]
        for point in dict.fromkeys((int(np.argmax(costs)), count // 2)):
            ways += self._apart(point, worst[sizes[point] : sizes[point + 1]], largest)
        return [self.graph.motion(way) for way in ways]

    def _apart(self, point: int, worst: Array, largest: float) -> list[Codes]:
        """The best ways that pass far from each other at a point, given the least cost through its candidates."""
        chosen: list[int] = []
        for k in np.argsort(worst, kind="stable").tolist():
            near = self.steps.between(self.found.postures[point][[k]], self.found.postures[point][chosen])
            if worst[k] <= _MAX_COST_RATIO * worst.min() and np.all(near > _MIN_DISTANCE_RAD) and np.isfinite(worst[k]):
                chosen.append(k)
            if len(chosen) == _MAX_START_WAYS:
                break
        ways = [self.graph.best_way(largest, float(worst[k]), (point, k)) for k in chosen[1:]]
        return [way for way in ways if way is not None]

    def _on_path(self, motion: Motion) -> Motion:
        """The same motion, its points met to the last digits by some steps of inverse kinematics."""
        Q, requests = motion.Q, np.vstack([held(self.engine, target).rows for target in self.found.targets])
        for _ in range(_FINAL_IK_STEPS):
            Q = self.steps.rested(self.engine.ik.stepped(Q, requests)[0])
        return self._motion(Q)

    def _smoothed(self, start: Motion, solved: Callable[[StationsProblem, StationsPoint], StationsOutcome]) -> Motion:
        """Where the smooth problem leads to; it is solved with rows that keep the arm clear where it must be."""
        for problem in self.smooth:
            end = solved(problem, StationsPoint(np.zeros(4), start.Q))
            motion = self._motion(end.point.Q, end.optimal)
            if motion.clear:
                break
        return motion

    def _motion(self, Q: Array, optimal: bool | None = None) -> Motion:
        """The motion through postures (K, n), joints turned on without jumps."""
        Q, _ = self.steps.unwrapped(Q)
        certain = not self.engine.optimisation_problem.freedom if optimal is None else optimal
        return Motion.of(self.engine, self.found.targets, Q, self.steps.along(Q) * self.path.parts, self.scene, certain)

    def too_large_a_step(self, smallest: float, largest: float, calm: Motion) -> list[Reason]:
        """Between which points the joints have to move farther than they may, and what would do."""
        k = int(np.argmax(calm.steps))
        names = self.path.numbers
        joints = np.abs(calm.Q[k + 1] - calm.Q[k])
        joint = self.engine.robot.joints[int(np.argmax(np.where(self.steps.counted, joints, 0.0)))]
        hint = math.ceil(math.degrees(smallest) * 10 + 1e-6) / 10
        message = (
            f"from {names[k]} to {names[k + 1]} {joint.name} has to move by {math.degrees(smallest):.4g} deg, and "
            f"{math.degrees(largest):.4g} deg a step are allowed: set largest_step: {hint:g} deg, or list more points"
        )
        return [Reason("largest_step", message, smallest - largest, "rad")]


def smooth_problem(
    problem: OptimisationProblem,
    steps: JointSteps,
    targets: Sequence[TaskTarget],
    path: TaskPath,
    box: PlacementRange | None = None,
) -> StationsProblem:
    """The postures of all points of a path as one smooth problem.

    Args:
        targets: of the points, in the frame of the workpiece.
        box: where that may stand; default: it is the world.
    """
    stations = tuple(Station(problem, target) for target in targets)
    lower, upper = (np.zeros(4), np.zeros(4)) if box is None else (box.lower, box.upper)
    joined = StationSteps(steps.counted, path.parts)
    return StationsProblem(stations, lower, upper, steps=joined, max_iterations=MAX_ITERATIONS)
