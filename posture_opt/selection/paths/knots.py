"""Knots: points of a long path that stand for all of it; motions found there are led to all points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from posture_opt.numerics import Array, Codes
from posture_opt.selection.paths.motion import Motion
from posture_opt.selection.paths.motion_search import MotionSearch
from posture_opt.selection.paths.path_candidates import PathCandidates, held
from posture_opt.selection.paths.task_path import TaskPath, stacked
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, TOLERANCE, PoseRequest
from posture_opt.selection.search.search_outcome import is_clear

MAX_SEARCHED_POINTS = 200
"""Points of a path that postures are sought at, one by one."""


def knots_of(path: TaskPath) -> Codes:
    """(M,) numbers of the points that stand for a long path, evenly among all K points, both ends included."""
    return np.linspace(0, len(path.points) - 1, MAX_SEARCHED_POINTS).round().astype(int)


def motions_at_knots(search: MotionSearch, stated: float | None, speed: float | None) -> list[Motion]:
    """The best motion at the knots, those it started from, the calmest, and the fastest for a stated speed [m/s]."""
    known = [search.calmest[1]] + ([] if speed is None else [search.fastest(speed)])
    paces = search.paces(stated, speed, known)
    best = search.best(paces, known)
    ways = [] if search.engine.optimisation_problem.freedom else search.ways(paces)
    return [motion for motion in (best, *ways, *known) if motion is not None]


def along_all(
    search: MotionSearch, path: TaskPath, targets: Sequence[TaskTarget], numbers: Codes, motions: Sequence[Motion]
) -> MotionSearch | None:
    """Search among motions at the knots, ``numbers`` (M,) of a path, led to all its points; None where none leads."""
    scale = search.found.targets[0].scale
    scaled = tuple(replace(target, scale=scale) for target in targets)
    led = list(_led(search, path, scaled, numbers, motions))
    if not led:
        return None
    flat, parameters = np.vstack(led), np.tile(stacked(scaled), (len(led), 1))
    objective, violation = (column[:, 0] for column in search.engine.screen(flat, parameters)[:2])
    met = violation <= ROW_TOLERANCE
    met[met] = is_clear(search.scene, flat[met])
    met, costs = met.reshape(len(led), -1), objective.reshape(len(led), -1)
    Q, at = flat.reshape(len(led), len(scaled), -1), range(len(scaled))
    if not np.all(met.any(axis=0)):
        return None
    postures = tuple(search.steps.wrapped(Q[met[:, k], k]) for k in at)
    found = PathCandidates(scaled, postures, tuple(costs[met[:, k], k] for k in at), (len(led),) * len(scaled))
    found = replace(found, postures=(*postures[:-1], postures[0])) if search.closed else found
    alone = np.full(len(scaled), -np.inf)
    alone[numbers] = search.alone
    return replace(search, path=path, found=found, alone=alone, apart=search.found, starts=1)


def _led(
    search: MotionSearch, path: TaskPath, targets: Sequence[TaskTarget], numbers: Codes, motions: Sequence[Motion]
) -> Iterator[Array]:
    """Postures (K, n) at all points that motions at the knots lead to, of those that arrive everywhere."""
    requests, names = [held(search.engine, t) for t in targets], ("position", "axis", "spin", "slack", "cone")
    given = {name: np.array([getattr(request, name) for request in requests]) for name in names}
    request = PoseRequest(weights=requests[0].weights, **given)
    for motion in motions:
        between = [np.interp(path.lengths, path.lengths[numbers], column) for column in motion.Q.T]
        Q, errors = search.engine.ik.solve(np.column_stack(between), request)
        if np.all(errors < TOLERANCE):
            Q = search.steps.rested(Q)
            yield np.vstack([Q[:-1], Q[0] + motion.Q[-1] - motion.Q[0]]) if search.closed else Q
