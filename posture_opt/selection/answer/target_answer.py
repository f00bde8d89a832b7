"""``TargetAnswer``: an answer at one station: the posture, its spread, and what else could be chosen."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np

from posture_opt.encoding import encoded
from posture_opt.numerics import Array, Json, finite_or_none
from posture_opt.result import Result
from posture_opt.robot.posture import Posture
from posture_opt.selection.answer.other_postures import (
    ManipulablePosture,
    configurations,
    end_moments,
    most_manipulable,
)
from posture_opt.selection.answer.prices import LowerBound, lower_bound
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.relaxation import Reason, Relaxation
from posture_opt.selection.search.search_outcome import SearchStatistics
from posture_opt.statements import Statement
from posture_opt.uncertainty.budget import Share
from posture_opt.uncertainty.clearance import Critical
from posture_opt.uncertainty.peg_spread import Orientation
from posture_opt.uncertainty.regions import Ellipsoid
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.spread import Spread, relative_spread
from posture_opt.uncertainty.task_spread import TaskSpread, sigma_along

Status = Literal["optimal", "feasible", "infeasible"]


@dataclass(frozen=True)
class Alternative:
    """A distinct posture that does the task too."""

    posture: Posture
    position: Array  # (3,) tool point, world [m]
    sigma_max: float  # [m]
    configuration: tuple[str, ...] = ()  # shoulder, elbow, wrist; empty for arms without

    def to_json(self) -> dict[str, Json]:
        named: dict[str, Json] = {"configuration": ", ".join(self.configuration)} if self.configuration else {}
        return {"posture": self.posture, "position": self.position.tolist(), "sigma_max": self.sigma_max, **named}


@dataclass(frozen=True, eq=False, repr=False)
class TargetAnswer(Result):
    """The answer at one target; of several stations those properties that are the worst one's."""

    problem: ProblemData
    optimisation_problem: OptimisationProblem
    target: TaskTarget
    status: Status
    q: Array
    statistics: SearchStatistics
    ended: Array
    notes: tuple[str | Statement, ...] = ()
    reasons: tuple[Reason, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()
    feasible: Array = field(default_factory=lambda: np.zeros((0, 0)))
    engine: Engine | None = None
    best_of_all: Alternative | None = None  # where an ordinary posture is the answer instead

    def beside(self, best: Self) -> Self:
        """This answer, of ordinary postures, with the best posture of all and what its search compared."""
        seen, searched = best.statistics, ("starts", "tried", "sampled")
        return replace(
            self, problem=best.problem, optimisation_problem=best.optimisation_problem, best_of_all=best.optima[0],
            statistics=replace(self.statistics, **{name: getattr(seen, name) for name in searched}),
            ended=np.vstack([self.q, best.ended]), feasible=np.vstack([self.q, best.feasible]),
        )  # fmt: skip

    @property
    def worst(self) -> TargetAnswer:
        """The answer at the station with the largest spread; itself where there is one target."""
        return self

    @cached_property
    def most_manipulable(self) -> ManipulablePosture | None:
        """The posture of greatest manipulability for the task, or None."""
        return most_manipulable(self.optimisation_problem, self.target, self.problem.solver, self.feasible)

    @property
    def posture(self) -> Posture:
        """Joint name -> value [rad or m] at the first station, printed in degrees."""
        return Posture(self.optimisation_problem.robot, self.q)

    @cached_property
    def spread(self) -> Spread:
        """The spread of the tool at the worst station, relative to the workpiece where that errs too."""
        worst = self.worst
        return worst.spread if worst is not self else relative_spread(self.problem, self.q, self.target.lever)

    @property
    def covariance(self) -> Array:
        """(3, 3) exact covariance of the tool point at the worst station, [m²]; relative to the workpiece."""
        return self.spread.covariance

    @property
    def ellipse(self) -> Ellipsoid:
        """Ellipse of a planar arm, else ellipsoid, of the tool point at the worst station."""
        return self.spread.ellipse

    @cached_property
    def ranked(self) -> Array:
        """(k, n) at most eight local optima, best first, one of each configuration before others."""
        named = configurations(self.problem.robot, self.ended)
        first = 1 if self.best_of_all is None else 2
        again = [k >= first and bool(name) and name in named[:k] for k, name in enumerate(named)]
        kept = sorted(range(len(self.ended)), key=again.__getitem__)[:8]  # a 6R wrist has eight branches (Pieper 1968)
        return np.asarray(self.ended[sorted(kept)])

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """The best local optimum of each configuration of the arm at the first station, best first, after the answer
        itself and the best posture of all.

        Every local optimum of an arm whose configurations have no names is one. A target that may be moved has one of
        each spread, too: a place that is only turned about the first axis is the same.
        """
        first = 1 if self.best_of_all is None else 2
        fixed = self.target.kind == "point"
        named = [(other.configuration, fixed or f"{other.sigma_max:.6g}") for other in self.optima]
        new = [k < first or not name[0] or name not in named[:k] for k, name in enumerate(named)]
        return tuple(other for other, kept in zip(self.optima, new, strict=True) if kept)

    @cached_property
    def optima(self) -> tuple[Alternative, ...]:
        """Distinct local optima of the first station, best first, spins of the tool and redundant ones included."""
        if not len(self.ranked):
            return ()
        moments = end_moments(self.optimisation_problem, self.ranked, self.basis, self.target.lever)
        robot = self.problem.robot
        named = configurations(robot, self.ranked)
        return tuple(
            Alternative(Posture(robot, q), x, float(s), name)
            for q, x, s, name in zip(self.ranked, moments.position, moments.sigma, named, strict=True)
        )

    @property
    def basis(self) -> Array:
        """(3, m) orthonormal basis of the part of the spread that counts, world, at the worst station."""
        return critical_basis(self.worst.optimisation_problem, self.worst.target)

    @cached_property
    def task_spread(self) -> TaskSpread:
        """The spread of the worst station as the task sees it: across, along, probability, peg and yaw."""
        return self._seen(self.spread) if self.worst is self else self.worst.task_spread

    def _seen(self, spread: Spread) -> TaskSpread:
        task, target = self.optimisation_problem.task, self.target
        critical = Critical.of(task.within, self.basis, spread.covariance, spread.bias)
        axes, along = np.vstack([target.basis.T, target.direction]), sigma_along(target.direction, spread.covariance)
        seen = TaskSpread(task.kind, axes, target.clearance, critical, along, spread.tool_point, spread.q)
        return seen.of_task(task, self.basis, spread.covariance)

    @property
    def critical(self) -> Critical:
        """The spread in the directions that count, at the worst station."""
        return self.task_spread.critical

    @property
    def sigma_max(self) -> float:
        """Largest standard deviation of the part that counts [m], ``sqrt(λ_max(Bᵀ C B))``, at the worst station.

        What answers are compared by, whatever the criterion that was minimised.
        """
        return self.critical.sigma_max

    @property
    def sigma_along(self) -> float:
        """Standard deviation along the task's direction [m]."""
        return self.task_spread.sigma_along

    @property
    def success_probability(self) -> float | None:
        """Probability to stay within the clearance at the worst station, bias included; None without a clearance."""
        return self.task_spread.success_probability

    @property
    def budget(self) -> tuple[Share, ...]:
        """Share of each source in the variance along the worst axis of the worst station, largest first."""
        return self.task_spread.budget

    @cached_property
    def orientation(self) -> Orientation:
        """How far the tool leans and turns by the errors, at the worst station."""
        spread, axis = self.spread, self.optimisation_problem.task.tool_axis
        return Orientation.of(spread.tool_point, spread.q, spread.pose_covariance[3:, 3:], axis)

    @cached_property
    def lower_bound(self) -> LowerBound | None:
        """A spread that no posture beats at the worst station's target, or None."""
        worst = self.worst
        return lower_bound(
            worst.optimisation_problem.tool_point.seen_from(worst.target.lever.tolist()), worst.target, self.basis
        )

    def sigma_under(self, sources: Sources) -> float:
        """σ_max [m] of the part that counts, in this posture under other ``sources`` of error, of the workpiece too."""
        if not np.any(sources.covariance):
            return 0.0
        spread = relative_spread(self.problem, self.q, self.target.lever, sources)
        return self._seen(spread).critical.sigma_max

    def sigma_at(self, target: TaskTarget, q: Array) -> float:
        """σ_max [m] of the part that counts, at another target in the posture (n,)."""
        return replace(self, target=target, q=q).critical.sigma_max

    def gain_over(self, sigma: float) -> float:
        """Relative reduction of σ_max against ``sigma`` [m], ``1 − σ_max/sigma``: 0.1 means 10 % smaller."""
        return 1.0 - self.sigma_max / sigma if sigma > 0 else 0.0

    @property
    def gain_of_best(self) -> float:
        """Relative reduction of σ_max by the best posture of all; zero where that is the answer."""
        return 0.0 if self.best_of_all is None else 1.0 - self.best_of_all.sigma_max / self.sigma_max

    def station_json(self, name: str) -> dict[str, Any]:
        """One of several features in ``solution.json``."""
        document = {"name": name, "status": self.status, **self.posture_json(), **self.spread_json()}
        kept = ("name", "status", "posture", "tool", "critical", "covariance", "success_probability")
        return {key: document[key] for key in kept}

    def posture_json(self) -> dict[str, Any]:
        """The posture, its tool pose, and what else could be chosen: the part of the first station in
        ``solution.json``.
        """
        return {
            "posture": self.posture,
            "tool": encoded(self.spread, "position quaternion_wxyz"),
            "alternatives": [alternative.to_json() for alternative in self.alternatives],
            "best_of_all": self.best_of_all and {**self.best_of_all.to_json(), "gain": self.gain_of_best},
            "most_manipulable": self.most_manipulable and self.most_manipulable.to_json(),
        }

    def spread_json(self) -> dict[str, Any]:
        """The spread of the tool point, its budget and comparisons: the worst station's part."""
        spread, statistics = self.spread, self.statistics
        return {
            **encoded(spread, "covariance covariance_first_order bias"),
            **encoded(spread, "method integration?"),
            **self.task_spread.to_json(),
            "budget": self.budget,
            "budget_groups": self.task_spread.budget_groups,
            "validity": spread.validity,
            "floor": self.lower_bound and encoded(self.lower_bound, "sigma_max=sigma source share"),
            "orientation": self.orientation.to_json(),
            "typical_sigma_max": finite_or_none(statistics.typical),
            "worst_sigma_max": finite_or_none(statistics.worst),
        }


def critical_basis(optimisation_problem: OptimisationProblem, target: TaskTarget) -> Array:
    """(3, m) orthonormal basis of the part of the spread that the task cares about."""
    within = optimisation_problem.task.within
    if within == "along":
        return target.direction[:, None]
    if within == "across":
        return target.basis[:, : optimisation_problem.across_rank]
    return optimisation_problem.reach.directions if optimisation_problem.flat else np.eye(3)
