"""``MotionSearch``: the ways through the candidates of a path, and the smooth motions that they lead to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.numerics import Array, Codes, DerivedAgain, Mask
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.paths.motion import Motion, breaks_away
from posture_opt.selection.paths.path_breaks import passes_singularity
from posture_opt.selection.paths.path_candidates import PathCandidates, held
from posture_opt.selection.paths.smooth_motion import SmoothMotion
from posture_opt.selection.paths.step_bounds import speed_bounds, step_bounds
from posture_opt.selection.paths.step_graph import StepGraph
from posture_opt.selection.paths.task_path import TaskPath
from posture_opt.selection.paths.time_law import TimeLaw
from posture_opt.selection.search.confirmation import Confirmation
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.multistart import as_good
from posture_opt.selection.stations.stations_problem import BARRIER, StationsOutcome, StationsPoint

_NO_OBJECTIVE = 1e-9  # of a scaled objective below it no share is asked for
_MAX_IDLE_SOLVES = 2  # smooth problems in a row that bring nothing
_MAX_START_WAYS = 3  # ways that the smooth problem starts from
_MIN_DISTANCE_RAD = math.radians(30.0)  # between two of them in a joint, or 0.5 m of a slide
_FINAL_IK_STEPS = 3  # of inverse kinematics, from an error of 1e-7: they are quadratic
_MAX_COST_RATIO = 1.5  # times the best objective: ways up to there may still become the best
_MAX_BREAKS = 8  # steps that may count nothing, because the arm has to leave the path there
_LATE_BARRIER = 1e-5  # that IPOPT starts with where a part of the points was optimised already
_STEP_RATIO = 3.0  # times the smallest step that is possible: what is allowed where nothing is stated
STEP_TOLERANCE_RAD = 1e-9
"""By which a step may exceed its bound [rad or m]: rounding."""
SPEED_TOLERANCE = 1e-6
"""Relative, by which the tool may be faster than its joints allow: rounding of their steps."""


@dataclass(frozen=True)
class Paces:
    """What bounds a motion.

    Args:
        largest: change of any joint between listed points [rad or m], but where the arm has to leave the path.
        stated: whether the task asks for it, and nowhere more.
        speed: of the tool point [m/s]; None where the joints may take their time.
        most: (K − 1, n) how far each joint may move between neighbours of all points [rad or m].
    """

    largest: float
    stated: bool
    speed: float | None
    most: Array


@dataclass(frozen=True, eq=False)
class MotionSearch(DerivedAgain):
    """The search among the candidates of one path.

    Args:
        engine: of the points; ``guard`` has rows that keep the arm clear of the ``scene``.
        closed: whether the motion comes back to its first posture; the candidates of both ends are then the same.
        alone: (K,) the best objective at each point by itself, as far as it was sought: minus infinity elsewhere.
        starts: smooth problems at most; a few candidates that are motions themselves need no second one.
        apart: candidates of points that were sought by themselves; None: ``found``.
    """

    engine: Engine
    guard: Engine
    path: TaskPath
    found: PathCandidates
    steps: JointSteps
    scene: Scene
    closed: bool
    alone: Array
    starts: int = 1 + 2 * _MAX_START_WAYS
    apart: PathCandidates | None = None

    def within_limits(self) -> MotionSearch:
        """The same search, joints that would leave their limits by going on turning compared as they are.

        So are those that would end a closed motion whole turns away where steps of the usual size lead back.
        """
        Q, beyond = self.steps.unwrapped(self._calmest_way[1])
        if len(beyond):
            return self._with_steps(self.steps.without_turns(beyond)).within_limits()
        turning = self.steps.whole_turns(Q) != 0
        if self.closed and np.any(turning & self.steps.wide):
            back = self._with_steps(self.steps.without_turns(turning))
            if back._breaks <= self._breaks and back._calmest_way[0] <= _STEP_RATIO * self._calmest_way[0]:
                return back.within_limits()
        return self

    @property
    def _breaks(self) -> int:
        """In how many steps the arm has to leave the path."""
        return int(np.count_nonzero(~self._calmest_way[2].any(axis=1)))

    def _with_steps(self, steps: JointSteps) -> MotionSearch:
        """The same search with steps that tell more turns apart, and the candidates that these are of."""
        return replace(self, steps=steps, found=self.found.turned(steps))

    def _graph(self, weights: Array) -> StepGraph:
        """The candidates with the steps between them, times weights (K − 1, n)."""
        return StepGraph.of(self.steps, self.found.postures, self.found.costs, weights)

    @cached_property
    def _calmest_way(self) -> tuple[float, Array, Array]:
        """The least possible largest step between listed points, the postures (K, n) of a way that has it, and the
        weights (K − 1, n) of the steps.

        Where the arm has to leave the path its step counts nothing, so that it stays on the path everywhere else.
        """
        weights = np.asarray(self.path.parts, dtype=float)[:, None] * np.ones(len(self.steps.wide))
        step, Q = self._calmest(weights)
        for _ in range(_MAX_BREAKS):
            Q, _ = self.steps.unwrapped(Q)
            k = int(np.argmax(np.max(np.abs(np.diff(Q, axis=0)) * self.steps.counted * weights, axis=1)))
            others = np.where((np.arange(len(weights)) == k)[:, None], 0.0, weights)
            if not others.any():
                break
            less, on = self._calmest(others)
            leaves = bool(breaks_away(self.engine, Q[k : k + 2])[0])
            if not leaves and (_STEP_RATIO * less > step or not self._is_singular(Q, k)):
                break
            step, Q, weights = less, on, others
        return step, Q, weights

    def _is_singular(self, Q: Array, k: int) -> bool:
        """Whether the arm comes near a singular posture between points k and k + 1 of a motion (K, n)."""
        return passes_singularity(self.engine, self.path, self.found.targets, self.steps, Q, k)

    def jumps(self, motion: Motion) -> Mask:
        """(K − 1,) the steps of a motion that are far larger than others, where the arm has to change its posture."""
        even = self.steps.along(motion.Q) * self.path.parts
        return np.asarray(~self._calmest_way[2].any(axis=1) & (even > _STEP_RATIO * self._even_step(motion)))

    def _calmest(self, weights: Array) -> tuple[float, Array]:
        """The least possible largest step, times weights (K − 1, n), and the postures (K, n) of a way that has it."""
        graph = self._graph(weights)
        ways = graph.closed_of_smallest_step() if self.closed else graph
        step, way = ways.smallest_step()
        return step, ways.motion(way)

    @cached_property
    def smooth(self) -> tuple[SmoothMotion, ...]:
        """Without rows that keep the arm clear, and with them: they are dear, and often nothing is in the way."""
        problems = [self.engine.optimisation_problem]
        if self.guard is not self.engine and self.scene.active:
            problems.append(self.guard.optimisation_problem)
        barrier, targets = _LATE_BARRIER if self.starts == 1 else BARRIER, self.found.targets
        return tuple(SmoothMotion.of(p, self.steps, targets, self.path, self.closed, barrier=barrier) for p in problems)

    def bound(self, motion: Motion) -> float:
        """σ_max [m] that no motion gets below at its worst point, as far as its best posture was found.

        NaN where something else is minimised.
        """
        task = self.engine.optimisation_problem.task
        if task.criterion != "worst" or task.minimize:
            return math.nan
        worst = float(np.max(np.minimum(self.alone, motion.objectives)))
        return float(np.sqrt(worst * self.found.targets[0].scale))

    @cached_property
    def calmest(self) -> tuple[float, Motion]:
        """The least possible largest step between listed points, divided evenly, and a motion that has it."""
        step, Q, weights = self._calmest_way
        start = self._motion(Q)
        if not self.engine.optimisation_problem.freedom or self.starts == 1:
            return step, start
        smooth = self._smoothed(start, lambda problem, point: problem.least_step(point, weights))
        even = self._even_step(smooth)
        return (even, smooth) if smooth.feasible and even < step else (step, start)

    def _even_step(self, motion: Motion) -> float:
        """The largest step between listed points that the steps of a motion on the path add up to [rad or m]."""
        return float(np.max(np.abs(np.diff(motion.Q, axis=0)) * self.steps.counted * self._calmest_way[2], initial=0.0))

    def fastest(self, speed: float) -> Motion:
        """A motion that can be followed at the highest constant speed, found about ``speed`` [m/s]."""
        weights = np.where(self._calmest_way[2] > 0, 1 / speed_bounds(self.steps, self.path, speed), 0.0)
        start = self._motion(self._calmest(weights)[1])
        if not self.engine.optimisation_problem.freedom:
            return self._on_path(start)
        if self.starts == 1:
            return start
        smooth = self._smoothed(start, lambda problem, point: problem.least_step(point, weights))
        pairs = [(self.law(motion).highest or math.inf, motion) for motion in (start, smooth) if motion.feasible]
        return max(pairs, key=lambda pair: pair[0])[1] if pairs else start

    def law(self, motion: Motion, speed: float | None = None) -> TimeLaw:
        """When a motion is where, at a stated speed or at the highest [m/s]."""
        return TimeLaw(self.engine.robot, motion.Q, self.path.lengths, speed)

    def paces(self, stated: float | None, speed: float | None, known: Sequence[Motion]) -> Paces:
        """What bounds the motion.

        Args:
            stated: change of any joint between listed points [rad or m]; None: three times the smallest possible.
            speed: of the tool [m/s]; None where nothing is stated.
            known: motions that the bounds must not exclude.
        """
        even = self.calmest[0]
        if stated is not None:
            return Paces(stated, True, speed, step_bounds(self.steps, self.path, max(stated, even), speed))
        calm = max([even, *(self._even_step(motion) for motion in known)])
        span = float(np.max(self.steps.span[self.steps.counted], initial=0.0))
        largest = min(_STEP_RATIO * calm, span)
        most = step_bounds(self.steps, self.path, largest, speed)
        return Paces(largest, False, speed, np.where(self._calmest_way[2] > 0, most, self.steps.span))

    def best(self, paces: Paces, known: Sequence[Motion]) -> Motion | None:
        """The best motion found within its bounds; None where none keeps them.

        Of ways through the candidates, of ``known`` motions, and of the smooth motions that they lead to.
        """
        ways = self._ways(paces.most)
        if (turning := self._turning(ways)) is not None:
            return self._with_steps(self.steps.without_turns(turning)).best(paces, known)
        motions = [self._motion(Q) for Q in ways] + list(known)
        if not self.engine.optimisation_problem.freedom:
            motions = [self._on_path(motion) for motion in motions]
        else:
            motions += self._spread_made_least(sorted(motions, key=lambda motion: motion.objective), paces)
        able = [motion for motion in motions if self._keeps(motion, paces)]
        if not able:
            return None
        best = min(motion.objective for motion in able)
        # The smooth problem trades the last digits of the worst point for better other ones.
        return min(able, key=lambda motion: (motion.objective > as_good(best), not motion.optimal, motion.objective))

    def ways(self, paces: Paces) -> list[Motion]:
        """The motions of the best ways through the candidates within bounds."""
        return [self._motion(Q) for Q in self._ways(paces.most)]

    def _turning(self, ways: Sequence[Array]) -> Codes | None:
        """The joints that end a closed way in other whole turns than the calmest motion; None where there are none."""
        if not self.closed or not len(ways):
            return None
        allowed = self.steps.whole_turns(self.calmest[1].Q)
        others = [self.steps.whole_turns(self.steps.unwrapped(Q)[0]) != allowed for Q in ways]
        more = np.flatnonzero(np.any(others, axis=0) & self.steps.wide)
        return more if len(more) else None

    def _keeps(self, motion: Motion, paces: Paces) -> bool:
        """Whether a motion meets all requirements within its bounds."""
        if not motion.feasible or (paces.stated and motion.largest_step > paces.largest + STEP_TOLERANCE_RAD):
            return False
        return paces.speed is None or keeps_speed(self.law(motion), paces.speed)

    def _spread_made_least(self, starts: list[Motion], paces: Paces) -> list[Motion]:
        """Where the smooth problem leads to from the starts, best first, until nothing can be better."""
        least = float(np.max(self.alone))
        ends: list[Motion] = []
        idle = 0
        for start in starts[: self.starts]:
            ends.append(self._smoothed(start, lambda problem, point: problem.solve(point, paces.most), spreads=True))
            able = [end.objective for end in ends if end.feasible and end.optimal]
            better = len(able) > 1 and as_good(able[-1]) < min(able[:-1])
            idle = 0 if better or len(able) < 2 else idle + 1
            if (able and abs(min(able) - least) <= as_good(least) - least) or idle == _MAX_IDLE_SOLVES:
                break
        return ends

    def _ways(self, most: Array) -> list[Array]:
        """The best way through the candidates, and the best ones that pass far from those before.

        Far at the point that costs most on the best way, or else in the middle. No step is above ``most`` (K − 1, n).
        """
        every = self._graph(1 / most)
        graph = every.closed_of_least_cost(1.0) if self.closed else every
        if graph is None:
            return []
        worst, count = graph.worst_costs(1.0), len(graph.costs)
        sizes = np.cumsum([0, *map(len, graph.costs)])
        best = graph.best_way(1.0, float(worst.min())) if np.isfinite(worst.min()) else None
        if best is None:
            return []
        costs = [float(cost[k]) for cost, k in zip(graph.costs, best, strict=True)]
        ways = [best]
        for point in dict.fromkeys((int(np.argmax(costs)), count // 2)):
            ways += self._apart(graph, point, worst[sizes[point] : sizes[point + 1]])
        return [graph.motion(way) for way in ways]

    def _apart(self, graph: StepGraph, point: int, worst: Array) -> list[Codes]:
        """The best ways that pass far from each other at a point, given the least cost through its candidates."""
        chosen: list[int] = []
        for k in np.argsort(worst, kind="stable").tolist():
            near = self.steps.between(graph.postures[point][[k]], graph.postures[point][chosen])
            if worst[k] <= _MAX_COST_RATIO * worst.min() and np.all(near > _MIN_DISTANCE_RAD) and np.isfinite(worst[k]):
                chosen.append(k)
            if len(chosen) == _MAX_START_WAYS:
                break
        ways = [graph.best_way(1.0, float(worst[k]), (point, k)) for k in chosen[1:]]
        return [way for way in ways if way is not None]

    def _on_path(self, motion: Motion) -> Motion:
        """The same motion, its points met to the last digits by some steps of inverse kinematics."""
        Q, requests = motion.Q, np.vstack([held(self.engine, target).rows for target in self.found.targets])
        turns = Q[-1] - Q[0]
        for _ in range(_FINAL_IK_STEPS):
            Q = self.steps.rested(self.engine.ik.stepped(Q, requests)[0])
        return self._motion(np.vstack([Q[:-1], Q[0] + turns]) if self.closed else Q)

    def _smoothed(
        self, start: Motion, solved: Callable[[SmoothMotion, StationsPoint], StationsOutcome], *, spreads: bool = False
    ) -> Motion:
        """Where the smooth problem leads to; it is solved with rows that keep the arm clear where it must be.

        Args:
            spreads: whether the objective is that of the motion, and not its steps.
        """
        for problem in self.smooth:
            end = solved(problem, StationsPoint(np.zeros(4), start.Q))
            motion = self._motion(end.point.Q, end.optimal)
            if spreads and end.optimal:
                motion = replace(motion, confirmation=_said(end, motion))
            if motion.clear:
                break
        return motion

    def _motion(self, Q: Array, optimal: bool | None = None) -> Motion:
        """The motion through postures (K, n), joints turned on without jumps."""
        Q, _ = self.steps.unwrapped(Q)
        certain = not self.engine.optimisation_problem.freedom if optimal is None else optimal
        swept = self.steps.swept(Q, self.path.listed)
        return Motion.of(self.engine, self.found.targets, Q, swept, self.scene, certain)


def _said(end: StationsOutcome, motion: Motion) -> Confirmation:
    """What IPOPT says of the motion that it ended at.

    The standard deviation that the search has of its postures is compared with that of IPOPT's own functions; the
    objective is a variance, or the logarithm of a probability.
    """
    agrees = abs(motion.objective - end.objective) / max(2 * abs(motion.objective), _NO_OBJECTIVE)
    return Confirmation("ipopt", end.iterations, end.residual, agrees)


def keeps_speed(law: TimeLaw, speed: float) -> bool:
    """Whether the joints of a motion allow a constant speed of the tool [m/s]."""
    return law.highest is None or law.highest >= speed * (1 - SPEED_TOLERANCE)
