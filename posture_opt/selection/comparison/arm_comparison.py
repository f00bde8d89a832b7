"""``compare``: one task for several arms, or for several states of knowledge of one arm, each judged by the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from posture_opt.errors import InputError, Issue, NoSolutionError, SolverError
from posture_opt.interrupts import interruptible
from posture_opt.numerics import Json, Progress
from posture_opt.result import Result
from posture_opt.robot.robot import Robot
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.comparison.plan_comparison import PredictedError, predicted_error
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.select_posture import Answer, select_posture

_TIE = 1e-12  # of a standard deviation


@dataclass(frozen=True, eq=False)
class JudgedPlan:
    """The postures of one arm as another one predicts them: a predicted_error for every posture of the answer."""

    predicted_errors: tuple[PredictedError, ...]

    @property
    def sigma_max(self) -> float:
        """Largest standard deviation of the part that counts [m]."""
        return max(predicted_error.sigma_max for predicted_error in self.predicted_errors)

    @property
    def distance(self) -> float:
        """Largest distance of a mean from its target, in the part that counts [m]."""
        return max(predicted_error.distance for predicted_error in self.predicted_errors)

    @property
    def critical_error(self) -> float:
        """Distance from the target that 95 of 100 repeats stay within, where it is largest [m]."""
        return max(predicted_error.critical_error for predicted_error in self.predicted_errors)

    @property
    def success_probability(self) -> float | None:
        """To stay within the clearance where that is least likely; None without one."""
        p_success = [predicted_error.success_probability for predicted_error in self.predicted_errors]
        known = [p for p in p_success if p is not None]
        return min(known) if len(known) == len(p_success) else None

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI."""
        return {
            "sigma_max": self.sigma_max,
            "miss": self.distance,
            "critical_error": self.critical_error,
            "success_probability": self.success_probability,
        }


@dataclass(frozen=True, eq=False)
class ComparedArm:
    """One arm of a comparison: its answer, or why there is none, and what each arm predicts of that answer.

    Args:
        judged: name of an arm -> what it predicts; its own prediction under its own name; arms with other joints are
            not asked.
    """

    problem: ProblemData
    answer: Answer | None
    judged: Mapping[str, JudgedPlan]
    reasons: tuple[str, ...] = ()

    @property
    def stations(self) -> tuple[Solution, ...]:
        """The postures of the answer: one, one a feature, or one a listed point of a path."""
        return () if self.answer is None else stations_of(self.answer)

    def to_json(self) -> dict[str, Json]:
        """The document of this arm: SI units and radians."""
        if self.answer is None:
            return {"status": "infeasible", "reasons": list(self.reasons)}
        return {
            "status": self.answer.status,
            "postures": [station.posture for station in self.stations],
            "sigma_max": max(station.critical.sigma_max for station in self.stations),
            "judged_by": {name: plan.to_json() for name, plan in self.judged.items()},
            "reasons": [],
        }


@dataclass(frozen=True, eq=False, repr=False)
class ArmComparison(Result):
    """One task for several arms, or for several models of one arm.

    Args:
        arms: by name; the task is that of the first.
        notes: sentences on what was not the same.
    """

    arms: Mapping[str, ComparedArm]
    notes: tuple[str, ...] = ()

    @property
    def problem(self) -> ProblemData:
        """The first arm with its task."""
        return next(iter(self.arms.values())).problem

    @property
    def answered(self) -> dict[str, ComparedArm]:
        """The arms that can do the task."""
        return {name: arm for name, arm in self.arms.items() if arm.answer is not None}

    @property
    def best(self) -> str | None:
        """The arm that predicts the smallest spread for itself, the first in a tie; None where none has an answer."""
        if not self.answered:
            return None
        sigmas = {name: arm.judged[name].sigma_max for name, arm in self.answered.items()}
        least = min(sigmas.values())
        return next(name for name, sigma in sigmas.items() if sigma <= least * (1 + _TIE))

    def to_json(self) -> dict[str, Json]:
        """The document ``comparison.json``: SI units and radians."""
        task = self.problem.task
        return {
            "name": self.problem.name,
            "task": None if task is None else task.kind,
            "arms": {name: arm.to_json() for name, arm in self.arms.items()},
            "best": self.best,
            "notes": list(self.notes),
        }


@interruptible()
def compare(
    problems: Mapping[str, ProblemData], *, seed: int | None = None, workers: int = 1,
    progress: Progress | None = None,
) -> ArmComparison:  # fmt: skip
    """The task of the first problem solved with every arm, and each answer judged by all arms with the same joints.

    An arm judges a posture by where it would itself land there: mean error from the target and spread about it.

    Args:
        problems: at least two, by name.
        progress: called with (done, all) arms.

    Raises:
        InputError: fewer than two problems, no task, or a task that an arm cannot be given.
        NoSolutionError: no arm can do the task; the message gives the reasons of each.
    """
    if len(problems) < 2:
        raise InputError(Issue("a comparison needs two problems", hint="name two problem files"))
    asked, notes = _same_task(problems)
    found: dict[str, Answer | tuple[str, ...]] = {}
    for done, (name, problem) in enumerate(asked.items()):
        if progress is not None:
            progress(done, len(asked))
        found[name] = _answer(problem, seed, workers)
    if all(isinstance(answer, tuple) for answer in found.values()):
        raise NoSolutionError("\n".join(f"{name}: {reason}" for name, why in found.items() for reason in _reasons(why)))
    return ArmComparison({name: _compared(name, asked, answer) for name, answer in found.items()}, notes)


def stations_of(answer: Answer) -> tuple[Solution, ...]:
    """The postures of an answer: one, one a feature, or one a listed point of a path."""
    return answer.stations


def _same_task(problems: Mapping[str, ProblemData]) -> tuple[dict[str, ProblemData], tuple[str, ...]]:
    """The problems with the task of the first, and which of them had another."""
    name, first = next(iter(problems.items()))
    if first.task is None:
        hint = f"add a task: section to {name}, name the file with the task first, or write --task and --position"
        raise InputError(Issue("there is no task to compare the arms by", ("task",), hint=hint))
    asked: dict[str, ProblemData] = {}
    notes = []
    for other, problem in problems.items():
        same = problem.task == first.task
        asked[other] = problem if same else problem.with_task_of(first)
        if not same:
            own = f"; the task stated in {other} is not used" if problem.task is not None else ""
            notes.append(f"The task of {name} is also given to {other}{own}.")
    return asked, tuple(notes)


def _answer(problem: ProblemData, seed: int | None, workers: int) -> Answer | tuple[str, ...]:
    """The answer of one arm, or the reasons why it has none."""
    try:
        return select_posture(problem, seed=seed, workers=workers)
    except (NoSolutionError, SolverError) as error:
        return tuple(str(error).splitlines())


def _reasons(answer: Answer | tuple[str, ...]) -> tuple[str, ...]:
    return answer if isinstance(answer, tuple) else ()


def _compared(name: str, problems: Mapping[str, ProblemData], answer: Answer | tuple[str, ...]) -> ComparedArm:
    problem = problems[name]
    if isinstance(answer, tuple):
        return ComparedArm(problem, None, {}, answer)
    stations = stations_of(answer)
    judged = {
        judge: JudgedPlan(tuple(predicted_error(other, station, station.basis, None) for station in stations))
        for judge, other in problems.items()
        if _same_joints(problem.robot, other.robot)
    }
    return ComparedArm(problem, answer, judged)


def _same_joints(one: Robot, other: Robot) -> bool:
    return [joint.type for joint in one.joints] == [joint.type for joint in other.joints]
