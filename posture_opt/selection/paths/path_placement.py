"""Where to put a workpiece so that a path on it is followed with least scatter.

Placements are searched with a few points of the path as if they were features of the part; the best ones are followed
by a full search of the motion, and the best motion leads one smooth problem in which the part moves too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posture_opt.numerics import Array, Progress
from posture_opt.selection.answer.placement import PlacementRange
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.paths.smooth_motion import SmoothMotion
from posture_opt.selection.paths.step_bounds import step_bounds
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.stations.placed_stations import PlacedStations
from posture_opt.selection.stations.placement_search import search_placement
from posture_opt.selection.stations.stations_problem import StationsPoint
from posture_opt.selection.tasks.path_task import PathTask

_SEARCHED_POINTS = 6  # of the path that stand for all of it
_SEARCHED_PLACEMENTS = 3  # placements whose motions are searched


def promising_placements(
    engine: Engine,
    targets: Sequence[TaskTarget],
    placement: PlacementRange,
    seed: int,
    workers: int = 1,
    progress: Progress | None = None,
) -> list[Array]:
    """Placements (4,) at which some points of a path have good postures, best first.

    Args:
        targets: of all points, in the frame of the workpiece.
        workers, progress: as of `search_placement`.
    """
    chosen = np.unique(np.linspace(0, len(targets) - 1, min(_SEARCHED_POINTS, len(targets))).round().astype(int))
    some = tuple(targets[k] for k in chosen.tolist())
    stations = PlacedStations((engine,) * len(some), some, placement, "worst")
    found = search_placement(stations, seed, workers, progress, wanted=1)
    return [placement.tidied(optimum.w) for optimum in found.optima[:_SEARCHED_PLACEMENTS]]


def moved_on(found: Solution, targets: Sequence[TaskTarget], placement: PlacementRange) -> Array:
    """The placement (4,) that a motion leads to where the part may move with it.

    Args:
        targets: of all points, in the frame of the workpiece.
    """
    problem, box = found.optimisation_problem, placement.without_seam
    own = [replace(target, scale=found.target.scale) for target in targets]
    steps = JointSteps.of(problem.robot, problem.nlp)
    task = found.problem.task
    closed, speed = (task.closed, task.stated_speed) if isinstance(task, PathTask) else (False, None)
    smooth = SmoothMotion.of(problem, steps, own, found.path, closed, box)
    most = step_bounds(steps, found.path, found.largest_step, speed)
    end = smooth.solve(StationsPoint(found.w, found.postures), most)
    return placement.tidied(end.point.w)
