"""``PathSelector``: one posture for each point of a path, joined without jumps."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NoReturn

import numpy as np

from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.numerics import Array, DerivedAgain, Progress
from posture_opt.selection.answer.infeasible import infeasible
from posture_opt.selection.answer.infeasible_stations import explain_stations
from posture_opt.selection.answer.placement import PlacementRange
from posture_opt.selection.answer.selector import PostureSelector, task_of
from posture_opt.selection.answer.shared_placement import Placement, PlacementFigure
from posture_opt.selection.answer.solution import Solution, Status
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.paths.knots import MAX_SEARCHED_POINTS, Knots, knots_of, motions_at_knots
from posture_opt.selection.paths.motion import Motion, off_lines
from posture_opt.selection.paths.motion_search import STEP_TOLERANCE_RAD, MotionSearch, keeps_speed
from posture_opt.selection.paths.naive import naive_motions
from posture_opt.selection.paths.pace_failure import too_fast, too_fast_in_small_steps, too_large_a_step
from posture_opt.selection.paths.path_answer import PathAnswer
from posture_opt.selection.paths.path_breaks import path_breaks
from posture_opt.selection.paths.path_candidates import PathCandidates, find_candidates
from posture_opt.selection.paths.path_placement import moved_on, promising_placements
from posture_opt.selection.paths.task_path import TaskPath
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.batches import usual_starts
from posture_opt.selection.search.change import Change, with_changes
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.multistart import Sampled, multistart
from posture_opt.selection.search.relaxation import Reason
from posture_opt.selection.search.search_statistics import SearchStatistics
from posture_opt.selection.tasks.path_task import HIGHEST, PathTask
from posture_opt.statements import Statement
from posture_opt.workers import Workers, opened

_MIN_COMPILED_POINTS = 100  # the searches of more points take longer than compiling them
_MAX_ROUNDS = 3  # of the smooth problem with the workpiece, and of the search at the placement found
_MIN_SIGMA_GAIN = 1e-3  # of a standard deviation: what is worth another round
_SPACING_SHARE = 0.05  # of the length of the arm, where none is stated: joints that move evenly stay near a line then


@dataclass(frozen=True, eq=False)
class PathSelector(DerivedAgain):
    """The search for the postures along the path of one problem; ``selector`` builds what every point needs.

    Args:
        w: (4,) where the workpiece stands; ``explains`` says whether a failure is looked into.
    """

    problem: ProblemData
    selector: PostureSelector
    task: PathTask
    placement: PlacementRange
    w: Array
    explains: bool = True

    @classmethod
    def of(cls, problem: ProblemData) -> PathSelector:
        """For a problem whose task follows a path; the workpiece in the middle of its ranges.

        Raises:
            InputError: nothing uncertain, or a task that the arm cannot do.
        """
        task = path_task_of(problem)
        if task.speed == HIGHEST and all(map(math.isnan, problem.robot.velocities)):
            name = problem.robot.joint_names[0]
            hint = f"add robot: velocity: {{{name}: 120 deg/s}}, or state a speed in mm/s"
            raise InputError(Issue("no largest speed of a joint is known", ("task", "speed"), HIGHEST, hint))
        one = replace(problem, task=task.model_copy(update={"path": None, "points": None, "workpiece": None}))
        spacing = task.spacing or _SPACING_SHARE * problem.robot.length or None
        task = task.model_copy(update={"spacing": spacing})
        placement = PlacementRange.of(task.workpiece)
        # Many placements or points, and rows that keep the arm clear, are worth the seconds that compiling takes.
        many = len(TaskPath.of(task).points) > _MIN_COMPILED_POINTS
        compiled = None if np.any(placement.free) or problem.scene.explicit or many else False
        selector = PostureSelector(one, compiled=compiled)
        return cls(problem, selector, task, placement, placement.centre)

    @cached_property
    def path(self) -> TaskPath:
        """The points of the task, and those added between them, at the placement of the workpiece."""
        return TaskPath.of(self.task).moved(self.w)

    @cached_property
    def targets(self) -> list[TaskTarget]:
        """Those of the points."""
        return self.path.targets(self.selector.target, self.selector.reach)

    def solve(self, *, seed: int | None = None, workers: int = 1, progress: Progress | None = None) -> Solution:
        """The motion, and the placement of the workpiece as far as that is free, of least largest critical spread.

        Args:
            seed: of the random postures; default: the problem's.
            workers: processes that share the search for candidates; the answer does not depend on it.
            progress: called with (done, all) parts of the search.

        Raises:
            NoSolutionError: a point that no posture reaches, or no way from point to point with steps as small as
                asked; carries the nearest posture, or the motion of least largest step, and the reasons. Where the
                workpiece may be placed and no placement does, those of its middle.
        """
        seed = self.problem.solver.seed if seed is None else seed
        if np.any(self.placement.free):
            return self._placed(seed, workers, progress)
        with opened(workers) as pool:
            return self.solve_here(seed, pool, progress)

    def _placed(self, seed: int, workers: int, progress: Progress | None) -> Solution:
        """The best of some placements and of the middle, moved on with the motion while that gains."""
        began = time.perf_counter()
        own = replace(self, w=np.zeros(4)).targets
        engine = self.selector.engine_of_all(self.targets)
        places = promising_placements(engine, own, self.placement, seed, workers, progress)
        tried: list[Solution | None] = []
        with opened(workers) as pool:

            def attempted(w: Array) -> Solution | None:
                """The motion at a placement, counted as a part of the search."""
                tried.append(self._attempted(w, seed, pool))
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
                if again is None or _sigma(again) > _sigma(best) * (1 - _MIN_SIGMA_GAIN):
                    break
                best = again
        assert best.placement is not None
        centre = None if central is None else PlacementFigure(self.placement.centre, _sigma(central))
        statistics = replace(best.statistics, seconds=time.perf_counter() - began)
        return replace(best, placement=replace(best.placement, at_centre=centre), statistics=statistics)

    def _attempted(self, w: Array, seed: int, pool: Workers) -> Solution | None:
        """The motion with the workpiece at w (4,); None where there is none."""
        try:
            return replace(self, w=w, explains=False).solve_here(seed, pool)
        except NoSolutionError:
            return None

    def solve_here(self, seed: int, pool: Workers | None = None, progress: Progress | None = None) -> Solution:
        """The best motion with the workpiece at its placement.

        Args:
            pool: works on the candidates; progress: called with (done, all) parts of the search for them.

        Raises:
            NoSolutionError: as `solve`.
        """
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
            self._refuse(search, known[-1], paces.largest, began, too_fast_in_small_steps(search, paces.largest, speed))
        return self._solution(search, best, paces.largest, began)

    def _refuse(self, search: MotionSearch, motion: Motion, largest: float, began: float, reason: Reason) -> NoReturn:
        """Raises the error of a motion that does not keep its bounds; arguments as of `_solution`."""
        raise NoSolutionError(reason.message, self._solution(search, motion, largest, began, [reason]))

    def _search(
        self, seed: int, began: float, pool: Workers | None = None, progress: Progress | None = None
    ) -> MotionSearch:
        """The candidates of all points; where some have none that is clear, with rows that keep the arm clear.

        Raises:
            NoSolutionError: a point without any.
        """
        self._check_plane(began)
        if len(self.targets) > MAX_SEARCHED_POINTS:
            search = self._search_at_knots(seed, pool, progress)
            if search is not None:
                return search
        engine, steps, found = self._candidates(self.targets, seed, pool, progress)
        failing = [k for k, costs in enumerate(found.costs) if not len(costs)]
        if failing:
            self._explain(engine, failing, began)
        return self._joined(self.path, engine, found, steps)

    def _search_at_knots(
        self, seed: int, pool: Workers | None = None, progress: Progress | None = None
    ) -> MotionSearch | None:
        """The search among motions that were found at some points of a long path; None where none leads all along."""
        numbers = knots_of(self.path)
        targets = [self.targets[k] for k in numbers.tolist()]
        engine, steps, found = self._candidates(targets, seed, pool, progress)
        if not all(map(len, found.costs)):
            return None
        knots = Knots(self._joined(self.path.at(numbers), engine, found, steps), self.path, self.targets, numbers)
        motions = motions_at_knots(knots.search, self.task.largest_step, self.task.stated_speed)
        return knots.along_all(motions)

    def _candidates(
        self,
        targets: Sequence[TaskTarget],
        seed: int,
        pool: Workers | None = None,
        progress: Progress | None = None,
    ) -> tuple[Engine, JointSteps, PathCandidates]:
        """The candidates of some points, with the engine that found them."""
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
        """Whether every point has a posture, and steps as small, or a speed as high, as asked lead along them.

        Why not is not asked.
        """
        seed = self.problem.solver.seed
        engine, steps, found = self._candidates(self.targets, seed)
        if not all(map(len, found.costs)):
            return False
        stated, speed = self.task.largest_step, self.task.stated_speed
        if stated is None and speed is None:
            return True
        search = self._joined(self.path, engine, found, steps)
        if stated is not None and search.calmest[1].largest_step > stated + STEP_TOLERANCE_RAD:
            return False
        return speed is None or keeps_speed(search.law(search.fastest(speed)), speed)

    def _joined(self, path: TaskPath, engine: Engine, found: PathCandidates, steps: JointSteps) -> MotionSearch:
        """The search among the candidates of the points of a path, which have some each."""
        guard = self.selector.engine_of_all(self.targets, True)
        alone = np.array([float(np.min(costs)) for costs in found.costs])
        candidates, closed = found.closed() if self.task.closed else found, self.task.closed
        search = MotionSearch(engine, guard, path, candidates, steps, self.problem.scene, closed, alone)
        return search.within_limits()

    def _solution(
        self, search: MotionSearch, motion: Motion, largest: float, began: float, reasons: Sequence[Reason] = ()
    ) -> Solution:
        """The answer of a motion, with what simpler ways give.

        Args:
            largest: step that is allowed [rad or m].
            reasons: why it does not do.
        """
        apart, targets = search.apart or search.found, search.found.targets
        naive = naive_motions(search.engine, apart, targets, search.steps, self.path, self.problem.scene)
        problem = search.engine.optimisation_problem
        astray = off_lines(search.engine, motion.Q)
        axis, remarks = problem.axis_note(search.found.targets[0]), self.selector.remarks()
        notes: tuple[str | Statement, ...] = (*self.problem.notes, axis, *remarks)
        jumps = search.jumps(motion)
        breaks = path_breaks(search.engine, self.path, targets, search.steps, motion.Q, astray, jumps)
        smallest = min(search.calmest[1].largest_step, motion.largest_step)
        followed = PathAnswer(
            self.path, motion, largest, smallest, search.bound(motion), float(astray.max()),
            naive, tuple(map(len, search.found.costs)), search.law(motion, self.task.stated_speed), breaks,
        )  # fmt: skip
        status: Status = "infeasible" if reasons else "optimal" if motion.optimal else "feasible"
        seconds, none = time.perf_counter() - began, np.zeros((0, motion.Q.shape[1]))
        placed_problem = self.problem.with_workpiece_at(self.w)
        points = tuple(
            Solution(placed_problem, problem, target, status, q, _counted(count, seconds, problem), none, notes,
                     tuple(reasons))
            for target, q, count in zip(search.found.targets, motion.Q, followed.candidates, strict=True)
        )  # fmt: skip
        placement = Placement(self.placement.lower, self.placement.upper, self.w)
        placed = None if self.task.workpiece is None else placement
        return replace(points[0], points=points, names=tuple(self.path.numbers), placement=placed, followed=followed)

    def _check_plane(self, began: float) -> None:
        """Raises the error of the point that lies farthest outside the plane (or line) that the arm moves in."""
        reach = self.selector.reach
        off = [float(np.linalg.norm(reach.outside(target.lower, target.upper))) for target in self.targets]
        k = int(np.argmax(off))
        if off[k] > reach.plane_slack:
            self._explain(self.selector.engine_of_all(self.targets), [k], began)

    def _explain(self, engine: Engine, failing: Sequence[int], began: float) -> None:
        """Raises the error of points that no posture does, with the reasons at the one that lacks most."""
        if not self.explains or self.problem.above_assumed_mounting:  # which is dropped first
            raise NoSolutionError(f"{self.path.numbers[failing[0]]}: no posture was found that meets all requirements")
        targets, names = [self.targets[k] for k in failing], [self.path.numbers[k] for k in failing]
        target = targets[len(targets) // 2]
        searched = multistart(engine, target, np.random.default_rng(self.problem.solver.seed), usual_starts(engine))
        inquiry = self.selector.inquiry(searched, self.problem, self._does)
        why = explain_stations(inquiry, targets, names)
        name = names[len(names) // 2]
        reasons = why.reasons or (Reason(name, f"{name}: no posture was found that meets all requirements", 0.0, "1"),)
        why = replace(why, reasons=reasons)
        solution = infeasible(self.problem, engine, searched, why, time.perf_counter() - began)
        raise NoSolutionError("\n".join(reason.message for reason in reasons), solution)

    def _does(self, changes: Sequence[Change], near: Array) -> bool:
        """Whether the whole path can be done with some changes."""
        try:
            changed = PathSelector.of(with_changes(self.problem, changes))
            return replace(changed, w=self.w).can_be_done()
        except InputError:  # no such problem can be stated
            return False


def _counted(candidates: int, seconds: float, problem: OptimisationProblem) -> SearchStatistics:
    """Of a point, whose candidates are compared together with those of all others."""
    sampled = Sampled.none(problem.robot)
    return SearchStatistics(candidates, candidates, 0, 0, 0, 0, sampled, None, math.nan, 1, 0, seconds)


def _sigma(found: Solution) -> float:
    """Largest σ_max [m] along a motion, as the search has it."""
    return float(found.motion.sigma.max())


def path_task_of(problem: ProblemData) -> PathTask:
    """The task of a problem that follows a path."""
    task = task_of(problem)
    assert isinstance(task, PathTask), task.kind
    return task
