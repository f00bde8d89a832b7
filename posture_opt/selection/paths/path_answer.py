"""``PathAnswer``: how the postures along a path are joined, and how sure one may be of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.numerics import TURN, Mask, finite_or_none
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.paths.motion import Motion
from posture_opt.selection.paths.naive import Naive
from posture_opt.selection.paths.path_breaks import PathBreak
from posture_opt.selection.paths.task_path import TaskPath
from posture_opt.selection.paths.time_law import TimeLaw

_CLOSED_TOLERANCE_RAD = 1e-6  # rad or m: postures that are one


@dataclass(frozen=True, eq=False)
class PathAnswer:
    """What a solution has beside its stations where they are the K points of a path.

    Args:
        path: K points, listed and added.
        largest_step: allowed change of a joint between listed points [rad or m]; ``smallest_step`` the least possible.
        bound: σ_max [m] of the best posture at the point where that is largest: no motion gets below it; NaN where
            something else is minimised.
        off_line: largest distance [m] of the tool point from the straight line between points where joints move evenly.
        naive: what simpler ways give.
        candidates: (K,) postures that were compared at each point.
        law: when the tool is at each point.
        breaks: where no motion leads along the path, but only away from it and back.
    """

    path: TaskPath
    motion: Motion
    largest_step: float
    smallest_step: float
    bound: float
    off_line: float
    naive: Naive
    candidates: tuple[int, ...]
    law: TimeLaw
    breaks: tuple[PathBreak, ...] = ()

    @property
    def listed(self) -> Mask:
        """(K,) whether the point is one of the task's own."""
        return self.path.listed

    @property
    def largest_joint_step(self) -> float:
        """Largest change of any joint between listed points [rad, or m of a slide]."""
        return float(np.max(np.abs(np.diff(self.motion.Q[self.listed], axis=0))))

    @property
    def closed(self) -> bool:
        """Whether the motion ends in the posture in which it began, or whole turns of joints away from it."""
        Q = self.motion.Q
        off = np.abs(Q[-1] - Q[0])
        turns = np.array([joint.type == "revolute" for joint in self.law.robot.joints])
        return bool(np.all(np.where(turns, np.abs(off - TURN * np.rint(off / TURN)), off) < _CLOSED_TOLERANCE_RAD))

    @property
    def times(self) -> list[float] | None:
        """When the tool is at each listed point [s]; None where no speed is stated and none is the highest."""
        every = self.law.times
        return None if every is None else [float(t) for t in every[self.listed]]

    def to_json(self, found: Solution) -> dict[str, Any]:
        """What ``solution.json`` says of the path: plain data."""
        onward = self.naive.onward
        return {
            "path": [_point_json(point) for point in found.stations],
            "largest_joint_step": self.largest_joint_step,
            "largest_step": self.largest_step,
            "smallest_step": self.smallest_step,
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
    """What the document of a path says of one listed point: posture, tool pose and spread."""
    spread = point.spread
    return {
        "posture": point.posture,
        "tool": {"position": spread.position.tolist(), "quaternion_wxyz": spread.quaternion_wxyz.tolist()},
        **point.task_spread.to_json(),
    }
