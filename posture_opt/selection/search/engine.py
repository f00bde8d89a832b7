"""``Engine``: the functions that screen, lead and improve the postures of one optimisation problem, built once."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from posture_opt.collision.contact_slack import ContactSlack
from posture_opt.collision.contacts import Contacts
from posture_opt.model.compiled import BatchFunction
from posture_opt.model.toolchain import find_compiler
from posture_opt.numerics import Array, Codes, DerivedAgain
from posture_opt.robot.robot import Robot
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.pose_request import PoseRequest, held_request, request_for
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.clusters import clusters
from posture_opt.selection.search.confirming_solver import ConfirmingSolver
from posture_opt.selection.search.elastic_problem import ElasticProblem
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, InverseKinematics
from posture_opt.selection.search.local_search import LocalOptima, LocalSearch
from posture_opt.selection.solvers import Outcome, Polish, Solver


@dataclass(frozen=True)
class CandidatePosture:
    """One posture of a search.

    Args:
        q: (n,) [rad or m].
        objective: over the target's scale, so about one.
        violation: the largest of a row [m, rad or 1].
        sigma: σ_max of the part that counts [m].
        optimal: whether first-order conditions hold; ``message`` is the solver's status.
        count: local searches that ended there.
    """

    q: Array
    objective: float
    violation: float
    sigma: float
    optimal: bool = False
    message: str = "not improved"
    count: int = 1

    @property
    def feasible(self) -> bool:
        """Whether every row is met."""
        return self.violation <= ROW_TOLERANCE


STEPS = 60
"""Of a local search that is followed to its end."""

VIOLATION_PRICE = 1e3  # of the objective for each m or rad of violation: the multipliers of rows are seldom larger
MAX_IPOPT_FALLBACKS = 4  # IPOPT solves tried in one search where the local search ends infeasible


@dataclass(frozen=True)
class Engine(DerivedAgain):
    """The functions that solve one optimisation problem again and again, built once.

    Each is built, and compiled where a C compiler is found, when it is first used. An engine travels to other
    processes as the data that it is built from.

    Args:
        compiled: None compiles where a C compiler is found; False never; True or an error.
        exact: whether the search keeps the arm clear by exact distances in C, where there is a compiler, instead of by
            rows of the nonlinear program: for repeated solves, which build neither these rows nor their derivatives.
    """

    optimisation_problem: OptimisationProblem
    solver: Solver
    compiled: bool | None
    exact: bool = False

    @property
    def robot(self) -> Robot:
        """The robot of the optimisation problem, n joints."""
        return self.optimisation_problem.robot

    def __reduce__(self) -> tuple[Any, ...]:
        return engine_of, (self._packed,)

    @cached_property
    def _packed(self) -> bytes:
        """The data that the engine is built from, as bytes."""
        # A fresh copy, without the symbols that the optimisation problem has cached.
        return pickle.dumps((replace(self.optimisation_problem), self.solver, self.compiled, self.exact))

    @cached_property
    def contacts(self) -> Contacts | None:
        """What the search keeps apart by exact distances; None where rows of the program do so, or nothing does."""
        scene = self.optimisation_problem.scene
        wanted = self.exact and scene is not None and self.compiled is not False and find_compiler()
        return scene.contacts if scene is not None and wanted else None

    @cached_property
    def searched(self) -> OptimisationProblem:
        """The optimisation problem whose program the local searches follow: without rows for what `contacts` keeps."""
        problem = self.optimisation_problem
        return problem if self.contacts is None else replace(problem, scene=None)

    @cached_property
    def indifferent(self) -> tuple[int, ...]:
        """The joints that nothing depends on, neither the program nor what keeps the arm clear."""
        found = self.searched.nlp.indifferent
        return found if self.contacts is None else tuple(k for k in found if k not in self.contacts.moving)

    @cached_property
    def ik(self) -> InverseKinematics:
        """Brings random postures onto the target."""
        problem = self.searched
        arm, task, spun = problem.arm, problem.task, problem.task.heading is not None
        whole = problem.nlp.unlike_turns
        return InverseKinematics(arm, task.tool_axis, problem.reach.directions, self.compiled, spun=spun, whole=whole)

    @cached_property
    def screen(self) -> Callable[[Array, Array], tuple[Array, ...]]:
        """Postures (N, n) and parameters (30,) or (N, 30) to objective, worst violation of a row, first term and
        variance.

        Each (N, 1); the variance [m²] is that along the worst axis, whatever the criterion.
        """
        rows = BatchFunction(self.searched.nlp.screen, compiled=self.compiled)
        return rows if self.contacts is None else _ScreenWithContacts(rows, ContactSlack(self.contacts, self.compiled))

    @cached_property
    def local(self) -> LocalSearch:
        """Follows postures to local optima."""
        return LocalSearch(self.searched.nlp, self.ik.step, self.solver.tolerance, self.compiled, self.contacts)

    @cached_property
    def elastic(self) -> ElasticProblem:
        """By how little requirements must give, where they cannot all be met."""
        return ElasticProblem(self.optimisation_problem)

    @cached_property
    def fallback_solver(self) -> Polish:
        """The solver of the problem, for what the local search does not settle: seldom, so that it is not compiled."""
        return self.solver.build(self.optimisation_problem.nlp)

    @cached_property
    def confirming(self) -> ConfirmingSolver:
        """The solver of the problem, for optima that the local search has found."""
        return ConfirmingSolver(self.optimisation_problem.nlp, self.solver)

    def request(
        self, target: TaskTarget, count: int, rng: np.random.Generator, *, whole_box: bool = False
    ) -> PoseRequest:
        """What ``count`` starts are led to."""
        aligned = self.optimisation_problem.axis_rows > 0
        return request_for(target, count, aligned, rng, whole_box=whole_box, slack_of_axis=self._slack_of_axis)

    @property
    def _slack_of_axis(self) -> float:
        """Error of the tool axis [rad] that starts may keep: half of what a loose row of the axis allows."""
        problem = self.optimisation_problem
        return problem.reach.axis_slack / 2 if problem.alignment == "loose" else 0.0

    def descended(self, Q: Array, target: TaskTarget, steps: int, state: Array | None = None) -> LocalOptima:
        """The postures (N, n) after at most ``steps`` steps of the local search, with the state (N, m + n + 1) to go on
        from.
        """
        return self.local.descend(Q, target.parameters, self.held(target).rows, steps, state)

    def descended_each(self, Q: Array, targets: Sequence[TaskTarget], of: Codes, steps: int) -> LocalOptima:
        """The same, the posture in row r (N, n) for ``targets[of[r]]``."""
        parameters = np.array([target.parameters for target in targets])[of]
        held = np.vstack([self.held(target).rows for target in targets])[of]
        return self.local.descend(Q, parameters, held, steps)

    def held(self, target: TaskTarget) -> PoseRequest:
        """What the steps of the local search must keep."""
        return held_request(target, self.optimisation_problem.axis_rows > 0, self._slack_of_axis)

    def candidates(self, Q: Array, target: TaskTarget) -> list[CandidatePosture]:
        """The postures (N, n) as candidates for one target."""
        return self.screened(Q, target.parameters)

    def screened(self, Q: Array, parameters: Array) -> list[CandidatePosture]:
        """The postures (N, n) as candidates for the target of ``parameters`` (p,), or of one row (N, p) each."""
        return [CandidatePosture(*row) for row in zip(Q, *self._values(Q, parameters).T.tolist(), strict=True)]

    def _values(self, Q: Array, parameters: Array) -> Array:
        """(N, 3) objective, worst violation of a row and σ_max [m] of the postures (N, n)."""
        objective, violation, _, variance = self.screen(Q, parameters)
        return np.hstack([objective, violation, np.sqrt(np.maximum(variance, 0.0))])

    def scale_of(self, variances: Array) -> float:
        """What the objective is divided by: the median of some postures' own terms (N,) [m²], one where it has no
        unit.
        """
        middle = 1.0 if self.optimisation_problem.task.criterion == "miss" else median(variances)
        return middle if middle > 0 else 1.0

    def polished(self, start: CandidatePosture, target: TaskTarget) -> CandidatePosture:
        """The local optimum that a posture leads to; the posture itself where nothing better was found.

        A start may gain a little objective from the last digits of its rows: a tie goes to the local search.
        """
        end = self.settled(self.descended(start.q[None], target, STEPS), target)[0]
        return end if _better(end, start) else self.tidied([replace(start, message=end.message)], target)[0]

    def settled(
        self, found: LocalOptima, target: TaskTarget, count: Codes | None = None, helped: bool = True
    ) -> list[CandidatePosture]:
        """Where local searches ended, with tidy joint values; IPOPT is tried on a few that are not optimal.

        Only where it could change the answer: a search that ended without an optimum below the best one that is known.

        Args:
            count: (N,) how many searches each of them represents.
            helped: whether IPOPT is tried where a feasible optimum is known too; else only where there is none.
        """
        counts, words = np.ones(len(found.q), dtype=int) if count is None else count, ("not converged", "converged")
        ends = [
            CandidatePosture(*tidy, yes, words[yes], n)
            for tidy, yes, n in zip(self._tidy(found.q, target), found.optimal.tolist(), counts.tolist(), strict=True)
        ]
        # Only where it would change the answer.
        limit = min((end.objective for end in ends if end.optimal and end.feasible), default=np.inf)
        doubtful = [k for k, end in enumerate(ends) if not end.optimal and (end.objective < limit or not end.feasible)]
        promising = np.isinf(limit) or (helped and any(ends[k].feasible for k in doubtful))
        for k in doubtful[: MAX_IPOPT_FALLBACKS if promising else 0]:
            ends[k] = self.confirmed(ends[k], target)
        return ends

    def confirmed(self, candidate: CandidatePosture, target: TaskTarget) -> CandidatePosture:
        """The same candidate, or where IPOPT goes on to from one that is no optimum."""
        better = candidate if candidate.optimal else self._fallback_solution(candidate, target)
        return candidate if better is candidate else self.tidied([better], target)[0]

    def _fallback_solution(self, start: CandidatePosture, target: TaskTarget) -> CandidatePosture:
        """Where IPOPT ends from a candidate, the candidate itself where that is not better."""
        if self.contacts is not None:
            return start  # IPOPT has rows in place of exact distances, and takes longer than many more starts
        if self.searched.freedom == 0:
            return start  # nothing is left to choose, and IPOPT would refuse more equalities than joints
        ends = self.optimisation_problem.nlp.ends(target.parameters)
        outcome: Outcome = self.fallback_solver(start.q, target.parameters, ends)
        if not np.all(np.isfinite(outcome.x)):
            return replace(start, message=outcome.message)
        end = replace(self.candidates(outcome.x[None], target)[0], optimal=outcome.optimal, message=outcome.message)
        end = replace(end, count=start.count)
        return end if _better(end, start) else replace(start, message=outcome.message)

    def clusters(self, Q: Array, size: Codes | None = None) -> tuple[Codes, Codes]:
        """As :func:`clusters`, by the joints that matter."""
        return clusters(Q, self.robot, size, self.indifferent)

    def tidied(self, candidates: Sequence[CandidatePosture], target: TaskTarget) -> list[CandidatePosture]:
        """The same postures with joints that do not matter at zero, whole turns taken off and angles rounded where that
        is free.
        """
        if not candidates:
            return []
        tidy = self._tidy(np.array([candidate.q for candidate in candidates]), target)
        return [
            CandidatePosture(*of, given.optimal, given.message, given.count)
            for of, given in zip(tidy, candidates, strict=True)
        ]

    def _tidy(self, Q: Array, target: TaskTarget) -> Iterator[tuple[Array, float, float, float]]:
        """Tidy postures in place of Q (N, n), with their objective, violation and σ_max [m].

        A rounded angle is taken where neither objective nor violation gets worse by more than 1e-9.
        """
        given, (lower, upper, turns, idle) = Q, self._ends
        turned = Q - turns * np.rint(Q * (0.5 / np.pi))
        Q = np.where((turned >= lower) & (turned <= upper), turned, Q)
        Q[:, idle] = np.clip(0.0, lower[idle], upper[idle])
        # Where the objective is flat, a whole degree is as good as 179.98.
        rounded = np.clip(np.where(turns > 0, np.deg2rad(np.rint(np.rad2deg(Q))), Q), lower, upper)
        options = np.concatenate([rounded, Q, given])
        values = self._values(options, target.parameters).reshape(3, len(Q), 3)
        costs = np.any(values[:2, :, :2] > values[2, :, :2] + 1e-9, axis=2)
        chosen = np.where(costs[0], np.where(costs[1], 2, 1), 0), np.arange(len(Q))
        return zip(options.reshape(3, *Q.shape)[chosen], *values[chosen].T.tolist(), strict=True)

    @cached_property
    def _ends(self) -> tuple[Array, Array, Array, list[int]]:
        """Limits and whole turns of the joints, and those that matter to nothing."""
        robot = self.robot
        turns = np.array([2 * np.pi * (joint.type == "revolute") for joint in robot.joints])
        return np.array(robot.lower), np.array(robot.upper), turns, list(self.indifferent)


@dataclass(frozen=True)
class _ScreenWithContacts:
    """`Engine.screen` with the violation of what is too near among that of the rows."""

    rows: BatchFunction
    kept: ContactSlack

    def __call__(self, Q: Array, parameters: Array) -> tuple[Array, ...]:
        objective, violation, own, variance = self.rows(Q, parameters)
        return objective, np.maximum(violation, -self.kept.slack(Q)[:, None]), own, variance


@lru_cache(maxsize=4)
def engine_of(packed: bytes) -> Engine:
    """The engine of what travels in its place, as functions cannot; built once in a process that gets it again."""
    return Engine(*pickle.loads(packed))


def _better(end: CandidatePosture, start: CandidatePosture) -> bool:
    """Whether a search ended at a feasible posture that is no worse than where it started, violation priced in."""
    return end.feasible and (
        not start.feasible or end.objective <= start.objective + 1e-6 + VIOLATION_PRICE * start.violation
    )


def median(values: Array) -> float:
    """The median of (N,) values; NumPy's own loads its masked arrays first, which a cold start can do without."""
    ordered = np.sort(values)
    return float(ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
