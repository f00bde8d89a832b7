"""``Knots``: the points of a long path that stand for all of it while postures are sought.

Neighbouring points of a dense path have nearly the same postures. The motions that are found at the knots are led to
all points by inverse kinematics, and are the candidates there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.numerics import Array, Codes
from posture_opt.selection.paths.motion import Motion
from posture_opt.selection.paths.motion_search import MotionSearch
from posture_opt.selection.paths.path_candidates import PathCandidates, held
from posture_opt.selection.paths.task_path import TaskPath, stacked
from posture_opt.selection.program.pose_request import PoseRequest
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, TOLERANCE
from posture_opt.selection.search.search_outcome import is_clear

MAX_SEARCHED_POINTS = 200
"""Points of a path that postures are sought at, one by one."""


def knots_of(path: TaskPath) -> Codes:
    """Numbers of the points that stand for a long path, evenly among all K points, both ends among them."""
    return np.linspace(0, len(path.points) - 1, MAX_SEARCHED_POINTS).round().astype(int)


def motions_at_knots(search: MotionSearch, stated: float | None, speed: float | None) -> list[Motion]:
    """The motions that the search at the knots ends with: the best, those it started from, the calmest, the fastest.

    Args:
        stated: largest step [rad or m]; speed: of the tool [m/s]; None where the task states none.
    """
    known = [search.calmest[1]] + ([] if speed is None else [search.fastest(speed)])
    paces = search.paces(stated, speed, known)
    best = search.best(paces, known)
    ways = [] if search.engine.optimisation_problem.freedom else search.ways(paces)
    return [motion for motion in (best, *ways, *known) if motion is not None]


@dataclass(frozen=True)
class Knots:
    """A search at the knots (M of the K points of a path), and the targets of all points.

    Args:
        search: of the path through the knots alone.
        path: all points; ``targets`` of them.
        numbers: (M,) of the knots among the points.
    """

    search: MotionSearch
    path: TaskPath
    targets: Sequence[TaskTarget]
    numbers: Codes

    def along_all(self, motions: Sequence[Motion]) -> MotionSearch | None:
        """The search among motions (M, n) led to all points; None where there is a point to which none leads."""
        search = self.search
        scale = search.found.targets[0].scale
        targets = tuple(replace(target, scale=scale) for target in self.targets)
        led = list(self._led(motions, targets))
        if not led:
            return None
        flat, parameters = np.vstack(led), np.tile(stacked(targets), (len(led), 1))
        objective, violation = (column[:, 0] for column in search.engine.screen(flat, parameters)[:2])
        met = violation <= ROW_TOLERANCE
        met[met] = is_clear(search.scene, flat[met])
        met, costs = met.reshape(len(led), -1), objective.reshape(len(led), -1)
        Q = flat.reshape(len(led), len(targets), -1)
        if not np.all(met.any(axis=0)):
            return None
        at = range(len(targets))
        postures = tuple(search.steps.wrapped(Q[met[:, k], k]) for k in at)
        found = PathCandidates(targets, postures, tuple(costs[met[:, k], k] for k in at), (len(led),) * len(targets))
        alone = np.full(len(targets), -np.inf)
        alone[self.numbers] = search.alone
        found = replace(found, postures=(*postures[:-1], postures[0])) if search.closed else found
        return replace(search, path=self.path, found=found, alone=alone, apart=search.found, starts=1)

    def _led(self, motions: Sequence[Motion], targets: Sequence[TaskTarget]) -> Iterator[Array]:
        """Postures (K, n) at all points that motions at the knots lead to, of those that arrive everywhere."""
        engine, at = self.search.engine, self.path.lengths
        requests = [held(engine, target) for target in targets]
        position, axis, spin, slack, cone = (
            np.array([getattr(request, name) for request in requests])
            for name in ("position", "axis", "spin", "slack", "cone")
        )
        request = PoseRequest(position, axis, spin, requests[0].weights, slack, cone)
        for motion in motions:
            between = [np.interp(at, at[self.numbers], column) for column in motion.Q.T]
            Q, errors = engine.ik.solve(np.column_stack(between), request)
            if np.all(errors < TOLERANCE):
                Q = self.search.steps.rested(Q)
                yield np.vstack([Q[:-1], Q[0] + motion.Q[-1] - motion.Q[0]]) if self.search.closed else Q
