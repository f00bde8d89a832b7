"""Where an arm may go to measure the places of an instrument that shows no position."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.experiments.candidate_postures import Workspace, joint_range
from posture_opt.experiments.planned_kind import KindPlaces
from posture_opt.numerics import Array, Mask
from posture_opt.robot.robot import Joint

_OTHER = 0.5
"""Two instruments in one posture are apart: their numbers differ by more."""


@dataclass(frozen=True)
class KindWorkspace(Workspace):
    """Where an arm may go to measure the places of an instrument; postures (N, w) as of `KindPlaces`."""

    places: KindPlaces

    @classmethod
    def around(cls, workspace: Workspace, places: KindPlaces) -> KindWorkspace:
        """A workspace of which only postures that can be measured count."""
        own = {name: getattr(workspace, name) for name in ("robot", "lower", "upper", "height", "box", "scene")}
        return cls(**own, places=places)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints of the arm, then of a second one."""
        return (*super().joints, *(joint for _, joint in self.places.further))

    @cached_property
    def ranges(self) -> tuple[Array, Array]:
        """(w,), (w,) lower and upper end of all joints."""
        more = np.array([joint_range(joint, 0.0) for _, joint in self.places.further]).reshape(-1, 2)
        return np.r_[self.lower, more[:, 0]], np.r_[self.upper, more[:, 1]]

    def allowed(self, q: Array) -> Mask:
        """Which postures (N, w) are allowed and measure something."""
        found = super().allowed(q[:, : self.robot.n])
        found[found] = self.places.offered(q[found])[1]
        found[found] = ~self.places.hidden(q[found], self.scene.placed)
        return found

    def passable(self, q: Array) -> Mask:
        """Which postures may be passed through: an instrument that stays at the tool is to measure on the way too."""
        return self.allowed(q) if self.places.kind.attached else super().allowed(q[:, : self.robot.n])

    def drawn(self, rng: np.random.Generator, count: int) -> Array:
        """Postures at random where such an instrument may see something."""
        return self.places.drawn(rng, count, *self.ranges)

    def rounded(self, q: Array) -> Array:
        """Postures as they are in the file; those that touch are first led to the nearest place."""
        q, joints = self.places.touching(q), len(self.joints)
        return np.column_stack([super().rounded(q[:, :joints]), np.round(q[:, joints:])])

    def separations(self, count: int) -> Array:
        """(w,) as of joints; another instrument is another posture."""
        return np.asarray(np.r_[super().separations(count), np.full(self.places.fixed, _OTHER)])

    def steps(self) -> Array:
        """(w,) ranges of the joints; the instrument stays."""
        return np.asarray(np.r_[super().steps(), np.zeros(self.places.fixed)])

    def unit_travel(self) -> Array:
        """(w,) as of joints; changing the instrument is no travel."""
        return np.asarray(np.r_[super().unit_travel(), np.full(self.places.fixed, np.inf)])
