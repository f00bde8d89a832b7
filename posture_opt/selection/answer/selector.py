"""``PostureSelector``: one problem, its optimisation problem built once, solved again and again."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import get_args

import numpy as np

from posture_opt.collision.contacts import ContactSlack
from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.interrupts import interruptible
from posture_opt.model.toolchain import find_compiler
from posture_opt.numerics import Array, Progress
from posture_opt.selection.answer.infeasible import (
    Does,
    Explanation,
    Infeasibility,
    infeasible,
    met_after_all,
    not_met_together,
)
from posture_opt.selection.answer.ordinary import OrdinaryRule, costs_at_most
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.answer.target_answer import Status
from posture_opt.selection.problem_data import ProblemData, one_target, sources_of, task_of
from posture_opt.selection.program.optimisation_problem import (
    Alignment,
    OptimisationProblem,
    held_joints,
    released,
    with_held_joints,
)
from posture_opt.selection.program.task_target import PLANE_TOLERANCE, Reach, TaskTarget
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, Aligner
from posture_opt.selection.search.multistart import (
    MultistartResult,
    as_good,
    distinct,
    multistart,
    rank,
    screened_search,
    until_found_often,
    until_recurrence,
    usual_starts,
)
from posture_opt.selection.search.relaxation import Change, with_changes
from posture_opt.selection.search.search_outcome import (
    SearchOutcome,
    SearchStatistics,
    Seek,
    Sweep,
    at_first_sight,
    clear_ones,
    confirmed,
    searched,
    sweep,
)
from posture_opt.selection.tasks import Task
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.task_spread import lies_in_plane
from posture_opt.uncertainty.tool_point import ToolPoint


@dataclass(frozen=True)
class _Request:
    seek: Seek
    began: float  # when it was asked [s]
    confirm: bool  # whether IPOPT is started at the answer
    share: float  # that an ordinary posture may be worse


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
        rule: what keeps its joints to the ranges of ordinary postures; its terms are not those of the task.

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
        rule: OrdinaryRule | None = None,
    ) -> None:
        self._problem, self._compiled, self._keeps_mounting = problem, compiled, keeps_mounting
        self._offers, self._explains = offers, explains
        self.task: Task = one_target(task_of(problem))
        arm = with_held_joints(problem.arm, self.task)
        arm = arm.within_measured() if problem.within_measured else arm.in_measured_turn()
        arm = arm if rule is None else rule.narrowed(arm)
        self.tool_point: ToolPoint = ToolPoint.of(arm, sources_of(problem))
        self.reach: Reach = Reach.of(arm, self.task.tool_axis)
        self.target: TaskTarget = TaskTarget.of(self.task, self.reach)
        self._aligner = Aligner(arm, self.task, self.reach, compiled, problem.arm)
        self._engines: dict[tuple[str, Alignment, bool, bool, bool], Engine] = {}
        self.engine(self.target).optimisation_problem.check_axis(self.target)

    def engine(self, target: TaskTarget, guarded: bool | None = None) -> Engine:
        """The functions that solve targets of this kind; built on first use.

        Args:
            guarded: whether rows keep the arm clear of collisions; default: where there are obstacles.
        """
        return self.engine_of_all([target], guarded)

    def engine_of_all(self, targets: Sequence[TaskTarget], guarded: bool | None = None, exact: bool = False) -> Engine:
        """The functions that solve every one of some targets of a kind: what one of them cannot have, none has.

        Args:
            exact: whether exact distances in C take the place of rows.
        """
        scene = self._problem.scene
        guarded = scene.explicit if guarded is None else guarded and scene.active
        in_plane = all(lies_in_plane(target.direction, self.reach.normal) for target in targets)
        alignments = [self._aligner.at(target) for target in targets]
        kind = targets[0].kind, max(alignments, key=get_args(Alignment).index), in_plane
        key = *kind, guarded, exact
        if key not in self._engines:
            problem = OptimisationProblem(self.tool_point, self.task, self.reach, *kind, scene if guarded else None)
            self._engines[key] = Engine(problem, self._problem.solver, self._compiled, exact)
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
        ordinary: float | None = None,
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
            ordinary: share [1] that an ordinary posture may be worse and come first, 0 never; default: the task's.

        Raises:
            NoSolutionError: nothing feasible; carries the nearest posture and the reasons.
            InputError: a target that is not three finite numbers.
        """
        seed = self._problem.solver.seed if seed is None else seed
        target = self._target(position, direction, clearance)
        return self.solve_target(target, seed, starts, confirm=confirm, ordinary=ordinary)

    def solve_target(
        self,
        target: TaskTarget,
        seed: int,
        starts: int | None = None,
        known: Array | None = None,
        confirm: bool = False,
        ordinary: float | None = None,
    ) -> Solution:
        """The best posture for a target; a ``known`` one (n,) is improved beside the random starts."""

        def seek(engine: Engine, target: TaskTarget) -> tuple[MultistartResult, Sweep | None]:
            found = until_found_often(engine, target, np.random.default_rng(seed), starts)
            if known is not None:
                found = found.with_known(engine, np.clip(known, engine.robot.lower, engine.robot.upper))
            return found, None

        return self._solved(self._request(seek, confirm, ordinary), target)

    def solve_to_compare(self, seed: int | None = None) -> Solution:
        """The best posture for the task without the evidence that it is: for answers that are compared with others.

        The solver is started at the best of many postures (`screened_search`); where that does not end at an optimum,
        the search is that of `solve`.
        """
        first = self._problem.solver.seed if seed is None else seed

        def seek(engine: Engine, target: TaskTarget) -> tuple[MultistartResult, Sweep | None]:
            found = screened_search(engine, target, np.random.default_rng(first), preferred=self._problem.narrowed)
            return found or until_found_often(engine, target, np.random.default_rng(first)), None

        return self._solved(self._request(seek, confirm=False, ordinary=0.0), self.target)

    def feasible(self, starts: int) -> bool:
        """Whether so many starts find a posture that does the task; why there is none is not asked."""

        def seek(engine: Engine, target: TaskTarget) -> tuple[MultistartResult, None]:
            return until_found_often(engine, target, np.random.default_rng(self._problem.solver.seed), starts), None

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
        solver, aim = self._problem.solver, self.target if target is None else target
        first = solver.seed if seed is None else seed

        def seek(engine: Engine, target: TaskTarget) -> tuple[MultistartResult, Sweep | None]:
            found = until_recurrence(engine, target, first, solver.starts, workers, progress)
            return found, sweep(engine, found.target, np.random.default_rng(first)) if found.found else None

        return self._solved(self._request(seek, confirm=True), aim)

    def _request(self, seek: Seek, confirm: bool, ordinary: float | None = None) -> _Request:
        return _Request(seek, time.perf_counter(), confirm, self.task.ordinary if ordinary is None else ordinary)

    def _solved(self, asked: _Request, target: TaskTarget) -> Solution:
        outcome = self._searched(asked.seek, target, exact=not asked.confirm)
        wider = None if outcome.feasible else self._wider
        if wider is None:
            return self._first(outcome, asked)
        if self._problem.narrowed:
            return wider._solved(asked, target)
        without = wider._searched(asked.seek, target, exact=not asked.confirm)
        above = self._lifted(without.feasible[:8], outcome)
        return self._first(above, asked) if above else wider._first(without, asked)

    def _first(self, outcome: SearchOutcome, asked: _Request) -> Solution:
        """The best posture of all, or the best ordinary one where it costs no more than the share that is asked."""
        rule = self._rule if asked.share else None
        best = self._answer(outcome, asked, rule)
        if rule is None or rule.met(best.q):
            return best
        found = self._ordinary._searched(asked.seek, best.target, exact=not asked.confirm)
        if not found.feasible:
            return best
        ends = np.array([found.feasible[0].q, best.q])
        objective, least = (end.objective for end in outcome.engine.candidates(ends, best.target))
        if not costs_at_most(asked.share, objective, least):
            return best
        answer = self._ordinary._answer(found, asked)
        return answer.beside(best) if answer.status in ("optimal", best.status) else best

    @cached_property
    def _rule(self) -> OrdinaryRule:
        return OrdinaryRule.of(self.task, self.tool_point.arm)

    @cached_property
    def _ordinary(self) -> PostureSelector:
        """The selection among ordinary postures."""
        task = self.task.model_copy(update={"subject_to": (*self.task.subject_to, *self._rule.terms)})
        return PostureSelector(replace(self._problem, task=task), compiled=self._compiled, rule=self._rule)

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
        return replace(outcome, engine=engine, found=found) if met else None

    @cached_property
    def _wider(self) -> PostureSelector | None:
        """The selection of the problem's fallback, or None; a kept mounting plane has none."""
        problem, kept = self._problem.fallback, self._keeps_mounting
        if problem is None or (kept and not self._problem.narrowed):
            return None
        return PostureSelector(problem, compiled=self._compiled, keeps_mounting=kept, explains=self._explains)

    def _searched(self, seek: Seek, target: TaskTarget, exact: bool = False) -> SearchOutcome:
        free, scene = self.engine(target, guarded=False), self._problem.scene
        exact = exact and self._has_exact(free)
        guarded = partial(self.engine_of_all, [target], True, exact)
        return searched(seek, target, free, guarded, self._slack if exact else scene)

    def clear_engine(self, target: TaskTarget) -> Engine:
        """The functions that keep the arm clear at least cost: by exact distances in C, or by rows without a compiler.

        Both are clear of the same things by the same margin.
        """
        return self.engine_of_all([target], True, self._has_exact(self.engine(target, guarded=False)))

    def _has_exact(self, free: Engine) -> bool:
        return self._problem.scene.active and free.compiled is not False and bool(find_compiler())

    @cached_property
    def _slack(self) -> ContactSlack:
        return ContactSlack(self._problem.scene.contacts, self._compiled)

    def _target(
        self, position: Sequence[float] | None, direction: Sequence[float] | None, clearance: float | None
    ) -> TaskTarget:
        """The task's target at another position [m], direction or clearance [m], all finite."""
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

    def _answer(self, outcome: SearchOutcome, asked: _Request, rule: OrdinaryRule | None = None) -> Solution:
        found, problem, began = outcome.found, outcome.engine.optimisation_problem, asked.began
        feasible = outcome.feasible or self._rescued(found, began)
        if rule is not None:  # of optima that are as good as the best
            alike = (k for k, c in enumerate(feasible) if c.optimal and c.objective <= as_good(feasible[0].objective))
            k = next((k for k in alike if rule.met(feasible[k].q)), 0)
            feasible = [feasible[k], *feasible[:k], *feasible[k + 1 :]]
        best, confirmation = feasible[0], None
        if asked.confirm:
            feasible, confirmation = confirmed(outcome.engine, feasible, found.target, self._problem.scene)
            best = feasible[0]
        # A solve that stalled is no optimum; it counts only where nothing better is known.
        ended = [c for c in feasible if c.optimal] or feasible[:1]
        apart = distinct(np.array([c.q for c in ended]), self._problem.robot) if outcome.by_sweep else range(len(ended))
        optima = [ended[k] for k in apart]
        statistics = SearchStatistics(
            found.arrived, found.tried, found.polished, found.sampled, time.perf_counter() - began,
            converged=sum(c.optimal for c in outcome.by_starts), distinct=len(optima),
            hits=found.hits if found.found and found.found[0].objective <= as_good(best.objective) else 0,
            batches=found.batches, recurred=found.recurred, sweep=outcome.swept, confirmation=confirmation,
        )  # fmt: skip
        stated = self._problem
        notes: tuple[str | Statement, ...] = (*stated.notes, problem.axis_note(found.target), *stated.remarks)
        if not outcome.feasible:
            notes = (*notes, state("selection.relaxed-search"))
        notes += self._beside(best.q, found.target)
        refuted = confirmation is not None and confirmation.refutes
        status: Status = "optimal" if best.optimal and not refuted else "feasible"
        return Solution(
            self._problem, problem, found.target, status, best.q, statistics, np.array([c.q for c in optima]), notes,
            feasible=np.vstack([best.q, found.sampled.Q]), engine=outcome.engine,
        )  # fmt: skip

    def _rescued(self, found: MultistartResult, began: float) -> list[CandidatePosture]:
        if not self._explains:
            raise NoSolutionError(at_first_sight(self.engine(found.target, guarded=False), found, self._problem.scene))
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
        # 1e-3: rounding of a change, and lower bounds of distances
        if near is not None and not ROW_TOLERANCE < (missed := self._missed(aim, near)) <= 1e-3:
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
        off = float(self.reach.misses(target.lower, target.upper))  # held joints may leave a plane to the tool point
        return max(engine.candidates(Q, target)[0].violation, -float(self._problem.scene.slack(Q)[0]), off)

    def _beside(self, q: Array, target: TaskTarget) -> tuple[Statement, ...]:
        N = self.reach.normals
        if not N.shape[1] or target.kind == "anywhere":
            return ()
        point = np.array(self.tool_point.walk(q.tolist())[0].position, dtype=float)
        distance = float(np.linalg.norm(N @ (N.T @ (point - np.clip(point, target.lower, target.upper)))))
        return () if distance <= PLANE_TOLERANCE else (state("selection.off-plane", distance=Quantity(distance)),)
