"""``FeaturesFailure``: which features of a workpiece cannot be done, why, and what move or turn would help."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from posture_opt.collision.cell import base_frame
from posture_opt.errors import NoSolutionError
from posture_opt.numerics import Array, Json
from posture_opt.selection.answer.infeasible import SEARCH, explain_stations, first_that_does, words_of
from posture_opt.selection.answer.placement import COORDINATES, PlacementRange, PlacementStatistics
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.search.multistart import multistart, usual_starts
from posture_opt.selection.search.relaxation import (
    Change,
    ChangedValue,
    Reason,
    Relaxation,
    rounded,
    shown,
    with_changes,
)
from posture_opt.selection.stations.placed_stations import PlacedStations
from posture_opt.selection.stations.placement_search import PlacementOnBench
from posture_opt.selection.tasks import Task
from posture_opt.selection.tasks.workpiece import Workpiece
from posture_opt.statements import Statement, state

_BEYOND = 96
"""Placements tried beyond the range."""


def nearest_feasible(stations: PlacedStations, seed: int) -> Array | None:
    """(4,) feasible placement of least shift [m] found outside the range, yaw within it; None if none was seen."""
    rng, box = np.random.default_rng(seed), stations.placement
    reach = stations.engines[0].optimisation_problem.reach
    far = np.append(np.full(3, reach.radius), 0.0)
    share = rng.random((_BEYOND, 1)) ** 2  # more of them near the range
    inside = box.lower + rng.random((_BEYOND, 4)) * (box.upper - box.lower)
    anywhere = inside + share * rng.uniform(-1, 1, (_BEYOND, 4)) * far
    # What is out of reach is reached on the way to the base, at its own height or nearly so.
    foot = np.append(base_frame(stations.engines[0].robot)[0][:2], inside[0, 2:])
    nearer = inside + np.linspace(0, 1, _BEYOND)[:, None] * (foot - inside) * [1, 1, 0, 0]
    nearer += 0.1 * rng.uniform(-1, 1, (_BEYOND, 4)) * far
    return _led_back(stations, np.vstack([nearer, anywhere]), rng)


def turned_feasible(stations: PlacedStations, seed: int) -> Array | None:
    """(4,) feasible placement turned least, x, y and z in their range; None if none was seen."""
    rng, box = np.random.default_rng(seed), stations.placement
    if box.all_round:
        return None
    tried = box.lower + rng.random((_BEYOND, 4)) * (box.upper - box.lower)
    tried[:, 3] = box.centre[3] + rng.uniform(-math.pi, math.pi, _BEYOND)
    return _led_back(stations, tried, rng)


def outside(box: PlacementRange, W: Array) -> Array:
    """(M,) distance of placements from a range, 1 rad like 1 m."""
    return np.asarray(np.linalg.norm(W - np.clip(W, box.lower, box.upper), axis=1))


def _led_back(stations: PlacedStations, W: Array, rng: np.random.Generator) -> Array | None:
    """(4,) feasible placement nearest to the range, from tried ones W (M, 4)."""
    box = stations.placement
    # Whether all can be done does not depend on the errors that they share.
    anywhere = replace(stations, placement=PlacementRange(np.full(4, -np.inf), np.full(4, np.inf)), shared=None)
    best: Array | None = None
    known: Array | None = None
    for _ in range(2 * 3 + 1):
        found = anywhere.best(anywhere.in_plane(W), 8, rng, known)
        feasible = np.flatnonzero((found.gap == 0).all(axis=1))
        if len(feasible):
            nearest = feasible[np.argmin(outside(box, found.W[feasible]))]
            if best is None or outside(box, found.W[nearest][None])[0] < outside(box, best[None])[0]:
                best, known = found.W[nearest], found.Q[nearest][None]
        if best is None:
            return None
        # In turn: the way back to the range, and what lies about the best.
        edge = np.clip(best, box.lower, box.upper)
        away = outside(box, best[None])[0]
        if away < 1e-6:
            return best
        along = np.linspace(0, 1, 12, endpoint=False)[:, None]
        about = rng.uniform(-1, 1, (2 * 12, 4)) * np.where(best == edge, 0.3 * (box.upper - box.lower), away / 3)
        W = np.vstack([edge + along * (best - edge), np.clip(best + about, edge - away, edge + away)])
    return best


@dataclass(frozen=True, eq=False)
class FeaturesFailure:
    """Inquiry into a search that found no placement for all features."""

    problem: ProblemData
    task: Task
    stations: PlacedStations  # with rows that keep the arm clear
    seed: int
    selector: PostureSelector  # of one feature
    does: Callable[[ProblemData], bool]  # whether a changed problem is solved

    def error(
        self, w: Array, failed: Sequence[int], solved: Sequence[Solution], errors: Sequence[NoSolutionError],
        looked: int, began: float,
    ) -> NoSolutionError:  # fmt: skip
        """Failure at the placement w (4,) where least is missing.

        Its first failed features have ``errors`` by themselves, or else all are ``solved``.
        """
        names = tuple(self.task.features[k].name for k in failed)
        notes: tuple[Statement, ...] = ()
        relaxations: Sequence[Relaxation] = self._moves()
        if errors:
            solved = [error.solution for error in errors]
            pairs = [(name, reason) for name, one in zip(names, solved, strict=False) for reason in one.reasons]
            reasons = tuple(replace(reason, message=f"{name}: {reason.message}") for name, reason in pairs)
            others = names[len(errors) :]
            notes = (state("selection.features-also-fail", features=others),) if others else ()
            relaxations = sorted((*relaxations, *self._for_all(w, failed)), key=lambda one: one.cost)
        else:
            message = (
                f"each feature can be done by itself, but of {looked} placements none was found at which all of them "
                "can be done; more starts may help (solver: {starts: 500})"
            )
            reasons = (Reason(SEARCH, message, 0.0, "1"),)
        statistics = PlacementStatistics(looked, 0, 0, 0, 1, 0, time.perf_counter() - began)
        box = self.stations.placement
        placement = PlacementOnBench(box.lower, box.upper, w, statistics, stations=self.stations)
        solution = joined_features(
            self.problem, solved, names[: len(solved)], placement,
            status="infeasible", notes=notes, reasons=reasons, relaxations=tuple(relaxations),
        )  # fmt: skip
        return NoSolutionError("\n".join(reason.message for reason in reasons), solution)

    def _for_all(self, w: Array, failed: Sequence[int]) -> tuple[Relaxation, ...]:
        targets = [self.stations.at(w)[k] for k in failed]
        engine = self.stations.engines[failed[0]]
        found = multistart(engine, targets[0], np.random.default_rng(self.seed), usual_starts(engine))
        inquiry = self.selector.inquiry(found, self.problem, self._with_changes)
        names = [self.task.features[k].name for k in failed]
        return explain_stations(inquiry, targets, names).relaxations

    def _with_changes(self, changes: Sequence[Change], near: Array | None = None) -> bool:
        return self.does(with_changes(self.problem, changes))

    def _moves(self) -> list[Relaxation]:
        found, box = [], self.stations.placement
        moved, turned = nearest_feasible(self.stations, self.seed), turned_feasible(self.stations, self.seed)
        if turned is not None and np.any(np.clip(turned, box.lower, box.upper)[:3] != turned[:3]):
            turned = None  # it is moved too
        for w in (moved, turned):
            if w is not None:
                changes = first_that_does((self._placed(v) for v in _rounded(w, box)), self._with_changes)
                away = float(outside(box, w[None])[0])
                found += [] if changes is None else [Relaxation(words_of(changes), (), {}, away, changes)]
        return found

    def _placed(self, w: Sequence[ChangedValue]) -> tuple[Change, ...]:
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
        )
        return (Change(("task", "workpiece"), Workpiece.model_validate(text), text, words + "done there"),)


def _rounded(w: Array, box: PlacementRange) -> Iterator[list[ChangedValue]]:
    """A placement (4,) as printed: rounded to mm and degrees, a little farther, and finer."""
    edge = np.clip(w, box.lower, box.upper)
    for decimals, more in ((0, 0.0), (0, 0.02), (1, 0.005), (6, 0.0)):
        beyond = edge + (1 + more) * (w - edge)
        parts = zip(beyond, w - edge, ("m", "m", "m", "rad"), strict=True)
        yield [rounded(float(v), unit, decimals, int(np.sign(off))) for v, off, unit in parts]


def joined_features(
    problem: ProblemData, solved: Sequence[Solution], names: Sequence[str], placement: PlacementOnBench, **stated: Any
) -> Solution:
    """One answer for several features; ``stated`` are fields of the whole answer."""
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
