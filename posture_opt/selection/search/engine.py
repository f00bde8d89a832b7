"""``Engine``: the functions that screen, lead, improve and confirm postures of one optimisation problem, built once."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, TypeAlias

import numpy as np

from posture_opt.collision.contacts import Contacts, ContactSlack
from posture_opt.encoding import Encoded
from posture_opt.model.compiled import BatchFunction
from posture_opt.model.toolchain import find_compiler
from posture_opt.numerics import TURN, Array, Codes, DerivedAgain, Json
from posture_opt.robot.robot import Robot
from posture_opt.selection.program.nlp import Nlp
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.elastic_problem import ElasticProblem
from posture_opt.selection.search.inverse_kinematics import (
    ROW_TOLERANCE,
    InverseKinematics,
    PoseRequest,
    held_request,
    request_for,
)
from posture_opt.selection.search.local_search import LocalOptima, LocalSearch
from posture_opt.selection.solvers import Ends, Outcome, Polish, Solver


@dataclass(frozen=True)
class CandidatePosture:
    """One posture of a search."""

    q: Array  # (n,) [rad or m]
    objective: float  # over the target's scale, about one
    violation: float  # the largest of a row [m, rad or 1]
    sigma: float  # σ_max [m]
    optimal: bool = False
    message: str = "not improved"  # the solver's status
    count: int = 1  # searches that ended there

    @property
    def feasible(self) -> bool:
        return self.violation <= ROW_TOLERANCE


STEPS = 60  # of a local search that is followed to its end


@dataclass(frozen=True)
class Engine(DerivedAgain):
    """The functions that solve one problem again and again, each built (and compiled) on first use."""

    optimisation_problem: OptimisationProblem
    solver: Solver
    compiled: bool | None  # None: where a C compiler is found
    exact: bool = False  # exact distances in C in place of rows, where there is a compiler

    @property
    def robot(self) -> Robot:
        return self.optimisation_problem.robot

    def __reduce__(self) -> tuple[Any, ...]:
        return engine_of, (pickle.dumps((replace(self.optimisation_problem), self.solver, self.compiled, self.exact)),)

    @cached_property
    def contacts(self) -> Contacts | None:
        """Contacts kept by exact distances in the search, or None with rows in their place."""
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
        problem = self.searched
        arm, task, spun = problem.arm, problem.task, problem.task.heading is not None
        whole = problem.nlp.unlike_turns
        return InverseKinematics(arm, task.tool_axis, problem.reach.directions, self.compiled, spun=spun, whole=whole)

    @cached_property
    def screen(self) -> Callable[[Array, Array], tuple[Array, ...]]:
        """Postures (N, n), parameters (33,) or (N, 33) -> objective, worst violation, first term, variance [m²]."""
        rows = BatchFunction(self.searched.nlp.screen, compiled=self.compiled)
        return rows if self.contacts is None else _ScreenWithContacts(rows, ContactSlack(self.contacts, self.compiled))

    @cached_property
    def local(self) -> LocalSearch:
        return LocalSearch(self.searched.nlp, self.ik.step, self.solver.tolerance, self.compiled, self.contacts)

    @cached_property
    def elastic(self) -> ElasticProblem:
        """By how little requirements must give, where they cannot all be met."""
        return ElasticProblem(self.optimisation_problem)

    @cached_property
    def fallback_solver(self) -> Polish:
        """The solver for starts that the local search does not settle: seldom, so not compiled."""
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
        """Postures (N, n) after at most ``steps`` steps; ``state`` (N, m + n + 1) to go on from."""
        return self.local.descend(Q, target.parameters, self.held(target).rows, steps, state)

    def descended_each(self, Q: Array, targets: Sequence[TaskTarget], of: Codes, steps: int) -> LocalOptima:
        """As `descended`, the posture in row r (N, n) for ``targets[of[r]]``."""
        parameters = np.array([target.parameters for target in targets])[of]
        held = np.vstack([self.held(target).rows for target in targets])[of]
        return self.local.descend(Q, parameters, held, steps)

    def held(self, target: TaskTarget) -> PoseRequest:
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
        """Median of postures' own terms (N,) [m²], one where the objective has no unit."""
        middle = 1.0 if self.optimisation_problem.task.criterion == "miss" else median(variances)
        return middle if middle > 0 else 1.0

    def polished(self, start: CandidatePosture, target: TaskTarget) -> CandidatePosture:
        """The local optimum that a posture leads to, or itself; a tie goes to the local search."""
        end = self.settled(self.descended(start.q[None], target, STEPS), target)[0]
        return end if _better(end, start) else self.tidied([replace(start, message=end.message)], target)[0]

    def settled(
        self, found: LocalOptima, target: TaskTarget, count: Codes | None = None, helped: bool = True
    ) -> list[CandidatePosture]:
        """Where local searches ended, tidy; IPOPT is tried on a few without an optimum that could change the answer.

        ``count`` (N,): searches that each stands for; ``helped``: IPOPT is tried beside a feasible optimum too.
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
        for k in doubtful[: 4 if promising else 0]:
            ends[k] = self.confirmed(ends[k], target)
        return ends

    def confirmed(self, candidate: CandidatePosture, target: TaskTarget) -> CandidatePosture:
        """The candidate, or where IPOPT goes on to from one without optimality."""
        better = candidate if candidate.optimal else self._fallback_solution(candidate, target)
        return candidate if better is candidate else self.tidied([better], target)[0]

    def _fallback_solution(self, start: CandidatePosture, target: TaskTarget) -> CandidatePosture:
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
        return clusters(Q, self.robot, size, self.indifferent)

    def tidied(self, candidates: Sequence[CandidatePosture], target: TaskTarget) -> list[CandidatePosture]:
        """Candidates with indifferent joints at zero, whole turns taken off, angles rounded where free."""
        if not candidates:
            return []
        tidy = self._tidy(np.array([candidate.q for candidate in candidates]), target)
        return [
            CandidatePosture(*of, given.optimal, given.message, given.count)
            for of, given in zip(tidy, candidates, strict=True)
        ]

    def _tidy(self, Q: Array, target: TaskTarget) -> Iterator[tuple[Array, float, float, float]]:
        """Tidy postures in place of Q (N, n) where they cost less than 1e-9, with objective, violation, σ_max [m]."""
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
        robot = self.robot
        turns = np.array([2 * np.pi * (joint.type == "revolute") for joint in robot.joints])
        return np.array(robot.lower), np.array(robot.upper), turns, list(self.indifferent)


@dataclass(frozen=True)
class _ScreenWithContacts:
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
    # 1e3 a unit of violation: multipliers of rows are seldom larger
    return end.feasible and (not start.feasible or end.objective <= start.objective + 1e-6 + 1e3 * start.violation)


def median(values: Array) -> float:
    """The median of (N,) values; NumPy's own loads its masked arrays first, which a cold start can do without."""
    ordered = np.sort(values)
    return float(ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2


DISTINCT_ANGLE = math.radians(5.0)  # apart in a joint: well above what a search leaves open in a flat valley


def clusters(Q: Array, robot: Robot, size: Codes | None = None, ignored: Sequence[int] = ()) -> tuple[Codes, Codes]:
    """Rows of Q (k, n) [rad or m] that differ from all before, and how many, ``size`` (k,) each, are near them.

    Near: within 5° or 10 mm in each joint but the ``ignored``, whole turns taken off.
    """
    joints = [k for k in range(robot.n) if k not in ignored]
    revolute = np.array([robot.joints[k].type == "revolute" for k in joints], dtype=bool)[:, None]
    limit, turn = np.where(revolute, DISTINCT_ANGLE, 0.01)[..., None], np.where(revolute, TURN, 0.0)
    X = Q.T[joints]
    X -= turn * np.rint(X / TURN)  # angles within half a turn of zero are near, or a turn but a little apart
    beyond = np.where(revolute, TURN, np.inf)[..., None] - limit
    left, cluster = np.ones(len(Q), dtype=bool), np.zeros(len(Q), dtype=int)
    first: list[int] = []
    for block in range(0, len(Q), 64):  # a block of 64 rows bounds the memory
        apart = np.abs(X[:, block : block + 64, None] - X[:, None])
        near = np.logical_and.reduce((apart <= limit) | (apart >= beyond))
        for k, row in enumerate(near, start=block):
            if left[k]:
                row &= left
                cluster[row] = len(first)
                first.append(k)
                left ^= row
    return np.array(first, dtype=int), np.bincount(cluster, size, len(first)).astype(int)


@dataclass(frozen=True)
class Confirmation(Encoded, json="name iterations kkt agrees"):
    """What a solver says of an optimum."""

    name: str
    iterations: int  # over all postures that went through it
    kkt: float  # largest scaled residual of the optimality conditions
    agrees: float  # relative difference of σ from what it was given
    taken: bool = False  # its end is the answer, as it is better
    q: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    row_multipliers: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    bound_multipliers: Array = field(default_factory=lambda: np.zeros(0), repr=False)

    @property
    def differs(self) -> bool:
        return not self.agrees <= 1e-6

    @property
    def refutes(self) -> bool:
        """Whether the solver left for something visibly different that is not the answer."""
        return not self.taken and self.agrees > 1e-3  # visible in three digits


# The same of an answer that the search alone gave.
UNCONFIRMED_JSON: dict[str, Json] = {"name": "search", "iterations": 0, "kkt": None, "agrees": None}


def joined_confirmation(every: Sequence[Confirmation | None]) -> Confirmation | None:
    """Largest residual and difference over several answers, or None unless all have one."""
    known = [one for one in every if one is not None]
    if not known or len(known) < len(every):
        return None
    kkt, agrees = (float(np.max([getattr(one, name) for one in known])) for name in ("kkt", "agrees"))
    return Confirmation(
        known[0].name, sum(one.iterations for one in known), kkt, agrees, any(one.taken for one in known)
    )


NEAR_ROW_M = 0.02  # distance from its end [m] up to which a row that keeps the arm clear takes part from the beginning

_Rows: TypeAlias = tuple[int, ...]


class ConfirmingSolver:
    """Solves a nonlinear program from postures that are optima, or nearly so."""

    def __init__(self, nlp: Nlp, solver: Solver) -> None:
        self._nlp, self._solver = nlp, solver
        self._built: dict[_Rows, Polish] = {}

    def solvable(self, parameters: Array) -> bool:
        """Whether there are no more equalities than variables, which is what an interior-point method takes."""
        low, high, row_low, row_high = self._nlp.ends(parameters)
        return int(np.count_nonzero(row_low == row_high)) <= int(np.count_nonzero(low < high))

    def solve(self, q: Array, parameters: Array, ends: Ends | None = None) -> Outcome:
        """Where the solver ends from q (n,) [rad or m]; multipliers (m,) and (n,), zero of rows that took no part."""
        low, high, row_low, row_high = self._nlp.ends(parameters) if ends is None else ends
        chosen = self._beyond(q, parameters, row_low + NEAR_ROW_M, row_high - NEAR_ROW_M)
        chosen |= {k for k, row in enumerate(self._nlp.rows) if not row.convex}
        while True:
            rows = tuple(sorted(chosen))
            kept = np.array(rows, dtype=int)
            found = self._polish(rows)(q, parameters, (low, high, row_low[kept], row_high[kept]))
            missed = self._beyond(found.x, parameters, row_low - ROW_TOLERANCE, row_high + ROW_TOLERANCE) - chosen
            if not missed:
                break
            chosen |= missed
        multipliers = np.zeros(len(self._nlp.rows))
        multipliers[kept] = found.row_multipliers
        return replace(found, row_multipliers=multipliers)

    def _beyond(self, q: Array, parameters: Array, low: Array, high: Array) -> set[int]:
        """The rows whose values are outside of (m,) ends."""
        if not any(row.convex for row in self._nlp.rows):
            return set()
        value = self._nlp.row_values.one(q, parameters)
        return {int(k) for k in np.flatnonzero((value < low) | (value > high))}

    def _polish(self, rows: _Rows) -> Polish:
        if rows not in self._built:
            whole = len(rows) == len(self._nlp.rows)
            nlp = self._nlp if whole else self._nlp.with_rows(rows)
            self._built[rows] = self._solver.build(nlp, confirms=True)
        return self._built[rows]
