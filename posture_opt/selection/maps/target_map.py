"""``map_targets``: the best posture and its spread over a grid of targets."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from posture_opt.collision.scene import Scene, scene_statements
from posture_opt.errors import NoSolutionError
from posture_opt.interrupts import interruptible
from posture_opt.numerics import Array, Json, Mask, Progress
from posture_opt.result import Result
from posture_opt.robot.posture import drawn_between
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.solution_statements import (
    NO_GAIN,
    beyond_measured,
    confirmed,
    free_frames,
    free_joints,
)
from posture_opt.selection.maps.grid_layout import Grid, GridRequest, Plane, grid_of
from posture_opt.selection.maps.map_exchange import Neighbourhood, worked_on
from posture_opt.selection.maps.map_points import MapCandidate, MapPoint, NeighbourSolves, packed_points
from posture_opt.selection.maps.map_search import SELF_COLLISION, best_candidates, clear_candidates
from posture_opt.selection.problem_data import ProblemData, with_fallbacks
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.registered_tasks import part_words
from posture_opt.selection.search.engine import UNCONFIRMED_JSON, Confirmation, Engine, joined_confirmation
from posture_opt.selection.search.search_outcome import confirmed as confirmed_posture
from posture_opt.selection.search.search_outcome import nearest_to_clear
from posture_opt.statements import Quantity, Statement, state
from posture_opt.statements.notation import place
from posture_opt.workers import Executor, Workers, opened


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
        """Statements, the best target first."""
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
        values = np.where(self.feasible, sign * self.sigma, np.inf)
        ties = np.flatnonzero(values <= values.min() + 1e-6 * abs(values.min()))  # of σ
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
    began = time.perf_counter()
    selector, scene = PostureSelector(problem, compiled=compiled), problem.scene
    grid = _grid(problem, selector, request)
    own = [selector.target.lower] if selector.target.kind == "point" else []
    targets = [selector.target.with_position(point) for point in (*grid.points, *own)]
    engines = [selector.engine(target, guarded=False) for target in targets]
    points, size = np.array([target.lower for target in targets]), len(grid.points)
    pairs = list(grid.neighbours)
    if own:  # beside the target next to it
        one, nearest = np.array([size]), np.array([np.argmin(np.linalg.norm(grid.points - own[0], axis=1))])
        pairs += [(one, nearest), (nearest, one)]
    neighbourhood = Neighbourhood.of(problem.arm, selector.target.direction, points, pairs)
    searched, cleared, spread = _parts(progress, len(targets), scene.active)
    unguarded, solves = best_candidates(engines, targets, neighbourhood, pool, seed=seed, progress=searched)
    candidates = clear_candidates(
        scene, selector.clear_engine, targets, unguarded, pairs, pool, seed=seed, progress=cleared
    )
    map_points = _points(pool, engines[0], targets, candidates, spread)
    for k, point in enumerate(map_points):
        if unguarded[k].best and not point.feasible:
            map_points[k] = replace(point, blocked_by=_in_the_way(engines[k], targets[k], scene, seed))
    if not any(point.feasible for point in map_points[:size]):
        raise NoSolutionError(_nowhere(map_points[:size]))
    solved = next(e for e, point in zip(engines, map_points, strict=True) if point.feasible).optimisation_problem
    remarks = (*problem.remarks, *_narrowed_notes(problem))
    notes: tuple[str | Statement, ...] = (*problem.notes, solved.axis_note(selector.target), *remarks)

    def found(said: Confirmation | None = None) -> TargetMap:
        at_own, seconds = map_points[size] if own else None, time.perf_counter() - began
        of_grid = tuple(map_points[:size])
        return TargetMap(
            problem, solved, selector.target, grid, of_grid, at_own, solves, seconds, notes, confirmation=said
        )

    named = (found().best_index, found().worst_index, *([size] if own else []))
    better, said = _confirmed_targets(selector.engine, targets, candidates, named, scene)
    for k, candidate in better.items():
        (map_points[k],) = _points(pool, engines[0], targets[k : k + 1], [candidate], None)
    return found(said)


def _in_the_way(engine: Engine, target: TaskTarget, scene: Scene, seed: int) -> str:
    nearest = nearest_to_clear(engine, target, scene, seed)
    return "" if nearest is None else SELF_COLLISION if nearest.own else nearest.names[1]


def _confirmed_targets(
    engine_of: Callable[[TaskTarget, bool], Engine], targets: Sequence[TaskTarget],
    candidates: Sequence[MapCandidate], named: Iterable[int], scene: Scene,
) -> tuple[dict[int, MapCandidate], Confirmation | None]:  # fmt: skip
    better: dict[int, MapCandidate] = {}
    every: list[Confirmation | None] = []
    for k in dict.fromkeys(named):
        given = candidates[k]
        if given.best is None:
            continue
        target = replace(targets[k], scale=given.scale)
        (best, *_), said = confirmed_posture(engine_of(target, False), [given.best], target, scene)
        if said is not None and said.differs and not said.taken and scene.active:
            (best, *_), said = confirmed_posture(engine_of(target, True), [given.best], target, scene)
        every.append(said)
        if said is not None and said.taken:
            better[k] = replace(given, best=best)
    return better, joined_confirmation(every)


def _parts(progress: Progress | None, count: int, cell: bool) -> list[Progress | None]:
    ends = np.cumsum([0, count, 4 * count if cell else 0, count // 3]).tolist()

    def part(begin: int, end: int) -> Progress | None:
        if progress is None:
            return None
        return lambda done, most: progress(begin + (end - begin) * done // max(most, 1), ends[-1])

    return [part(begin, end) for begin, end in pairwise(ends)]


def _points(
    pool: Workers, engine: Engine, targets: Sequence[TaskTarget], candidates: Sequence[MapCandidate],
    progress: Progress | None,
) -> list[MapPoint]:  # fmt: skip
    found: dict[int, MapPoint] = {}

    def item(k: int) -> tuple[TaskTarget, MapCandidate]:
        return targets[k], candidates[k]

    for k, row in worked_on(pool, packed_points, [engine] * len(targets), range(len(targets)), item):
        found[k] = MapPoint.unpacked(targets[k].lower, row)
        if progress is not None:
            progress(len(found), len(targets))
    return [found[k] for k in range(len(targets))]


def _grid(problem: ProblemData, selector: PostureSelector, request: GridRequest) -> Grid:
    target, robot = selector.target, problem.robot
    Q = np.random.default_rng(0).uniform(*drawn_between(robot), (4000, robot.n))
    positions = np.broadcast_to(np.asarray(problem.arm.position(Q), dtype=float), (4000, 3))
    best = None
    if target.kind == "anywhere" and request.low is None:
        best = np.asarray(selector.solve().spread.position)
    return grid_of(request, target, selector.reach, positions, best)


def _narrowed_notes(problem: ProblemData) -> tuple[Statement, ...]:
    if not problem.narrowed:
        return ()
    joints = tuple(dict.fromkeys(found.effect.target for found in problem.arm.measured_ranges))
    return (state("selection.beyond-range-left-out", joints=joints),)


def _nowhere(map_points: list[MapPoint]) -> str:
    reached = sum(map_point.status == "requirement not met" for map_point in map_points)
    why = f"; {reached} can be reached, but not with all requirements met" if reached else ""
    targets = f"none of the {len(map_points)} targets"
    return f"{targets} has a posture with the required tool orientation{why}: move the box (--min, --max)"


def map_statements(found: TargetMap) -> tuple[Statement, ...]:
    """All statements, the best target first."""
    best, worst, Q = found.best, found.worst, found.postures[found.feasible]
    part = part_words(found.within, found.optimisation_problem.task.kind)
    return (
        state("selection.best-target", position=place(best.position), sigma=Quantity(best.sigma_max), part=part),
        *([] if found.own is None else [_own(best, found.own)]),
        state("selection.worst-target", sigma=Quantity(worst.sigma_max), position=place(worst.position)),
        *free_joints(found.optimisation_problem),
        *scene_statements(found.problem.scene, Q),
        *beyond_measured(found.problem.arm, Q),
        *confirmed(found.confirmation),
        *{note.text: note for note in found.notes if isinstance(note, Statement)}.values(),
        *free_frames(found.problem.robot),
    )


def _own(best: MapPoint, own: MapPoint) -> Statement:
    if not own.feasible:
        return state("selection.own-target-infeasible")
    gain = 1 - best.sigma_max / own.sigma_max if own.sigma_max > 0 else 0.0
    sigma = Quantity(own.sigma_max)
    if gain < NO_GAIN:
        return state("selection.own-target-best", sigma=sigma)
    return state("selection.own-target", sigma=sigma, gain=Quantity(gain, "share"))
