"""``Solution``: the best posture at one station or at several, what they share, and how sure one may be of it.

A single target is one station. Several features of a workpiece share its placement; the points of a path are joined by
steps of the joints besides.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast

import numpy as np

from posture_opt.collision.pairs import Clearance
from posture_opt.encoding import encoded
from posture_opt.numerics import Array, Json
from posture_opt.selection.answer.improvements import MIN_GAIN, Improvement, improvements
from posture_opt.selection.answer.placement import BenchMap, Placement, VisitingOrder, best_order, combined_sigma
from posture_opt.selection.answer.prices import Price, prices_of
from posture_opt.selection.answer.solution_statements import solution_statements
from posture_opt.selection.answer.target_answer import TargetAnswer
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import UNCONFIRMED_JSON, Confirmation, joined_confirmation
from posture_opt.selection.tasks import Task
from posture_opt.selection.tasks.workpiece import Combine
from posture_opt.statements import Statement
from posture_opt.uncertainty.sources import ANGLE, FEATURE, POSITION, stated_name
from posture_opt.uncertainty.success_of_all import JointSuccess, PlaceErrors, success_of_all

if TYPE_CHECKING:
    from posture_opt.selection.answer.path_answer import Motion, Naive, PathAnswer, PathBreak, TimeLaw
    from posture_opt.selection.answer.placement import PlacementFigure
    from posture_opt.selection.program.task_path import TaskPath


T = TypeVar("T")


def _of_path(read: Callable[[PathAnswer], T], text: str) -> T:
    """An attribute that answers along a path have; None of others."""
    of = property(lambda found: None if found.followed is None else read(found.followed), doc=f"{text}; of a path.")
    return cast(T, of)


def _of_placement(read: Callable[[Placement], T], text: str) -> T:
    """An attribute that answers with a workpiece have; None of others."""
    of = property(lambda found: None if found.placement is None else read(found.placement), doc=f"{text}; of a part.")
    return cast(T, of)


@dataclass(frozen=True, eq=False, repr=False)
class Solution(TargetAnswer):
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
        best_of_all: the posture with the smallest objective, where the answer is an ordinary one; else None.
        points: the answers at each of K stations, listed and added; empty where there is one target.
        names: of these.
        placement: of the workpiece that they share; None where the task names none.
        followed: of a path, how its points are joined.
    """

    points: tuple[Solution, ...] = ()
    names: tuple[str, ...] = ()
    placement: Placement | None = None
    followed: PathAnswer | None = None

    w: ClassVar[Array] = _of_placement(lambda p: p.w, "(4,) x, y, z [m] and yaw [rad], world")
    workpiece: ClassVar[dict[str, float]] = _of_placement(lambda p: p.workpiece, "x, y, z [m] and yaw [rad] by name")
    centre: ClassVar[PlacementFigure | None] = _of_placement(lambda p: p.at_centre, "Its range's middle, with σ [m]")
    typical: ClassVar[PlacementFigure | None] = _of_placement(lambda p: p.typical, "The median random one, with σ [m]")
    others: ClassVar[tuple[PlacementFigure, ...]] = _of_placement(lambda p: p.others, "Further optima, best first")
    path: ClassVar[TaskPath] = _of_path(lambda p: p.path, "Its K points, listed and added")
    motion: ClassVar[Motion] = _of_path(lambda p: p.motion, "The postures ``Q`` (K, n) [rad or m]")
    naive: ClassVar[Naive] = _of_path(lambda p: p.naive, "What simpler ways give")
    largest_step: ClassVar[float] = _of_path(lambda p: p.largest_step, "Allowed change of a joint [rad or m]")
    smallest_step: ClassVar[float] = _of_path(lambda p: p.smallest_step, "Least that this can be [rad or m]")
    bound: ClassVar[float] = _of_path(lambda p: p.bound, "σ_max [m] that no motion is below")
    off_line: ClassVar[float] = _of_path(lambda p: p.off_line, "Largest distance [m] from its lines")
    breaks: ClassVar[tuple[PathBreak, ...]] = _of_path(lambda p: p.breaks, "Where no motion leads along it")
    law: ClassVar[TimeLaw] = _of_path(lambda p: p.law, "Speed, and when the tool is where")
    closed: ClassVar[bool] = _of_path(lambda p: p.closed, "Whether it ends where it began")
    times: ClassVar[list[float] | None] = _of_path(lambda p: p.times, "(listed,) at each listed point [s]")
    largest_joint_step: ClassVar[float] = _of_path(
        lambda p: p.largest_joint_step, "Largest change of a joint [rad or m]"
    )
    candidates: ClassVar[tuple[int, ...]] = _of_path(lambda p: p.candidates, "(K,) postures compared at each point")

    @property
    def seconds(self) -> float:
        """How long the search took [s]."""
        return self.statistics.seconds

    @property
    def task(self) -> Task:
        """What is to be done."""
        assert self.problem.task is not None
        return self.problem.task

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
        return self.task.combine

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
    def bench(self) -> BenchMap | None:
        """The spread over the first two free coordinates of the placement; None where fewer are free."""
        return None if self.placement is None else self.placement.bench(self.postures)

    @cached_property
    def clearance(self) -> Clearance | None:
        """The least distance of the arm to what it is checked against, over all postures; None where nothing is
        checked.
        """
        return self.problem.scene.clearance(self.postures)

    @cached_property
    def prices(self) -> tuple[Price, ...]:
        """What one unit of each requirement that holds the answer back is worth, largest first."""
        if self.points and (
            self.followed is not None
            or self.combine != "worst"
            or (self.placement is not None and bool(self.placement.free.any()))
        ):
            return ()  # what holds one station is not what holds all of them together
        held = self.worst
        return (
            ()
            if held.engine is None
            else prices_of(held.engine, held.target, held.statistics.confirmation, held.problem.robot)
        )

    @property
    def confirmation(self) -> Confirmation | None:
        """What the solver of the problem says of the postures; None where it was not asked about all of them."""
        if self.followed is not None:
            return self.followed.motion.confirmation
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
        count = len(self.points)
        if count <= 100:  # neighbouring points of a longer path are alike
            return self.points or (self,)
        even = np.linspace(0, count - 1, 100).round().astype(int)
        return tuple(self.points[k] for k in np.union1d(even, self.worst_index).tolist())

    def fields_json(self) -> dict[str, Json]:
        """The document ``solution.json``: SI units, finite numbers only."""
        followed = self.followed
        return {
            "name": self.problem.name,
            "task": self.optimisation_problem.task.kind,
            "status": self.status,
            **self.first.posture_json(),
            "sigma_max": self.sigma_max,
            "worst_station": self.worst_station,
            **self.worst.spread_json(),
            "clearance": None if self.clearance is None else self.clearance.to_json(),
            **encoded(self.problem.scene, "mounting unchecked"),
            "beyond_measured": [found.to_json() for found in self.problem.arm.beyond_measured(self.postures)],
            "what_would_help": [change.to_json() for change in self.improvements],
            "solver": self.statistics.to_json(),
            "prices": [price.to_json() for price in self.prices],
            "reasons": [vars(reason) for reason in self.reasons],
            "relaxations": [relaxation.to_json() for relaxation in self.relaxations],
            "notes": list(dict.fromkeys(map(str, self.notes))),
            **({} if self.placement is None else {"workpiece": self.placement.workpiece}),
            **({} if self.problem.workpiece_sources.empty else {"workpiece_errors": self._workpiece_errors()}),
            **(followed.to_json(self.stations, self.confirmation_json, self.seconds) if followed else {}),
            **(self._features_json() if self.points and self.followed is None else {}),
        }

    @cached_property
    def mounting_note(self) -> str:
        """What a reader has to know of the surface that the arm stands on; empty where it is stated."""
        return self.problem.scene.mounting_note(self.postures)

    def _workpiece_errors(self) -> dict[str, Json]:
        """Standard deviations of workpiece [m, rad] and features [m], and the origin that the angle is about, world."""
        errors, worst = self.problem.workpiece_sources, self.worst
        sigma = dict(zip(map(stated_name, errors.names), map(float, errors.sigma), strict=True))
        stated = {"position": POSITION, "angle": ANGLE, "feature": FEATURE}
        origin = worst.spread.position - worst.target.lever
        return {**{key: sigma.get(name, 0.0) for key, name in stated.items()}, "origin": origin.tolist()}

    def _features_json(self) -> dict[str, Any]:
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

    def explain(self) -> str:
        """The optimisation problem as it was solved: variables, objective, rows, and their values here."""
        return str(self._presenter.explain())
