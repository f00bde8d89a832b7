"""``Engine``: the functions that screen, lead and polish the postures of one programme, built once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.model.compiled import BatchFunction
from posture_opt.selection.feasible import ROW_TOLERANCE, InverseKinematics, Wish, wish_for
from posture_opt.selection.goal import Goal
from posture_opt.selection.optimisation_problem import OptimisationProblem
from posture_opt.selection.solvers import Outcome, Polish, Solver

Floats = np.ndarray


@dataclass(frozen=True)
class CandidatePosture:
    """One posture (n,): objective (scaled), worst violation of a row, σ_max [m], and the solver's word on it."""

    q: Floats
    objective: float
    violation: float
    sigma: float
    optimal: bool = False
    message: str = "not polished"

    @property
    def feasible(self) -> bool:
        return self.violation <= ROW_TOLERANCE


Recipe = tuple[OptimisationProblem, Solver, bool | None]
"""What an engine is built from: this travels to other processes, the functions cannot."""


@dataclass(frozen=True)
class Engine:
    """The functions that solve one programme again and again, built once."""

    programme: OptimisationProblem
    solver: Solver
    compiled: bool | None

    @classmethod
    def build(cls, recipe: Recipe) -> Engine:
        return cls(*recipe)

    @property
    def recipe(self) -> Recipe:
        # A fresh copy, without the symbols that the programme has cached.
        return replace(self.programme), self.solver, self.compiled

    @cached_property
    def ik(self) -> InverseKinematics:
        programme = self.programme
        return InverseKinematics(programme.arm, programme.task.tool_axis, programme.reach.directions, self.compiled)

    @cached_property
    def screen(self) -> BatchFunction:
        return BatchFunction(self.programme.nlp.screen, compiled=self.compiled)

    @cached_property
    def polish(self) -> Polish:
        return self.solver.build(self.programme.nlp, self.compiled)

    def wish(self, goal: Goal, count: int, rng: np.random.Generator, *, whole_box: bool = False) -> Wish:
        """What ``count`` starts are led to."""
        slack = self.programme.reach.axis_slack / 2 if self.programme.alignment == "loose" else 0.0
        aligned = self.programme.axis_rows > 0
        return wish_for(goal, count, aligned, rng, whole_box=whole_box, slack_of_axis=slack)

    def candidates(self, Q: Floats, goal: Goal) -> list[CandidatePosture]:
        """The postures (N, n) as candidates."""
        columns = (column.tolist() for column in self.screened(Q, goal))
        return [CandidatePosture(*row) for row in zip(Q, *columns, strict=True)]

    def screened(self, Q: Floats, goal: Goal) -> tuple[Floats, Floats, Floats]:
        """Objective (scaled), worst violation of a row and σ_max [m] of the postures (N, n): three times (N,)."""
        objective, violation, _, variance = (column[:, 0] for column in self.screen(Q, goal.parameters()))
        return objective, violation, np.sqrt(np.maximum(variance, 0.0))

    def polished(self, start: CandidatePosture, goal: Goal) -> CandidatePosture:
        """The start improved by the solver; the start itself where the solver made it worse.

        A start may gain a little objective from the last digits of its rows: a tie goes to the solver.
        """
        outcome: Outcome = self.polish(start.q, goal.parameters())
        if not np.all(np.isfinite(outcome.x)):
            return replace(start, message=outcome.message)
        end = self.candidates(outcome.x[None], goal)[0]
        end = replace(end, optimal=outcome.optimal, message=outcome.message)
        end = self.tidied(end, goal)
        better = end.feasible and (not start.feasible or end.objective <= start.objective + 1e-6)
        return end if better else self.tidied(replace(start, message=outcome.message), goal)

    def tidied(self, candidate: CandidatePosture, goal: Goal) -> CandidatePosture:
        """The same posture as people write it: joints that do not matter at zero, whole turns taken off."""
        robot = self.programme.robot
        lower, upper = np.array(robot.lower), np.array(robot.upper)
        turns = np.array([2 * np.pi * (joint.type == "revolute") for joint in robot.joints])
        q = candidate.q - turns * np.round(candidate.q / (2 * np.pi))
        q = np.where((q >= lower) & (q <= upper), q, candidate.q)
        idle = list(self.programme.nlp.indifferent)
        q[idle] = np.clip(0.0, lower[idle], upper[idle])
        # Where the objective is flat, a whole degree is as good as 179.98.
        rounded = np.clip(np.where(turns > 0, np.deg2rad(np.round(np.rad2deg(q))), q), lower, upper)
        for tidy in self.candidates(np.array([rounded, q]), goal):
            worse = tidy.violation > candidate.violation + 1e-9 or tidy.objective > candidate.objective + 1e-9
            if not worse:
                return replace(tidy, optimal=candidate.optimal, message=candidate.message)
        return candidate
