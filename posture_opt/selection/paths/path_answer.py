"""``PathAnswer``: how the postures along a path are joined, beside what simpler ways give."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from posture_opt.numerics import TURN, Mask, finite_or_none
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.paths.motion import Motion, PathBreak, TimeLaw
from posture_opt.selection.paths.motion_search import MotionSearch
from posture_opt.selection.paths.path_candidates import held
from posture_opt.selection.paths.task_path import TaskPath
from posture_opt.selection.search.inverse_kinematics import TOLERANCE


@dataclass(frozen=True)
class Naive:
    """Two motions without look-ahead; their steps are those from point to point, as they are."""

    each: Motion  # the best posture of every point, whatever those beside it
    onward: Motion | None  # by inverse kinematics from the best first posture on; None where that comes to a limit
    reached: int  # how many points it got to


def naive_motions(search: MotionSearch) -> Naive:
    """Motions without look-ahead, from the candidates of points that were sought by themselves."""
    found, targets, engine, scene = search.apart or search.found, search.found.targets, search.engine, search.scene
    best = np.array([Q[int(np.argmin(costs))] for Q, costs in zip(found.postures, found.costs, strict=True)])
    apart = np.array([search.steps.between(a[None], b[None])[0, 0] for a, b in pairwise(best)])
    each = Motion.of(engine, found.targets, best, apart, scene, True)
    way = [best[0]]
    for target in targets[1:]:
        moved, error = engine.ik.solve(way[-1][None], held(engine, target))
        if error[0] >= TOLERANCE:
            return Naive(each, None, len(way))
        way.append(moved[0])
    Q = np.array(way)
    return Naive(each, Motion.of(engine, targets, Q, search.steps.swept(Q, search.path.listed), scene, True), len(way))


@dataclass(frozen=True, eq=False)
class PathAnswer:
    """The part of a solution beside its stations where they are the K points of a path."""

    path: TaskPath  # K points, listed and added
    motion: Motion
    largest_step: float  # allowed change of a joint between listed points [rad or m]
    smallest_step: float  # the least possible
    bound: float  # σ_max [m] that no motion gets below at its worst point; NaN where something else is minimised
    off_line: float  # largest distance [m] of the tool point from the lines between points where joints move evenly
    naive: Naive  # what simpler ways give
    candidates: tuple[int, ...]  # (K,) postures that were compared at each point
    law: TimeLaw  # when the tool is at each point
    breaks: tuple[PathBreak, ...] = ()  # where no motion leads along the path, but only away from it and back

    @property
    def listed(self) -> Mask:
        """(K,) whether a point is one of the task's own."""
        return self.path.listed

    @property
    def largest_joint_step(self) -> float:
        """Largest change of any joint between listed points [rad or m]."""
        return float(np.max(np.abs(np.diff(self.motion.Q[self.listed], axis=0))))

    @property
    def closed(self) -> bool:
        """Whether the motion ends where it began, or whole turns of joints away."""
        Q = self.motion.Q
        off = np.abs(Q[-1] - Q[0])
        turns = np.array([joint.type == "revolute" for joint in self.law.robot.joints])
        return bool(np.all(np.where(turns, np.abs(off - TURN * np.rint(off / TURN)), off) < 1e-6))

    @property
    def times(self) -> list[float] | None:
        """Times at the listed points [s]; None without a speed."""
        every = self.law.times
        return None if every is None else [float(t) for t in every[self.listed]]

    def to_json(self, found: Solution) -> dict[str, Any]:
        """The path in ``solution.json``."""
        onward = self.naive.onward
        steps = ("largest_joint_step", "largest_step", "smallest_step")
        return {
            "path": [_point_json(point) for point in found.stations],
            **{name: getattr(self, name) for name in steps},
            "sigma_max_bound": finite_or_none(self.bound),
            "off_line": self.off_line,
            "closed": self.closed,
            "whole_turns": self.law.whole_turns if self.closed else {},
            "speed": self.law.speed,
            "highest_speed": self.law.highest,
            "times": self.times,
            "limiting_joint": self.law.limiting_joint,
            "breaks": [one.to_json() for one in self.breaks],
            "without_look_ahead": {
                "each_point_alone": self.naive.each.to_json(),
                "following_the_first": None if onward is None else onward.to_json(),
            },
            "solver": {**found.confirmation_json, "starts": sum(self.candidates), "distinct": 1,
                       "converged": int(self.motion.optimal), "seconds": found.statistics.seconds},
        }  # fmt: skip


def _point_json(point: Solution) -> dict[str, Any]:
    spread = point.spread
    return {
        "posture": point.posture,
        "tool": {"position": spread.position.tolist(), "quaternion_wxyz": spread.quaternion_wxyz.tolist()},
        **point.task_spread.to_json(),
    }
