"""``Motion``: postures along a path; ``TimeLaw``: their times; ``PathBreak``: where they leave the path."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import TURN, Array, Json, Mask
from posture_opt.robot.robot import Robot
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.paths.path_candidates import held
from posture_opt.selection.paths.task_path import TaskPath, between, stacked
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Confirmation, Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, TOLERANCE
from posture_opt.selection.search.search_outcome import is_clear


@dataclass(frozen=True)
class Motion:
    """Postures Q (K, n) [rad or m] of the points of a path."""

    Q: Array
    objectives: Array  # (K,), scaled
    violations: Array  # (K,) the worst row of each [m, rad or 1]
    sigma: Array  # (K,) largest standard deviation in the part that counts [m]
    steps: Array  # (L − 1,) largest range that a joint sweeps between neighbours of the L listed points [rad or m]
    optimal: bool  # whether first-order conditions hold, or nothing was left to choose but between separate postures
    clear: bool  # whether all joints keep their limits, and the arm collides with nothing, at the points
    confirmation: Confirmation | None = None  # what IPOPT says of the motion where it found it; None of other motions

    @classmethod
    def of(
        cls, engine: Engine, targets: Sequence[TaskTarget], Q: Array, steps: Array, scene: Scene, optimal: bool
    ) -> Motion:
        """Motion through postures Q (K, n), evaluated at the targets of its points."""
        inside = np.all((np.array(engine.robot.lower) <= Q) & (np.array(engine.robot.upper) >= Q))
        clear = bool(inside and np.all(is_clear(scene, Q)))
        objective, violation, _, variance = (column[:, 0] for column in engine.screen(Q, stacked(targets)))
        return cls(Q, objective, violation, np.sqrt(np.maximum(variance, 0.0)), steps, optimal, clear)

    @property
    def objective(self) -> float:
        """Objective of the worst point, scaled."""
        return float(np.max(self.objectives))

    @property
    def feasible(self) -> bool:
        return self.clear and float(np.max(self.violations)) <= ROW_TOLERANCE

    @property
    def largest_step(self) -> float:
        """Largest change of a joint between listed points [rad or m]."""
        return float(np.max(self.steps))

    def to_json(self) -> dict[str, float]:
        """Largest scatter [m] and largest step [rad or m]."""
        return {"sigma_max": float(self.sigma.max()), "step": self.largest_step}

    @property
    def worst(self) -> int:
        """Number of the point with the largest scatter."""
        return int(np.argmax(self.sigma))


def breaks_away(engine: Engine, Q: Array) -> Mask:
    """(K − 1,) whether the tool leaves the line between postures (K, n) by more than half of its length."""
    ways = np.diff(_positions(engine)(Q), axis=0)
    return np.asarray(off_lines(engine, Q) > 0.5 * np.linalg.norm(ways, axis=1))


def _positions(engine: Engine) -> BatchFunction:
    """Postures (N, n) to nominal tool points (N, 3) [m]."""
    at = engine.optimisation_problem.quantities
    return BatchFunction(ca.Function("position", [at.q], [at.position]), compiled=False)


def off_lines(engine: Engine, Q: Array) -> Array:
    """(K − 1,) distance [m] of the tool point from the lines between postures (K, n), joints moving evenly."""
    shares, position = np.linspace(0.0, 1.0, 9)[1:-1], _positions(engine)
    within = Q[:-1, None] + shares[:, None] * (Q[1:] - Q[:-1])[:, None]
    reached, ends = position(within.reshape(-1, Q.shape[1])).reshape(len(Q) - 1, len(shares), 3), position(Q)
    start, way = ends[:-1, None], (ends[1:] - ends[:-1])[:, None]
    along = np.clip(np.sum((reached - start) * way, axis=2) / np.sum(way**2, axis=2), 0.0, 1.0)
    return np.asarray(np.max(np.linalg.norm(reached - start - along[..., None] * way, axis=2), axis=1))


@dataclass(frozen=True, eq=False)
class TimeLaw:
    """Times at constant speed, at most ``min over k, j of (s_{k+1} − s_k) v_j / |q_{k+1,j} − q_{k,j}|``."""

    robot: Robot  # with the largest speeds of its joints, as far as they are known
    Q: Array  # (K, n) postures [rad or m]
    lengths: Array  # (K,) way along the path up to each point [m]
    stated: float | None = None  # speed of the tool point that is asked for [m/s]; None: the highest

    @cached_property
    def _use(self) -> Array:
        """(K − 1, n) share [s/m] of each joint's largest speed at 1 m/s of the tool."""
        moved = np.abs(np.diff(self.Q, axis=0)) / np.diff(self.lengths)[:, None]
        use = moved / np.array(self.robot.velocities)
        return np.where(np.isnan(use), 0.0, use)

    @cached_property
    def _most_used(self) -> tuple[int, int]:
        k, j = np.unravel_index(int(np.argmax(self._use)), self._use.shape)
        return int(k), int(j)

    @property
    def highest(self) -> float | None:
        """Highest constant speed of the tool point [m/s]; None where no joint of known largest speed moves."""
        use = float(self._use[self._most_used])
        return 1 / use if use > 0 else None

    @property
    def speed(self) -> float | None:
        """Constant speed of the tool point [m/s], stated or the highest."""
        return self.highest if self.stated is None else self.stated

    @property
    def times(self) -> Array | None:
        """(K,) time at each point [s]; None without a speed."""
        return None if self.speed is None else self.lengths / self.speed

    @property
    def limiting_step(self) -> int | None:
        """Number of the step, from 0, in which the limiting joint is nearest to its largest speed."""
        return None if self.highest is None else self._most_used[0]

    @property
    def limiting_joint(self) -> str | None:
        """Joint that bounds the speed of the tool."""
        return None if self.highest is None else self.robot.joint_names[self._most_used[1]]

    @property
    def unknown(self) -> tuple[str, ...]:
        """Joints that move and whose largest speed is not known."""
        moving = zip(self.robot.joints, np.any(np.diff(self.Q, axis=0) != 0, axis=0), strict=True)
        return tuple(joint.name for joint, moves in moving if moves and math.isnan(joint.velocity))

    @property
    def whole_turns(self) -> dict[str, int]:
        """Joint -> whole turns that it ends away from where it began."""
        turns = np.rint((self.Q[-1] - self.Q[0]) / TURN).astype(int)
        return {name: int(turn) for name, turn in zip(self.robot.joint_names, turns, strict=True) if turn}


def step_bounds(steps: JointSteps, path: TaskPath, largest: float, speed: float | None) -> Array:
    """(K − 1, n) bound of each joint's step [rad or m], by ``largest`` between listed points and the speed [m/s]."""
    even = largest / np.asarray(path.parts, dtype=float)[:, None]
    even = np.where(steps.span > even, even, np.inf)
    most = even if speed is None else np.minimum(even, speed_bounds(steps, path, speed))
    return np.asarray(np.maximum(most - 1e-9, 1e-12))  # a solver may overstep it, and no joint stands quite still


def speed_bounds(steps: JointSteps, path: TaskPath, speed: float) -> Array:
    """(K − 1, n) motion of each joint at its largest speed between the points, the tool at ``speed`` [m/s]."""
    each = np.diff(path.lengths)[:, None] / speed * np.array(steps.robot.velocities)
    return np.asarray(np.where(np.isnan(each), np.inf, each))


@dataclass(frozen=True)
class PathBreak:
    """A step between points at which the arm changes its posture off the path."""

    first: int  # number of the listed point before it, from 1
    last: int
    kind: Literal["singular", "limits"]  # limits: of joints, or of what the arm must keep clear of
    joint: str  # that moves most
    moved: float  # [rad or m]
    unit: Literal["rad", "m"]
    off: float  # how far the tool leaves the straight line where all joints move evenly [m]
    step: int  # number of the step among those of all points, added ones too, from 0

    def to_json(self) -> dict[str, Json]:
        return dict(vars(self))


def passes_singularity(engine: Engine, targets: Sequence[TaskTarget], Q: Array, k: int) -> bool:
    """Whether the arm, led on from either end of the step from point k of a motion (K, n), comes near a singularity.

    That is a sensitivity below a tenth of the median along the motion.
    """
    sampled = Q[np.linspace(0, len(Q) - 1, min(len(Q), 40)).astype(int)]
    usual = float(np.median([_sensitivity(engine, q) for q in sampled]))
    a, b = targets[k], targets[k + 1]
    ways = (*_followed(engine, Q[k], a, b), *_followed(engine, Q[k + 1], b, a))
    return min(_sensitivity(engine, q) for q in ways) < 0.1 * usual


def _followed(engine: Engine, q: Array, a: TaskTarget, b: TaskTarget) -> Iterator[Array]:
    """Postures (n,) from target a towards b, each from the one before, as far as they lead."""
    yield q
    for share in (np.arange(1, 24 + 1) / 24).tolist():
        x = (1 - share) * a.lower + share * b.lower
        aim = replace(a, lower=x, upper=x, axis=between(a.axis, b.axis, share))
        moved, errors = engine.ik.solve(q[None], held(engine, aim))
        if errors[0] >= TOLERANCE:
            return
        q = moved[0]
        yield q


def _sensitivity(engine: Engine, q: Array) -> float:
    """Smallest singular value of the held motions [m, and rad times the size of the workspace]."""
    problem = engine.optimisation_problem
    J, reach = np.asarray(problem.arm.jacobian(q), dtype=float), problem.reach
    rows, rank = [reach.directions.T @ J[:3]], reach.directions.shape[1]
    if problem.axis_rows:
        R = np.asarray(problem.arm.pose(q), dtype=float)[:3, :3]
        axis = R @ (np.array(problem.task.tool_axis) / np.linalg.norm(problem.task.tool_axis))
        rows.append(reach.radius * np.cross(J[3:].T, axis).T)
        rank += reach.axis_rank if reach.orients_at_point else 0
    values = np.linalg.svd(np.vstack(rows), compute_uv=False)
    return float(values[min(rank, len(values)) - 1])
