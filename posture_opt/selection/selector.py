"""``PostureSelector``: one problem, its programme built once, solved again and again."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posture_opt.errors import InputError, Issue, NoSolutionError, SolverError
from posture_opt.numerics import Progress
from posture_opt.selection.alignment import Aligner
from posture_opt.selection.engine import CandidatePosture, Engine
from posture_opt.selection.evidence import Evidence
from posture_opt.selection.goal import Goal
from posture_opt.selection.has_task import HasTask, sources_of, task_of
from posture_opt.selection.infeasible import infeasible, inquire
from posture_opt.selection.multistart import MapPolish, Search, distinct, in_processes, rank, search, with_progress
from posture_opt.selection.optimisation_problem import Alignment, OptimisationProblem
from posture_opt.selection.reach import PLANE_TOLERANCE, Reach
from posture_opt.selection.solution import Alternative, Solution, Status, critical_basis
from posture_opt.selection.sweep import Sweep, sweep
from posture_opt.uncertainty.tool_point import ToolPoint

Floats = np.ndarray

QUICK_STARTS = 48
"""Feasible starts of a repeated solve: enough for the best one to lie in the best optimum's basin (benchmarks/)."""
QUICK_POLISH = {"point": 1, "region": 4, "anywhere": 4}
"""Local solves of a repeated solve. At a point the freedom left is small, and screening finds the basin."""
_SAME_OPTIMUM = 1e-4
_MOST_ALTERNATIVES = 8
_ONE_ONLY = (
    "No random start met all requirements; one posture was found by relaxing them in turn. Whether a better one "
    "exists is not known."
)
_LINK_HEIGHT = " To keep the arm above its table add subject_to: [{kind: link_height, at_least: 50 mm}]."


class PostureSelector:
    """The posture selection of one problem, for repeated solves with other targets.

    Args:
        problem: with a task and uncertain parameters.
        compiled: None compiles the programme where a C compiler is found (some seconds once, then cached);
            False interprets it; True insists.

    Raises:
        InputError: no task, nothing uncertain, or a task that the arm cannot do.
    """

    def __init__(self, problem: HasTask, *, compiled: bool | None = None) -> None:
        self._problem, self._compiled = problem, compiled
        self.task = task_of(problem)
        self.tool_point = ToolPoint.of(problem.arm, sources_of(problem))
        self.reach = Reach.of(problem.arm, self.task.tool_axis)
        self.goal = Goal.of(self.task, self.reach)
        self._aligner = Aligner(problem.arm, self.task, self.reach, compiled)
        self._engines: dict[tuple[str, Alignment], Engine] = {}
        self.engine(self.goal).programme.check_axis(self.goal)

    def engine(self, goal: Goal) -> Engine:
        """The functions that solve goals of this kind; built on first use."""
        key = goal.kind, self._aligner.at(goal)
        if key not in self._engines:
            programme = OptimisationProblem(self.tool_point, self.task, self.reach, *key)
            self._engines[key] = Engine(programme, self._problem.solver, self._compiled)
        return self._engines[key]

    def solve(
        self,
        position: Sequence[float] | None = None,
        direction: Sequence[float] | None = None,
        clearance: float | None = None,
        *,
        seed: int | None = None,
        starts: int = QUICK_STARTS,
        polish: int | None = None,
    ) -> Solution:
        """The best posture for the task, or for another position [m], direction or clearance [m], world frame.

        Args:
            position: (3,) [m].
            direction: (3,) of any length.
            clearance: radial [m].
            seed: of the random starts; default: the problem's.
            starts: feasible postures to compare.
            polish: how many of them the solver improves.

        Raises:
            NoSolutionError: nothing feasible; carries the nearest posture and the reasons.
            InputError: a target that is not three finite numbers.
        """
        began = time.perf_counter()
        goal = self._goal(position, direction, clearance)
        seed = self._problem.solver.seed if seed is None else seed
        polish = QUICK_POLISH[goal.kind] if polish is None else polish
        found = search(self.engine(goal), goal, np.random.default_rng(seed), starts, polish)
        return self._answer(found, None, began)

    def solve_thoroughly(
        self, *, seed: int | None = None, workers: int = 1, progress: Progress | None = None
    ) -> Solution:
        """The best posture with the evidence that it is: every start polished, the remaining freedom swept."""
        began = time.perf_counter()
        engine, solver = self.engine(self.goal), self._problem.solver
        rng = np.random.default_rng(solver.seed if seed is None else seed)
        how: MapPolish | None = in_processes(workers) if workers > 1 else with_progress(progress) if progress else None
        found = search(engine, self.goal, rng, solver.starts, solver.starts, how)
        swept = sweep(engine, found.goal, rng) if found.found else None
        return self._answer(found, swept, began)

    def _goal(
        self, position: Sequence[float] | None, direction: Sequence[float] | None, clearance: float | None
    ) -> Goal:
        goal = self.goal
        if position is not None:
            goal = goal.with_position(np.asarray(position, dtype=float))
        if direction is not None:
            goal = goal.with_direction(np.asarray(direction, dtype=float), self.reach)
        if clearance is not None:
            if not clearance > 0:
                raise InputError(Issue(f"the clearance {clearance} is not above zero", ("clearance",), clearance))
            goal = replace(goal, clearance=float(clearance))
        return goal

    def _answer(self, found: Search, swept: Sweep | None, began: float) -> Solution:
        engine = self.engine(found.goal)
        programme = engine.programme
        by_starts = [c for c in found.found if c.feasible]
        by_sweep = [engine.polished(swept.best, found.goal)] if swept is not None else []
        feasible = sorted(by_starts + by_sweep, key=rank) or self._rescued(found, began)
        best = feasible[0]
        # A solve that stalled is no optimum; it counts only where nothing better is known.
        ended = [c for c in feasible if c.optimal] or feasible[:1]
        optima = [ended[k] for k in distinct(np.array([c.q for c in ended]), self._problem.robot)]
        evidence = _evidence(found, swept, by_starts, best, len(optima), began)

        def ranked() -> tuple[Alternative, ...]:
            return self._alternatives(programme, found.goal, optima)

        notes = (*self._problem.notes, programme.axis_note(found.goal), *self.remarks())
        if not by_starts and not by_sweep:
            notes = (*notes, _ONE_ONLY)
        notes += self._beside(best.q, found.goal)
        status: Status = "optimal" if best.optimal else "feasible"
        return Solution(self._problem, programme, found.goal, status, best.q, evidence, ranked, notes)

    def _rescued(self, found: Search, began: float) -> list[CandidatePosture]:
        """What the inquiry into the failure found to be feasible after all; else the error with the reasons."""
        engine = self.engine(found.goal)
        q, reasons = inquire(engine, found)
        if reasons:
            solution = infeasible(self._problem, engine, found, q, reasons, time.perf_counter() - began)
            raise NoSolutionError("\n".join(reason.message for reason in reasons), solution)
        rescued = engine.polished(engine.candidates(q[None], found.goal)[0], found.goal)
        if not rescued.feasible:
            raise SolverError(
                "the solver failed: each requirement can be met, but no posture was found that meets all of them; "
                "more starts may help (solver: {starts: 500})"
            )
        return [rescued]

    def _beside(self, q: Floats, goal: Goal) -> tuple[str, ...]:
        """How far the tool point of an arm that moves in a plane stays off a target that does not lie in it."""
        point = np.array(self.tool_point.walk(q.tolist())[0].position, dtype=float)
        N = self.reach.normals
        off = N @ (N.T @ (point - np.clip(point, goal.lower, goal.upper)))
        distance = float(np.linalg.norm(off))
        if goal.kind == "anywhere" or distance <= PLANE_TOLERANCE:
            return ()
        vector = ", ".join(f"{v * 1e3 + 0.0:.2f}" for v in off)
        return (
            f"The corrected arm leaves its plane by itself and not at will: its tool point comes to lie "
            f"{distance * 1e3:.2g} mm off the target, by ({vector}) mm, and no posture mends that.",
        )

    def remarks(self) -> tuple[str, ...]:
        """Sentences on what is not looked at."""
        if self._problem.robot.n < 3:
            return ()
        tipped = any(f.kind == "rotate" and f.axis != 2 and abs(f.nominal) > 1e-6 for f in self._problem.robot.base)
        asked = any(term.kind == "link_height" for term in self.task.subject_to)
        return (f"Collisions are not checked.{'' if tipped or asked else _LINK_HEIGHT}",)

    def _alternatives(
        self, programme: OptimisationProblem, goal: Goal, optima: Sequence[CandidatePosture]
    ) -> tuple[Alternative, ...]:
        Q = np.array([c.q for c in optima[:_MOST_ALTERNATIVES]])
        moments = self.tool_point.moments([Q[:, k] for k in range(Q.shape[1])])
        B = critical_basis(programme, goal)
        sigmas = np.sqrt(np.linalg.eigvalsh(B.T @ moments.covariance @ B)[..., -1].clip(0))
        positions = np.broadcast_to(moments.position, (len(Q), 3))
        names = self._problem.robot.joint_names
        return tuple(
            Alternative(dict(zip(names, map(float, q), strict=True)), x, float(s))
            for q, x, s in zip(Q, positions, sigmas, strict=True)
        )


def _evidence(
    found: Search,
    swept: Sweep | None,
    feasible: Sequence[CandidatePosture],
    best: CandidatePosture,
    distinct: int,
    began: float,
) -> Evidence:
    """What the search did; ``feasible`` are the answers that its starts led to."""
    as_good = best.objective + _SAME_OPTIMUM * max(abs(best.objective), 1e-9)
    return Evidence(
        starts=found.arrived,
        tried=found.tried,
        polished=found.polished,
        converged=sum(c.optimal for c in feasible),
        distinct=distinct,
        hits=sum(c.objective <= as_good for c in feasible),
        sampled=found.sampled,
        sweep=swept,
        sweep_sigma=math.nan if swept is None else swept.best.sigma,
        seconds=time.perf_counter() - began,
    )


def select_posture(
    problem: HasTask, *, seed: int | None = None, workers: int = 1, progress: Progress | None = None
) -> Solution:
    """The posture whose spread hurts the task least, with alternatives and evidence.

    Args:
        problem: with a task and uncertain parameters.
        seed: of the random starts; the same seed gives the same answer. Default: the problem's.
        workers: processes that share the local solves.
        progress: called with (done, total) local solves.

    Raises:
        NoSolutionError: nothing feasible; carries the nearest posture and the reasons.
        InputError: no task, nothing uncertain, or a task that the arm cannot do.
    """
    return PostureSelector(problem, compiled=False).solve_thoroughly(seed=seed, workers=workers, progress=progress)
