"""``MotionSearch``: the ways through the candidates of a path, and the smooth motions that they lead to."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Literal

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.numerics import Array, Codes, DerivedAgain, Mask
from posture_opt.selection.answer.path_answer import Motion, PathBreak, TimeLaw
from posture_opt.selection.answer.placement import PlacementRange
from posture_opt.selection.paths.joint_steps import (
    JointSteps,
    StepGraph,
    breaks_away,
    passes_singularity,
    speed_bounds,
    step_bounds,
)
from posture_opt.selection.paths.path_candidates import PathCandidates
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_path import TaskPath, stacked
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Confirmation, Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, TOLERANCE, PoseRequest
from posture_opt.selection.search.multistart import as_good
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.selection.stations.stations_problem import (
    BARRIER,
    Station,
    StationsOutcome,
    StationsPoint,
    StationsProblem,
    StationSteps,
)


def smooth_motion(
    problem: OptimisationProblem, steps: JointSteps, targets: Sequence[TaskTarget], path: TaskPath, closed: bool,
    box: PlacementRange | None = None, barrier: float = BARRIER,
) -> StationsProblem:  # fmt: skip
    """Problem of all points of a path, their targets in the frame of the workpiece that may stand in ``box``."""
    stations = tuple(Station(problem, target) for target in (targets[:-1] if closed else targets))
    lower, upper = (np.zeros(4), np.zeros(4)) if box is None else (box.lower, box.upper)
    joined = StationSteps(steps.counted, np.asarray(path.parts, dtype=float), closed)
    return StationsProblem(stations, lower, upper, steps=joined, max_iterations=200, barrier=barrier)


_MAX_START_WAYS = 3
"""Ways that the smooth problem starts from."""
_STEP_RATIO = 3.0
"""Times the smallest step that is possible: what is allowed where nothing is stated."""
STEP_TOLERANCE_RAD = 1e-9
"""By which a step may exceed its bound [rad or m]: rounding."""


@dataclass(frozen=True)
class Paces:
    """What bounds a motion."""

    largest: float  # change of any joint between listed points [rad or m], but where the arm has to leave the path
    stated: bool  # whether the task asks for it, and nowhere more
    speed: float | None  # of the tool point [m/s]; None where the joints may take their time
    most: Array  # (K − 1, n) how far each joint may move between neighbours of all points [rad or m]


@dataclass(frozen=True, eq=False)
class MotionSearch(DerivedAgain):
    """The search among the candidates of one path."""

    engine: Engine  # of the points
    guard: Engine  # with rows that keep the arm clear of the scene
    path: TaskPath
    found: PathCandidates
    steps: JointSteps
    scene: Scene
    closed: bool  # whether the motion comes back to its first posture; the candidates of both ends are then the same
    alone: Array  # (K,) the best objective at each point by itself, as far as it was sought: minus infinity elsewhere
    starts: int = 1 + 2 * _MAX_START_WAYS  # smooth problems at most; candidates that are motions need no second one
    apart: PathCandidates | None = None  # candidates of points that were sought by themselves; None: found

    def within_limits(self) -> MotionSearch:
        """Search with joints compared as they are that would leave their limits, or not come back, by turning on."""
        Q, beyond = self.steps.unwrapped(self._calmest_way[1])
        if len(beyond):
            return self._with_steps(self.steps.without_turns(beyond)).within_limits()
        turning = self.steps.whole_turns(Q) != 0
        if self.closed and np.any(turning & self.steps.wide):
            back = self._with_steps(self.steps.without_turns(turning))
            fewer = np.count_nonzero(back._on_path_steps) >= np.count_nonzero(self._on_path_steps)
            if fewer and back._calmest_way[0] <= _STEP_RATIO * self._calmest_way[0]:
                return back.within_limits()
        return self

    @property
    def _on_path_steps(self) -> Mask:
        """(K − 1,) steps in which the arm need not leave the path."""
        return np.asarray(self._calmest_way[2].any(axis=1))

    def _with_steps(self, steps: JointSteps) -> MotionSearch:
        return replace(self, steps=steps, found=self.found.turned(steps))

    def _graph(self, weights: Array) -> StepGraph:
        return StepGraph.of(self.steps, self.found.postures, self.found.costs, weights)

    @cached_property
    def _calmest_way(self) -> tuple[float, Array, Array]:
        """Least largest step, postures (K, n), weights (K − 1, n) of steps: 0 where the arm has to leave the path."""
        weights = np.asarray(self.path.parts, dtype=float)[:, None] * np.ones(len(self.steps.wide))
        step, Q = self._calmest(weights)
        for _ in range(8):
            Q, _ = self.steps.unwrapped(Q)
            k = int(np.argmax(np.max(np.abs(np.diff(Q, axis=0)) * self.steps.counted * weights, axis=1)))
            others = np.where((np.arange(len(weights)) == k)[:, None], 0.0, weights)
            if not others.any():
                break
            less, on = self._calmest(others)
            if not breaks_away(self.engine, Q[k : k + 2])[0] and (
                _STEP_RATIO * less > step or not passes_singularity(self.engine, self.found.targets, Q, k)
            ):
                break
            step, Q, weights = less, on, others
        return step, Q, weights

    def breaks(self, motion: Motion, off: Array) -> tuple[PathBreak, ...]:
        """Steps in which a motion leaves the path, ``off`` (K − 1,) its lines [m], or is far larger than elsewhere."""
        even = self.steps.along(motion.Q) * self.path.parts
        jumps = ~self._on_path_steps & (even > _STEP_RATIO * self._even_step(motion))
        where = np.flatnonzero(breaks_away(self.engine, motion.Q) | jumps).tolist()
        return tuple(self._break_at(motion.Q, k, float(off[k])) for k in where)

    def _break_at(self, Q: Array, k: int, off: float) -> PathBreak:
        moved, first = np.abs(Q[k + 1] - Q[k]) * self.steps.counted, int(np.count_nonzero(self.path.listed[: k + 1]))
        j = int(np.argmax(moved))
        joint, singular = self.engine.robot.joints[j], passes_singularity(self.engine, self.found.targets, Q, k)
        kind: Literal["singular", "limits"] = "singular" if singular else "limits"
        return PathBreak(first, first + 1, kind, joint.name, float(moved[j]), joint.unit, off, k)

    def _calmest(self, weights: Array) -> tuple[float, Array]:
        """Least largest step, times weights (K − 1, n), and the postures (K, n) of its way."""
        graph = self._graph(weights)
        ways = graph.closed_of_smallest_step() if self.closed else graph
        step, way = ways.smallest_step()
        return step, ways.motion(way)

    @cached_property
    def smooth(self) -> tuple[StationsProblem, ...]:
        """Without rows that keep the arm clear, which are dear, and with them."""
        problems = [self.engine.optimisation_problem]
        if self.guard is not self.engine and self.scene.active:
            problems.append(self.guard.optimisation_problem)
        given, barrier = (self.steps, self.found.targets, self.path, self.closed), BARRIER
        if self.starts == 1:  # a part of the points was optimised already
            barrier = 1e-5
        return tuple(smooth_motion(problem, *given, barrier=barrier) for problem in problems)

    def bound(self, motion: Motion) -> float:
        """σ_max [m] that no motion gets below at its worst point; NaN where something else is minimised."""
        task = self.engine.optimisation_problem.task
        if task.criterion != "worst" or task.minimize:
            return math.nan
        worst = float(np.max(np.minimum(self.alone, motion.objectives)))
        return float(np.sqrt(worst * self.found.targets[0].scale))

    @cached_property
    def calmest(self) -> tuple[float, Motion]:
        """Least largest step between listed points, divided evenly [rad or m], and a motion that has it."""
        step, Q, weights = self._calmest_way
        start = self._motion(Q)
        if not self.engine.optimisation_problem.freedom or self.starts == 1:
            return step, start
        smooth = self._smoothed(start, lambda problem, point: problem.least_step(point, weights))
        even = self._even_step(smooth)
        return (even, smooth) if smooth.feasible and even < step else (step, start)

    def _even_step(self, motion: Motion) -> float:
        """Largest step between listed points that steps on the path add up to [rad or m]."""
        return float(np.max(np.abs(np.diff(motion.Q, axis=0)) * self.steps.counted * self._calmest_way[2], initial=0.0))

    def fastest(self, speed: float) -> Motion:
        """Motion of highest constant speed, found about ``speed`` [m/s]."""
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
        """Times of a motion at a stated speed or at the highest [m/s]."""
        return TimeLaw(self.engine.robot, motion.Q, self.path.lengths, speed)

    def paces(self, stated: float | None, speed: float | None, known: Sequence[Motion]) -> Paces:
        """Bounds: a stated step [rad or m], or three times the smallest possible, and a speed [m/s]."""
        even = self.calmest[0]
        if stated is not None:
            return Paces(stated, True, speed, step_bounds(self.steps, self.path, max(stated, even), speed))
        calm = max([even, *(self._even_step(motion) for motion in known)])
        span = float(np.max(self.steps.span[self.steps.counted], initial=0.0))
        largest = min(_STEP_RATIO * calm, span)
        most = step_bounds(self.steps, self.path, largest, speed)
        return Paces(largest, False, speed, np.where(self._calmest_way[2] > 0, most, self.steps.span))

    def best(self, paces: Paces, known: Sequence[Motion]) -> Motion | None:
        """Best motion within bounds, of ways, ``known`` motions and smooth motions from them; None without one."""
        ways = self._ways(paces.most)
        if len(turning := self._turning(ways)):
            return self._with_steps(self.steps.without_turns(turning)).best(paces, known)
        motions = [self._motion(Q) for Q in ways] + list(known)
        if not self.engine.optimisation_problem.freedom:
            motions = [self._on_path(motion) for motion in motions]
        else:
            motions += self._spread_made_least(sorted(motions, key=lambda motion: motion.objective), paces)
        able = [motion for motion in motions if motion.feasible]
        if paces.stated:
            able = [motion for motion in able if motion.largest_step <= paces.largest + STEP_TOLERANCE_RAD]
        if paces.speed is not None:
            able = [motion for motion in able if keeps_speed(self.law(motion), paces.speed)]
        if not able:
            return None
        best = min(motion.objective for motion in able)
        # The smooth problem trades the last digits of the worst point for better other ones.
        return min(able, key=lambda motion: (motion.objective > as_good(best), not motion.optimal, motion.objective))

    def ways(self, paces: Paces) -> list[Motion]:
        return [self._motion(Q) for Q in self._ways(paces.most)]

    def _turning(self, ways: Sequence[Array]) -> Codes:
        if not self.closed or not len(ways):
            return np.zeros(0, dtype=int)
        allowed = self.steps.whole_turns(self.calmest[1].Q)
        others = [self.steps.whole_turns(self.steps.unwrapped(Q)[0]) != allowed for Q in ways]
        return np.flatnonzero(np.any(others, axis=0) & self.steps.wide)

    def _spread_made_least(self, starts: list[Motion], paces: Paces) -> list[Motion]:
        least = float(np.max(self.alone))
        ends: list[Motion] = []
        idle = 0
        for start in starts[: self.starts]:
            ends.append(self._smoothed(start, lambda problem, point: problem.solve(point, paces.most), spreads=True))
            able = [end.objective for end in ends if end.feasible and end.optimal]
            better = len(able) > 1 and as_good(able[-1]) < min(able[:-1])
            idle = 0 if better or len(able) < 2 else idle + 1
            if (able and abs(min(able) - least) <= as_good(least) - least) or idle == 2:
                break
        return ends

    def _ways(self, most: Array) -> list[Array]:
        """Best ways far from each other at the dearest point or in the middle, steps up to ``most`` (K − 1, n)."""
        every = self._graph(1 / most)
        graph = every.closed_of_least_cost(1.0) if self.closed else every
        if graph is None:
            return []
        worst = graph.worst_costs(1.0)
        least = min(float(cost.min()) for cost in worst)
        best = graph.best_way(1.0, least) if np.isfinite(least) else None
        if best is None:
            return []
        dearest = int(np.argmax([cost[k] for cost, k in zip(graph.costs, best, strict=True)]))
        others = [self._apart(graph, k, worst[k]) for k in dict.fromkeys((dearest, len(worst) // 2))]
        return [graph.motion(way) for way in (best, *chain.from_iterable(others))]

    def _apart(self, graph: StepGraph, point: int, worst: Array) -> list[Codes]:
        chosen: list[int] = []
        for k in np.argsort(worst, kind="stable").tolist():
            near = self.steps.between(graph.postures[point][[k]], graph.postures[point][chosen])
            if worst[k] <= 1.5 * worst.min() and np.all(near > math.radians(30.0)) and np.isfinite(worst[k]):
                chosen.append(k)
            if len(chosen) == _MAX_START_WAYS:
                break
        ways = [graph.best_way(1.0, float(worst[k]), (point, k)) for k in chosen[1:]]
        return [way for way in ways if way is not None]

    def _on_path(self, motion: Motion) -> Motion:
        Q, requests = motion.Q, np.vstack([self.engine.held(target).rows for target in self.found.targets])
        turns = Q[-1] - Q[0]
        for _ in range(3):  # from an error of 1e-7, quadratic
            Q = self.steps.rested(self.engine.ik.stepped(Q, requests)[0])
        return self._motion(np.vstack([Q[:-1], Q[0] + turns]) if self.closed else Q)

    def _smoothed(
        self,
        start: Motion,
        solved: Callable[[StationsProblem, StationsPoint], StationsOutcome],
        *,
        spreads: bool = False,
    ) -> Motion:
        for problem in self.smooth:
            end = solved(problem, StationsPoint(np.zeros(4), start.Q))
            motion = self._motion(end.point.Q, end.optimal)
            if spreads and end.optimal:
                # Of standard deviations: the objective is a variance, or the logarithm of a probability.
                agrees = abs(motion.objective - end.objective) / max(2 * abs(motion.objective), 1e-9)
                said = Confirmation("ipopt", end.iterations, end.residual, agrees)
                motion = replace(motion, confirmation=said)
            if motion.clear:
                break
        return motion

    def _motion(self, Q: Array, optimal: bool | None = None) -> Motion:
        """The motion through postures (K, n), joints turned on without jumps."""
        Q, _ = self.steps.unwrapped(Q)
        certain = not self.engine.optimisation_problem.freedom if optimal is None else optimal
        swept = self.steps.swept(Q, self.path.listed)
        return Motion.of(self.engine, self.found.targets, Q, swept, self.scene, certain)


def keeps_speed(law: TimeLaw, speed: float) -> bool:
    """Whether the joints of a motion allow a constant speed of the tool [m/s]."""
    return law.highest is None or law.highest >= speed * (1 - 1e-6)  # rounding of steps


MAX_SEARCHED_POINTS = 200
"""Points of a path that postures are sought at, one by one."""


def knots_of(path: TaskPath) -> Codes:
    """(M,) numbers of the points that stand for a long path, evenly among all K points, both ends included."""
    return np.linspace(0, len(path.points) - 1, MAX_SEARCHED_POINTS).round().astype(int)


def motions_at_knots(search: MotionSearch, stated: float | None, speed: float | None) -> list[Motion]:
    """The best motion at the knots, those it started from, the calmest, and the fastest for a stated speed [m/s]."""
    known = [search.calmest[1]] + ([] if speed is None else [search.fastest(speed)])
    paces = search.paces(stated, speed, known)
    best = search.best(paces, known)
    ways = [] if search.engine.optimisation_problem.freedom else search.ways(paces)
    return [motion for motion in (best, *ways, *known) if motion is not None]


def along_all(
    search: MotionSearch, path: TaskPath, targets: Sequence[TaskTarget], numbers: Codes, motions: Sequence[Motion]
) -> MotionSearch | None:
    """Search among motions at the knots, ``numbers`` (M,) of a path, led to all its points; None where none leads."""
    scale = search.found.targets[0].scale
    scaled = tuple(replace(target, scale=scale) for target in targets)
    led = list(_led(search, path, scaled, numbers, motions))
    if not led:
        return None
    flat, parameters = np.vstack(led), np.tile(stacked(scaled), (len(led), 1))
    objective, violation = (column[:, 0] for column in search.engine.screen(flat, parameters)[:2])
    met = violation <= ROW_TOLERANCE
    met[met] = is_clear(search.scene, flat[met])
    met, costs = met.reshape(len(led), -1), objective.reshape(len(led), -1)
    Q, at = flat.reshape(len(led), len(scaled), -1), range(len(scaled))
    if not np.all(met.any(axis=0)):
        return None
    postures = tuple(search.steps.wrapped(Q[met[:, k], k]) for k in at)
    found = PathCandidates(scaled, postures, tuple(costs[met[:, k], k] for k in at), (len(led),) * len(scaled))
    found = replace(found, postures=(*postures[:-1], postures[0])) if search.closed else found
    alone = np.full(len(scaled), -np.inf)
    alone[numbers] = search.alone
    return replace(search, path=path, found=found, alone=alone, apart=search.found, starts=1)


def _led(
    search: MotionSearch, path: TaskPath, targets: Sequence[TaskTarget], numbers: Codes, motions: Sequence[Motion]
) -> Iterator[Array]:
    """Postures (K, n) at all points that motions at the knots lead to, of those that arrive everywhere."""
    requests, names = [search.engine.held(t) for t in targets], ("position", "axis", "spin", "slack", "cone")
    given = {name: np.array([getattr(request, name) for request in requests]) for name in names}
    request = PoseRequest(weights=requests[0].weights, **given)
    for motion in motions:
        between = [np.interp(path.lengths, path.lengths[numbers], column) for column in motion.Q.T]
        Q, errors = search.engine.ik.solve(np.column_stack(between), request)
        if np.all(errors < TOLERANCE):
            Q = search.steps.rested(Q)
            yield np.vstack([Q[:-1], Q[0] + motion.Q[-1] - motion.Q[0]]) if search.closed else Q
