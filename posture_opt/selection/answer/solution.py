"""``Solution``: the best posture, its alternatives, its probability of success, and how sure one may be of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from posture_opt.collision.scene import Clearance
from posture_opt.numerics import Array, Json, finite_or_none
from posture_opt.result import Result
from posture_opt.robot.posture import Posture
from posture_opt.selection.answer.end_moments import end_moments
from posture_opt.selection.answer.improvements import Improvement, improvements
from posture_opt.selection.answer.lower_bound import LowerBound, lower_bound
from posture_opt.selection.answer.most_manipulable import ManipulablePosture, most_manipulable
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.relaxation import Reason, Relaxation
from posture_opt.selection.search.search_statistics import SearchStatistics
from posture_opt.uncertainty.regions.critical import Critical
from posture_opt.uncertainty.regions.regions import Ellipsoid
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.spread.budget import Share
from posture_opt.uncertainty.spread.orientation import Orientation
from posture_opt.uncertainty.spread.spread import Spread, budget_json, groups_json, propagate
from posture_opt.uncertainty.spread.task_spread import TaskSpread, sigma_along

Status = Literal["optimal", "feasible", "infeasible"]


@dataclass(frozen=True)
class Alternative:
    """A distinct posture (joint name -> rad or m), its tool point (3,) [m] and its σ_max [m]."""

    posture: Posture
    position: Array
    sigma_max: float

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI."""
        return {"posture": self.posture, "position": self.position.tolist(), "sigma_max": self.sigma_max}


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Result):
    """The answer to one problem; where it is infeasible, the nearest posture and the reasons.

    Args:
        problem: with ``robot``, ``sources``, ``task`` and ``name``.
        q: (n,) the posture [rad or m].
        reasons: why there is no solution; empty where there is one.
        relaxations: changes that would each make one possible, cheapest first.
        ranked: (k, n) distinct local optima, best first; the alternatives.
        feasible: (N, n) postures of the search that do the task, none where they are not kept.
        engine: the functions that found it; None where they are not kept.
    """

    problem: ProblemData
    optimisation_problem: OptimisationProblem
    target: TaskTarget
    status: Status
    q: Array
    statistics: SearchStatistics
    ranked: Array
    notes: tuple[str, ...] = ()
    reasons: tuple[Reason, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()
    feasible: Array = field(default_factory=lambda: np.zeros((0, 0)))
    engine: Engine | None = None

    @cached_property
    def most_manipulable(self) -> ManipulablePosture | None:
        """The posture of greatest manipulability that does the task too; None where nothing was found."""
        return most_manipulable(self.optimisation_problem, self.target, self.problem.solver, self.feasible)

    @property
    def posture(self) -> Posture:
        """Joint name -> value [rad or m], printed in degrees."""
        return Posture(self.optimisation_problem.robot, self.q)

    @cached_property
    def spread(self) -> Spread:
        """The spread of the tool at the posture."""
        return propagate(self.problem, self.q)

    @property
    def covariance(self) -> Array:
        """(3, 3) exact covariance of the tool point, world [m²]."""
        return self.spread.covariance

    @property
    def ellipse(self) -> Ellipsoid:
        """Ellipse of a planar arm, else ellipsoid, of the tool point."""
        return self.spread.ellipse

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """Distinct local optima, best first; the first is the answer itself."""
        return self._alternatives

    @cached_property
    def _alternatives(self) -> tuple[Alternative, ...]:
        if not len(self.ranked):
            return ()
        moments = end_moments(self.optimisation_problem, self.ranked, self.basis)
        robot = self.problem.robot
        return tuple(
            Alternative(Posture(robot, q), x, float(s))
            for q, x, s in zip(self.ranked, moments.position, moments.sigma, strict=True)
        )

    @property
    def basis(self) -> Array:
        """(3, m) basis of the part of the spread that counts."""
        return critical_basis(self.optimisation_problem, self.target)

    @cached_property
    def task_spread(self) -> TaskSpread:
        """The spread as the task sees it."""
        task, target, spread = self.optimisation_problem.task, self.target, self.spread
        critical = Critical.of(task.within, self.basis, spread.covariance, spread.bias)
        axes, along = np.vstack([target.basis.T, target.direction]), sigma_along(target.direction, spread.covariance)
        seen = TaskSpread(task.kind, axes, target.clearance, critical, along, spread.tool_point, spread.q)
        return seen.of_task(task, self.basis, spread.covariance)

    @property
    def critical(self) -> Critical:
        """The spread across the direction (or along it, or all of it, as the task says)."""
        return self.task_spread.critical

    @property
    def sigma_along(self) -> float:
        """Standard deviation along the task's direction [m]."""
        return self.task_spread.sigma_along

    @property
    def success_probability(self) -> float | None:
        """Probability to stay within the clearance, bias included; None without a clearance."""
        return self.task_spread.success_probability

    @property
    def budget(self) -> tuple[Share, ...]:
        """Share of each source in the variance along the worst axis, largest first."""
        return self.task_spread.budget

    @cached_property
    def orientation(self) -> Orientation:
        """How far the tool leans and turns."""
        return Orientation.of(self.spread, self.optimisation_problem.task.tool_axis)

    @cached_property
    def lower_bound(self) -> LowerBound | None:
        """A spread that no posture can beat at this target."""
        return lower_bound(self.optimisation_problem.tool_point, self.target, self.basis)

    @cached_property
    def clearance(self) -> Clearance | None:
        """The least distance of the arm to what it is checked against; None where nothing is."""
        found: Clearance | None = self.problem.scene.clearance(self.q)
        return found

    @cached_property
    def improvements(self) -> tuple[Improvement, ...]:
        """What would lower the spread: smaller errors, a calibration, the part elsewhere; most gain first."""
        return () if self.status == "infeasible" else improvements((self,), np.max, place=self)

    def sigma_under(self, sources: Sources) -> float:
        """σ_max [m] of the part that counts, in this posture under other errors."""
        if not np.any(sources.covariance):
            return 0.0
        return replace(self, problem=replace(self.problem, sources=sources)).critical.sigma_max

    def sigma_at(self, target: TaskTarget, q: Array) -> float:
        """σ_max [m] of the part that counts, at another target in the posture (n,)."""
        return replace(self, target=target, q=q).critical.sigma_max

    def gain_over(self, sigma: float) -> float:
        """Relative reduction of σ_max against ``sigma`` [m], ``1 − σ_max/sigma``: 0.1 means 10 % smaller."""
        return 1.0 - self.critical.sigma_max / sigma if sigma > 0 else 0.0

    def to_json(self) -> dict[str, Json]:
        """The document ``solution.json``: SI units, finite numbers only."""
        spread, statistics = self.spread, self.statistics
        return {
            "name": self.problem.name,
            "task": self.optimisation_problem.task.kind,
            "status": self.status,
            "posture": self.posture,
            "tool": {"position": spread.position.tolist(), "quaternion_wxyz": spread.quaternion_wxyz.tolist()},
            "covariance": spread.covariance.tolist(),
            "covariance_first_order": spread.covariance_first_order.tolist(),
            "bias": spread.bias.tolist(),
            **spread.method_json,
            **self.task_spread.to_json(),
            "budget": budget_json(self.budget),
            "budget_groups": groups_json(self.task_spread.budget_groups),
            "validity": spread.validity.to_json(),
            "clearance": None if self.clearance is None else self.clearance.to_json(),
            "alternatives": [alternative.to_json() for alternative in self.alternatives],
            "floor": self._lower_bound_json(),
            "orientation": self.orientation.to_json(),
            "most_manipulable": self.most_manipulable and self.most_manipulable.to_json(),
            "what_would_help": [change.to_json() for change in self.improvements],
            "typical_sigma_max": finite_or_none(statistics.typical),
            "worst_sigma_max": finite_or_none(statistics.worst),
            "solver": statistics.to_json(),
            "reasons": [vars(reason) for reason in self.reasons],
            "relaxations": [relaxation.to_json() for relaxation in self.relaxations],
            "notes": list(self.notes),
        }

    def _lower_bound_json(self) -> dict[str, Json] | None:
        if self.lower_bound is None:
            return None
        return {"sigma_max": self.lower_bound.sigma, "source": self.lower_bound.source, "share": self.lower_bound.share}

    def explain(self) -> str:
        """The optimisation problem as it was solved: variables, objective, rows, and their values here."""
        return str(self._presenter.explain())


def critical_basis(optimisation_problem: OptimisationProblem, target: TaskTarget) -> Array:
    """(3, m) orthonormal basis of the part of the spread that the task cares about."""
    within = optimisation_problem.task.within
    if within == "along":
        return target.direction[:, None]
    if within == "across":
        return target.basis[:, : optimisation_problem.across_rank]
    return optimisation_problem.reach.directions if optimisation_problem.flat else np.eye(3)
