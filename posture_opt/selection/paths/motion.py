"""``Motion``: postures along a path, how good they are, and how far the joints move between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array, Mask
from posture_opt.selection.paths.task_path import stacked
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.confirmation import Confirmation
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.search.search_outcome import is_clear

_POSTURES_BETWEEN = 7  # postures between two points that are looked at
_MAX_DEVIATION_SHARE = 0.5  # of the distance between two points: off the line by more is no way along it


@dataclass(frozen=True)
class Motion:
    """Postures Q (K, n) [rad or m] of the points of a path.

    Args:
        objectives: (K,), scaled; violations: (K,) the worst row of each [m, rad or 1].
        clear: whether all joints keep their limits, and the arm collides with nothing, at the points.
        sigma: (K,) largest standard deviation in the part that counts [m].
        steps: (L − 1,) largest range that a joint sweeps between neighbours of the L listed points [rad or m].
        optimal: whether first-order conditions hold, or nothing was left to choose but between separate postures.
        confirmation: what IPOPT says of the motion where it found it; None of other motions.
    """

    Q: Array
    objectives: Array
    violations: Array
    sigma: Array
    steps: Array
    optimal: bool
    clear: bool
    confirmation: Confirmation | None = None

    @classmethod
    def of(
        cls, engine: Engine, targets: Sequence[TaskTarget], Q: Array, steps: Array, scene: Scene, optimal: bool
    ) -> Motion:
        """The motion through postures Q (K, n), evaluated at the targets of its points.

        Args:
            steps: (L − 1,), ``optimal``: as of `Motion`.
            scene: what the arm must not collide with.
        """
        inside = np.all((np.array(engine.robot.lower) <= Q) & (np.array(engine.robot.upper) >= Q))
        clear = bool(inside and np.all(is_clear(scene, Q)))
        objective, violation, _, variance = (column[:, 0] for column in engine.screen(Q, stacked(targets)))
        return cls(Q, objective, violation, np.sqrt(np.maximum(variance, 0.0)), steps, optimal, clear)

    @property
    def objective(self) -> float:
        """The objective of the worst point, scaled."""
        return float(np.max(self.objectives))

    @property
    def feasible(self) -> bool:
        """Whether all requirements are met at all points."""
        return self.clear and float(np.max(self.violations)) <= ROW_TOLERANCE

    @property
    def largest_step(self) -> float:
        """The largest change of a joint between listed points [rad or m]."""
        return float(np.max(self.steps))

    def to_json(self) -> dict[str, float]:
        """Largest scatter [m] and largest step [rad or m]."""
        return {"sigma_max": float(self.sigma.max()), "step": self.largest_step}

    @property
    def worst(self) -> int:
        """Number of the point with the largest scatter."""
        return int(np.argmax(self.sigma))


def breaks_away(engine: Engine, Q: Array) -> Mask:
    """(K − 1,) whether the tool leaves the path from one of the postures (K, n) to the next, joints moving evenly.

    By more than half of the distance between them.
    """
    ends = _positions(engine)(Q)
    return np.asarray(off_lines(engine, Q) > _MAX_DEVIATION_SHARE * np.linalg.norm(np.diff(ends, axis=0), axis=1))


def _positions(engine: Engine) -> BatchFunction:
    """Postures (N, n) to nominal tool points (N, 3) [m]."""
    at = engine.optimisation_problem.quantities
    return BatchFunction(ca.Function("position", [at.q], [at.position]), compiled=False)


def off_lines(engine: Engine, Q: Array) -> Array:
    """(K − 1,) how far [m] the tool point leaves the straight lines between points, where all joints move evenly.

    Args:
        Q: (K, n) postures at the points.
    """
    shares = np.linspace(0.0, 1.0, _POSTURES_BETWEEN + 2)[1:-1]
    between = Q[:-1, None] + shares[:, None] * (Q[1:] - Q[:-1])[:, None]
    position = _positions(engine)
    reached = position(between.reshape(-1, Q.shape[1])).reshape(len(Q) - 1, _POSTURES_BETWEEN, 3)
    ends = position(Q)
    start, way = ends[:-1, None], (ends[1:] - ends[:-1])[:, None]
    along = np.clip(np.sum((reached - start) * way, axis=2) / np.sum(way**2, axis=2), 0.0, 1.0)
    return np.asarray(np.max(np.linalg.norm(reached - start - along[..., None] * way, axis=2), axis=1))
