"""``MeasuredGoals``: goals that were measured in several postures, and what each model would have chosen there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.cross_validation import HeldOut
from posture_opt.measurements.measurements import Measurements, arm_for, rows_of
from posture_opt.numerics import Json
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.task_target import Reach, TaskTarget
from posture_opt.uncertainty.clearance import central_radii
from posture_opt.uncertainty.tool_point import ToolPoint

Floats = np.ndarray
Postures = Sequence[np.ndarray]


@dataclass(frozen=True, eq=False)
class Choice:
    """One posture chosen for every goal, and what was measured there.

    Args:
        missed: (G,) distance from the goal in the chosen posture, in the part that the task cares about [m].
        elsewhere: (G,) its mean over the other postures of the goal [m].
    """

    missed: Floats
    elsewhere: Floats
    better: float

    @classmethod
    def of(cls, errors: Floats, preference: Floats, goals: Sequence[Postures]) -> Choice:
        """The posture of least ``preference`` (N,) of every goal, by the ``errors`` (N,) of all rows [m]."""
        missed, elsewhere, better = [], [], 0
        for postures in goals:
            sizes = np.array([errors[rows].mean() for rows in postures])
            chosen = int(np.argmin([preference[rows].mean() for rows in postures]))
            missed.append(sizes[chosen])
            elsewhere.append(np.delete(sizes, chosen).mean())
            better += bool(sizes[chosen] <= sizes.min())
        return cls(np.array(missed), np.array(elsewhere), better / len(goals))

    def hits(self, clearance: float) -> float:
        """Share of the goals that are met within a clearance [m]."""
        return float(np.mean(self.missed <= clearance))

    def to_json(self, clearance: float | None = None) -> dict[str, Json]:
        """Lengths [m]: median and what 95 % of the goals stay below; the share within the clearance."""
        return {
            "missed": _median_and_p95(self.missed), "missed_elsewhere": _median_and_p95(self.elsewhere),
            "better": self.better, "success": None if clearance is None else self.hits(clearance),
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class MeasuredGoals:
    """What the data say of the postures that models choose among those in which a goal was measured.

    Args:
        anyhow: (G,) mean over the postures of each goal of what that tool misses [m].
        clearance: of the task [m]; None without one.
    """

    goals: int
    postures: int
    within: str
    sent: Mapping[str, Choice]
    uncorrected: Mapping[str, Choice]
    anyhow: Floats
    chance: float
    clearance: float | None = None

    @property
    def margin(self) -> float:
        """How far the share of better choices strays by chance, 95 %."""
        return float(1.96 * np.sqrt(self.chance * (1 - self.chance) / self.goals))

    def to_json(self) -> dict[str, Json]:
        return {
            "goals": self.goals, "postures": self.postures, "within": self.within, "better_by_chance": self.chance,
            "sent": {name: choice.to_json(self.clearance) for name, choice in self.sent.items()},
            "uncorrected": {
                "any_posture": _median_and_p95(self.anyhow),
                **{name: choice.to_json(self.clearance) for name, choice in self.uncorrected.items()},
            },
        }  # fmt: skip


def measured_goals(
    data: Measurements, held: Mapping[str, HeldOut], models: Mapping[str, ProblemData]
) -> MeasuredGoals | None:
    """What each model would have chosen where a goal was measured in several postures; None without such goals."""
    goals = goals_in_postures(data)
    task = models["nominal"].task
    if not goals or task is None:
        return None
    B = _task_basis(models["nominal"])
    errors = {name: held[name].errors @ B for name in models}
    missed = {name: np.linalg.norm(e, axis=1) for name, e in errors.items()}
    sent = {name: Choice.of(missed[name], _predicted_radius(models, name, data, B), goals) for name in models}
    believed = {name: np.linalg.norm(errors["nominal"] - e, axis=1) for name, e in errors.items() if name != "nominal"}
    return MeasuredGoals(
        goals=len(goals),
        postures=sum(map(len, goals)),
        within=task.within,
        sent=sent,
        uncorrected={name: Choice.of(missed["nominal"], size, goals) for name, size in believed.items()},
        anyhow=np.array([np.mean([missed["nominal"][rows].mean() for rows in postures]) for postures in goals]),
        chance=float(np.mean([1 / len(postures) for postures in goals])),
        clearance=task.clearance if task.within == "across" else None,
    )


def goals_in_postures(data: Measurements) -> list[Postures]:
    """For every goal with two postures or more, the rows of each posture."""
    if data.position is None or not data.goal_given:
        return []
    payload = np.zeros(len(data)) if data.payload is None else data.payload
    where = np.unique(np.column_stack([data.goal, data.target, payload]), axis=0, return_inverse=True)[1].ravel()
    found = [[rows[mine] for mine in rows_of(data.pose[rows])] for rows in rows_of(where)]
    return [postures for postures in found if len(postures) > 1]


def _task_basis(problem: ProblemData) -> Floats:
    """(3, m) the part of an error that the task cares about, world; of an arm in a plane, in its plane."""
    assert problem.task is not None
    reach = Reach.of(problem.arm, problem.task.tool_axis)
    goal = TaskTarget.of(problem.task, reach)
    if problem.task.within == "along":
        return goal.direction[:, None]
    planar = reach.normals.shape[1] == 1
    if problem.task.within == "across":
        return goal.basis[:, :1] if planar else goal.basis
    return reach.directions if planar else np.eye(3)


def _predicted_radius(models: Mapping[str, ProblemData], name: str, data: Measurements, B: Floats) -> Floats:
    """(N,) distance that 95 of 100 repeats stay within, as a model predicts it for the posture of every row [m]."""
    stated = models[name].sources
    arm = arm_for(models[name].arm, data)
    tool_point = ToolPoint.of(arm, models["extended"].sources if stated.empty else stated)
    moments = tool_point.moments([np.ascontiguousarray(c) for c in data.q.T])
    C = np.broadcast_to(np.asarray(moments.covariance, dtype=float), (len(data), 3, 3))
    return central_radii(0.95, B.T @ C @ B)


def _median_and_p95(values: Floats) -> dict[str, float]:
    return {"median": float(np.median(values)), "p95": float(np.quantile(values, 0.95))}
