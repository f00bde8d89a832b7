"""``Engine``: the functions that screen, lead and polish the postures of one optimisation problem, built once.

The `Aligner` says before what an arm can give of the tool axis that a task asks for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.inverse_kinematics import (
    ROW_TOLERANCE,
    TOLERANCE,
    InverseKinematics,
    PoseRequest,
    axis_can_reach,
    request_for,
)
from posture_opt.selection.optimisation_problem import Alignment, OptimisationProblem
from posture_opt.selection.solvers import Outcome, Polish, Solver
from posture_opt.selection.task_target import Reach, TaskTarget
from posture_opt.selection.tasks import Task


@dataclass(frozen=True)
class CandidatePosture:
    """One posture (n,): objective (scaled), worst violation of a row, σ_max [m], and the solver's word on it."""

    q: Array
    objective: float
    violation: float
    sigma: float
    optimal: bool = False
    message: str = "not polished"

    @property
    def feasible(self) -> bool:
        """Whether every row is met."""
        return self.violation <= ROW_TOLERANCE


Recipe = tuple[OptimisationProblem, Solver, bool | None]
"""What an engine is built from: this travels to other processes, the functions cannot."""


@dataclass(frozen=True)
class Engine:
    """The functions that solve one optimisation problem again and again, built once."""

    optimisation_problem: OptimisationProblem
    solver: Solver
    compiled: bool | None

    @property
    def robot(self) -> Robot:
        """Of the optimisation problem."""
        return self.optimisation_problem.robot

    @classmethod
    def build(cls, recipe: Recipe) -> Engine:
        """The engine that another process described."""
        return cls(*recipe)

    @property
    def recipe(self) -> Recipe:
        """What another process builds the same engine from."""
        # A fresh copy, without the symbols that the optimisation problem has cached.
        return replace(self.optimisation_problem), self.solver, self.compiled

    @cached_property
    def ik(self) -> InverseKinematics:
        """Brings random postures onto the target."""
        problem = self.optimisation_problem
        return InverseKinematics(problem.arm, problem.task.tool_axis, problem.reach.directions, self.compiled)

    @cached_property
    def screen(self) -> BatchFunction:
        """Postures (N, n) and parameters to objective, worst violation of a row, first term and variance."""
        return BatchFunction(self.optimisation_problem.nlp.screen, compiled=self.compiled)

    @cached_property
    def polish(self) -> Polish:
        """The local solver."""
        return self.solver.build(self.optimisation_problem.nlp, self.compiled)

    def request(
        self, target: TaskTarget, count: int, rng: np.random.Generator, *, whole_box: bool = False
    ) -> PoseRequest:
        """What ``count`` starts are led to."""
        problem = self.optimisation_problem
        slack = problem.reach.axis_slack / 2 if problem.alignment == "loose" else 0.0
        return request_for(target, count, problem.axis_rows > 0, rng, whole_box=whole_box, slack_of_axis=slack)

    def candidates(self, Q: Array, target: TaskTarget) -> list[CandidatePosture]:
        """The postures (N, n) as candidates for one target."""
        return self.screened(Q, target.parameters())

    def screened(self, Q: Array, parameters: Array) -> list[CandidatePosture]:
        """The postures (N, n) as candidates for the target of ``parameters`` (p,), or of one row (N, p) each."""
        objective, violation, _, variance = (column[:, 0] for column in self.screen(Q, parameters))
        columns = (column.tolist() for column in (objective, violation, np.sqrt(np.maximum(variance, 0.0))))
        return [CandidatePosture(*row) for row in zip(Q, *columns, strict=True)]

    def scale_of(self, variances: Array) -> float:
        """What the objective is divided by: the median of some postures' own terms (N,), one where it has no unit."""
        middle = 1.0 if self.optimisation_problem.task.criterion == "miss" else median(variances)
        return middle if middle > 0 else 1.0

    def polished(self, start: CandidatePosture, target: TaskTarget) -> CandidatePosture:
        """The start improved by the solver; the start itself where the solver made it worse.

        A start may gain a little objective from the last digits of its rows: a tie goes to the solver.
        """
        outcome: Outcome = self.polish(start.q, target.parameters())
        if not np.all(np.isfinite(outcome.x)):
            return replace(start, message=outcome.message)
        end = self.candidates(outcome.x[None], target)[0]
        end = replace(end, optimal=outcome.optimal, message=outcome.message)
        end = self.tidied(end, target)
        better = end.feasible and (not start.feasible or end.objective <= start.objective + 1e-6)
        return end if better else self.tidied(replace(start, message=outcome.message), target)

    def tidied(self, candidate: CandidatePosture, target: TaskTarget) -> CandidatePosture:
        """The same posture as people write it: joints that do not matter at zero, whole turns taken off."""
        robot = self.robot
        lower, upper = np.array(robot.lower), np.array(robot.upper)
        turns = np.array([2 * np.pi * (joint.type == "revolute") for joint in robot.joints])
        q = candidate.q - turns * np.round(candidate.q / (2 * np.pi))
        q = np.where((q >= lower) & (q <= upper), q, candidate.q)
        idle = list(self.optimisation_problem.nlp.indifferent)
        q[idle] = np.clip(0.0, lower[idle], upper[idle])
        # Where the objective is flat, a whole degree is as good as 179.98.
        rounded = np.clip(np.where(turns > 0, np.deg2rad(np.round(np.rad2deg(q))), q), lower, upper)
        for tidy in self.candidates(np.array([rounded, q]), target):
            worse = tidy.violation > candidate.violation + 1e-9 or tidy.objective > candidate.objective + 1e-9
            if not worse:
                return replace(tidy, optimal=candidate.optimal, message=candidate.message)
        return candidate


def median(values: Array) -> float:
    """The median of (N,) values; NumPy's own loads its masked arrays first, which a cold start can do without."""
    ordered = np.sort(values)
    return float(ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2


_TRIALS = 96  # random postures: where one in twenty arrives aligned, all of them fail at 0.7 % of the targets


@dataclass(frozen=True)
class Aligner:
    """The arm and the axis that is asked of it; ``compiled`` as of the selector."""

    arm: Arm
    task: Task
    reach: Reach
    compiled: bool | None

    def at(self, target: TaskTarget) -> Alignment:
        """Whether the tool axis is asked for, and what the arm can give at such a target."""
        reach = self.reach
        if self.task.axis == "free" or reach.axis_rank == 0:
            return "free"
        if reach.axis_freedom == 2 and reach.orients_at_point:
            return "exact"
        # Too few joints to turn the tool at will: it depends on direction and target, so try.
        if reach.axis_rank == 1 and self._can_align(target, 0.0):
            return "exact"
        if self._can_align(target, reach.axis_slack / 2):
            return "loose"
        can_turn = target.kind != "point" or reach.orients_at_point
        nearly = can_turn and axis_can_reach(self.arm, self.task.tool_axis, target, reach.axis_slack)
        return "loose" if nearly else "free"

    def _can_align(self, target: TaskTarget, slack: float) -> bool:
        rng, ik = np.random.default_rng(0), self._trial
        request = request_for(target, _TRIALS, True, rng, whole_box=True, slack_of_axis=slack)
        return bool(np.min(ik.solve(ik.random_postures(_TRIALS, rng), request, enough=1)[1]) < TOLERANCE)

    @cached_property
    def _trial(self) -> InverseKinematics:
        return InverseKinematics(self.arm, self.task.tool_axis, self.reach.directions, self.compiled)
