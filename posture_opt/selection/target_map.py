"""``map_targets``: the best posture and its spread over a grid of targets."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.errors import NoSolutionError
from posture_opt.numerics import Progress
from posture_opt.selection.goal import Goal
from posture_opt.selection.grid import Grid, grid_of
from posture_opt.selection.grid_request import GridRequest, Plane
from posture_opt.selection.has_task import HasTask
from posture_opt.selection.map_points import MapPoint, spots_of
from posture_opt.selection.map_search import best_places
from posture_opt.selection.optimisation_problem import OptimisationProblem
from posture_opt.selection.reach import drawn_between
from posture_opt.selection.selector import PostureSelector

Floats = np.ndarray
_SAMPLES = 4000
_MARGIN = 1e-6  # of σ: differences below it do not make a place better than another


@dataclass(frozen=True, eq=False)
class TargetMap:
    """The best posture and its spread at every target of a grid.

    Args:
        spots: one for each of ``grid.points``.
        own: the position in the problem file, where it has one.
        seconds: wall time.
        notes: sentences for the report.
    """

    problem: Any
    programme: OptimisationProblem
    goal: Goal
    grid: Grid
    spots: tuple[MapPoint, ...]
    own: MapPoint | None
    seconds: float
    notes: tuple[str, ...] = ()

    @property
    def within(self) -> str:
        """The part of the spread that the task cares about: ``across``, ``along`` or ``all``."""
        return self.programme.task.within

    @cached_property
    def feasible(self) -> np.ndarray:
        """(N,) whether there is a posture."""
        return np.array([spot.feasible for spot in self.spots])

    @cached_property
    def sigma(self) -> Floats:
        """(N,) largest standard deviation of the part that counts [m]; NaN where there is no posture."""
        return np.array([spot.sigma_max for spot in self.spots])

    @cached_property
    def postures(self) -> Floats:
        """(N, n) postures [rad or m]; NaN where there is none."""
        return np.array([spot.q for spot in self.spots])

    @property
    def best(self) -> MapPoint:
        """The target with the smallest spread."""
        return self.spots[self._extreme(1)]

    @property
    def worst(self) -> MapPoint:
        """The target with the largest spread among those that have a posture."""
        return self.spots[self._extreme(-1)]

    def _extreme(self, sign: int) -> int:
        values = np.where(self.feasible, sign * self.sigma, np.inf)
        ties = np.flatnonzero(values <= values.min() + _MARGIN * abs(values.min()))
        # Of equal places the one nearest to the middle of the map.
        away = np.linalg.norm(self.grid.points[ties] - self.grid.points.mean(axis=0), axis=1)
        return int(ties[np.argmin(np.round(away, 9))])

    def to_json(self) -> dict[str, Any]:
        """The document ``map.json``: SI units, finite numbers only."""
        joints = self.programme.robot.joint_names
        return {
            "name": self.problem.name,
            "task": self.programme.task.kind,
            "quantity": "spread",
            "within": self.within,
            "direction": self.goal.direction.tolist(),
            "grid": self.grid.to_json(),
            "targets": [spot.to_json(joints) for spot in self.spots],
            "best": self.best.to_json(joints),
            "worst": self.worst.to_json(joints),
            "own": None if self.own is None else self.own.to_json(joints),
            "seconds": self.seconds,
            "notes": list(self.notes),
        }

    def plot(self) -> Any:
        """The map as a matplotlib figure."""
        from posture_opt.report.figures.map import plot_target_map

        return plot_target_map(self)


def map_targets(
    problem: HasTask,
    *,
    counts: tuple[int, ...] | None = None,
    low: tuple[float, float, float] | None = None,
    high: tuple[float, float, float] | None = None,
    plane: Plane | None = None,
    seed: int | None = None,
    workers: int = 1,
    progress: Progress | None = None,
    compiled: bool | None = None,
) -> TargetMap:
    """The best posture of the task, and its spread, at every target of a grid.

    The grid lies in the plane of a planar arm, else across the direction of the task; it covers the task's region,
    else the surroundings of its position, else the workspace at the height of the best place.

    Args:
        problem: with a task and uncertain parameters.
        counts: (2,) targets along the sides of the plane, or (3,) along x, y, z.
        low, high: (3,) corners of the box that the targets lie in [m], world.
        plane: ``xy``, ``xz`` or ``yz``.
        seed: of the random starts; default: the problem's. The answer does not depend on ``workers``.
        workers: processes to share the targets.
        progress: called with (done, total) targets.
        compiled: as of `PostureSelector`.

    Raises:
        InputError: no task, nothing uncertain, or a grid that is none.
        NoSolutionError: no target of the grid has a posture.
    """
    began = time.perf_counter()
    wish = GridRequest(counts, low, high, plane)
    wish.check()
    selector = PostureSelector(problem, compiled=compiled)
    grid = _grid(problem, selector, wish)
    targets = [grid.points, *([selector.goal.lower[None]] if selector.goal.kind == "point" else [])]
    goals = [selector.goal.with_position(point) for point in np.vstack(targets)]
    engines = [selector.engine(goal) for goal in goals]
    seed = problem.solver.seed if seed is None else seed
    pairs = (*grid.neighbours, *_beside(grid, len(goals), goals))
    places = best_places(engines, goals, pairs, seed=seed, workers=workers, progress=progress)
    spots = spots_of(engines[0].programme, goals, places)
    size = len(grid.points)
    if not any(spot.feasible for spot in spots[:size]):
        raise NoSolutionError(_nowhere(spots[:size]))
    programme = engines[[spot.feasible for spot in spots].index(True)].programme
    notes = (*problem.notes, programme.axis_note(selector.goal), *selector.remarks())
    own = spots[size] if len(spots) > size else None
    return TargetMap(
        problem, programme, selector.goal, grid, tuple(spots[:size]), own, time.perf_counter() - began, notes
    )


def _grid(problem: HasTask, selector: PostureSelector, wish: GridRequest) -> Grid:
    goal, robot = selector.goal, problem.robot
    rng = np.random.default_rng(0)
    Q = rng.uniform(*drawn_between(robot), (_SAMPLES, robot.n))
    positions = np.broadcast_to(np.asarray(problem.arm.position(Q), dtype=float), (_SAMPLES, 3))
    best = None
    if goal.kind == "anywhere" and wish.low is None:
        best = np.asarray(selector.solve().spread.position)
    return grid_of(wish, goal, selector.reach, positions, best)


def _beside(grid: Grid, count: int, goals: list[Goal]) -> list[tuple[np.ndarray, np.ndarray]]:
    """The file's own position and the target next to it are neighbours."""
    if count == len(grid.points):
        return []
    nearest = int(np.argmin(np.linalg.norm(grid.points - goals[-1].lower, axis=1)))
    own, other = np.array([count - 1]), np.array([nearest])
    return [(own, other), (other, own)]


def _nowhere(spots: list[MapPoint]) -> str:
    reached = sum(spot.fate == "requirement not met" for spot in spots)
    why = f"; {reached} can be reached, but not with all requirements met" if reached else ""
    return (
        f"none of the {len(spots)} targets has a posture with the tool as it must be{why}: move the box (--min, --max)"
    )
