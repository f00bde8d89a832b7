"""``FeaturesFailure``: which features of a workpiece cannot be done, why, and what move or turn would help."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from posture_opt.errors import NoSolutionError
from posture_opt.numerics import Array, Json
from posture_opt.selection.answer.infeasible import SEARCH, first_that_does, words_of
from posture_opt.selection.answer.infeasible_stations import explain_stations
from posture_opt.selection.answer.placement import COORDINATES, PlacementRange
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.shared_placement import PlacementStatistics
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.search.batches import usual_starts
from posture_opt.selection.search.change import Change, ChangedValue, rounded, with_changes
from posture_opt.selection.search.multistart import multistart
from posture_opt.selection.search.relaxation import Reason, Relaxation, shown
from posture_opt.selection.stations.bench_map import PlacementOnBench
from posture_opt.selection.stations.placed_stations import PlacedStations
from posture_opt.selection.stations.placement_relaxation import nearest_feasible, outside, turned_feasible
from posture_opt.selection.tasks import Task
from posture_opt.selection.tasks.workpiece import Workpiece
from posture_opt.statements import Statement, state


@dataclass(frozen=True, eq=False)
class FeaturesFailure:
    """The inquiry into a search that found no placement at which every feature can be done.

    Args:
        stations: with rows that keep the arm clear.
        selector: of one feature; ``does`` says whether a changed problem is solved.
    """

    problem: ProblemData
    task: Task
    stations: PlacedStations
    seed: int
    selector: PostureSelector
    does: Callable[[ProblemData], bool]

    def error(
        self, w: Array, failed: Sequence[int], errors: Sequence[NoSolutionError],
        looked: int, began: float,
    ) -> NoSolutionError:  # fmt: skip
        """The error that carries the placement w (4,) where least is missing.

        Args:
            failed: features that cannot be done there; errors: of the first of them.
            looked: how many placements were looked at; began: when the search did.
        """
        names = tuple(self.task.features[k].name for k in failed[: len(errors)])
        solved = [error.solution for error in errors]
        pairs = [(name, reason) for name, one in zip(names, solved, strict=True) for reason in one.reasons]
        reasons = tuple(replace(reason, message=f"{name}: {reason.message}") for name, reason in pairs)
        others = tuple(self.task.features[k].name for k in failed[len(errors) :])
        notes = (state("selection.features-also-fail", features=others),) if others else ()
        relaxations = sorted((*self._moves(), *self._for_all(w, failed)), key=lambda one: one.cost)
        return self._error(w, solved, names, notes, reasons, relaxations, looked, began)

    def not_together(
        self, w: Array, failed: Sequence[int], solved: Sequence[Solution], looked: int, began: float
    ) -> NoSolutionError:
        """The error where each feature can be done at the placement w (4,), and the search did not do all of them.

        Args:
            failed: features that the search did not do there; solved: each of the first of them by itself.
        """
        names = tuple(self.task.features[k].name for k in failed[: len(solved)])
        message = (
            f"each feature can be done by itself, but of {looked} placements none was found at which all of them can "
            "be done; more starts may help (solver: {starts: 500})"
        )
        reason = Reason(SEARCH, message, 0.0, "1")
        return self._error(w, solved, names, (), (reason,), self._moves(), looked, began)

    def _error(
        self, w: Array, solved: Sequence[Solution], names: Sequence[str], notes: tuple[Statement, ...],
        reasons: tuple[Reason, ...], relaxations: Sequence[Relaxation], looked: int, began: float,
    ) -> NoSolutionError:  # fmt: skip
        """The error with the infeasible answer."""
        statistics = PlacementStatistics(looked, 0, 0, 0, 1, 0, time.perf_counter() - began)
        box = self.stations.placement
        solution = joined_features(
            self.problem, solved, names, PlacementOnBench(box.lower, box.upper, w, statistics, stations=self.stations),
            status="infeasible", notes=notes, reasons=reasons, relaxations=tuple(relaxations),
        )  # fmt: skip
        return NoSolutionError("\n".join(reason.message for reason in reasons), solution)

    def _for_all(self, w: Array, failed: Sequence[int]) -> tuple[Relaxation, ...]:
        """Changes of requirements with which every feature can be done."""
        targets = [self.stations.at(w)[k] for k in failed]
        engine = self.stations.engines[failed[0]]
        found = multistart(engine, targets[0], np.random.default_rng(self.seed), usual_starts(engine))
        inquiry = self.selector.inquiry(found, self.problem, self._with_changes)
        names = [self.task.features[k].name for k in failed]
        return explain_stations(inquiry, targets, names).relaxations

    def _with_changes(self, changes: Sequence[Change], near: Array | None = None) -> bool:
        """Whether the problem with some changes is solved."""
        return self.does(with_changes(self.problem, changes))

    def _moves(self) -> list[Relaxation]:
        """Where the whole workpiece could stand, or how it could be turned, for every feature to be possible."""
        found, box = [], self.stations.placement
        moved, turned = nearest_feasible(self.stations, self.seed), turned_feasible(self.stations, self.seed)
        if turned is not None and np.any(np.clip(turned, box.lower, box.upper)[:3] != turned[:3]):
            turned = None  # it is moved too
        for w in (moved, turned):
            if w is not None:
                changes = first_that_does((self._placed(v) for v in _written(w, box)), self._with_changes)
                away = float(outside(box, w[None])[0])
                found += [] if changes is None else [Relaxation(words_of(changes), (), {}, away, changes)]
        return found

    def _placed(self, w: Sequence[ChangedValue]) -> tuple[Change, ...]:
        """The workpiece at one placement."""
        text: dict[str, Json] = {name: part.text for name, part in zip(COORDINATES, w, strict=True)}
        if self.task.workpiece is not None:
            text |= self.task.workpiece.shape_keys
        x, y, z = (part.text.split()[0] for part in w[:3])
        box = self.stations.placement
        there = np.array([part.value for part in w])
        away = np.linalg.norm((there - np.clip(there, box.lower, box.upper))[:3])
        beyond = f", {shown(float(away), 'm')} outside of its range" if away > 0 else ""
        words = (
            f"let the workpiece stand at ({x}, {y}, {z}) mm with a yaw of {w[3].text}{beyond}: every feature can be "
            "done there"
        )
        return (Change(("task", "workpiece"), Workpiece.model_validate(text), text, words),)


def _written(w: Array, box: PlacementRange) -> Iterator[list[ChangedValue]]:
    """A placement (4,) with the digits that are printed: rounded to mm and degrees, a little farther, and finer."""
    edge = np.clip(w, box.lower, box.upper)
    for decimals, more in ((0, 0.0), (0, 0.02), (1, 0.005), (6, 0.0)):
        beyond = edge + (1 + more) * (w - edge)
        parts = zip(beyond, w - edge, ("m", "m", "m", "rad"), strict=True)
        yield [rounded(float(v), unit, decimals, int(np.sign(off))) for v, off, unit in parts]


def joined_features(
    problem: ProblemData, solved: Sequence[Solution], names: Sequence[str], placement: PlacementOnBench, **stated: Any
) -> Solution:
    """The answer for several features from that for each of them.

    Args:
        stated: fields of the whole answer: status, notes, reasons and what would help.
    """
    statistics = placement.statistics
    assert statistics is not None
    first = replace(solved[0].statistics, seconds=statistics.seconds)
    placed = problem.with_workpiece_at(placement.w)
    if placed is not problem:
        solved = [replace(one, problem=replace(one.problem, part=placed.part)) for one in solved]
    return replace(
        solved[0], problem=placed, statistics=first, points=tuple(solved), names=tuple(names), placement=placement,
        **stated,
    )  # fmt: skip
