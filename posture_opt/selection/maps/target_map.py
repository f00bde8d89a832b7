"""``map_targets``: the best posture and its spread over a grid of targets."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from posture_opt.errors import NoSolutionError
from posture_opt.interrupts import interruptible
from posture_opt.numerics import Array, Codes, Json, Mask, Progress
from posture_opt.result import Result
from posture_opt.robot.joint_ranges import drawn_between
from posture_opt.selection.answer.fallbacks import with_fallbacks
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.maps.confirmed_cells import confirmed_cells
from posture_opt.selection.maps.grid_layout import GridRequest, Plane, grid_of
from posture_opt.selection.maps.map_candidate import MapCandidate
from posture_opt.selection.maps.map_collisions import clear_candidates, in_the_way
from posture_opt.selection.maps.map_neighbours import Neighbourhood
from posture_opt.selection.maps.map_points import Grid, MapPoint, NeighbourSolves, packed_points
from posture_opt.selection.maps.map_rounds import worked_on
from posture_opt.selection.maps.map_search import best_candidates
from posture_opt.selection.maps.map_statements import map_statements
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.confirmation import UNCONFIRMED_JSON, Confirmation
from posture_opt.selection.search.engine import Engine
from posture_opt.statements import Statement, state
from posture_opt.workers import Executor, Workers, opened

WORKSPACE_SAMPLES = 4000  # tool points that show how far the workspace goes
TIE_TOLERANCE = 1e-6  # of σ: differences below it do not make one target better than another


@dataclass(frozen=True, eq=False, repr=False)
class TargetMap(Result):
    """The best posture and its spread at every target of a grid.

    Args:
        problem: what was asked; ``optimisation_problem`` of the first target with a posture.
        target: of the problem, with the direction of the task (world).
        grid: the targets; ``map_points`` N, one for each of ``grid.points``.
        own: the position in the problem file, where it has one.
        solves: what targets learnt from each other.
        seconds: wall time.
        notes: what was assumed, of the problem in sentences.
        confirmation: what IPOPT says of the best, the worst and the own target; None where it was not asked.
    """

    problem: ProblemData
    optimisation_problem: OptimisationProblem
    target: TaskTarget
    grid: Grid
    map_points: tuple[MapPoint, ...]
    own: MapPoint | None
    solves: NeighbourSolves
    seconds: float
    notes: tuple[str | Statement, ...] = ()
    confirmation: Confirmation | None = None

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """What the map has to say, the best target first."""
        return map_statements(self)

    @property
    def within(self) -> str:
        """The part of the spread that the task cares about: ``across``, ``along`` or ``all``."""
        return self.optimisation_problem.task.within

    @cached_property
    def feasible(self) -> Mask:
        """(N,) whether there is a posture."""
        return np.array([map_point.feasible for map_point in self.map_points])

    @cached_property
    def sigma(self) -> Array:
        """(N,) largest standard deviation of the part that counts [m]; NaN where there is no posture."""
        return np.array([map_point.sigma_max for map_point in self.map_points])

    @cached_property
    def postures(self) -> Array:
        """(N, n) postures [rad or m]; NaN where there is none."""
        return np.array([map_point.q for map_point in self.map_points])

    @property
    def best(self) -> MapPoint:
        """The target with the smallest spread."""
        return self.map_points[self.best_index]

    @property
    def worst(self) -> MapPoint:
        """The target with the largest spread among those that have a posture."""
        return self.map_points[self.worst_index]

    @property
    def best_index(self) -> int:
        """Number of the target with the smallest spread."""
        return self._extreme(1)

    @property
    def worst_index(self) -> int:
        """Number of the target with the largest spread among those that have a posture."""
        return self._extreme(-1)

    def _extreme(self, sign: int) -> int:
        """Index of the least (sign 1) or largest (−1) spread; of equal ones the target nearest to the middle of the
        map.
        """
        values = np.where(self.feasible, sign * self.sigma, np.inf)
        ties = np.flatnonzero(values <= values.min() + TIE_TOLERANCE * abs(values.min()))
        # Of equal targets the one nearest to the middle of the map.
        away = np.linalg.norm(self.grid.points[ties] - self.grid.points.mean(axis=0), axis=1)
        return int(ties[np.argmin(np.round(away, 9))])

    def fields_json(self) -> dict[str, Json]:
        """The document ``map.json``: SI units, finite numbers only."""
        joints = self.optimisation_problem.robot.joint_names
        return {
            "name": self.problem.name,
            "task": self.optimisation_problem.task.kind,
            "quantity": "spread",
            "within": self.within,
            "direction": self.target.direction.tolist(),
            "grid": self.grid.to_json(),
            "targets": [map_point.to_json(joints) for map_point in self.map_points],
            "best": self.best.to_json(joints),
            "worst": self.worst.to_json(joints),
            "own": None if self.own is None else self.own.to_json(joints),
            "neighbour_solves": self.solves.to_json(),
            "solver": UNCONFIRMED_JSON if self.confirmation is None else self.confirmation.to_json(),
            "seconds": self.seconds,
            "notes": [str(note) for note in self.notes],
        }


@interruptible()
def map_targets(
    problem: ProblemData,
    *,
    counts: tuple[int, ...] | None = None,
    low: tuple[float, float, float] | None = None,
    high: tuple[float, float, float] | None = None,
    plane: Plane | None = None,
    seed: int | None = None,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Progress | None = None,
    compiled: bool | None = None,
) -> TargetMap:
    """The best posture of the task, and its spread, at every target of a grid.

    The grid is in the plane of a planar arm, else across the direction of the task; it covers the task's region, else
    the surroundings of its position, else the workspace at the height of the best target.

    Args:
        problem: with a task and uncertain parameters.
        counts: (2,) targets along the sides of the plane, or (3,) along x, y, z.
        low, high: (3,) corners of the box that the targets are in [m], world.
        plane: ``xy``, ``xz`` or ``yz``.
        seed: of the random starts; default: the problem's. The answer does not depend on ``workers``.
        workers: processes to share the targets.
        executor: of `concurrent.futures`, or a Dask client, to share them instead; it stays open.
        progress: called with (done, total) steps.
        compiled: as of `PostureSelector`.

    Returns:
        ``TargetMap``: of each point of the grid the best posture [rad or m] and its standard deviation [m], or why
        there is none; ``to_dataframe()`` has a row a point.

    Raises:
        InputError: no task, nothing uncertain, or a grid that is none.
        NoSolutionError: no target of the grid has a posture.

    Example:
        >>> import posture_opt as po
        >>> found = po.map_targets(po.load_problem("insert_planar_2r"), counts=(3, 3), seed=0, compiled=False)
        >>> len(found.map_points), found.best.sigma_max <= found.worst.sigma_max
        (9, True)
    """
    request = GridRequest(counts, low, high, plane)
    request.check()
    seed = problem.solver.seed if seed is None else seed
    with opened(workers, executor) as pool:
        return with_fallbacks(problem, lambda one: _mapped(one, request, pool, seed, progress, compiled))


def _mapped(
    problem: ProblemData, request: GridRequest, pool: Workers, seed: int, progress: Progress | None,
    compiled: bool | None,
) -> TargetMap:  # fmt: skip
    """The map of a problem, by the workers.

    Raises:
        NoSolutionError: no target of the grid has a posture.
    """
    began = time.perf_counter()
    selector = PostureSelector(problem, compiled=compiled)
    grid = _grid(problem, selector, request)
    own = [selector.target.lower] if selector.target.kind == "point" else []
    targets = [selector.target.with_position(point) for point in (*grid.points, *own)]
    engines = [selector.engine(target, guarded=False) for target in targets]
    pairs = (*grid.neighbours, *_beside(grid, len(targets), targets))
    points = np.array([target.lower for target in targets])
    neighbourhood = Neighbourhood.of(problem.arm, selector.target.direction, points, pairs)
    searched, cleared, spread = _parts(progress, len(targets), problem.scene.active)
    candidates, solves = best_candidates(engines, targets, neighbourhood, pool, seed=seed, progress=searched)
    unguarded = [candidate.best for candidate in candidates]
    candidates = clear_candidates(
        problem.scene, selector.clear_engine, targets, candidates, pairs, pool, seed=seed, progress=cleared
    )
    map_points = [
        found if found.feasible or best is None else replace(found, blocked_by=in_the_way(problem.scene, best.q))
        for found, best in zip(_points(pool, engines[0], targets, candidates, spread), unguarded, strict=True)
    ]
    size = len(grid.points)
    feasible = [map_point.feasible for map_point in map_points]
    if not any(feasible[:size]):
        raise NoSolutionError(_nowhere(map_points[:size]))
    solved = engines[feasible.index(True)].optimisation_problem
    found = TargetMap(
        problem=problem,
        optimisation_problem=solved,
        target=selector.target,
        grid=grid,
        map_points=tuple(map_points[:size]),
        own=map_points[size] if own else None,
        solves=solves,
        seconds=time.perf_counter() - began,
        notes=(*problem.notes, solved.axis_note(selector.target), *selector.remarks(), *_narrowed_notes(problem)),
    )
    named = (found.best_index, found.worst_index, *([size] if own else []))
    better, said = confirmed_cells(selector.engine, targets, candidates, named, problem.scene)
    for k, candidate in better.items():
        (map_points[k],) = _points(pool, engines[0], targets[k : k + 1], [candidate], None)
    return replace(
        found,
        map_points=tuple(map_points[:size]),
        own=map_points[size] if own else None,
        confirmation=said,
        seconds=time.perf_counter() - began,
    )


def _parts(progress: Progress | None, count: int, cell: bool) -> list[Progress | None]:
    """The progress of the three parts of a map, as steps of the whole: about as many as each takes time."""
    ends = np.cumsum([0, count, 4 * count if cell else 0, count // 3]).tolist()

    def part(begin: int, end: int) -> Progress | None:
        if progress is None:
            return None
        return lambda done, most: progress(begin + (end - begin) * done // max(most, 1), ends[-1])

    return [part(begin, end) for begin, end in pairwise(ends)]


def _points(
    pool: Workers,
    engine: Engine,
    targets: Sequence[TaskTarget],
    candidates: Sequence[MapCandidate],
    progress: Progress | None,
) -> list[MapPoint]:
    """A map point for every target, computed by the workers in chunks of targets."""
    found: dict[int, MapPoint] = {}

    def item(chunk: Sequence[int]) -> tuple[list[TaskTarget], list[MapCandidate]]:
        return [targets[k] for k in chunk], [candidates[k] for k in chunk]

    for k, row in worked_on(pool, packed_points, [engine] * len(targets), range(len(targets)), item):
        found[k] = MapPoint.unpacked(targets[k].lower, row)
        if progress is not None:
            progress(len(found), len(targets))
    return [found[k] for k in range(len(targets))]


def _grid(problem: ProblemData, selector: PostureSelector, request: GridRequest) -> Grid:
    """The grid that is asked for, else one over the region, about the position, or over the workspace."""
    target, robot = selector.target, problem.robot
    rng = np.random.default_rng(0)
    Q = rng.uniform(*drawn_between(robot), (WORKSPACE_SAMPLES, robot.n))
    positions = np.broadcast_to(np.asarray(problem.arm.position(Q), dtype=float), (WORKSPACE_SAMPLES, 3))
    best = None
    if target.kind == "anywhere" and request.low is None:
        best = np.asarray(selector.solve().spread.position)
    return grid_of(request, target, selector.reach, positions, best)


def _narrowed_notes(problem: ProblemData) -> tuple[Statement, ...]:
    """What the targets lack that a single solve answers: postures beyond the ranges that effects were measured in."""
    if not problem.narrowed:
        return ()
    joints = tuple(dict.fromkeys(found.effect.target for found in problem.arm.measured_ranges))
    return (state("selection.beyond-range-left-out", joints=joints),)


def _beside(grid: Grid, count: int, targets: list[TaskTarget]) -> list[tuple[Codes, Codes]]:
    """The file's own position and the target next to it are neighbours."""
    if count == len(grid.points):
        return []
    nearest = int(np.argmin(np.linalg.norm(grid.points - targets[-1].lower, axis=1)))
    own, other = np.array([count - 1]), np.array([nearest])
    return [(own, other), (other, own)]


def _nowhere(map_points: list[MapPoint]) -> str:
    """Why no target of the grid has a posture, in words."""
    reached = sum(map_point.status == "requirement not met" for map_point in map_points)
    why = f"; {reached} can be reached, but not with all requirements met" if reached else ""
    targets = f"none of the {len(map_points)} targets"
    return f"{targets} has a posture with the required tool orientation{why}: move the box (--min, --max)"
