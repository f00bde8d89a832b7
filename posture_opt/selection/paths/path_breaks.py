"""``PathBreak``: where no motion leads along a path, but only away from it and back, and why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from posture_opt.numerics import Array, Json, Mask
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.paths.motion import breaks_away
from posture_opt.selection.paths.path_candidates import held
from posture_opt.selection.paths.task_path import TaskPath, between
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.inverse_kinematics import TOLERANCE

_MAX_SINGULAR_SHARE = 0.1  # of the median sensitivity along the motion: a posture with less is near a singular one
_SUBDIVISIONS = 24  # of the step, on the way that is followed into it
_SAMPLED_POSTURES = 40  # of the motion, whose sensitivity is what is usual


@dataclass(frozen=True)
class PathBreak:
    """A step between points at which the arm changes its posture off the path.

    Args:
        first, last: numbers of the listed points that it is between, from 1.
        kind: ``singular`` where the arm loses a direction of motion there, else ``limits``: it could only go on beyond
            the limits of its joints, or through what it must keep clear of.
        joint: that moves most; ``moved`` by how much [rad or m]; ``unit`` of it.
        off: how far the tool leaves the straight line where all joints move evenly [m].
        step: number of the step among those of all points, added ones too, from 0.
    """

    first: int
    last: int
    kind: Literal["singular", "limits"]
    joint: str
    moved: float
    unit: Literal["rad", "m"]
    off: float
    step: int

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI."""
        return dict(vars(self))


@dataclass(frozen=True)
class _Breaks:
    """The search for breaks of one motion (K, n) through targets."""

    engine: Engine
    path: TaskPath
    targets: tuple[TaskTarget, ...]
    steps: JointSteps
    Q: Array

    def at(self, k: int, off: float) -> PathBreak:
        """What is wrong with the step from point k to the next."""
        moved = np.abs(self.Q[k + 1] - self.Q[k]) * self.steps.counted
        joint = int(np.argmax(moved))
        first = int(np.count_nonzero(self.path.listed[: k + 1]))
        robot = self.engine.robot
        kind: Literal["singular", "limits"] = "singular" if self.is_singular(k) else "limits"
        return PathBreak(
            first, first + 1, kind, robot.joints[joint].name, float(moved[joint]), robot.joints[joint].unit, off, k
        )

    def is_singular(self, k: int) -> bool:
        """Whether the arm comes near a singular posture where it is led on from either end of the step."""
        sampled = self.Q[np.linspace(0, len(self.Q) - 1, min(len(self.Q), _SAMPLED_POSTURES)).astype(int)]
        usual = float(np.median([self._sensitivity(q) for q in sampled]))
        ways = (*self._followed(k, k + 1), *self._followed(k + 1, k))
        return min(self._sensitivity(q) for q in ways) < _MAX_SINGULAR_SHARE * usual

    def _followed(self, start: int, end: int) -> Iterator[Array]:
        """Postures (n,) from point ``start`` towards point ``end``, each from the one before, as far as they lead."""
        q, a, b = self.Q[start], self.targets[start], self.targets[end]
        yield q
        for share in (np.arange(1, _SUBDIVISIONS + 1) / _SUBDIVISIONS).tolist():
            x = (1 - share) * a.lower + share * b.lower
            aim = replace(a, lower=x, upper=x, axis=between(a.axis, b.axis, share))
            moved, errors = self.engine.ik.solve(q[None], held(self.engine, aim))
            if errors[0] >= TOLERANCE:
                return
            q = moved[0]
            yield q

    def _sensitivity(self, q: Array) -> float:
        """The least motion of what the task holds by a unit motion of the joints (n,): its smallest singular value.

        Metres and, of the tool axis, radians times the size of the workspace.
        """
        problem = self.engine.optimisation_problem
        J = np.asarray(problem.arm.jacobian(q), dtype=float)
        reach = problem.reach
        rows, rank = [reach.directions.T @ J[:3]], reach.directions.shape[1]
        if problem.axis_rows:
            R = np.asarray(problem.arm.pose(q), dtype=float)[:3, :3]
            axis = R @ (np.array(problem.task.tool_axis) / np.linalg.norm(problem.task.tool_axis))
            rows.append(reach.radius * np.cross(J[3:].T, axis).T)
            rank += reach.axis_rank if reach.orients_at_point else 0
        values = np.linalg.svd(np.vstack(rows), compute_uv=False)
        return float(values[min(rank, len(values)) - 1])


def path_breaks(
    engine: Engine,
    path: TaskPath,
    targets: tuple[TaskTarget, ...],
    steps: JointSteps,
    Q: Array,
    off: Array,
    jumps: Mask,
) -> tuple[PathBreak, ...]:
    """The steps of a motion (K, n) in which the arm changes its posture.

    Those in which the tool leaves the path by more than half of what lies between two points, and known ``jumps``.

    Args:
        off: (K − 1,) how far the tool point leaves the straight lines [m].
        jumps: (K − 1,) steps that are far larger than all others.
    """
    found = _Breaks(engine, path, targets, steps, Q)
    where = np.flatnonzero(breaks_away(engine, Q) | jumps)
    return tuple(found.at(k, float(off[k])) for k in where.tolist())


def passes_singularity(
    engine: Engine, path: TaskPath, targets: tuple[TaskTarget, ...], steps: JointSteps, Q: Array, k: int
) -> bool:
    """Whether the arm comes near a singular posture between points k and k + 1 of a motion (K, n)."""
    return _Breaks(engine, path, targets, steps, Q).is_singular(k)
