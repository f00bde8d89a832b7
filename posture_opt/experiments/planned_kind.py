"""Plans for instruments that measure no position: postures at which their places can be touched or read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.measurements.kinds import Seen
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array, Codes, Mask, stacked_rows

_CONTACT_TOLERANCE_M = 1e-3
"""A posture that near to a place touches it: the move that touches stops there."""
_CONTACT_STEPS = 8
_MAX_CONTACT_STEP = 0.3
"""rad or m a step of a joint toward a place."""
_DIFFERENCE = 1e-6


@dataclass(frozen=True, eq=False)
class KindPlaces:
    """The places of an instrument as a fit to the given rows has them, and where they can be measured from.

    Args:
        residuals: of the given rows; x: (k,) the fit [rad, m].
    """

    residuals: Residuals
    x: Array

    @property
    def each(self) -> int:
        """How many readings stand for one posture."""
        return 1

    @property
    def data(self) -> Measurements:
        """The given rows."""
        return self.residuals.data

    @cached_property
    def values(self) -> Array:
        """(P, u) the unknowns of the places."""
        return self.residuals.places(self.x)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """(P, m) least and largest `Kind.aspect` of the given rows at each place: the stroke of a bar, the plate."""
        seen, count = self.residuals.seen(self.x, self.residuals.walk(self.x)), len(self.values)
        aspect = self.data.kind.aspect(seen)
        own = [aspect[self.data.point == k] for k in range(count)]
        low, high = (np.array([get(a, axis=0) for a in own]) for get in (np.min, np.max))
        return low, high

    def seen(self, q: Array, place: Codes) -> Seen:
        """The fitted arm at postures (N, n) beside places (N,)."""
        robot, n = self.residuals.robot, len(q)
        values = {p.source: float(v) for p, v in zip(self.residuals.parameters, self.x, strict=True) if p.source}
        own = {name: v for name, v in values.items() if name in robot.parameters}
        columns = [np.ascontiguousarray(column) for column in q.T]
        reached = walk(robot.factors, factor_values(robot.factors, columns, own))
        position = stacked_rows(reached.position, n).T
        axes = [stacked_rows(column, n).T for column in reached.columns]
        return Seen(position, axes, np.zeros((n, 3)), place, self.values[place])

    def offered(self, q: Array) -> tuple[Codes, Mask]:
        """(N,) the place that is measured from each posture, and whether any can be.

        Of touched places the nearest; of others the one whose aspect is nearest to the middle of its bounds.
        """
        n, (low, high) = len(q), self.bounds
        cost = np.full((n, len(self.values)), np.inf)
        for k in range(len(self.values)):
            seen = self.seen(q, np.full(n, k, dtype=np.intp))
            aspect = self.data.kind.aspect(seen)
            inside = np.all((aspect >= low[k]) & (aspect <= high[k]), axis=1)
            off = np.abs(aspect[:, 0] - (low[k, 0] + high[k, 0]) / 2)
            if self.data.kind.contact:
                off = np.abs(np.broadcast_to(self.data.kind.error(seen)[0], n))
                inside &= off <= _CONTACT_TOLERANCE_M
            cost[inside, k] = off[inside]
        return cost.argmin(axis=1), np.isfinite(cost.min(axis=1))

    def weights(self, q: Array) -> Array:
        """(N, each) how much each reading of a posture counts."""
        return np.ones((len(q), 1))

    def hidden(self, q: Array, placed: PlacedCapsules) -> Mask:
        """(N,) whether a link is in the way."""
        return np.zeros(len(q), dtype=bool)

    def drawn(self, rng: np.random.Generator, count: int, lower: Array, upper: Array) -> Array:
        """(count, n) postures at random, before those that measure nothing are left out."""
        return rng.uniform(lower, upper, (count, len(lower)))

    def touching(self, q: Array, place: Codes) -> Array:
        """Postures (N, n) led to their places by Newton steps of least length; unchanged where nothing is touched."""
        if not self.data.kind.contact:
            return q
        for _ in range(_CONTACT_STEPS):
            here = self.off(q, place)
            slope = np.stack([self.off(q + h, place) - here for h in _DIFFERENCE * np.eye(q.shape[1])], axis=1)
            slope /= _DIFFERENCE
            step = slope * (here / np.maximum(np.sum(slope**2, axis=1), 1e-12))[:, None]
            q = q - np.clip(step, -_MAX_CONTACT_STEP, _MAX_CONTACT_STEP)
        return q

    def off(self, q: Array, place: Codes) -> Array:
        """(N,) how far postures are from their places [m]."""
        return np.broadcast_to(self.data.kind.error(self.seen(q, place))[0], len(q))

    def rows(self, planned: Measurements) -> Measurements:
        """Planned rows as rows of this instrument, each at its place."""
        place, _ = self.offered(planned.q)
        data = self.data
        return replace(
            planned, position=None, measured_axes=data.measured_axes, rotation=None, reading=np.zeros((len(place), 3)),
            point=place, point_names=data.point_names, instrument=data.kind,
            lever=None if data.lever is None else np.ones(len(place)),
        )  # fmt: skip
