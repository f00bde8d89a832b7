"""``TimeLaw``: when the tool is where on a path at constant speed, and which joint bounds that speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.numerics import TURN, Array
from posture_opt.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class TimeLaw:
    """The times of the K points of a motion, the tool point at constant speed and each joint even between two points.

    With the way ``s_k`` along the path up to point k and the largest speed ``v_j`` of joint j, the tool is no faster
    than ``min over k, j of (s_{k+1} − s_k) v_j / |q_{k+1,j} − q_{k,j}|``.

    Args:
        robot: with the largest speeds of its joints, as far as they are known.
        Q: (K, n) postures [rad or m].
        lengths: (K,) way along the path up to each point [m].
        stated: speed of the tool point that is asked for [m/s]; None: the highest.
    """

    robot: Robot
    Q: Array
    lengths: Array
    stated: float | None = None

    @cached_property
    def _use(self) -> Array:
        """(K − 1, n) the share [s/m] of its largest speed that each joint needs where the tool moves by 1 m/s."""
        moved = np.abs(np.diff(self.Q, axis=0)) / np.diff(self.lengths)[:, None]
        use = moved / np.array(self.robot.velocities)
        return np.where(np.isnan(use), 0.0, use)

    @cached_property
    def _most_used(self) -> tuple[int, int]:
        """The step between points, and the joint in it, that bound the speed."""
        k, j = np.unravel_index(int(np.argmax(self._use)), self._use.shape)
        return int(k), int(j)

    @property
    def highest(self) -> float | None:
        """The highest constant speed of the tool point [m/s]; None where no joint with a known largest speed moves."""
        use = float(self._use[self._most_used])
        return 1 / use if use > 0 else None

    @property
    def speed(self) -> float | None:
        """Constant speed of the tool point [m/s]: the stated one, or else the highest."""
        return self.highest if self.stated is None else self.stated

    @property
    def times(self) -> Array | None:
        """(K,) when the tool is at each point [s]; None where no speed is stated and none is the highest."""
        return None if self.speed is None else self.lengths / self.speed

    @property
    def limiting_step(self) -> int | None:
        """Number of the step between points, from zero, in which the limiting joint is nearest to its largest speed."""
        return None if self.highest is None else self._most_used[0]

    @property
    def limiting_joint(self) -> str | None:
        """The joint that comes nearest to its largest speed: it bounds the speed of the tool."""
        return None if self.highest is None else self.robot.joint_names[self._most_used[1]]

    @property
    def limiting_velocity(self) -> float:
        """The largest speed of the limiting joint [rad/s or m/s]; NaN where nothing bounds the tool."""
        return math.nan if self.highest is None else self.robot.velocities[self._most_used[1]]

    @property
    def unknown(self) -> tuple[str, ...]:
        """The joints that move, of which no largest speed is known: nothing is checked of them."""
        moving = np.any(np.diff(self.Q, axis=0) != 0, axis=0)
        return tuple(
            j.name for j, moves in zip(self.robot.joints, moving, strict=True) if moves and math.isnan(j.velocity)
        )

    @property
    def whole_turns(self) -> dict[str, int]:
        """Joint -> the whole turns that it ends away from where it began, of a motion that comes back but for these."""
        turns = np.rint((self.Q[-1] - self.Q[0]) / TURN).astype(int)
        return {name: int(turn) for name, turn in zip(self.robot.joint_names, turns, strict=True) if turn}
