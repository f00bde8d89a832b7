"""How far a motion leaves the lines of its path, how far its joints may step, and where it passes a singularity."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array, Mask
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.paths.path_candidates import held
from posture_opt.selection.program.task_path import TaskPath, between
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.inverse_kinematics import TOLERANCE


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
