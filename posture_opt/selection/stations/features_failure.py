"""``FeaturesFailure``: which features of a workpiece cannot be done, why, and what move or turn would help."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from posture_opt.errors import NoSolutionError
from posture_opt.numerics import Array
from posture_opt.selection.answer.shared_placement import PlacementStatistics
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.search.relaxation import Relaxation
from posture_opt.selection.stations.bench_map import PlacementOnBench
from posture_opt.selection.stations.placed_stations import PlacedStations
from posture_opt.selection.stations.placement_relaxation import nearest_feasible, outside, turned_feasible
from posture_opt.selection.tasks import Task


@dataclass(frozen=True, eq=False)
class FeaturesFailure:
    """The inquiry into a search that found no placement at which every feature can be done."""

    problem: ProblemData
    task: Task
    stations: PlacedStations
    seed: int

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
        notes = (f"{', '.join(others)} cannot be done there either",) if others else ()
        relaxations = (*self._moves(), *_of_the_only_one(names, solved))
        statistics = PlacementStatistics(looked, 0, 0, 0, 1, 0, time.perf_counter() - began)
        box = self.stations.placement
        solution = joined_features(
            self.problem, solved, names, PlacementOnBench(box.lower, box.upper, w, statistics, stations=self.stations),
            status="infeasible", notes=notes, reasons=reasons, relaxations=tuple(relaxations),
        )  # fmt: skip
        return NoSolutionError("\n".join(reason.message for reason in reasons), solution)

    def _moves(self) -> list[Relaxation]:
        """Where the whole workpiece could go, or how it could be turned, for every feature to be possible."""
        found = []
        moved, turned = nearest_feasible(self.stations, self.seed), turned_feasible(self.stations, self.seed)
        if moved is not None:
            away = float(outside(self.stations.placement, moved[None])[0])
            x, y, z = (f"{v * 1e3:.0f}" for v in moved[:3])
            change = (
                f"let the workpiece stand at ({x}, {y}, {z}) mm, {away * 1e3:.0f} mm outside of its range: every "
                f"feature can be done there"
            )
            found.append(Relaxation(change, (), {}, away))
        if turned is not None:
            away = float(outside(self.stations.placement, turned[None])[0])
            change = f"let the yaw go to {np.degrees(turned[3]):.0f} deg: every feature can be done then"
            found.append(Relaxation(change, (), {}, away))
        return sorted(found, key=lambda one: one.cost)


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
    return replace(
        solved[0], problem=problem, statistics=first, points=tuple(solved), names=tuple(names), placement=placement,
        **stated,
    )  # fmt: skip


def _of_the_only_one(names: Sequence[str], solved: Sequence[Solution]) -> list[Relaxation]:
    """What would help a feature that fails alone: of several, no such change helps them all."""
    if len(solved) != 1:
        return []
    return [replace(one, change=f"{names[0]}: {one.change}") for one in solved[0].relaxations]
