"""``PathSelector``: one posture for each point of a path, joined without jumps."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NoReturn

import numpy as np

from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.numerics import Array, DerivedAgain, Progress
from posture_opt.selection.answer.infeasible import explain_stations, infeasible
from posture_opt.selection.answer.path_answer import Motion, Naive, PathAnswer, TimeLaw
from posture_opt.selection.answer.placement import Placement, PlacementFigure, PlacementRange
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.answer.target_answer import Status
from posture_opt.selection.paths.joint_steps import JointSteps, off_lines, step_bounds
from posture_opt.selection.paths.motion_search import (
    MAX_SEARCHED_POINTS,
    STEP_TOLERANCE_RAD,
    MotionSearch,
    along_all,
    keeps_speed,
    knots_of,
    motions_at_knots,
    smooth_motion,
)
from posture_opt.selection.paths.path_candidates import PathCandidates, find_candidates
from posture_opt.selection.problem_data import ProblemData, task_of
from posture_opt.selection.program.task_path import TaskPath
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.inverse_kinematics import TOLERANCE
from posture_opt.selection.search.multistart import Sampled, multistart, usual_starts
from posture_opt.selection.search.relaxation import Change, Reason, with_changes
from posture_opt.selection.search.search_outcome import SearchStatistics
from posture_opt.selection.stations.placed_stations import PlacedStations
from posture_opt.selection.stations.placement_search import search_placement
from posture_opt.selection.stations.stations_problem import StationsPoint
from posture_opt.selection.tasks.path_task import HIGHEST, PathTask
from posture_opt.statements import Statement
from posture_opt.units import joint_text
from posture_opt.workers import Workers, opened


def too_large_a_step(search: MotionSearch, largest: float, calm: Motion) -> Reason:
    """Where a joint has to move farther than ``largest`` [rad or m], and which bound would do."""
    smallest, ends = calm.largest_step, np.flatnonzero(search.path.listed)
    k = int(np.argmax(calm.steps))
    swept = np.ptp(calm.Q[ends[k] : ends[k + 1] + 1], axis=0)
    joint = search.engine.robot.joints[int(np.argmax(np.where(search.steps.counted, swept, 0.0)))]
    names = [search.path.numbers[end] for end in ends]
    hint = math.ceil(math.degrees(smallest) * 10 + 1e-6) / 10
    message = (
        f"from {names[k]} to {names[k + 1]} {joint.name} has to move by {math.degrees(smallest):.4g} deg, and "
        f"{math.degrees(largest):.4g} deg a step are allowed: set largest_step: {hint:g} deg, or list more points"
    )
    return Reason("largest_step", message, smallest - largest, "rad")


def too_fast(search: MotionSearch, speed: float, law: TimeLaw) -> Reason:
    """Which joint is too slow for a speed of the tool [m/s], where, and which speed would do."""
    highest, step = law.highest, law.limiting_step
    assert highest is not None, "a motion that no joint bounds is not too fast"
    assert step is not None, "a joint that bounds a motion does so in a step"
    joint = search.engine.robot.joints[search.engine.robot.joint_names.index(str(law.limiting_joint))]
    needed, limit = (f"{joint_text(v, joint.unit)}/s" for v in (joint.velocity * speed / highest, joint.velocity))
    first = int(np.count_nonzero(search.path.listed[: step + 1]))
    power = 10.0 ** (math.floor(math.log10(highest * 1e3)) - 2)  # three digits, rounded down
    below = float(f"{math.floor(highest * 1e3 / power * (1 - 1e-9)) * power:.4g}")
    message = (
        f"at {speed * 1e3:.4g} mm/s {joint.name} would have to move at {needed} between points {first} and "
        f"{first + 1}, and {limit} is its limit: set speed: {below:g} mm/s"
    )
    return Reason("speed", message, speed - highest, "m/s")


def naive_motions(search: MotionSearch) -> Naive:
    """Motions without look-ahead, from the candidates of points that were sought by themselves."""
    found, targets, engine, scene = search.apart or search.found, search.found.targets, search.engine, search.scene
    best = np.array([Q[int(np.argmin(costs))] for Q, costs in zip(found.postures, found.costs, strict=True)])
    apart = np.array([search.steps.between(a[None], b[None])[0, 0] for a, b in pairwise(best)])
    each = Motion.of(engine, found.targets, best, apart, scene, True)
    way = [best[0]]
    for target in targets[1:]:
        moved, error = engine.ik.solve(way[-1][None], engine.held(target))
        if error[0] >= TOLERANCE:
            return Naive(each, None, len(way))
        way.append(moved[0])
    Q = np.array(way)
    return Naive(each, Motion.of(engine, targets, Q, search.steps.swept(Q, search.path.listed), scene, True), len(way))


def moved_on(found: Solution, targets: Sequence[TaskTarget], placement: PlacementRange) -> Array:
    """(4,) placement that a motion leads to where the part may move with it; targets in the part's frame."""
    problem, task = found.optimisation_problem, found.problem.task
    own = [replace(target, scale=found.target.scale) for target in targets]
    steps = JointSteps.of(problem.robot, problem.nlp)
    closed, speed = (task.closed, task.stated_speed) if isinstance(task, PathTask) else (False, None)
    smooth = smooth_motion(problem, steps, own, found.path, closed, placement.without_seam)
    most = step_bounds(steps, found.path, found.largest_step, speed)
    end = smooth.solve(StationsPoint(found.w, found.postures), most)
    return placement.tidied(end.point.w)


_MAX_ROUNDS = 3
"""Of the smooth problem with the workpiece, and of the search at the placement found."""


@dataclass(frozen=True, eq=False)
class PathSelector(DerivedAgain):
    """The search for postures along the path of one problem."""

    problem: ProblemData
    selector: PostureSelector
    task: PathTask
    placement: PlacementRange
    w: Array  # (4,) where the workpiece stands
    explains: bool = True  # whether a failure is looked into

    @classmethod
    def of(cls, problem: ProblemData) -> PathSelector:
        """Selector for a task along a path, the workpiece mid-range; InputError as `PostureSelector`."""
        task = path_task_of(problem)
        if task.speed == HIGHEST and all(map(math.isnan, problem.robot.velocities)):
            name = problem.robot.joint_names[0]
            hint = f"add robot: velocity: {{{name}: 120 deg/s}}, or state a speed in mm/s"
            raise InputError(Issue("no largest speed of a joint is known", ("task", "speed"), HIGHEST, hint))
        one = replace(problem, task=task.model_copy(update={"path": None, "points": None, "workpiece": None}))
        spacing = task.spacing or 0.05 * problem.robot.length or None  # joints that move evenly stay near a line then
        task = task.model_copy(update={"spacing": spacing})
        placement = PlacementRange.of(task.workpiece)
        # Many placements or points, and rows that keep the arm clear, are worth the seconds that compiling takes.
        many = len(TaskPath.of(task).points) > 30
        compiled = None if np.any(placement.free) or problem.scene.explicit or many else False
        selector = PostureSelector(one, compiled=compiled)
        return cls(problem, selector, task, placement, placement.centre)

    @cached_property
    def path(self) -> TaskPath:
        return TaskPath.of(self.task).moved(self.w)

    @cached_property
    def targets(self) -> list[TaskTarget]:
        return self.path.targets(self.selector.target, self.selector.reach)

    def solve(self, *, seed: int | None = None, workers: int = 1, progress: Progress | None = None) -> Solution:
        """Motion and placement of least largest spread; NoSolutionError carries what comes nearest."""
        seed = self.problem.solver.seed if seed is None else seed
        if np.any(self.placement.free):
            return self._placed(seed, workers, progress)
        with opened(workers) as pool:
            return self.solve_here(seed, pool, progress)

    def _placed(self, seed: int, workers: int, progress: Progress | None) -> Solution:
        began = time.perf_counter()
        own = replace(self, w=np.zeros(4)).targets
        chosen = np.unique(np.linspace(0, len(own) - 1, min(6, len(own))).round().astype(int)).tolist()
        engines = (self.selector.engine_of_all(self.targets),) * len(chosen)
        stations = PlacedStations(engines, tuple(own[k] for k in chosen), self.placement, "worst")
        optima = search_placement(stations, seed, workers, progress, wanted=1).optima[:3]
        places = [self.placement.tidied(optimum.w) for optimum in optima]
        tried: list[Solution | None] = []
        with opened(workers) as pool:

            def attempted(w: Array) -> Solution | None:
                try:
                    tried.append(replace(self, w=w, explains=False).solve_here(seed, pool))
                except NoSolutionError:
                    tried.append(None)
                if progress is not None:
                    progress(len(tried), len(places) + 1 + _MAX_ROUNDS)
                return tried[-1]

            found = [one for w in (*places, self.placement.centre) if (one := attempted(w)) is not None]
            central = tried[-1]
            if not found:
                return self.solve_here(seed, pool)  # which says why not
            best = min(found, key=_sigma)
            for _ in range(_MAX_ROUNDS):
                again = attempted(moved_on(best, own, self.placement))
                if again is None or _sigma(again) > _sigma(best) * (1 - 1e-3):
                    break
                best = again
        assert best.placement is not None
        centre = None if central is None else PlacementFigure(self.placement.centre, _sigma(central))
        statistics = replace(best.statistics, seconds=time.perf_counter() - began)
        return replace(best, placement=replace(best.placement, at_centre=centre), statistics=statistics)

    def solve_here(self, seed: int, pool: Workers | None = None, progress: Progress | None = None) -> Solution:
        """Best motion with the workpiece where it is; raises as `solve`."""
        began = time.perf_counter()
        search = self._search(seed, began, pool, progress)
        stated, speed = self.task.largest_step, self.task.stated_speed
        known = [search.calmest[1]]
        if stated is not None and known[0].largest_step > stated + STEP_TOLERANCE_RAD:
            self._refuse(search, known[0], stated, began, too_large_a_step(search, stated, known[0]))
        if speed is not None and not keeps_speed(search.law(known[0]), speed):
            known.append(search.fastest(speed))
            if not keeps_speed(law := search.law(known[-1]), speed):
                largest = known[-1].largest_step if stated is None else stated
                self._refuse(search, known[-1], largest, began, too_fast(search, speed, law))
        paces = search.paces(stated, speed, known)
        best = search.best(paces, known)
        if best is None:
            assert speed is not None, "the calmest motion keeps its step"
            message = (
                f"no motion was found at {speed * 1e3:.4g} mm/s with steps of at most "
                f"{math.degrees(paces.largest):.4g} deg: leave out largest_step, or lower the speed"
            )
            self._refuse(search, known[-1], paces.largest, began, Reason("speed", message, 0.0, "m/s"))
        return self._solution(search, best, paces.largest, began)

    def _refuse(self, search: MotionSearch, motion: Motion, largest: float, began: float, reason: Reason) -> NoReturn:
        raise NoSolutionError(reason.message, self._solution(search, motion, largest, began, [reason]))

    def _search(self, seed: int, began: float, pool: Workers | None, progress: Progress | None) -> MotionSearch:
        reach = self.selector.reach
        off = [float(np.linalg.norm(reach.outside(target.lower, target.upper))) for target in self.targets]
        if max(off) > reach.plane_slack:
            self._explain(self.selector.engine_of_all(self.targets), [int(np.argmax(off))], began)
        if len(self.targets) > MAX_SEARCHED_POINTS:
            search = self._search_at_knots(seed, pool, progress)
            if search is not None:
                return search
        engine, steps, found = self._candidates(self.targets, seed, pool, progress)
        failing = [k for k, costs in enumerate(found.costs) if not len(costs)]
        if failing:
            self._explain(engine, failing, began)
        return self._joined(self.path, engine, found, steps)

    def _search_at_knots(self, seed: int, pool: Workers | None, progress: Progress | None) -> MotionSearch | None:
        numbers = knots_of(self.path)
        targets = [self.targets[k] for k in numbers.tolist()]
        engine, steps, found = self._candidates(targets, seed, pool, progress)
        if not all(map(len, found.costs)):
            return None
        search = self._joined(self.path.at(numbers), engine, found, steps)
        motions = motions_at_knots(search, self.task.largest_step, self.task.stated_speed)
        return along_all(search, self.path, self.targets, numbers, motions)

    def _candidates(
        self, targets: Sequence[TaskTarget], seed: int, pool: Workers | None = None, progress: Progress | None = None
    ) -> tuple[Engine, JointSteps, PathCandidates]:
        scene = self.problem.scene
        for guarded in (None, True):
            engine = self.selector.engine_of_all(self.targets, guarded)
            steps = JointSteps.of(engine.robot, engine.optimisation_problem.nlp)
            rng = np.random.default_rng(seed)
            found = find_candidates(engine, targets, steps, scene, rng, pool, progress)
            if all(map(len, found.costs)) or engine.optimisation_problem.scene is not None or not scene.active:
                break
        return engine, steps, found

    def can_be_done(self) -> bool:
        """Whether postures, steps and speed lead along the path without a break; why not is not asked."""
        seed = self.problem.solver.seed
        engine, steps, found = self._candidates(self.targets, seed)
        if not all(map(len, found.costs)):
            return False
        stated, speed = self.task.largest_step, self.task.stated_speed
        search = self._joined(self.path, engine, found, steps)
        motion = search.calmest[1]
        if search.breaks(motion, off_lines(search.engine, motion.Q)):
            return False
        if stated is not None and motion.largest_step > stated + STEP_TOLERANCE_RAD:
            return False
        return speed is None or keeps_speed(search.law(search.fastest(speed)), speed)

    def _joined(self, path: TaskPath, engine: Engine, found: PathCandidates, steps: JointSteps) -> MotionSearch:
        guard = self.selector.engine_of_all(self.targets, True)
        alone = np.array([float(np.min(costs)) for costs in found.costs])
        candidates, closed = found.closed() if self.task.closed else found, self.task.closed
        search = MotionSearch(engine, guard, path, candidates, steps, self.problem.scene, closed, alone)
        return search.within_limits()

    def _solution(
        self, search: MotionSearch, motion: Motion, largest: float, began: float, reasons: Sequence[Reason] = ()
    ) -> Solution:
        """Answer of a motion with steps up to ``largest`` [rad or m], and the reasons why it does not do."""
        targets, problem = search.found.targets, search.engine.optimisation_problem
        axis, remarks = problem.axis_note(targets[0]), self.problem.remarks
        notes: tuple[str | Statement, ...] = (*self.problem.notes, axis, *remarks)
        astray, counts = off_lines(search.engine, motion.Q), tuple(map(len, search.found.costs))
        smallest = min(search.calmest[1].largest_step, motion.largest_step)
        followed = PathAnswer(
            self.path, motion, largest, smallest, search.bound(motion), float(astray.max()), naive_motions(search),
            counts, search.law(motion, self.task.stated_speed), search.breaks(motion, astray),
        )  # fmt: skip
        status: Status = "infeasible" if reasons else "optimal" if motion.optimal else "feasible"
        seconds, none = time.perf_counter() - began, np.zeros((0, motion.Q.shape[1]))
        placed_problem, sampled = self.problem.with_workpiece_at(self.w), Sampled.none(problem.robot)
        points = []
        for target, q, count in zip(targets, motion.Q, counts, strict=True):
            counted = SearchStatistics(count, count, 0, sampled, seconds)
            points.append(Solution(placed_problem, problem, target, status, q, counted, none, notes, tuple(reasons)))
        placement = Placement(self.placement.lower, self.placement.upper, self.w)
        placed = None if self.task.workpiece is None else placement
        names = tuple(self.path.numbers)
        return replace(points[0], points=tuple(points), names=names, placement=placed, followed=followed)

    def _explain(self, engine: Engine, failing: Sequence[int], began: float) -> None:
        if not self.explains or self.problem.above_assumed_mounting:  # which is dropped first
            raise NoSolutionError(f"{self.path.numbers[failing[0]]}: no posture was found that meets all requirements")
        targets, names = [self.targets[k] for k in failing], [self.path.numbers[k] for k in failing]
        target, name = targets[len(targets) // 2], names[len(names) // 2]
        searched = multistart(engine, target, np.random.default_rng(self.problem.solver.seed), usual_starts(engine))
        inquiry = self.selector.inquiry(searched, self.problem, self._does)
        why = explain_stations(inquiry, targets, names)
        reasons = why.reasons or (Reason(name, f"{name}: no posture was found that meets all requirements", 0.0, "1"),)
        given = replace(why, reasons=reasons)
        solution = infeasible(self.problem, engine, searched, given, time.perf_counter() - began)
        raise NoSolutionError("\n".join(reason.message for reason in reasons), solution)

    def _does(self, changes: Sequence[Change], near: Array) -> bool:
        try:
            changed = PathSelector.of(with_changes(self.problem, changes))
            return replace(changed, w=self.w).can_be_done()
        except InputError:  # no such problem can be stated
            return False


def _sigma(found: Solution) -> float:
    """Largest σ_max [m] along a motion."""
    return float(found.motion.sigma.max())


def path_task_of(problem: ProblemData) -> PathTask:
    task = task_of(problem)
    assert isinstance(task, PathTask), task.kind
    return task
