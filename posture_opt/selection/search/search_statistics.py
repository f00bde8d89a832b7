"""``SearchStatistics``: what a search did, and the systematic sweep that is made in addition to its random starts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array, Json
from posture_opt.selection.program.pose_request import PoseRequest
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.confirmation import UNCONFIRMED_JSON, Confirmation
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, TOLERANCE
from posture_opt.selection.search.multistart import MultistartResult, Sampled, as_good

_SPIN_STEPS = 120  # steps of 3°: the optimum over the spin is several of them wide
_STARTS_PER_SPIN = 8  # starts at each angle: a 6R wrist has that many branches (Pieper 1968)
_GRID_VALUES = 91  # values of each joint: steps of 4° over a turn


@dataclass(frozen=True)
class Sweep:
    """A systematic sweep.

    Args:
        over: what was swept, in words; ``points`` in how many points, ``feasible`` of them met every requirement.
        best: the best of these, before it is improved.
    """

    over: str
    points: int
    feasible: int
    best: CandidatePosture


@dataclass(frozen=True)
class SearchStatistics:
    """How the answer was searched for.

    Args:
        tried: random postures that were led towards the target.
        starts: those of them that arrived, with the tool axis as it should be.
        polished: local searches; ``converged`` of the distinct optima kept are so by first-order conditions.
        distinct: different local optima among them; ``hits`` of the polished starts ended at the best one.
        sampled: those of these that meet all further requirements too.
        sweep: a systematic sweep in addition to the random starts, or None; ``sweep_sigma`` its best [m].
        batches: independent searches of as many starts; ``recurred`` of them found the best optimum.
        seconds: wall time.
        confirmation: what the solver of the problem says of the answer; None where it was not asked.
    """

    starts: int
    tried: int
    polished: int
    converged: int
    distinct: int
    hits: int
    sampled: Sampled
    sweep: Sweep | None
    sweep_sigma: float
    batches: int
    recurred: int
    seconds: float
    confirmation: Confirmation | None = None

    @classmethod
    def of(
        cls,
        found: MultistartResult,
        swept: Sweep | None,
        feasible: Sequence[CandidatePosture],
        best: CandidatePosture,
        distinct: int,
        seconds: float,
        confirmation: Confirmation | None = None,
    ) -> SearchStatistics:
        """What the search did; ``feasible`` are the answers that its starts led to, ``best`` is the final one."""
        return cls(
            starts=found.arrived,
            tried=found.tried,
            polished=found.polished,
            converged=sum(c.optimal for c in feasible),
            distinct=distinct,
            hits=found.hits if found.found and found.found[0].objective <= as_good(best.objective) else 0,
            sampled=found.sampled,
            sweep=swept,
            sweep_sigma=math.nan if swept is None else swept.best.sigma,
            batches=found.batches,
            recurred=found.recurred,
            seconds=seconds,
            confirmation=confirmation,
        )

    @property
    def feasible(self) -> int:
        """How many starts met every requirement."""
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
        counts = (
            "starts",
            "feasible",
            "tried",
            "polished",
            "converged",
            "distinct",
            "hits",
            "batches",
            "recurred",
            "seconds",
        )
        said = UNCONFIRMED_JSON if self.confirmation is None else self.confirmation.to_json()
        return {**said, **{name: getattr(self, name) for name in counts}}


def sweep(engine: Engine, target: TaskTarget, rng: np.random.Generator) -> Sweep | None:
    """The sweep that the problem allows: over both joint angles, or over the spin of the tool; else None.

    It covers the whole of what is free, so that random starts can be compared with it in every run: 91 x 91 postures
    of an arm with two joints, or 120 spins of the tool with eight starts each where one degree of freedom is left.
    """
    robot, problem = engine.robot, engine.optimisation_problem
    if robot.n <= 2 and target.kind != "point":
        axes = [np.linspace(low, high, _GRID_VALUES) for low, high in zip(robot.lower, robot.upper, strict=True)]
        Q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, robot.n)
        return _evaluate(engine, target, Q, f"a grid of {_GRID_VALUES} values of each joint")
    if target.spun:
        return None  # what would be swept is held
    fixed = problem.reach.directions.shape[1] + problem.axis_rows
    if target.kind == "point" and target.tilt == 0 and problem.axis_rows == 2 and robot.n == fixed + 1:
        return _evaluate(engine, target, _spun(engine, target, rng), f"the spin of the tool in {_SPIN_STEPS} steps")
    return None


def _spun(engine: Engine, target: TaskTarget, rng: np.random.Generator) -> Array:
    """Postures (k, n) that reach the target with the tool's spin held at each of many angles, every branch sought anew.

    At the spin φ the spin vector is ``cos φ b₁ + sin φ b₂`` with the unit vectors b across the wanted axis.
    """
    angles = np.repeat(np.arange(_SPIN_STEPS) * 2 * np.pi / _SPIN_STEPS, _STARTS_PER_SPIN)
    spin = np.cos(angles)[:, None] * target.axis_basis[:, 0] + np.sin(angles)[:, None] * target.axis_basis[:, 1]
    request = PoseRequest(target.lower, target.axis, spin, np.ones(3))
    Q, errors = engine.ik.solve(engine.ik.random_postures(len(angles), rng), request)
    return Q[errors < TOLERANCE]


def _evaluate(engine: Engine, target: TaskTarget, Q: Array, over: str) -> Sweep | None:
    """The best feasible posture of Q (N, n), and how many there are; None where there is none."""
    if not len(Q):
        return None
    objective, violation = (column[:, 0] for column in engine.screen(Q, target.parameters)[:2])
    feasible = violation <= ROW_TOLERANCE
    if not np.any(feasible):
        return None
    k = int(np.argmin(np.where(feasible, objective, np.inf)))
    best = engine.candidates(Q[k : k + 1], target)[0]
    return Sweep(over, len(Q), int(np.count_nonzero(feasible)), best)
