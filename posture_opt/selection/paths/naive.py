"""What simpler ways to choose the postures of a path give: each point by itself, or the first one and then on.

They are the comparison for the planned motion: point by point the joints jump, onward the spread grows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.paths.motion import Motion
from posture_opt.selection.paths.path_candidates import PathCandidates, held
from posture_opt.selection.paths.task_path import TaskPath
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.inverse_kinematics import TOLERANCE


@dataclass(frozen=True)
class Naive:
    """Two motions without look-ahead; their steps are those from point to point, as they are.

    Args:
        each: the best posture of every point, whatever those beside it.
        onward: from the best posture of the first point by inverse kinematics, each from the one before; None where
            that comes to a limit.
        reached: how many points it got to.
    """

    each: Motion
    onward: Motion | None
    reached: int


def naive_motions(
    engine: Engine,
    found: PathCandidates,
    targets: Sequence[TaskTarget],
    steps: JointSteps,
    path: TaskPath,
    scene: Scene,
) -> Naive:
    """The motions that are to be had without look-ahead, from the candidates of points.

    Args:
        found: of all points, or of some of a long path; ``targets`` of all.
    """
    best = np.array([Q[int(np.argmin(costs))] for Q, costs in zip(found.postures, found.costs, strict=True)])
    apart = np.array([steps.between(a[None], b[None])[0, 0] for a, b in pairwise(best)])
    each = Motion.of(engine, found.targets, best, apart, scene, True)
    way = [best[0]]
    for target in targets[1:]:
        moved, error = engine.ik.solve(way[-1][None], held(engine, target))
        if error[0] >= TOLERANCE:
            return Naive(each, None, len(way))
        way.append(moved[0])
    Q = np.array(way)
    return Naive(each, Motion.of(engine, targets, Q, steps.swept(Q, path.listed), scene, True), len(way))
