"""``PathAnswer``: the motion that joins the postures along a path, its times, and where it leaves the path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.encoding import Encoded, encoded
from posture_opt.numerics import TURN, Array, Json, Mask
from posture_opt.robot.robot import Robot
from posture_opt.selection.answer.target_answer import TargetAnswer
from posture_opt.selection.program.task_path import TaskPath, stacked
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Confirmation, Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
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


@dataclass(frozen=True)
class PathBreak(Encoded):
    """A step between points at which the arm changes its posture off the path."""

    first: int  # number of the listed point before it, from 1
    last: int
    kind: Literal["singular", "limits"]  # limits: of joints, or of what the arm must keep clear of
    joint: str  # that moves most
    moved: float  # [rad or m]
    unit: Literal["rad", "m"]
    off: float  # how far the tool leaves the straight line where all joints move evenly [m]
    step: int  # number of the step among those of all points, added ones too, from 0


@dataclass(frozen=True)
class Naive:
    """Two motions without look-ahead; their steps are those from point to point, as they are."""

    each: Motion  # the best posture of every point, whatever those beside it
    onward: Motion | None  # by inverse kinematics from the best first posture on; None where that comes to a limit
    reached: int  # how many points it got to


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
        """Whether the motion ends in the posture in which it began."""
        return self.returns and not self.law.whole_turns

    @property
    def returns(self) -> bool:
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

    def to_json(self, stations: Sequence[TargetAnswer], said: dict[str, Json], seconds: float) -> dict[str, Any]:
        """The path in ``solution.json``: answers at its listed points, what the solver said, and the search's time."""
        onward = self.naive.onward
        return {
            "path": [_point_json(point) for point in stations],
            **encoded(self, "largest_joint_step largest_step smallest_step sigma_max_bound=bound off_line closed"),
            "whole_turns": self.law.whole_turns if self.returns else {},
            **encoded(self, "speed=law.speed highest_speed=law.highest times limiting_joint=law.limiting_joint"),
            "breaks": [one.to_json() for one in self.breaks],
            "without_look_ahead": {
                "each_point_alone": self.naive.each.to_json(),
                "following_the_first": None if onward is None else onward.to_json(),
            },
            "solver": {**said, "starts": sum(self.candidates), "distinct": 1,
                       "converged": int(self.motion.optimal), "seconds": seconds},
        }  # fmt: skip


def _point_json(point: TargetAnswer) -> dict[str, Any]:
    return {
        "posture": point.posture,
        "tool": encoded(point.spread, "position quaternion_wxyz"),
        **point.task_spread.to_json(),
    }
