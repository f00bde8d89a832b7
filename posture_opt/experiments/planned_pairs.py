"""Plans for two arms whose tools touch: postures of both, in which nothing but the tools meets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.collision.scene import Scene
from posture_opt.collision.segment_distances import to_segment
from posture_opt.experiments.planned_kind import KindPlaces
from posture_opt.measurements.kinds import PairContact
from posture_opt.numerics import Array, Mask


@dataclass(frozen=True, eq=False)
class PairPlaces(KindPlaces):
    """Where the second arm stands by a fit to the given rows, and in which postures of both the tools touch.

    The tools face each other as in the given rows. Links that the given rows have nearer than their capsules allow are
    not checked against each other: the capsules are wider than the arms there.
    """

    @property
    def kind(self) -> PairContact:
        """The touches, with the second arm."""
        assert isinstance(self.data.kind, PairContact), "two arms touch"
        return self.data.kind

    @cached_property
    def scene(self) -> Scene:
        """The second arm beside itself."""
        return Scene.of(self.kind.second.robot, None, guessed=True, without_mounting=True)

    def hidden(self, q: Array, placed: PlacedCapsules) -> Mask:
        """(N,) whether the second arm meets itself, or more than the tools of both meet."""
        if not len(q):
            return np.zeros(0, dtype=bool)
        checked = self._apart(self.given, placed).min(axis=0) > 0
        met = np.any(self._apart(q, placed)[:, checked] < 0, axis=1)
        return np.asarray(met | (self.scene.slack(q[:, self.robot.n :]) < 0))

    def _apart(self, q: Array, placed: PlacedCapsules) -> Array:
        """(N, pairs) distances of the capsules of one arm from those of the other; of both tools, infinite [m]."""
        own, other = placed, self.scene.placed
        T = self.kind.frame.pose(self.values[0])
        starts, ends = (p @ T[:3, :3].T + T[:3, 3] for p in other.segments(q[:, self.robot.n :]))
        first, last = own.segments(q[:, : self.robot.n])
        between = to_segment(first[:, :, None], last[:, :, None], starts[:, None], ends[:, None])
        between = between - own.radii[:, None] - other.radii
        tools = (np.array(own.bodies) == own.robot.n)[:, None] & (np.array(other.bodies) == other.robot.n)
        return np.asarray(np.where(tools, np.inf, between).reshape(len(q), -1))
