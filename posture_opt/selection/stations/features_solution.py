"""``FeaturesSolution``: where the workpiece goes, a posture for each of its features, and what another place costs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.collision.scene import Clearance
from posture_opt.numerics import Array, Json, finite_or_none
from posture_opt.result import Result
from posture_opt.robot.posture import Posture
from posture_opt.selection.answer.improvements import Improvement, improvements
from posture_opt.selection.answer.solution import Alternative, Solution, Status
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.search.relaxation import Reason, Relaxation
from posture_opt.selection.stations.bench_map import BenchMap, bench_map
from posture_opt.selection.stations.placed_stations import PlacedStations
from posture_opt.selection.stations.placement import PlacementRange, placement_json
from posture_opt.selection.stations.visiting_order import VisitingOrder, best_order
from posture_opt.selection.tasks import Task
from posture_opt.uncertainty.regions.critical import Critical
from posture_opt.uncertainty.regions.regions import Ellipsoid
from posture_opt.uncertainty.spread.budget import Share
from posture_opt.uncertainty.spread.joint_success import JointSuccess, PlaceErrors, success_of_all
from posture_opt.uncertainty.spread.spread import Spread

_TIE = 1e-4  # of a standard deviation: features that differ by less are as bad


@dataclass(frozen=True)
class PlacementFigure:
    """A placement (4,) [m, rad] and the standard deviation there [m]: of the worst feature, or the mean of all.

    ``success`` is the probability that all features succeed, where that is what counts.
    """

    w: Array
    sigma: float
    success: float | None = None

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI; no spread where a feature cannot be done."""
        figures = {"sigma": finite_or_none(self.sigma), "success_all": self.success}
        return {"workpiece": placement_json(self.w), **figures}


@dataclass(frozen=True)
class PlacementStatistics:
    """How the placement was searched for.

    Args:
        placements: that were looked at; ``feasible`` of them have a posture for every feature.
        starts: random postures that were led to features.
        solves: of the joint problem.
        batches: independent ones; ``recurred`` of them found the best optimum.
        seconds: wall time.
    """

    placements: int
    feasible: int
    starts: int
    solves: int
    batches: int
    recurred: int
    seconds: float


@dataclass(frozen=True, eq=False, repr=False)
class FeaturesSolution(Result):
    """The answer for several features on one workpiece; where it is infeasible, what comes nearest and why.

    What is asked of one posture, ``posture`` or ``covariance``, is that of the first feature of the file.

    Args:
        problem: with the task as it was stated.
        placed: the features and where the workpiece may stand.
        w: (4,) x, y, z [m] and yaw [rad] of the workpiece.
        stations: a solution for each feature, in the order of the file; where there is none, of features that fail.
        names: of these features.
        centre, typical: the middle of the range, and the median of random placements at which every feature can be
            done; None where the placement is fixed or there is none.
        others: further optima, best first.
        reasons: why there is no solution; relaxations: changes that would each make one possible, cheapest first.
    """

    problem: ProblemData
    task: Task
    placed: PlacedStations
    status: Status
    w: Array
    stations: tuple[Solution, ...]
    statistics: PlacementStatistics
    names: tuple[str, ...]
    centre: PlacementFigure | None = None
    typical: PlacementFigure | None = None
    others: tuple[PlacementFigure, ...] = ()
    notes: tuple[str, ...] = ()
    reasons: tuple[Reason, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()

    @property
    def placement(self) -> PlacementRange:
        """Where the workpiece may stand."""
        return self.placed.placement

    @property
    def workpiece(self) -> dict[str, float]:
        """x, y, z [m] and yaw [rad] of the workpiece, by name."""
        return placement_json(self.w)

    @property
    def first(self) -> Solution:
        """The solution of the first feature of the file."""
        return self.stations[0]

    @property
    def optimisation_problem(self) -> OptimisationProblem:
        """Of the first feature."""
        return self.first.optimisation_problem

    @property
    def q(self) -> Array:
        """(n,) the posture of the first feature [rad or m]."""
        return self.first.q

    @property
    def posture(self) -> Posture:
        """Joint name -> value [rad or m], printed in degrees, of the first feature."""
        return self.first.posture

    @property
    def spread(self) -> Spread:
        """Of the tool at the first feature."""
        return self.first.spread

    @property
    def covariance(self) -> Array:
        """(3, 3) of the tool point at the first feature, world [m²]."""
        return self.first.covariance

    @property
    def ellipse(self) -> Ellipsoid:
        """Of the tool point at the first feature."""
        return self.first.ellipse

    @property
    def critical(self) -> Critical:
        """Of the first feature."""
        return self.first.critical

    @property
    def budget(self) -> tuple[Share, ...]:
        """Of the first feature."""
        return self.first.budget

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """Other postures for the first feature, the workpiece where it is."""
        return self.first.alternatives

    @cached_property
    def postures(self) -> Array:
        """(K, n) of all features [rad or m]."""
        return np.array([station.q for station in self.stations])

    @cached_property
    def sigmas(self) -> Array:
        """(K,) largest standard deviation of the part that counts, of each feature [m]."""
        return np.array([station.critical.sigma_max for station in self.stations])

    @property
    def worst(self) -> int:
        """Index of the feature with the largest spread, the first one in a tie."""
        return int(np.argmax(self.sigmas >= (1 - _TIE) * self.sigmas.max()))

    @property
    def sigma(self) -> float:
        """Standard deviation [m] of the worst feature; the mean of all where the task asks for that."""
        return float(self.sigmas.mean() if self.task.combine == "mean" else self.sigmas.max())

    @cached_property
    def success(self) -> JointSuccess | None:
        """The probability that all features succeed; None without a clearance, and for a peg whose length counts.

        Of a peg, tip and top are one draw of the scatter at each feature, which this does not join with what stays.
        """
        if any(s.success_probability is None or s.task_spread.peg is not None for s in self.stations):
            return None
        return success_of_all(
            [PlaceErrors.of(station.spread, station.basis, station.target.clearance) for station in self.stations]
        )

    @cached_property
    def order(self) -> VisitingOrder:
        """In which order to visit the features."""
        return best_order(self.optimisation_problem.robot, self.postures)

    @cached_property
    def clearance(self) -> Clearance | None:
        """The least distance of the arm to what it is checked against, over all postures; None where nothing is."""
        found: Clearance | None = self.problem.scene.clearance(self.postures)
        return found

    @cached_property
    def improvements(self) -> tuple[Improvement, ...]:
        """What would lower the spread, where the workpiece stands: smaller errors, a calibration; most gain first."""
        combined = np.mean if self.task.combine == "mean" else np.max
        return () if self.status == "infeasible" else improvements(self.stations, combined)

    @cached_property
    def bench(self) -> BenchMap | None:
        """The spread over the first two free coordinates of the placement; None where fewer are free."""
        return bench_map(self.placed, self.w, self.postures)

    def to_json(self) -> dict[str, Json]:
        """The document ``solution.json``: that of the first feature, and what holds for all."""
        success = self.success if self.status != "infeasible" else None
        return {
            **self.first.to_json(),
            "name": self.problem.name,
            "status": self.status,
            "combine": self.task.combine,
            "workpiece": self.workpiece,
            "features": [_feature_json(name, station) for name, station in zip(self.names, self.stations, strict=True)],
            "worst_feature": {"name": self.names[self.worst], "sigma_max": float(self.sigmas[self.worst])},
            "success_all": None if success is None else success.probability,
            "success_all_standard_error": None if success is None else success.standard_error,
            "success_product": None if success is None else success.product,
            "clearance": None if self.clearance is None else self.clearance.to_json(),
            "what_would_help": [change.to_json() for change in self.improvements],
            "visiting_order": {
                "order": [self.names[k] for k in self.order.order],
                "joint_travel": self.order.travel,
                "as_listed": self.order.as_listed,
            },
            "placements": {
                "centre": None if self.centre is None else self.centre.to_json(),
                "typical": None if self.typical is None else self.typical.to_json(),
                "others": [other.to_json() for other in self.others],
            },
            "solver": {**self.first.statistics.to_json(), **vars(self.statistics)},
            "reasons": [vars(reason) for reason in self.reasons],
            "relaxations": [relaxation.to_json() for relaxation in self.relaxations],
            "notes": list(self.notes),
        }

    def explain(self) -> str:
        """The optimisation problem of the first feature, with its values where the workpiece is."""
        return self.first.explain()


def _feature_json(name: str, station: Solution) -> dict[str, Json]:
    document = station.to_json()
    kept = ("status", "posture", "tool", "critical", "covariance", "success_probability")
    return {"name": name, **{key: document[key] for key in kept}}
