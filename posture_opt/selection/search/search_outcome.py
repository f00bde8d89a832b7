"""``SearchOutcome``: the feasible postures that one search found, and what of them keeps clear of collisions.

Rows that keep the arm clear make each step of a search several times dearer, and most of the time the best posture is
clear without them. So the search is made without: if the best of all postures is clear, it is the best of those that
are. Only otherwise the search is made again with the rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from posture_opt.collision.contacts import ContactSlack
from posture_opt.collision.scene import Scene
from posture_opt.encoding import encoded
from posture_opt.numerics import Array, Json, Mask
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import UNCONFIRMED_JSON, CandidatePosture, Confirmation, Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, TOLERANCE, PoseRequest
from posture_opt.selection.search.multistart import MultistartResult, Sampled, as_good, rank
from posture_opt.selection.solvers import Outcome

# A search with the functions of one engine, at one target
Seek = Callable[[Engine, TaskTarget], "tuple[MultistartResult, Sweep | None]"]
Keeper = Scene | ContactSlack  # what says by how much postures keep the distances that are asked for
DISTANCE_ROUNDING = 1e-9  # m: rounding of a distance


@dataclass(frozen=True)
class SearchOutcome:
    """What random starts and a sweep led to."""

    engine: Engine
    found: MultistartResult
    swept: Sweep | None  # None where the problem allows none
    by_sweep: tuple[CandidatePosture, ...]

    @classmethod
    def of(cls, engine: Engine, found: MultistartResult, swept: Sweep | None) -> SearchOutcome:
        """The feasible postures of a search, the best one of its sweep improved."""
        by_sweep = () if swept is None else (engine.polished(swept.best, found.target),)
        return cls(engine, found, swept, by_sweep)

    @property
    def by_starts(self) -> tuple[CandidatePosture, ...]:
        """The feasible ones."""
        return tuple(c for c in self.found.found if c.feasible)

    @cached_property
    def feasible(self) -> list[CandidatePosture]:
        return sorted(self.by_starts + self.by_sweep, key=rank)

    def clear_of(self, scene: Keeper) -> SearchOutcome | None:
        """The outcome without collisions, or None if nothing clear is as good as the best."""
        by_starts, by_sweep = (clear_ones(group, scene) for group in (self.by_starts, self.by_sweep))
        left = sorted(by_starts + by_sweep, key=rank)
        if not left or left[0].objective > as_good(self.feasible[0].objective):
            return None
        sampled, clear = self.found.sampled, is_clear(scene, self.found.sampled.Q)
        others = tuple(c for c in self.found.found if not c.feasible)
        kept = Sampled(sampled.robot, sampled.Q[clear], sampled.sigma[clear])
        found = replace(self.found, found=by_starts + others, sampled=kept)
        return replace(self, found=found, by_sweep=by_sweep)


def searched(
    seek: Seek, target: TaskTarget, free: Engine, guarded: Callable[[], Engine], scene: Keeper
) -> SearchOutcome:
    """The outcome of ``seek`` without rows for collisions; with ``guarded`` ones where its best posture collides."""
    outcome = SearchOutcome.of(free, *seek(free, target))
    if not scene.active or not outcome.feasible:
        return outcome
    clear = outcome.clear_of(scene)
    if clear is not None:
        return clear
    engine = guarded()
    return SearchOutcome.of(engine, *seek(engine, target))


def clear_ones(candidates: tuple[CandidatePosture, ...], scene: Keeper) -> tuple[CandidatePosture, ...]:
    """Candidates at the required distance, by exact distances."""
    if not candidates:
        return ()
    clear = is_clear(scene, np.array([candidate.q for candidate in candidates]))
    return tuple(candidate for candidate, yes in zip(candidates, clear, strict=True) if yes)


def is_clear(scene: Keeper, Q: Array) -> Mask:
    """(N,) whether postures Q (N, n) [rad or m] keep the distance asked for, by exact distances."""
    if not len(Q):
        return np.zeros(0, dtype=bool)
    return np.asarray(scene.slack(Q) >= -DISTANCE_ROUNDING)


class Lacking(NamedTuple):
    """The pair of bodies that lacks most of its distance, at the posture of a target that lacks least."""

    names: tuple[str, str]
    own: bool  # whether both are of the arm
    distance: float  # [m]
    required: float  # [m]


_TRIED = 48  # Postures at a target that are looked at for `nearest_to_clear`: by choice


def nearest_to_clear(engine: Engine, target: TaskTarget, scene: Scene, seed: int) -> Lacking | None:
    """What keeps postures from a target, at once and without a search; None where no start arrives there."""
    rng = np.random.default_rng(seed)
    starts = engine.ik.random_postures(_TRIED, rng)
    (reached,) = engine.ik.reached([starts], [engine.request(target, _TRIED, rng)])
    if not len(reached) or not scene.active:
        return None
    distances = scene.distances(reached[np.argmax(scene.slack(reached))])[0]
    k = int(np.argmin(distances - np.array(scene.required)))
    return Lacking(scene.pairs[k], k < len(scene.own), float(distances[k]), scene.required[k])


def at_first_sight(engine: Engine, found: MultistartResult, scene: Scene) -> str:
    """Why a search may have found nothing, in a clause; the reasons themselves take longer."""
    if not found.arrived:
        return "the target seems to be out of reach"
    nearest = nearest_to_clear(engine, found.target, scene, 0)
    if nearest is None or nearest.distance >= nearest.required:
        return "no posture was found that does the task"
    to = " and ".join(nearest.names) if nearest.own else nearest.names[1]
    return f"clearance {1e3 * nearest.distance:.1f} of {1e3 * nearest.required:.4g} mm to {to}"


_SPIN_STEPS = 120  # steps of 3°: the optimum over the spin is several of them wide


@dataclass(frozen=True)
class Sweep:
    """A systematic sweep."""

    over: str  # what was swept, in words
    points: int
    feasible: int  # points that met every requirement
    best: CandidatePosture  # before it is improved


@dataclass(frozen=True)
class SearchStatistics:
    """How the answer was searched for."""

    starts: int  # random postures that arrived
    tried: int  # random postures
    polished: int  # local searches
    sampled: Sampled  # starts that met every requirement
    seconds: float
    converged: int = 0  # distinct optima by first-order conditions
    distinct: int = 0  # local optima
    hits: int = 0  # starts that ended at the best one
    batches: int = 1
    recurred: int = 0  # batches that found the best optimum
    sweep: Sweep | None = None
    confirmation: Confirmation | None = None

    @property
    def sweep_sigma(self) -> float:
        """The best of the sweep [m]; NaN without one."""
        return math.nan if self.sweep is None else self.sweep.best.sigma

    @property
    def feasible(self) -> int:
        return len(self.sampled.Q)

    @property
    def typical(self) -> float:
        """σ_max [m], median over the distinct feasible starts; NaN where there are none."""
        return self.sampled.typical

    @property
    def worst(self) -> float:
        """σ_max [m] of the worst feasible start; NaN where there are none."""
        return self.sampled.worst

    def to_json(self) -> dict[str, Json]:
        """The part ``solver`` of ``solution.json``."""
        names = "starts feasible tried polished converged distinct hits batches recurred seconds"
        said = UNCONFIRMED_JSON if self.confirmation is None else self.confirmation.to_json()
        return {**said, **encoded(self, names)}


def sweep(engine: Engine, target: TaskTarget, rng: np.random.Generator) -> Sweep | None:
    """Sweep over both joint angles (91 x 91), or over the spin (120 x 8 starts); None where more is free."""
    robot, problem = engine.robot, engine.optimisation_problem
    if robot.n <= 2 and target.kind != "point":
        # Steps of 4° over a turn
        axes = [np.linspace(low, high, 91) for low, high in zip(robot.lower, robot.upper, strict=True)]
        Q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, robot.n)
        return _evaluate(engine, target, Q, "a grid of 91 values of each joint")
    if target.spun:
        return None  # what would be swept is held
    fixed = problem.reach.directions.shape[1] + problem.axis_rows
    if target.kind == "point" and target.tilt == 0 and problem.axis_rows == 2 and robot.n == fixed + 1:
        return _evaluate(engine, target, _spun(engine, target, rng), f"the spin of the tool in {_SPIN_STEPS} steps")
    return None


def _spun(engine: Engine, target: TaskTarget, rng: np.random.Generator) -> Array:
    """Postures (k, n) on the target at spins φ, where the spin vector is ``cos φ b₁ + sin φ b₂``."""
    # A 6R wrist has eight branches (Pieper 1968)
    angles = np.repeat(np.arange(_SPIN_STEPS) * 2 * np.pi / _SPIN_STEPS, 8)
    spin = np.cos(angles)[:, None] * target.axis_basis[:, 0] + np.sin(angles)[:, None] * target.axis_basis[:, 1]
    request = PoseRequest(target.lower, target.axis, spin, np.ones(3))
    Q, errors = engine.ik.solve(engine.ik.random_postures(len(angles), rng), request)
    return Q[errors < TOLERANCE]


def _evaluate(engine: Engine, target: TaskTarget, Q: Array, over: str) -> Sweep | None:
    """The best feasible posture of Q (N, n) and their number, or None."""
    if not len(Q):
        return None
    objective, violation = (column[:, 0] for column in engine.screen(Q, target.parameters)[:2])
    feasible = violation <= ROW_TOLERANCE
    if not np.any(feasible):
        return None
    k = int(np.argmin(np.where(feasible, objective, np.inf)))
    best = engine.candidates(Q[k : k + 1], target)[0]
    return Sweep(over, len(Q), int(np.count_nonzero(feasible)), best)


_BETTER = 1e-6  # of the objective: what agrees to the sixth digit is as good, and the tidier joint values stay


def confirmed(
    engine: Engine, best_first: Sequence[CandidatePosture], target: TaskTarget, scene: Scene
) -> tuple[list[CandidatePosture], Confirmation | None]:
    """The postures after the solver was started at the best few, and its word; None with more rows than joints."""
    given = best_first[0]
    if not engine.confirming.solvable(target.parameters):
        return list(best_first), None
    ends = [_ended(engine, start, target, scene) for start in (given, *_rivals(best_first))]
    iterations = sum(one.iterations for _, one in ends)
    own = ends[0][1]
    best, confirmation = given, own
    for end, one in ends:
        if end is not None and end.objective < best.objective - _BETTER * max(1.0, abs(best.objective)):
            end = engine.tidied([end], target)[0]
            best, confirmation = end, replace(one, agrees=max(own.agrees, _apart(end, given)), taken=True)
    if best is given and ends[0][0] is not None and not own.differs:
        best = replace(given, optimal=True)
    every = [best, *best_first]
    left = engine.clusters(np.array([one.q for one in every]))[0]
    return [every[k] for k in left], replace(confirmation, iterations=iterations)


def _rivals(best_first: Sequence[CandidatePosture]) -> Sequence[CandidatePosture]:
    best = best_first[0].objective
    more = [(one.objective - best) / max(abs(best), _BETTER) for one in best_first[1:]]
    # Beyond 2 % no difference of two methods decides
    near = [one for one, gap in zip(best_first[1:], more, strict=True) if _BETTER < gap <= 0.02]
    return near[:2]


def _ended(
    engine: Engine, start: CandidatePosture, target: TaskTarget, scene: Scene
) -> tuple[CandidatePosture | None, Confirmation]:
    """Where the solver ends, or None; a worse end is tried once more with a larger barrier."""
    parameters = target.parameters
    first = _said(engine, start, target, scene, engine.confirming.solve(start.q, parameters))
    if not first[1].differs or (first[0] is not None and first[0].objective < start.objective):
        return first
    ends = engine.optimisation_problem.nlp.ends(parameters)
    again = _said(engine, start, target, scene, engine.fallback_solver(start.q, parameters, ends))
    return again if again[0] is not None and (first[0] is None or again[0].objective < first[0].objective) else first


def _said(
    engine: Engine, start: CandidatePosture, target: TaskTarget, scene: Scene, outcome: Outcome
) -> tuple[CandidatePosture | None, Confirmation]:
    if not np.all(np.isfinite(outcome.x)):
        return None, Confirmation(engine.solver.kind, outcome.iterations, np.nan, np.nan)
    end = engine.candidates(outcome.x[None], target)[0]
    end = replace(end, optimal=outcome.optimal, message=outcome.message, count=start.count)
    said = Confirmation(
        engine.solver.kind, outcome.iterations, outcome.residual, _apart(end, start), False,
        outcome.x, outcome.row_multipliers, outcome.bound_multipliers,
    )  # fmt: skip
    does = outcome.optimal and end.feasible and bool(is_clear(scene, end.q[None])[0])
    return (end if does else None), said


def _apart(end: CandidatePosture, start: CandidatePosture) -> float:
    return abs(end.sigma - start.sigma) / max(end.sigma, start.sigma, 1e-9)  # arms exist whose errors cancel
