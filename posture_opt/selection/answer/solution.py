"""``Solution``: the best posture at one station or at several, what they share, and how sure one may be of it.

A single target is one station. Several features of a workpiece share its placement; the points of a path are joined by
steps of the joints besides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Literal, Protocol

import numpy as np

from posture_opt.collision.nearest import Clearance
from posture_opt.numerics import Array, Json, Mask, finite_or_none
from posture_opt.result import Result
from posture_opt.robot.posture import Posture
from posture_opt.selection.answer.combine import combined_sigma
from posture_opt.selection.answer.configurations import configurations
from posture_opt.selection.answer.end_moments import end_moments
from posture_opt.selection.answer.improvements import MIN_GAIN, Improvement, improvements
from posture_opt.selection.answer.lower_bound import LowerBound, lower_bound
from posture_opt.selection.answer.most_manipulable import ManipulablePosture, most_manipulable
from posture_opt.selection.answer.prices import Price, prices_of
from posture_opt.selection.answer.shared_placement import Placement
from posture_opt.selection.answer.solution_statements import solution_statements
from posture_opt.selection.answer.visiting_order import VisitingOrder, best_order
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.confirmation import UNCONFIRMED_JSON, Confirmation, joined_confirmation
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.relaxation import Reason, Relaxation
from posture_opt.selection.search.search_statistics import SearchStatistics
from posture_opt.selection.tasks.workpiece import Combine
from posture_opt.statements import Statement
from posture_opt.uncertainty.regions.critical import Critical
from posture_opt.uncertainty.regions.regions import Ellipsoid
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.sources.workpiece import ANGLE, FEATURE, POSITION, stated_name
from posture_opt.uncertainty.spread.budget import Share
from posture_opt.uncertainty.spread.orientation import Orientation
from posture_opt.uncertainty.spread.spread import Spread, budget_json, groups_json, relative_spread
from posture_opt.uncertainty.spread.success_of_all import JointSuccess, PlaceErrors, success_of_all
from posture_opt.uncertainty.spread.task_spread import TaskSpread, sigma_along

_MAX_ALTERNATIVES = 8  # a 6R wrist has that many branches (Pieper 1968)
_MAX_COMPARED_STATIONS = 100  # neighbouring points of a longer path are alike
Status = Literal["optimal", "feasible", "infeasible"]


@dataclass(frozen=True)
class Alternative:
    """A distinct posture that does the task too.

    Args:
        posture: joint name -> rad or m.
        position: (3,) its tool point, world [m].
        sigma_max: of the part that counts [m].
        configuration: names of shoulder, elbow and wrist; empty for arms that have none.
    """

    posture: Posture
    position: Array
    sigma_max: float
    configuration: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI."""
        named: dict[str, Json] = {"configuration": ", ".join(self.configuration)} if self.configuration else {}
        return {"posture": self.posture, "position": self.position.tolist(), "sigma_max": self.sigma_max, **named}


class FollowedPath(Protocol):
    """What an answer along a path has in addition to its stations: the motion that joins them."""

    @property
    def listed(self) -> Mask:
        """(K,) whether the point is one of the task's own."""

    def to_json(self, found: Solution) -> dict[str, Json]:
        """What ``solution.json`` says of the path: plain data."""


def _part(part: str, name: str, text: str) -> Any:
    """What only some answers have: an attribute of their part; None where an answer has no such part."""
    of = {"placement": " – of the placement of a workpiece, else None", "followed": " – of a path, else None"}
    return property(lambda found: getattr(getattr(found, part), name, None), doc=f"{text}{of.get(part, '')}.")


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Result):
    """The answer to one problem; where it is infeasible, the nearest posture and the reasons.

    Of several stations ``q``, ``posture`` and ``alternatives`` are those of the first; ``sigma_max``, ``spread``,
    ``covariance``, ``critical``, ``success_probability`` and ``budget`` those of the worst, which ``worst_station``
    names. ``stations[k]`` is the answer at one of them alone.

    Args:
        problem: with ``robot``, ``sources``, ``task`` and ``name``.
        q: (n,) the posture [rad or m], at the first station.
        reasons: why there is no solution; empty where there is one.
        relaxations: changes that would each make one possible, cheapest first.
        ended: (k, n) distinct local optima of the search, best first.
        feasible: (N, n) postures of the search that do the task, none where they are not kept.
        engine: the functions that found it; None where they are not kept.
        points: the answers at each of K stations, listed and added; empty where there is one target.
        names: of these.
        placement: of the workpiece that they share; None where the task names none.
        followed: of a path, how its points are joined.
    """

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
    points: tuple[Solution, ...] = ()
    names: tuple[str, ...] = ()
    placement: Placement | None = None
    followed: FollowedPath | None = None

    w: ClassVar[Any] = _part("placement", "w", "(4,) x, y, z [m] and yaw [rad], world")
    workpiece: ClassVar[Any] = _part("placement", "workpiece", "x, y, z [m] and yaw [rad] by name")
    placed: ClassVar[Any] = _part("placement", "stations", "The problem data of its stations")
    centre: ClassVar[Any] = _part("placement", "at_centre", "Its range's middle, with σ [m]")
    typical: ClassVar[Any] = _part("placement", "typical", "The median random one, with σ [m]")
    others: ClassVar[Any] = _part("placement", "others", "Further optima, best first")
    path: ClassVar[Any] = _part("followed", "path", "Its K points, listed and added")
    motion: ClassVar[Any] = _part("followed", "motion", "The postures ``Q`` (K, n) [rad or m]")
    naive: ClassVar[Any] = _part("followed", "naive", "What simpler ways give")
    largest_step: ClassVar[Any] = _part("followed", "largest_step", "Allowed change of a joint [rad or m]")
    smallest_step: ClassVar[Any] = _part("followed", "smallest_step", "Least that this can be [rad or m]")
    bound: ClassVar[Any] = _part("followed", "bound", "σ_max [m] that no motion is below")
    off_line: ClassVar[Any] = _part("followed", "off_line", "Largest distance [m] from its lines")
    breaks: ClassVar[Any] = _part("followed", "breaks", "Where no motion leads along it")
    law: ClassVar[Any] = _part("followed", "law", "Speed, and when the tool is where")
    closed: ClassVar[Any] = _part("followed", "closed", "Whether it ends where it began")
    times: ClassVar[Any] = _part("followed", "times", "(listed,) at each listed point [s]")
    largest_joint_step: ClassVar[Any] = _part("followed", "largest_joint_step", "Largest change of a joint [rad or m]")
    candidates: ClassVar[Any] = _part("followed", "candidates", "(K,) postures compared at each point")
    seconds: ClassVar[Any] = _part("statistics", "seconds", "How long the search took [s]")
    task: ClassVar[Any] = _part("problem", "task", "What is to be done")

    @property
    def stations(self) -> tuple[Solution, ...]:
        """The answer at each feature or listed point; at the one target, itself."""
        every = self.points or (self,)
        listed = (True,) * len(every) if self.followed is None else self.followed.listed
        return tuple(point for point, asked in zip(every, listed, strict=True) if asked)

    @property
    def along_path(self) -> bool:
        """Whether the stations are the points of a path."""
        return self.followed is not None

    @property
    def of_features(self) -> bool:
        """Whether the stations are features that share a placement."""
        return bool(self.points) and not self.along_path

    @property
    def central(self) -> float:
        """Standard deviation [m] with the workpiece in the middle of its ranges; NaN where that is not known."""
        return math.nan if self.placement is None else self.placement.central

    @property
    def first(self) -> Solution:
        """The answer at the first feature or listed point: the posture in which a program begins."""
        return self.stations[0]

    @property
    def targets(self) -> tuple[TaskTarget, ...]:
        """The targets of all stations, listed and added, at the placement of the answer."""
        return tuple(point.target for point in self.points or (self,))

    @cached_property
    def postures(self) -> Array:
        """(K, n) at all stations, listed and added [rad or m]."""
        return np.array([point.q for point in self.points or (self,)])

    @cached_property
    def sigmas(self) -> Array:
        """(K,) largest standard deviation of the part that counts, at each station [m]."""
        return np.array([point.critical.sigma_max for point in self.points or (self,)])

    @property
    def worst_index(self) -> int:
        """Number of the station with the largest spread among ``points``, from zero."""
        return int(np.argmax(self.sigmas)) if self.points else 0

    @property
    def worst(self) -> Solution:
        """The answer at the station with the largest spread; itself where there is one target."""
        return self.points[self.worst_index] if self.points else self

    @property
    def worst_station(self) -> str | None:
        """Name of the feature or point with the largest spread; None where there is one target."""
        return self.names[self.worst_index] if self.points else None

    @property
    def combine(self) -> Combine:
        """What is made of the stations' standard deviations: the worst, their mean, or the probability that all
        succeed.
        """
        return "worst" if self.problem.task is None else self.problem.task.combine

    @property
    def sigma(self) -> float:
        """Standard deviation [m] of the worst station; the mean of all where the task asks for that."""
        return float(combined_sigma(self.combine, self.sigmas))

    @cached_property
    def success(self) -> JointSuccess | None:
        """The probability that all features succeed; None without a clearance, and for a peg whose length counts.

        Of a peg, tip and top are one draw of the scatter at each feature, which this does not join with what stays.
        """
        if self.followed is not None or any(
            point.success_probability is None or point.task_spread.peg is not None for point in self.stations
        ):
            return None
        return success_of_all(
            [PlaceErrors.of(point.spread, point.basis, point.target.clearance) for point in self.stations]
        )

    @cached_property
    def order(self) -> VisitingOrder:
        """In which order to visit the stations, so that the joints travel least."""
        return best_order(self.optimisation_problem.robot, self.postures)

    @cached_property
    def bench(self) -> Any:
        """The spread over the first two free coordinates of the placement; None where fewer are free."""
        return None if self.placement is None else self.placement.bench(self.postures)

    @cached_property
    def most_manipulable(self) -> ManipulablePosture | None:
        """The posture of greatest manipulability that does the task too; None where nothing was found."""
        return most_manipulable(self.optimisation_problem, self.target, self.problem.solver, self.feasible)

    @property
    def posture(self) -> Posture:
        """Joint name -> value [rad or m] at the first station, printed in degrees."""
        return Posture(self.optimisation_problem.robot, self.q)

    @cached_property
    def spread(self) -> Spread:
        """The spread of the tool at the worst station, relative to the workpiece where that errs too."""
        return self.worst.spread if self.points else relative_spread(self.problem, self.q, self.target.lever)

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
        """(k, n) at most eight of the local optima, best first: those of each configuration, then others."""
        named = configurations(self.problem.robot, self.ended)
        again = [bool(name) and name in named[:k] for k, name in enumerate(named)]
        kept = sorted(range(len(self.ended)), key=again.__getitem__)[:_MAX_ALTERNATIVES]
        return np.asarray(self.ended[sorted(kept)])

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """The best local optimum of each configuration of the arm at the first station, best first; the first is the
        answer itself.

        Every local optimum of an arm whose configurations have no names is one, and of a target that may be moved.
        """
        named = [other.configuration * (self.target.kind == "point") for other in self.optima]
        return tuple(other for k, other in enumerate(self.optima) if not named[k] or named[k] not in named[:k])

    @cached_property
    def optima(self) -> tuple[Alternative, ...]:
        """Distinct local optima of the first station, best first, those that differ by the spin of the tool or by what
        a redundant arm has over among them.
        """
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
        if self.points:
            return self.worst.task_spread
        return self._seen(self.spread)

    def _seen(self, spread: Spread) -> TaskSpread:
        """A spread in the posture of the answer as the task sees it."""
        task, target = self.optimisation_problem.task, self.target
        critical = Critical.of(task.within, self.basis, spread.covariance, spread.bias)
        axes, along = np.vstack([target.basis.T, target.direction]), sigma_along(target.direction, spread.covariance)
        seen = TaskSpread(task.kind, axes, target.clearance, critical, along, spread.tool_point, spread.q)
        return seen.of_task(task, self.basis, spread.covariance)

    @property
    def critical(self) -> Critical:
        """The spread across the direction (or along it, or all of it, as the task says) at the worst station."""
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
        return Orientation.of(self.spread, self.optimisation_problem.task.tool_axis)

    @cached_property
    def lower_bound(self) -> LowerBound | None:
        """A spread that no posture can beat at the target of the worst station; None where there is no such bound."""
        worst = self.worst
        return lower_bound(
            worst.optimisation_problem.tool_point.seen_from(worst.target.lever.tolist()), worst.target, self.basis
        )

    @cached_property
    def clearance(self) -> Clearance | None:
        """The least distance of the arm to what it is checked against, over all postures; None where nothing is
        checked.
        """
        found: Clearance | None = self.problem.scene.clearance(self.postures)
        return found

    @cached_property
    def prices(self) -> tuple[Price, ...]:
        """What one unit of each requirement that holds the answer back is worth, largest first."""
        if self.points and (self.followed is not None or self.combine != "worst" or self._placement_is_free):
            return ()  # what holds one station is not what holds all of them together
        held = self.worst
        return () if held.engine is None else prices_of(held.engine, held.target, held.statistics.confirmation)

    @property
    def _placement_is_free(self) -> bool:
        """Whether the workpiece could stand elsewhere."""
        return self.placement is not None and bool(self.placement.free.any())

    @property
    def confirmation(self) -> Confirmation | None:
        """What the solver of the problem says of the postures; None where it was not asked about all of them."""
        if self.followed is not None:
            said: Confirmation | None = self.motion.confirmation
            return said
        return joined_confirmation([point.statistics.confirmation for point in self.points or (self,)])

    @property
    def confirmation_json(self) -> dict[str, Json]:
        """The same in the part ``solver`` of ``solution.json``."""
        return UNCONFIRMED_JSON if self.confirmation is None else self.confirmation.to_json()

    @cached_property
    def improvements(self) -> tuple[Improvement, ...]:
        """What would lower the spread: smaller errors, a calibration, the one target elsewhere; most gain first."""
        if self.status == "infeasible":
            return ()
        combined = partial(combined_sigma, self.combine)
        return improvements(self._compared(), combined, place=None if self.points else self)

    @property
    def helpful(self) -> tuple[Improvement, ...]:
        """The improvements that are worth a word."""
        return tuple(change for change in self.improvements if change.gain >= MIN_GAIN)

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """What the answer has to say, the posture first."""
        return solution_statements(self)

    def _compared(self) -> tuple[Solution, ...]:
        """The stations that changes are compared at: all, or of a long path some, evenly, and the worst one."""
        count = len(self.points)
        if count <= _MAX_COMPARED_STATIONS:
            return self.points or (self,)
        even = np.linspace(0, count - 1, _MAX_COMPARED_STATIONS).round().astype(int)
        return tuple(self.points[k] for k in np.union1d(even, self.worst_index).tolist())

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

    def fields_json(self) -> dict[str, Json]:
        """The document ``solution.json``: SI units, finite numbers only."""
        return {
            "name": self.problem.name,
            "task": self.optimisation_problem.task.kind,
            "status": self.status,
            **self.first.posture_json(),
            "sigma_max": self.sigma_max,
            "worst_station": self.worst_station,
            **self.worst.spread_json(),
            "clearance": None if self.clearance is None else self.clearance.to_json(),
            **self._mounting_json(),
            "beyond_measured": [found.to_json() for found in self.problem.arm.beyond_measured(self.postures)],
            "what_would_help": [change.to_json() for change in self.improvements],
            "solver": self.statistics.to_json(),
            "prices": [price.to_json() for price in self.prices],
            "reasons": [vars(reason) for reason in self.reasons],
            "relaxations": [relaxation.to_json() for relaxation in self.relaxations],
            "notes": list(dict.fromkeys(map(str, self.notes))),
            **({} if self.placement is None else {"workpiece": self.placement.workpiece}),
            **({} if self.problem.workpiece_sources.empty else {"workpiece_errors": self._workpiece_errors()}),
            **({} if self.followed is None else self.followed.to_json(self)),
            **(self._features_json() if self.points and self.followed is None else {}),
        }

    @cached_property
    def mounting_note(self) -> str:
        """What a reader has to know of the surface that the arm stands on; empty where it is stated."""
        return self.problem.scene.mounting_note(self.postures)

    def _mounting_json(self) -> dict[str, Any]:
        """What the arm stands on, and the links that nothing is known of."""
        scene = self.problem.scene
        mounting = None if scene.mounting is None else scene.mounting.to_json()
        return {"mounting": mounting, "unchecked": list(scene.unchecked)}

    def _workpiece_errors(self) -> dict[str, Json]:
        """Standard deviations of workpiece [m, rad] and features [m], and the origin that the angle is about, world."""
        errors, worst = self.problem.workpiece_sources, self.worst
        sigma = dict(zip(map(stated_name, errors.names), map(float, errors.sigma), strict=True))
        stated = {"position": POSITION, "angle": ANGLE, "feature": FEATURE}
        origin = worst.spread.position - worst.target.lever
        return {**{key: sigma.get(name, 0.0) for key, name in stated.items()}, "origin": origin.tolist()}

    def _features_json(self) -> dict[str, Any]:
        """What holds for all features: each of them, the worst, all together, the order of visits, other placements."""
        success = self.success if self.status != "infeasible" else None
        return {
            "combine": self.combine,
            "features": [point.station_json(name) for name, point in zip(self.names, self.points, strict=True)],
            "worst_feature": {"name": self.worst_station, "sigma_max": self.sigma_max},
            "success_all": None if success is None else success.probability,
            "success_all_standard_error": None if success is None else success.standard_error,
            "success_product": None if success is None else success.product,
            "visiting_order": {
                "order": [self.names[k] for k in self.order.order],
                "joint_travel": self.order.travel,
                "as_listed": self.order.as_listed,
            },
            "placements": None if self.placement is None else self.placement.to_json(),
            "solver": {
                **self.statistics.to_json(),
                **(self.placement.search_json if self.placement is not None else {}),
                **self.confirmation_json,
            },
        }

    def station_json(self, name: str) -> dict[str, Any]:
        """What the document of several features says of one of them: plain data."""
        document = {"name": name, "status": self.status, **self.posture_json(), **self.spread_json()}
        kept = ("name", "status", "posture", "tool", "critical", "covariance", "success_probability")
        return {key: document[key] for key in kept}

    def posture_json(self) -> dict[str, Any]:
        """The posture, its tool pose, and what else could be chosen: the part of the first station in
        ``solution.json``.
        """
        spread = self.spread
        return {
            "posture": self.posture,
            "tool": {"position": spread.position.tolist(), "quaternion_wxyz": spread.quaternion_wxyz.tolist()},
            "alternatives": [alternative.to_json() for alternative in self.alternatives],
            "most_manipulable": self.most_manipulable and self.most_manipulable.to_json(),
        }

    def spread_json(self) -> dict[str, Any]:
        """The spread of the tool point, what it is made of and what it is compared with: the part of the worst
        station.
        """
        spread, statistics = self.spread, self.statistics
        return {
            "covariance": spread.covariance.tolist(),
            "covariance_first_order": spread.covariance_first_order.tolist(),
            "bias": spread.bias.tolist(),
            **spread.method_json,
            **self.task_spread.to_json(),
            "budget": budget_json(self.budget),
            "budget_groups": groups_json(self.task_spread.budget_groups),
            "validity": spread.validity.to_json(),
            "floor": self._lower_bound_json(),
            "orientation": self.orientation.to_json(),
            "typical_sigma_max": finite_or_none(statistics.typical),
            "worst_sigma_max": finite_or_none(statistics.worst),
        }

    def _lower_bound_json(self) -> dict[str, Json] | None:
        """The bound with the source that sets it; null where there is none."""
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
