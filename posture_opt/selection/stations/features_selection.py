"""``select_for_features``: the placement of a workpiece and a posture for each of its features."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.numerics import Array, Progress
from posture_opt.selection.answer.placement import (
    PlacementFigure,
    PlacementRange,
    PlacementStatistics,
    best_order,
    nearest_ties,
    nearest_turns,
)
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.answer.target_answer import Status, critical_basis
from posture_opt.selection.problem_data import ProblemData, with_fallbacks
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.search_outcome import confirmed, is_clear
from posture_opt.selection.stations.features_failure import FeaturesFailure, joined_features
from posture_opt.selection.stations.placed_stations import PlacedStations, Postures
from posture_opt.selection.stations.placement_search import (
    PlacementOnBench,
    PlacementOptimum,
    PlacementSearch,
    failing,
    placement_sigma,
    search_placement,
)
from posture_opt.selection.stations.stations_problem import StationsPoint
from posture_opt.selection.tasks import Task
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.spread import relative_spread
from posture_opt.uncertainty.success_of_all import PlaceErrors, success_of_all


def _confirmed(solution: Solution) -> Solution:
    assert solution.engine is not None
    given = solution.engine.candidates(solution.q[None], solution.target)[0]
    (best, *_), said = confirmed(solution.engine, [given], solution.target, solution.problem.scene)
    answer = replace(solution, statistics=replace(solution.statistics, confirmation=said))
    if said is not None and said.refutes:
        return replace(answer, status="feasible")
    return replace(answer, q=best.q, ended=np.vstack([best.q, solution.ended[1:]])) if said and said.taken else answer


def postures_together(
    stations: PlacedStations, w: Array, solved: Sequence[Solution], known: Array | None = None
) -> Sequence[Solution]:
    """Answers with the postures (K, n) of greatest joint success at w (4,); unchanged without shared errors."""
    if stations.shared is None:
        return solved
    precise, still = replace(stations, draws=8192), replace(stations, placement=PlacementRange(w, w))
    given = [_postures(s, None if known is None else known[k]) for k, s in enumerate(solved)]
    found = precise.among(w, given)
    options = [np.array([s.q for s in solved]), *([] if known is None or not np.isfinite(known).all() else [known])]
    options += [found.Q[0]] if np.isfinite(found.loss[0]) else []
    if any(engine.optimisation_problem.freedom for engine in stations.engines):
        end = still.joint.solve(StationsPoint(w, options[-1]))
        improved = precise.among(w, list(end.point.Q[:, None]))
        options += [improved.Q[0]] if np.isfinite(improved.loss[0]) else []
    scene = solved[0].problem.scene
    clear = [Q for Q in options if is_clear(scene, Q).all()] or options[:1]
    answers = []
    for Q in clear:
        each = zip(stations.engines, stations.at(w), Q, strict=True)
        tidied = [e.tidied(e.candidates(q[None], target), target)[0].q for e, target, q in each]
        answers.append([_with_posture(one, q) for one, q in zip(solved, tidied, strict=True)])
    places = [[PlaceErrors.of(s.spread, s.basis, s.target.clearance) for s in answer] for answer in answers]
    return answers[int(np.argmax([success_of_all(each).probability for each in places]))]


def _postures(solved: Solution, known: Array | None) -> Array:
    seen = solved.feasible[:: max(len(solved.feasible) // 12, 1)]
    rows = [solved.ranked, seen] if len(seen) else [solved.ranked]
    Q = np.vstack([solved.q[None], *rows, *([] if known is None else [known[None]])])
    return np.asarray(Q[is_clear(solved.problem.scene, Q)])


def _with_posture(one: Solution, q: Array) -> Solution:
    """The answer with a posture (n,), which comes first among its alternatives."""
    if np.array_equal(one.q, q):
        return one
    return replace(one, q=q, ended=np.vstack([q, one.ended[np.abs(one.ended - q).max(axis=1) > 1e-6]]))


def select_for_features(
    problem: ProblemData, *, seed: int | None = None, workers: int = 1, progress: Progress | None = None
) -> Solution:
    """``min over w, q_1 … q_K`` of the features' spreads combined; raises as `select_posture`."""
    return with_fallbacks(problem, lambda one: _FeaturesSelection.of(one, seed).answer(workers, progress))


@dataclass(frozen=True, eq=False)
class _FeaturesSelection:
    problem: ProblemData
    task: Task
    placement: PlacementRange  # where the workpiece may stand
    seed: int  # of the random placements and postures

    @classmethod
    def of(cls, problem: ProblemData, seed: int | None) -> _FeaturesSelection:
        """Selection for a task with features; ``seed`` None is the problem's."""
        assert problem.task is not None
        placement = PlacementRange.of(problem.task.workpiece)
        return cls(problem, problem.task, placement, problem.solver.seed if seed is None else seed)

    def answer(self, workers: int, progress: Progress | None) -> Solution:
        began = time.perf_counter()
        if not self.placement.free.any():
            return self._where_it_stands(workers, progress, began)
        search = self._search(workers, progress)
        if not search.optima:
            raise self._failure(search, began)
        return self._at(search, began)

    @cached_property
    def _shared(self) -> Sources | None:
        sources = self.problem.task_sources
        stays = bool(np.any(np.diag(sources.constant) > 0))
        return sources if self.task.combine == "success" and stays and self.task.part is None else None

    @cached_property
    def _selector(self) -> PostureSelector:
        first = self.task.features[0]
        clearances = [c for c in (self.task.clearance, *(f.clearance for f in self.task.features)) if c is not None]
        given = {
            "features": (), "workpiece": None, "combine": "worst", "position": first.position, "ordinary": 0.0,
            "direction": first.direction or self.task.direction, "clearance": next(iter(clearances), None),
            **({"criterion": "miss"} if self.task.combine == "success" else {}),
        }  # fmt: skip
        single = replace(self.problem, task=self.task.model_copy(update=given))
        compiled = None if self.placement.free.any() else False
        return PostureSelector(single, compiled=compiled, keeps_mounting=True, offers=False)

    def _stations(self, guarded: bool | None = None) -> PlacedStations:
        selector, normal = self._selector, self._selector.reach.normal
        targets = tuple(self._target(selector, feature) for feature in self.task.features)
        at = [target.moved(self.placement.centre) for target in targets]
        turns = self.placement.lower[3] != 0 or self.placement.upper[3] != 0
        if normal is not None and turns and abs(normal[2]) < 1 - 1e-9:
            message, key = "the arm moves in a plane that a yaw turns the part out of", ("task", "workpiece", "yaw")
            raise InputError(Issue(message, key, hint="leave the yaw out"))
        engines = tuple(selector.engine(target, guarded) for target in at)
        for engine, target in zip(engines, at, strict=True):
            engine.optimisation_problem.check_axis(target)
        return PlacedStations(engines, targets, self.placement, self.task.combine, self._shared)

    def _target(self, selector: PostureSelector, feature: Any) -> TaskTarget:
        target = selector.target.with_position(np.array(feature.position))
        direction = feature.direction or self.task.direction
        target = target.with_direction(np.array(direction), selector.reach)
        clearance, lever = feature.clearance or self.task.clearance, np.subtract(feature.position, self.task.origin)
        return replace(target, clearance=np.nan if clearance is None else clearance, lever=lever)

    def _search(self, workers: int, progress: Progress | None) -> PlacementSearch:
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
        rng = np.random.default_rng(self.seed)
        found = free.best(free.in_plane(self.placement.drawn(8, rng)), 8, rng)
        best = int(np.argmin(found.loss))
        return not np.isfinite(found.loss[best]) or bool(is_clear(self.problem.scene, found.Q[best]).all())

    def _at(self, search: PlacementSearch, began: float) -> Solution:
        stations, optimum, every = search.stations, search.optima[0], search.screened
        solved = [
            self._selector.solve_target(target, self.seed, known=q if np.isfinite(q).all() else None)
            for target, q in zip(stations.at(optimum.w), optimum.postures, strict=True)
        ]
        solved = list(postures_together(stations, optimum.w, solved, optimum.postures))
        feasible = np.isfinite(placement_sigma(stations, every))
        drawn = np.flatnonzero(feasible)[1:] if feasible[0] else np.flatnonzero(feasible)
        middle = drawn[np.argsort(every.loss[drawn], kind="stable")[len(drawn) // 2]] if len(drawn) else None
        rest = [o for o in search.optima[1:] if is_clear(self.problem.scene, o.postures).all()]
        statistics = PlacementStatistics(
            len(every.W), int(feasible.sum()), every.tried, search.solves, search.batches, search.recurred,
            time.perf_counter() - began,
        )  # fmt: skip
        return self._solution(
            stations, optimum.w, solved, statistics,
            optimal=optimum.optimal,
            at_centre=self._figure(stations, every, 0),
            typical=None if middle is None else self._figure(stations, every, int(middle)),
            others=tuple(self._figure(stations, other.found, 0) for other in rest[:5]),
        )  # fmt: skip

    def _figure(self, stations: PlacedStations, found: Postures, m: int) -> PlacementFigure:
        w, sigma = found.W[m], float(placement_sigma(stations, found)[m])
        if self.task.combine != "success" or not np.isfinite(sigma):
            return PlacementFigure(w, sigma, None)
        places = []
        for engine, target, q in zip(stations.engines, stations.at(w), found.Q[m], strict=True):
            basis = critical_basis(engine.optimisation_problem, target)
            places.append(PlaceErrors.of(relative_spread(self.problem, q, target.lever), basis, target.clearance))
        return PlacementFigure(w, sigma, success_of_all(places).probability)

    def _solution(
        self, stations: PlacedStations, w: Array, solved: Sequence[Solution], statistics: PlacementStatistics,
        *, optimal: bool = True, **beside: Any,
    ) -> Solution:  # fmt: skip
        """Answer at w (4,) [m, rad], world; ties and whole turns decided by the way between postures."""
        robot = solved[0].optimisation_problem.robot
        solved = self._ties(solved)
        Q = np.array([solution.q for solution in solved])
        turned = nearest_turns(robot, Q, best_order(robot, Q).order)
        if best_order(robot, turned).travel < best_order(robot, Q).travel - 1e-9:
            solved = [replace(solution, q=q) for solution, q in zip(solved, turned, strict=True)]
        if self.task.combine != "success":  # where errors stay none is the best by itself
            solved = [_confirmed(solution) for solution in solved]
        status: Status = "optimal" if optimal and all(s.status == "optimal" for s in solved) else "feasible"
        notes = tuple(dict.fromkeys(note for solution in solved for note in solution.notes))
        names = [feature.name for feature in self.task.features]
        box = self.placement
        placement = PlacementOnBench(box.lower, box.upper, w, statistics, stations=stations, **beside)
        return joined_features(self.problem, solved, names, placement, status=status, notes=notes)

    def _ties(self, solved: Sequence[Solution]) -> Sequence[Solution]:
        if self.task.criterion != "worst" or self.task.combine == "success" or self.task.minimize:
            return solved
        options = []
        for s in solved:
            alike = [a for a in s.optima if a.sigma_max <= (1 + 1e-4) * s.critical.sigma_max]
            options.append(np.array([s.q, *(list(a.posture.values()) for a in alike)]))
        chosen = nearest_ties(solved[0].optimisation_problem.robot, options)
        return [replace(s, q=each[k]) if k else s for s, each, k in zip(solved, options, chosen, strict=True)]

    def _where_it_stands(self, workers: int, progress: Progress | None, began: float) -> Solution:
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
                raise self._explained().error(w, failed, [], [error], 1, began) from None
            if progress is not None:
                progress(k + 1, len(stations.targets))
        starts = sum(solution.statistics.tried for solution in solved)
        recurred = min(solution.statistics.recurred for solution in solved)
        batches = max(solution.statistics.batches for solution in solved)
        statistics = PlacementStatistics(1, 1, starts, 0, batches, recurred, time.perf_counter() - began)
        return self._solution(stations, w, postures_together(stations, w, solved), statistics)

    def _explained(self) -> FeaturesFailure:
        return FeaturesFailure(self.problem, self.task, self._stations(guarded=True), self.seed, self._selector, _does)

    def can_be_done(self) -> bool:
        """Whether a placement is found for all features; why not is not asked."""
        if self.placement.free.any():
            return bool(search_placement(self._stations(guarded=True), self.seed, wanted=1).optima)
        return all(self._selector.can_be_done(target) for target in self._stations().at(self.placement.lower))

    def _failure(self, search: PlacementSearch, began: float) -> NoSolutionError:
        stations, every = search.stations, search.screened
        m = int(np.argmin(failing(every)))
        if self.problem.above_assumed_mounting:  # which is dropped first
            raise NoSolutionError("no placement was found above the mounting plane")
        errors: list[NoSolutionError] = []
        solved: list[Solution] = []
        failed = [int(k) for k in np.flatnonzero(every.gap[m] > 0)]
        for k in failed[:3]:
            try:
                solved.append(self._selector.solve_target(stations.targets[k].moved(every.W[m]), self.seed, 8))
            except NoSolutionError as error:
                errors.append(error)
        return self._explained().error(every.W[m], failed, solved, errors, len(every.W), began)


def _does(problem: ProblemData) -> bool:
    try:
        return _FeaturesSelection.of(problem, None).can_be_done()
    except InputError:  # no such problem can be stated
        return False
