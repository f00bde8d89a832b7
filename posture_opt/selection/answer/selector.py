"""``PostureSelector``: one problem, its optimisation problem built once, solved again and again."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import get_args

import numpy as np

from posture_opt.collision.contact_slack import ContactSlack
from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.interrupts import interruptible
from posture_opt.model.toolchain import find_compiler
from posture_opt.numerics import Array, Progress
from posture_opt.selection.answer.held_joints import held_joints, released, with_held_joints
from posture_opt.selection.answer.infeasible import (
    Does,
    Explanation,
    Infeasibility,
    infeasible,
    met_after_all,
    not_met_together,
)
from posture_opt.selection.answer.solution import Solution, Status
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import Alignment, OptimisationProblem
from posture_opt.selection.program.task_target import PLANE_TOLERANCE, Reach, TaskTarget
from posture_opt.selection.search.axis_alignment import Aligner
from posture_opt.selection.search.batches import until_found_often, until_recurrence, usual_starts
from posture_opt.selection.search.change import Change, with_changes
from posture_opt.selection.search.confirmed_posture import confirmed
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.search.multistart import MultistartResult, distinct, multistart, rank
from posture_opt.selection.search.screened_search import screened_search
from posture_opt.selection.search.search_outcome import SearchOutcome, Seek, clear_ones, searched
from posture_opt.selection.search.search_statistics import SearchStatistics, Sweep, sweep
from posture_opt.selection.tasks import Task
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.spread.task_spread import lies_in_plane

_MAX_LIFTED = 8  # postures below an assumed mounting plane from which one above it is sought
_NEARLY_MET = 1e-3  # m, rad or 1: what rounding of a change and lower bounds of distances leave


class PostureSelector:
    """The posture selection of one problem, for repeated solves with other targets.

    Args:
        problem: with a task and uncertain parameters.
        compiled: None compiles the optimisation problem where a C compiler is found (some seconds once, then cached);
            False interprets it; True insists.
        keeps_mounting: whether what cannot be done above an assumed mounting plane has no solution; else that plane is
            dropped for it.
        offers: whether changes that would help are tried where there is no solution.
        explains: whether the reasons are looked for where there is none, which takes longer than the search.

    Raises:
        InputError: no task, nothing uncertain, or a task that the arm cannot do.

    Example:
        >>> import posture_opt as po
        >>> selector = po.PostureSelector(po.load_problem("insert_planar_2r_fixed_hole"), compiled=False)
        >>> [f"{1e3 * selector.solve(position=(x, 0.5, 0.0)).sigma_max:.1f} mm" for x in (1.0, 1.2)]
        ['28.6 mm', '26.9 mm']
    """

    def __init__(
        self,
        problem: ProblemData,
        *,
        compiled: bool | None = None,
        keeps_mounting: bool = False,
        offers: bool = True,
        explains: bool = True,
    ) -> None:
        self._problem, self._compiled, self._keeps_mounting = problem, compiled, keeps_mounting
        self._offers, self._explains = offers, explains
        self.task: Task = one_target(task_of(problem))
        arm = with_held_joints(problem.arm, self.task)
        arm = arm.within_measured() if problem.within_measured else arm.in_measured_turn()
        self.tool_point: ToolPoint = ToolPoint.of(arm, sources_of(problem))
        self.reach: Reach = Reach.of(arm, self.task.tool_axis)
        self.target: TaskTarget = TaskTarget.of(self.task, self.reach)
        self._aligner = Aligner(arm, self.task, self.reach, compiled, problem.arm)
        self._engines: dict[tuple[str, Alignment, bool, bool], Engine] = {}
        self._exact_engines: dict[tuple[str, Alignment, bool], Engine] = {}
        self.engine(self.target).optimisation_problem.check_axis(self.target)

    def engine(self, target: TaskTarget, guarded: bool | None = None) -> Engine:
        """The functions that solve targets of this kind; built on first use.

        Args:
            guarded: whether rows keep the arm clear of collisions; default: where there are obstacles.
        """
        return self.engine_of_all([target], guarded)

    def engine_of_all(self, targets: Sequence[TaskTarget], guarded: bool | None = None) -> Engine:
        """The functions that solve every one of some targets of a kind: what one of them cannot have, none has."""
        scene = self._problem.scene
        guarded = scene.explicit if guarded is None else guarded and scene.active
        in_plane = all(lies_in_plane(target.direction, self.reach.normal) for target in targets)
        alignments = [self._aligner.at(target) for target in targets]
        kind = targets[0].kind, max(alignments, key=get_args(Alignment).index), in_plane
        key = *kind, guarded
        if key not in self._engines:
            problem = OptimisationProblem(self.tool_point, self.task, self.reach, *kind, scene if guarded else None)
            self._engines[key] = Engine(problem, self._problem.solver, self._compiled)
        return self._engines[key]

    @interruptible()
    def solve(
        self,
        position: Sequence[float] | None = None,
        direction: Sequence[float] | None = None,
        clearance: float | None = None,
        *,
        seed: int | None = None,
        starts: int | None = None,
        confirm: bool = False,
    ) -> Solution:
        """The best posture for the task, or for another position [m], direction or clearance [m], world frame.

        Args:
            position: (3,) [m].
            direction: (3,) of any length.
            clearance: radial [m].
            seed: of the random starts; default: the problem's.
            starts: feasible postures that local searches start from; default: as many as it takes to find the best
                optimum several times.
            confirm: whether IPOPT is started at the answer, and the better of both taken, as `select_posture` does.

        Raises:
            NoSolutionError: nothing feasible; carries the nearest posture and the reasons.
            InputError: a target that is not three finite numbers.
        """
        seed = self._problem.solver.seed if seed is None else seed
        return self.solve_target(self._target(position, direction, clearance), seed, starts, confirm=confirm)

    def solve_target(
        self,
        target: TaskTarget,
        seed: int,
        starts: int | None = None,
        known: Array | None = None,
        confirm: bool = False,
    ) -> Solution:
        """The best posture for a target; a ``known`` one (n,) is improved beside the random starts."""
        began = time.perf_counter()

        def seek(engine: Engine) -> tuple[MultistartResult, Sweep | None]:
            found = until_found_often(engine, target, np.random.default_rng(seed), starts)
            return found if known is None else found.with_known(engine, known), None

        return self._solved(seek, target, began, confirm)

    def solve_to_compare(self, seed: int | None = None) -> Solution:
        """The best posture for the task without the evidence that it is: for answers that are compared with others.

        The solver is started at the best of many postures (`screened_search`); where that does not end at an optimum,
        the search is that of `solve`.
        """
        began, first = time.perf_counter(), self._problem.solver.seed if seed is None else seed

        def seek(engine: Engine) -> tuple[MultistartResult, Sweep | None]:
            preferred = self._problem.narrowed
            found = screened_search(engine, self.target, np.random.default_rng(first), preferred=preferred)
            return found or until_found_often(engine, self.target, np.random.default_rng(first)), None

        return self._solved(seek, self.target, began, confirm=False)

    def feasible(self, starts: int) -> bool:
        """Whether so many starts find a posture that does the task; why there is none is not asked."""

        def seek(engine: Engine) -> tuple[MultistartResult, Sweep | None]:
            rng = np.random.default_rng(self._problem.solver.seed)
            return until_found_often(engine, self.target, rng, starts), None

        return bool(self._searched(seek, self.target).feasible)

    @interruptible()
    def solve_thoroughly(
        self,
        *,
        seed: int | None = None,
        workers: int = 1,
        progress: Progress | None = None,
        target: TaskTarget | None = None,
    ) -> Solution:
        """The best posture with the evidence that it is: found again by independent starts, the freedom left swept.

        At the target of the task, or at another one.
        """
        began = time.perf_counter()
        solver, aim = self._problem.solver, self.target if target is None else target
        first = solver.seed if seed is None else seed

        def seek(engine: Engine) -> tuple[MultistartResult, Sweep | None]:
            found = until_recurrence(engine, aim, first, solver.starts, workers, progress)
            return found, sweep(engine, found.target, np.random.default_rng(first)) if found.found else None

        return self._solved(seek, aim, began, confirm=True)

    def _solved(self, seek: Seek, target: TaskTarget, began: float, confirm: bool) -> Solution:
        """The solution of a search, or of one in the problem's fallbacks.

        What is found without a mounting plane is lifted above it first: a search may have missed the postures that are.
        """
        outcome = self._searched(seek, target, exact=not confirm)
        wider = None if outcome.feasible else self._wider
        if wider is None:
            return self._answer(outcome, began, confirm)
        if self._problem.narrowed:
            return wider._solved(seek, target, began, confirm)
        without = wider._searched(seek, target, exact=not confirm)
        above = self._lifted(without.feasible[:_MAX_LIFTED], outcome)
        return self._answer(above, began, confirm) if above else wider._answer(without, began, confirm)

    def _lifted(self, below: Sequence[CandidatePosture], outcome: SearchOutcome) -> SearchOutcome | None:
        """A search that found nothing, with what local searches from postures below the plane lead to; else None."""
        if not below:
            return None
        target = outcome.found.target
        engine = self.clear_engine(target)
        starts = engine.candidates(np.array([candidate.q for candidate in below]), target)
        ends = clear_ones(tuple(engine.polished(start, target) for start in starts), self._problem.scene)
        met = tuple(sorted((candidate for candidate in ends if candidate.feasible), key=rank))
        found = replace(outcome.found, found=(*met, *outcome.found.found))
        return replace(outcome, engine=engine, found=found, by_starts=met) if met else None

    @cached_property
    def _wider(self) -> PostureSelector | None:
        """The selection of the problem's fallback; None where there is none, or where the mounting plane is kept."""
        problem, kept = self._problem.fallback, self._keeps_mounting
        if problem is None or (kept and not self._problem.narrowed):
            return None
        return PostureSelector(problem, compiled=self._compiled, keeps_mounting=kept, explains=self._explains)

    def _searched(self, seek: Seek, target: TaskTarget, exact: bool = False) -> SearchOutcome:
        """The search without rows against collisions, and again with them where the answer collides.

        Args:
            exact: whether exact distances in C take the place of the rows, where there is a compiler.
        """
        free, scene = self.engine(target, guarded=False), self._problem.scene
        if not (exact and self._has_exact(free)):
            return searched(seek, free, lambda: self.engine(target, guarded=True), scene)
        return searched(seek, free, lambda: self._exact_engine(target), self._slack)

    def clear_engine(self, target: TaskTarget) -> Engine:
        """The functions that keep the arm clear at least cost: by exact distances in C, or by rows without a compiler.

        Both are clear of the same things by the same margin.
        """
        exact = self._has_exact(self.engine(target, guarded=False))
        return self._exact_engine(target) if exact else self.engine(target, guarded=True)

    def _has_exact(self, free: Engine) -> bool:
        return self._problem.scene.active and free.compiled is not False and bool(find_compiler())

    @cached_property
    def _slack(self) -> ContactSlack:
        """How near postures come to anything, in C."""
        return ContactSlack(self._problem.scene.contacts, self._compiled)

    def _exact_engine(self, target: TaskTarget) -> Engine:
        """The functions that keep the arm clear by exact distances; built on first use."""
        free = self.engine(target, guarded=False)
        problem = free.optimisation_problem
        key = problem.kind, problem.alignment, problem.in_plane
        if key not in self._exact_engines:
            kept = replace(problem, scene=self._problem.scene)
            self._exact_engines[key] = Engine(kept, self._problem.solver, self._compiled, exact=True)
        return self._exact_engines[key]

    def _target(
        self, position: Sequence[float] | None, direction: Sequence[float] | None, clearance: float | None
    ) -> TaskTarget:
        """The target of the task with another position [m], direction or clearance [m]; refuses what is not finite."""
        target = self.target
        if position is not None:
            target = target.with_position(np.asarray(position, dtype=float))
        if direction is not None:
            target = target.with_direction(np.asarray(direction, dtype=float), self.reach)
        if clearance is not None:
            if not clearance > 0:
                raise InputError(Issue(f"the clearance {clearance} is not above zero", ("clearance",), clearance))
            target = replace(target, clearance=float(clearance))
        return target

    def _answer(self, outcome: SearchOutcome, began: float, confirm: bool) -> Solution:
        """The solution of a search, or the error with the reasons.

        Alternatives are among the distinct optima that the search ended at.

        Args:
            confirm: whether the solver of the problem is started at the best of them.
        """
        found, by_starts, by_sweep = outcome.found, outcome.by_starts, outcome.by_sweep
        problem = outcome.engine.optimisation_problem
        feasible = outcome.feasible or self._rescued(found, began)
        best, confirmation = feasible[0], None
        if confirm:
            feasible, confirmation = confirmed(outcome.engine, feasible, found.target, self._problem.scene)
            best = feasible[0]
        # A solve that stalled is no optimum; it counts only where nothing better is known.
        ended = [c for c in feasible if c.optimal] or feasible[:1]
        apart = distinct(np.array([c.q for c in ended]), self._problem.robot) if by_sweep else range(len(ended))
        optima = [ended[k] for k in apart]
        seconds = time.perf_counter() - began
        statistics = SearchStatistics.of(found, outcome.swept, by_starts, best, len(optima), seconds, confirmation)

        notes: tuple[str | Statement, ...] = (
            *self._problem.notes, problem.axis_note(found.target), *self.remarks(),
        )  # fmt: skip
        if not by_starts and not by_sweep:
            notes = (*notes, state("selection.relaxed-search"))
        notes += self._beside(best.q, found.target)
        refuted = confirmation is not None and confirmation.refutes
        status: Status = "optimal" if best.optimal and not refuted else "feasible"
        seen = np.vstack([best.q, found.sampled.Q])
        return Solution(
            self._problem, problem, found.target, status, best.q, statistics, np.array([c.q for c in optima]), notes,
            feasible=seen, engine=outcome.engine,
        )  # fmt: skip

    def _rescued(self, found: MultistartResult, began: float) -> list[CandidatePosture]:
        """What the inquiry into the failure found to be feasible after all; else the error with the reasons."""
        if not self._explains:
            raise NoSolutionError("no posture was found that does the task")
        engine = self.engine(found.target, guarded=True)  # what is offered keeps the arm clear of collisions too
        dropped = self._keeps_mounting and self._problem.above_assumed_mounting  # and asked again
        met = met_after_all(engine, found) if dropped or engine.elastic.in_cell else None
        if met is not None:
            return [met]
        if dropped:
            raise NoSolutionError("no posture was found above the mounting plane")
        why = self._explained(found)
        if not why.reasons:
            rescued = engine.polished(engine.candidates(why.q[None], found.target)[0], found.target)
            if rescued.feasible:
                return [rescued]
            why = not_met_together(engine, found, rescued)
        solution = infeasible(self._problem, engine, found, why, time.perf_counter() - began)
        raise NoSolutionError(why.text, solution)

    def _explained(self, found: MultistartResult) -> Explanation:
        """What keeps a search from finding anything, and which changes help."""
        target = found.target
        asked = replace(self._problem, task=target.in_task(self.task))

        def does(changes: Sequence[Change], near: Array) -> bool:
            """Whether the problem with some changes is solved, from a posture (n,) that should do or by a search."""
            if not self._offers:
                return False
            other = with_changes(asked, changes)
            if {change.path for change in changes} == {"task.position"}:  # a number of this program
                return self.can_be_done(target.with_position(np.array(task_of(other).position)), near)
            try:
                return PostureSelector(other, compiled=False).can_be_done(None, near)
            except InputError:  # no such problem can be stated
                return False

        return self.inquiry(found, asked, does).explanation()

    def inquiry(self, found: MultistartResult, asked: ProblemData, does: Does) -> Infeasibility:
        """The inquiry into a search that found nothing; joints that are held are asked to give like anything else.

        Args:
            asked: the problem as it is stated; ``does`` says whether it is solved with some changes.
        """
        robot = self._problem.robot
        held, selector = held_joints(robot, self.task), self
        if held:
            selector = PostureSelector(replace(self._problem, task=released(robot, self.task)), compiled=False)
        return Infeasibility(selector.engine(found.target, guarded=True), found, asked, held, does)

    def can_be_done(self, target: TaskTarget | None = None, near: Array | None = None) -> bool:
        """Whether a posture is found that does the task; why not is not asked.

        A posture ``near`` (n,) that was read from a compromise decides where it does, or misses by more than rounding.
        """
        aim, seed = self.target if target is None else target, self._problem.solver.seed
        if near is not None and not ROW_TOLERANCE < (missed := self._missed(aim, near)) <= _NEARLY_MET:
            return missed <= ROW_TOLERANCE
        engine = self.engine(aim, guarded=True)
        starts = self._problem.solver.starts or usual_starts(engine)
        found = multistart(engine, aim, np.random.default_rng([seed, 0]), starts)
        if any(candidate.feasible for candidate in found.found):
            return True
        return met_after_all(engine, found) is not None

    def _missed(self, target: TaskTarget, q: Array) -> float:
        """By how much [m, rad or 1] the posture misses that the inverse kinematics leads q (n,) to."""
        engine = self.engine(target, guarded=False)
        Q, _ = engine.ik.solve(np.clip(q, engine.robot.lower, engine.robot.upper)[None], engine.held(target))
        return max(engine.candidates(Q, target)[0].violation, -float(self._problem.scene.slack(Q)[0]))

    def _beside(self, q: Array, target: TaskTarget) -> tuple[Statement, ...]:
        """How far the tool point of an arm that moves in a plane stays off a target that does not lie in it."""
        if not self.reach.normals.shape[1]:
            return ()
        point = np.array(self.tool_point.walk(q.tolist())[0].position, dtype=float)
        N = self.reach.normals
        distance = float(np.linalg.norm(N @ (N.T @ (point - np.clip(point, target.lower, target.upper)))))
        if target.kind == "anywhere" or distance <= PLANE_TOLERANCE:
            return ()
        return (state("selection.off-plane", distance=Quantity(distance)),)

    def remarks(self) -> tuple[Statement, ...]:
        """What is not looked at."""
        scene = self._problem.scene
        if self._problem.robot.n < 3 or scene.active or scene.switched_off:
            return ()
        tipped = any(f.kind == "rotate" and f.axis != 2 and abs(f.nominal) > 1e-6 for f in self._problem.robot.base)
        asked = any(term.keeps_clear for term in self.task.subject_to)
        hint = () if tipped or asked else (state("collision.link-height"),)
        why = "; ".join(self._problem.robot.shape_notes) or "the shape of the arm is not known"
        return (state("collision.shape-unknown", why=why), *hint)


def task_of(problem: ProblemData) -> Task:
    """The task, or an InputError where there is none."""
    if problem.task is None:
        raise InputError(
            Issue("the problem states no task", ("task",), hint="add task: {kind: insert}, or name one: --task insert")
        )
    return problem.task


def one_target(task: Task) -> Task:
    """The same task, or an InputError where it has several targets."""
    if task.features:
        hint = (
            "solve the task as it is (its report maps the bench), or name one target: position: [0.6 m, 0.2 m, 0.1 m]"
        )
        raise InputError(
            Issue("this takes a task with one target, and the task has features", ("task", "features"), hint=hint)
        )
    if task.on_path:
        hint = (
            "solve the task as it is (its report maps the bench), or name one target: position: [0.6 m, 0.2 m, 0.1 m]"
        )
        raise InputError(Issue("this takes a task with one target, and the task has a path", ("task",), hint=hint))
    return task


def sources_of(problem: ProblemData) -> Sources:
    """The sources of error that the task sees, or an InputError where none of the arm could make a difference.

    Errors of the workpiece alone are the same in every posture.
    """
    # Stricter than for one posture: a spread of zero is an answer there, but no reason for any choice.
    if problem.sources.empty or not np.any(np.diag(problem.sources.covariance) > 0):
        hint = "add uncertainty: {sigma: {JOINT.theta: 0.02 deg}} or uncertainty: {repeatability: 0.05 mm}"
        what = "nothing" if problem.workpiece_sources.empty else "nothing of the arm"
        raise InputError(
            Issue(f"{what} is uncertain, so no posture is better than another", ("uncertainty",), hint=hint)
        )
    return problem.task_sources
