"""``select_for_features``: the placement of a workpiece and a posture for each of its features.

Placements are screened with the features taken one by one; the best go into one program of placement and all postures.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.numerics import Array, Progress
from posture_opt.selection.answer.fallbacks import with_fallbacks
from posture_opt.selection.answer.placement import PlacementRange
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.shared_placement import PlacementFigure, PlacementStatistics
from posture_opt.selection.answer.solution import Solution, Status, critical_basis
from posture_opt.selection.answer.visiting_order import best_order, nearest_ties, nearest_turns
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.selection.stations.bench_map import PlacementOnBench, placement_sigma
from posture_opt.selection.stations.confirmed_features import confirmed_features
from posture_opt.selection.stations.features_failure import FeaturesFailure, joined_features
from posture_opt.selection.stations.placed_stations import PlacedStations, Postures
from posture_opt.selection.stations.placement_search import (
    PlacementOptimum,
    PlacementSearch,
    failing,
    search_placement,
)
from posture_opt.selection.stations.postures_together import postures_together
from posture_opt.selection.tasks import Task
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.spread.spread import relative_spread
from posture_opt.uncertainty.spread.success_of_all import PlaceErrors, success_of_all

_EXPLAINED_FEATURES = 3  # features that fail, for which the reason is looked into
_MAX_OTHER_OPTIMA = 5
_PROBED = 8  # placements that show whether the arm comes near to itself
_STARTS_PER_PROBE = 8  # random postures of a feature there
_SIGMA_TOLERANCE = 1e-4  # of a standard deviation: features that differ by less are the same


def select_for_features(
    problem: ProblemData, *, seed: int | None = None, workers: int = 1, progress: Progress | None = None
) -> Solution:
    """The placement and the postures whose spread hurts the task least.

    ``min over w, q_1 … q_K`` of the largest or the mean standard deviation of the features, or of the probability that
    one is missed; subject to the range of the placement and to all that holds for one posture.

    Raises:
        NoSolutionError: no placement at which every feature can be done; carries the one that fails least.
        InputError: as `select_posture`.
    """
    return with_fallbacks(problem, lambda one: _FeaturesSelection.of(one, seed).answer(workers, progress))


@dataclass(frozen=True, eq=False)
class _FeaturesSelection:
    """The selection for one task with features.

    Args:
        placement: where the workpiece may stand.
        seed: of the random placements and postures.
    """

    problem: ProblemData
    task: Task
    placement: PlacementRange
    seed: int

    @classmethod
    def of(cls, problem: ProblemData, seed: int | None) -> _FeaturesSelection:
        """The selection for a problem with a task that has features; ``seed`` None is that of the problem."""
        assert problem.task is not None
        placement = PlacementRange.of(problem.task.workpiece)
        return cls(problem, problem.task, placement, problem.solver.seed if seed is None else seed)

    def answer(self, workers: int, progress: Progress | None) -> Solution:
        """The placement that is found to be best, with the best postures there.

        Raises:
            NoSolutionError: no placement at which every feature can be done.
        """
        began = time.perf_counter()
        if not self.placement.free.any():
            return self._where_it_stands(workers, progress, began)
        search = self._search(workers, progress)
        if not search.optima:
            raise self._failure(search, began)
        return self._at(search, began)

    @cached_property
    def _shared(self) -> Sources | None:
        """The sources of which a part stays, where what counts is that all succeed; None where features err alone.

        A peg fails with either end, which is not one circle at each feature: its probabilities are multiplied.
        """
        sources = self.problem.task_sources
        stays = bool(np.any(np.diag(sources.constant) > 0))
        return sources if self.task.combine == "success" and stays and self.task.part is None else None

    @cached_property
    def _selector(self) -> PostureSelector:
        """Of one feature: by the probability to miss it where that all succeed is asked for, else by the criterion."""
        return self._single({"criterion": "miss"} if self.task.combine == "success" else {})

    def _single(self, criterion: dict[str, str]) -> PostureSelector:
        """The selector of one feature, with keys of the task replaced: the placed features are its targets."""
        first = self.task.features[0]
        clearances = [c for c in (self.task.clearance, *(f.clearance for f in self.task.features)) if c is not None]
        given = {
            "features": (), "workpiece": None, "combine": "worst", "position": first.position,
            "direction": first.direction or self.task.direction, "clearance": next(iter(clearances), None),
            **criterion,
        }  # fmt: skip
        single = replace(self.problem, task=self.task.model_copy(update=given))
        compiled = None if self.placement.free.any() else False
        return PostureSelector(single, compiled=compiled, keeps_mounting=True, offers=False)

    def _stations(self, guarded: bool | None = None) -> PlacedStations:
        """The features as stations, with the engines that serve them.

        Args:
            guarded: as of `PostureSelector.engine`.

        Raises:
            InputError: a yaw that turns directions out of the plane of the arm, or an axis that the arm cannot hold.
        """
        selector = self._selector
        targets = tuple(self._target(selector, feature) for feature in self.task.features)
        at = [target.moved(self.placement.centre) for target in targets]
        self._check_plane(selector)
        engines = tuple(selector.engine(target, guarded) for target in at)
        for engine, target in zip(engines, at, strict=True):
            engine.optimisation_problem.check_axis(target)
        return PlacedStations(engines, targets, self.placement, self.task.combine, self._shared)

    def _target(self, selector: PostureSelector, feature: Any) -> TaskTarget:
        """The target of a feature in the frame of the workpiece, with direction and clearance of its own or of the
        task.
        """
        target = selector.target.with_position(np.array(feature.position))
        direction = feature.direction or self.task.direction
        target = target.with_direction(np.array(direction), selector.reach)
        clearance, lever = feature.clearance or self.task.clearance, np.subtract(feature.position, self.task.origin)
        return replace(target, clearance=np.nan if clearance is None else clearance, lever=lever)

    def _check_plane(self, selector: PostureSelector) -> None:
        """Refuses a yaw that would turn directions out of the plane of a planar arm.

        Raises:
            InputError: the plane is not level and the yaw is not zero.
        """
        normal = selector.reach.normal
        turns = self.placement.lower[3] != 0 or self.placement.upper[3] != 0
        if normal is not None and turns and abs(normal[2]) < 1 - 1e-9:
            hint = "leave the yaw out"
            issue = Issue("the arm moves in a plane that a yaw turns the part out of", ("task", "workpiece", "yaw"))
            raise InputError(replace(issue, hint=hint))

    def _search(self, workers: int, progress: Progress | None) -> PlacementSearch:
        """As for one target: without rows that keep the arm clear of itself, unless the answer is not."""
        scene = self.problem.scene

        def clear(optimum: PlacementOptimum) -> bool:
            return scene.explicit or bool(is_clear(scene, optimum.postures).all())

        free = self._stations()
        if scene.explicit or self._mostly_clear(free):
            found = search_placement(free, self.seed, workers, progress, accepted=clear)
            if not found.optima or clear(found.optima[0]):
                return found
        return search_placement(self._stations(guarded=True), self.seed, workers, progress)

    def _mostly_clear(self, free: PlacedStations) -> bool:
        """Whether the best of some placements, without rows that keep the arm clear, is clear as it is."""
        rng = np.random.default_rng(self.seed)
        found = free.best(free.in_plane(self.placement.drawn(_PROBED, rng)), _STARTS_PER_PROBE, rng)
        best = int(np.argmin(found.loss))
        return not np.isfinite(found.loss[best]) or bool(is_clear(self.problem.scene, found.Q[best]).all())

    def _at(self, search: PlacementSearch, began: float) -> Solution:
        """Every feature solved on its own where the workpiece is, from the joint answer and from random starts."""
        stations, optimum = search.stations, search.optima[0]
        solved = [
            self._selector.solve_target(target, self.seed, known=q if np.isfinite(q).all() else None)
            for target, q in zip(stations.at(optimum.w), optimum.postures, strict=True)
        ]
        every = search.screened
        sigma = placement_sigma(stations, every)
        feasible = np.isfinite(sigma)
        drawn = np.flatnonzero(feasible)[1:] if feasible[0] else np.flatnonzero(feasible)
        middle = drawn[np.argsort(every.loss[drawn], kind="stable")[len(drawn) // 2]] if len(drawn) else None
        scene = self.problem.scene
        rest = [o for o in search.optima[1:] if is_clear(scene, o.postures).all()]
        figure = _Figures(self.problem, stations, self.task.combine == "success")
        statistics = PlacementStatistics(
            len(every.W), int(feasible.sum()), every.tried, search.solves, search.batches, search.recurred,
            time.perf_counter() - began,
        )  # fmt: skip
        return self._solution(
            stations, optimum.w, postures_together(stations, optimum.w, solved, optimum.postures), statistics,
            optimal=optimum.optimal,
            at_centre=figure.of(every, 0),
            typical=None if middle is None else figure.of(every, int(middle)),
            others=tuple(figure.of(other.found, 0) for other in rest[:_MAX_OTHER_OPTIMA]),
        )  # fmt: skip

    def _solution(
        self, stations: PlacedStations, w: Array, solved: Sequence[Solution], statistics: PlacementStatistics,
        *, optimal: bool = True, **beside: Any,
    ) -> Solution:  # fmt: skip
        """The answer with postures near each other: ties and whole turns decided by the way between them.

        Args:
            w: (4,) the placement [m, rad], world.
            beside: figures of other placements.
        """
        robot = solved[0].optimisation_problem.robot
        solved = self._ties(solved)
        Q = np.array([solution.q for solution in solved])
        turned = nearest_turns(robot, Q, best_order(robot, Q).order)
        if best_order(robot, turned).travel < best_order(robot, Q).travel - 1e-9:
            solved = [replace(solution, q=q) for solution, q in zip(solved, turned, strict=True)]
        solved = solved if self.task.combine == "success" else confirmed_features(solved)
        status: Status = "optimal" if optimal and all(s.status == "optimal" for s in solved) else "feasible"
        notes = tuple(dict.fromkeys(note for solution in solved for note in solution.notes))
        names = [feature.name for feature in self.task.features]
        box = self.placement
        placement = PlacementOnBench(box.lower, box.upper, w, statistics, stations=stations, **beside)
        return joined_features(self.problem, solved, names, placement, status=status, notes=notes)

    def _ties(self, solved: Sequence[Solution]) -> Sequence[Solution]:
        """Of postures that scatter alike, such as mirrored elbows, those that the joints travel least between."""
        if self.task.criterion != "worst" or self.task.combine == "success" or self.task.minimize:
            return solved
        alike = [[a for a in s.optima if a.sigma_max <= (1 + _SIGMA_TOLERANCE) * s.critical.sigma_max] for s in solved]
        options = [
            np.array([s.q, *(list(a.posture.values()) for a in same)]) for s, same in zip(solved, alike, strict=True)
        ]
        robot = solved[0].optimisation_problem.robot
        chosen = nearest_ties(robot, options)
        return [replace(s, q=each[k]) if k else s for s, each, k in zip(solved, options, chosen, strict=True)]

    def _where_it_stands(self, workers: int, progress: Progress | None, began: float) -> Solution:
        """The answer for a placement that is fixed: the features are single problems, and what joins them is the order.

        Raises:
            NoSolutionError: some feature cannot be done there.
        """
        selector, stations, w = self._selector, self._stations(), self.placement.lower
        solved: list[Solution] = []
        for k, target in enumerate(stations.at(w)):
            try:
                solved.append(selector.solve_thoroughly(seed=self.seed, workers=workers, target=target))
            except NoSolutionError as error:
                if self.problem.above_assumed_mounting:  # which is dropped first
                    raise
                after = range(k + 1, len(stations.targets))
                failed = [k, *(j for j in after if not selector.can_be_done(stations.at(w)[j]))]
                raise self._explained().error(w, failed, [error], 1, began) from None
            if progress is not None:
                progress(k + 1, len(stations.targets))
        starts = sum(solution.statistics.tried for solution in solved)
        recurred = min(solution.statistics.recurred for solution in solved)
        batches = max(solution.statistics.batches for solution in solved)
        statistics = PlacementStatistics(1, 1, starts, 0, batches, recurred, time.perf_counter() - began)
        return self._solution(stations, w, postures_together(stations, w, solved), statistics)

    def _explained(self) -> FeaturesFailure:
        """The inquiry into a failure, with rows that keep the arm clear."""
        return FeaturesFailure(self.problem, self.task, self._stations(guarded=True), self.seed, self._selector, _does)

    def can_be_done(self) -> bool:
        """Whether a placement is found at which every feature can be done; why not is not asked."""
        if self.placement.free.any():
            return bool(search_placement(self._stations(guarded=True), self.seed, wanted=1).optima)
        return all(self._selector.can_be_done(target) for target in self._stations().at(self.placement.lower))

    def _failure(self, search: PlacementSearch, began: float) -> NoSolutionError:
        """The error with the placement at which least is missing, and why the features fail there that do."""
        stations, every = search.stations, search.screened
        m = int(np.argmin(failing(every)))
        selector = self._selector
        if self.problem.above_assumed_mounting:  # which is dropped first
            raise NoSolutionError("no placement was found above the mounting plane")
        errors: list[NoSolutionError] = []
        solved: list[Solution] = []
        failed = [int(k) for k in np.flatnonzero(every.gap[m] > 0)]
        for k in failed[:_EXPLAINED_FEATURES]:
            try:
                solved.append(selector.solve_target(stations.targets[k].moved(every.W[m]), self.seed, 8))
            except NoSolutionError as error:
                errors.append(error)
        if not errors:
            return self._explained().not_together(every.W[m], failed, solved, len(every.W), began)
        return self._explained().error(every.W[m], failed, errors, len(every.W), began)


def _does(problem: ProblemData) -> bool:
    """Whether a changed problem with features is solved."""
    try:
        return _FeaturesSelection.of(problem, None).can_be_done()
    except InputError:  # no such problem can be stated
        return False


@dataclass(frozen=True)
class _Figures:
    """What placements cost, for comparison with the answer: the middle of the range, a typical one, other optima."""

    problem: ProblemData
    stations: PlacedStations
    with_success: bool

    def of(self, found: Postures, m: int) -> PlacementFigure:
        """The figure of the placement in row m."""
        sigma = float(placement_sigma(self.stations, found)[m])
        p_success = self._success(found.W[m], found.Q[m]) if self.with_success and np.isfinite(sigma) else None
        return PlacementFigure(found.W[m], sigma, p_success)

    def _success(self, w: Array, Q: Array) -> float:
        """Probability that all features succeed at a placement w (4,) with postures Q (K, n)."""
        places = [
            PlaceErrors.of(
                relative_spread(self.problem, q, target.lever),
                critical_basis(engine.optimisation_problem, target),
                target.clearance,
            )
            for engine, target, q in zip(self.stations.engines, self.stations.at(w), Q, strict=True)
        ]
        return success_of_all(places).probability
