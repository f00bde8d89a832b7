"""``SmoothMotion``: the postures of all points of a path as one smooth problem, closed paths included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.answer.placement import PlacementRange
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.paths.task_path import TaskPath
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.stations.stations_problem import (
    BARRIER,
    Station,
    StationsOutcome,
    StationsPoint,
    StationsProblem,
    StationSteps,
)

MAX_ITERATIONS = 200  # of IPOPT in one smooth problem


@dataclass(frozen=True, eq=False)
class SmoothMotion:
    """The smooth problem of a path; of a closed one the last point is the first one again and has no variables.

    Args:
        problem: its stations, all points but the last one of a closed path.
    """

    problem: StationsProblem
    closed: bool

    @classmethod
    def of(
        cls,
        problem: OptimisationProblem,
        steps: JointSteps,
        targets: Sequence[TaskTarget],
        path: TaskPath,
        closed: bool,
        box: PlacementRange | None = None,
        barrier: float = BARRIER,
    ) -> SmoothMotion:
        """The problem of all points.

        Args:
            targets: of the points, in the frame of the workpiece.
            box: where that may stand; default: it is the world.
            barrier: as of `StationsProblem`.
        """
        stations = tuple(Station(problem, target) for target in (targets[:-1] if closed else targets))
        lower, upper = (np.zeros(4), np.zeros(4)) if box is None else (box.lower, box.upper)
        joined = StationSteps(steps.counted, np.asarray(path.parts, dtype=float), closed)
        most = MAX_ITERATIONS
        program = StationsProblem(stations, lower, upper, steps=joined, max_iterations=most, barrier=barrier)
        return cls(program, closed)

    def solve(self, start: StationsPoint, most: Array) -> StationsOutcome:
        """The local optimum from a motion (K, n), with no joint moving more than ``most`` (K − 1, n) [rad or m]."""
        turns = self._turns(start)
        return self._whole(self.problem.solve(self._open(start), most, turns), turns)

    def least_step(self, start: StationsPoint, weights: Array) -> StationsOutcome:
        """The motion whose largest step, times its weights (K − 1, n), is least."""
        turns = self._turns(start)
        return self._whole(self.problem.least_step(self._open(start), weights, turns), turns)

    def _turns(self, start: StationsPoint) -> Array:
        """(n,) how far from its first posture a closed motion ends [rad]; zero of others."""
        return start.Q[-1] - start.Q[0] if self.closed else np.zeros(start.Q.shape[1])

    def _open(self, start: StationsPoint) -> StationsPoint:
        """The start without the posture that is the first one again."""
        return replace(start, Q=start.Q[:-1]) if self.closed else start

    def _whole(self, end: StationsOutcome, turns: Array) -> StationsOutcome:
        """The outcome with the posture that is the first one again."""
        if not self.closed:
            return end
        Q = np.vstack([end.point.Q, end.point.Q[0] + turns])
        return replace(end, point=replace(end.point, Q=Q))
