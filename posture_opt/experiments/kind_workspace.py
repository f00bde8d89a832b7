"""Where an arm may go to measure the places of an instrument that shows no position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.experiments.candidate_postures import Workspace
from posture_opt.experiments.planned_kind import KindPlaces
from posture_opt.numerics import Array, Mask


@dataclass(frozen=True)
class KindWorkspace(Workspace):
    """Where an arm may go to measure the places of an instrument."""

    places: KindPlaces

    @classmethod
    def around(cls, workspace: Workspace, places: KindPlaces) -> KindWorkspace:
        """A workspace of which only postures that can be measured count."""
        own = {name: getattr(workspace, name) for name in ("robot", "lower", "upper", "height", "box", "scene")}
        return cls(**own, places=places)

    def allowed(self, q: Array) -> Mask:
        """Which postures (N, n) are allowed and measure something."""
        found = super().allowed(q)
        found[found] = self.places.offered(q[found])[1]
        found[found] = ~self.places.hidden(q[found], self.scene.placed)
        return found

    def drawn(self, rng: np.random.Generator, count: int) -> Array:
        """Postures at random where such an instrument may see something."""
        return self.places.drawn(rng, count, self.lower, self.upper)

    def rounded(self, q: Array) -> Array:
        """Postures as they are in the file; those that touch are first led to the nearest place."""
        if self.places.data.kind.contact:
            count = len(self.places.values)
            off = np.stack([np.abs(self.places.off(q, np.full(len(q), k, dtype=np.intp))) for k in range(count)])
            q = self.places.touching(q, off.argmin(axis=0))
        return super().rounded(q)
