"""Plans for instruments that measure no position: postures at which their places can be touched or read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.measurements.kinds import Kind, Seen
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array, Codes, Mask, stacked_rows
from posture_opt.robot.robot import Joint, Robot

_CONTACT_TOLERANCE_M = 1e-3
"""A posture that near to a place touches it: the move that touches stops there."""
_CONTACT_STEPS = 8
_MAX_CONTACT_STEP = 0.3
"""rad or m a step of a joint toward a place."""
_DIFFERENCE = 1e-6
_LEAST_SLOPE = 1e-2
"""Of the largest: directions in which a posture can hardly be led to a place are given up."""
_STEP = 0.3
"""rad, or share of a slide's range: how far new postures are from those of the given rows, one σ."""


@dataclass(frozen=True, eq=False)
class KindPlaces:
    """The places of an instrument as a fit to the given rows has them, and where they can be measured from.

    A planned posture is a row of w numbers: the joints of the arm, then those of a second arm [rad or m].

    Args:
        data: the given rows of this instrument.
        moved: parameter of the arm -> its deviation in the fit [rad or m]; ``values`` (P, u) unknowns of the places.
    """

    data: Measurements
    robot: Robot
    moved: Mapping[str, float]
    values: Array

    @classmethod
    def of(cls, residuals: Residuals, x: Array) -> KindPlaces:
        """From the given rows and the fit to them, x (k,) [rad, m]."""
        return cls(residuals.data, residuals.robot, moved_parameters(residuals, x), residuals.places(x))

    @property
    def kind(self) -> Kind:
        """What is measured."""
        return self.data.kind

    @property
    def each(self) -> int:
        """How many readings stand for one posture."""
        return 1

    @cached_property
    def further(self) -> tuple[tuple[str, Joint], ...]:
        """Names and joints of a second arm."""
        arms = self.kind.second_arms.items()
        return tuple((f"{name}.{joint.name}", joint) for name, arm in arms for joint in arm.robot.joints)

    @property
    def fixed(self) -> int:
        """How many numbers of a posture are no joints."""
        return 0

    @cached_property
    def given(self) -> Array:
        """(N, w) the postures of the given rows."""
        count = len(self.further)
        return self.data.q if not count else np.column_stack([self.data.q, self._reading[:, :count]])

    @property
    def _reading(self) -> Array:
        assert self.data.reading is not None, "the joints of a second arm were read"
        return self.data.reading

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """(P, m) least and largest `Kind.aspect` at each place: the stroke of a bar, the plate, how it was touched."""
        aspect = self._aspect_of_given()
        places = [aspect[self.data.point == k] for k in range(self._count)]
        found = [self.kind.bounds(k, own) if len(own) else _nowhere(aspect) for k, own in enumerate(places)]
        low, high = (np.array(rows) for rows in zip(*found, strict=True))
        return low, high

    @property
    def _count(self) -> int:
        """Places that are measured: of cameras without what they see."""
        return max(len(self.data.point_names), 1)

    def _aspect_of_given(self) -> Array:
        """(N, m) of the given rows."""
        return self.kind.aspect(self.seen(self.given, self.data.point))

    def seen(self, q: Array, place: Codes) -> Seen:
        """The fitted arm at postures (N, w) beside places (N,)."""
        n = len(q)
        columns = [np.ascontiguousarray(column) for column in q.T[: self.robot.n]]
        reached = walk(self.robot.factors, factor_values(self.robot.factors, columns, self.moved))
        position = stacked_rows(reached.position, n).T
        axes = [stacked_rows(column, n).T for column in reached.columns]
        shown = q[:, self.robot.n :] if self.further else np.zeros((n, 3))
        return Seen(position, axes, shown, place, self.values[place])

    def offered(self, q: Array) -> tuple[Codes, Mask]:
        """(N,) the place that is measured from each posture, and whether any can be.

        Of touched places the nearest; of others the one whose aspect is nearest to the middle of its bounds.
        """
        n, (low, high) = len(q), self.bounds
        cost = np.full((n, self._count), np.inf)
        seen = self.seen(q, np.zeros(n, dtype=np.intp))
        for k in range(self._count):
            here = self._beside(seen, np.full(n, k, dtype=np.intp))
            aspect = self.kind.aspect(here)
            inside = np.all((aspect >= low[k]) & (aspect <= high[k]), axis=1)
            off = np.abs(aspect[:, 0] - (low[k, 0] + high[k, 0]) / 2)
            if self.kind.contact:
                off = np.linalg.norm(self._error(here), axis=1)
                inside &= off <= _CONTACT_TOLERANCE_M
            cost[inside, k] = off[inside]
        return cost.argmin(axis=1), np.isfinite(cost.min(axis=1))

    def weights(self, q: Array) -> Array:
        """(N, each) how much each reading of a posture counts."""
        return np.ones((len(q), self.each))

    def hidden(self, q: Array, placed: PlacedCapsules) -> Mask:
        """(N,) whether a link is in the way."""
        return np.zeros(len(q), dtype=bool)

    def drawn(self, rng: np.random.Generator, count: int, lower: Array, upper: Array) -> Array:
        """(count, w) postures, before those that measure nothing are left out: half at random, half about given ones.

        Args:
            lower, upper: (w,) where the joints may be.
        """
        return np.concatenate([rng.uniform(lower, upper, (count // 2, len(lower))),
                               self.about_given(rng, count - count // 2, lower, upper)])  # fmt: skip

    def about_given(self, rng: np.random.Generator, count: int, lower: Array, upper: Array) -> Array:
        """(count, w) postures about those of the given rows."""
        about = self.given[rng.integers(len(self.given), size=count)]
        joints = (*self.robot.joints, *(joint for _, joint in self.further))
        step = _STEP * np.where([joint.type == "revolute" for joint in joints], 1.0, upper - lower)
        return np.asarray(np.clip(about + rng.normal(0.0, step, about.shape), lower, upper))

    def touching(self, q: Array) -> Array:
        """Postures (N, w) led to the nearest place by Newton steps of least length; as they are where none is touched.

        ``q − Jᵀ (J Jᵀ)⁻¹ e`` with e what is left to the place.
        """
        if not self.kind.contact:
            return q
        seen = self.seen(q, np.zeros(len(q), dtype=np.intp))
        codes = [np.full(len(q), k, dtype=np.intp) for k in range(self._count)]
        off = np.stack([np.linalg.norm(self._error(self._beside(seen, k)), axis=1) for k in codes])
        place = off.argmin(axis=0)
        for _ in range(_CONTACT_STEPS):
            here = self.off(q, place)
            J = np.stack([self.off(q + h, place) - here for h in _DIFFERENCE * np.eye(q.shape[1])], axis=2)
            step = np.einsum("njd,nd->nj", np.linalg.pinv(J / _DIFFERENCE, rcond=_LEAST_SLOPE), here)
            q = q - np.clip(step, -_MAX_CONTACT_STEP, _MAX_CONTACT_STEP)
        return q

    def off(self, q: Array, place: Codes) -> Array:
        """(N, d) how far postures are from their places [m]."""
        return self._error(self.seen(q, place))

    def _error(self, seen: Seen) -> Array:
        """(N, d) what is left to the places."""
        n = len(seen.place)
        return np.stack([np.broadcast_to(slot, n) for slot in self.kind.error(seen)], axis=1)

    def _beside(self, seen: Seen, place: Codes) -> Seen:
        """The same postures beside other places."""
        return replace(seen, place=place, values=self.values[place])

    def rows(self, planned: Measurements, q: Array) -> Measurements:
        """Planned rows of postures (N, w) as rows of this instrument, each at its place."""
        place, _ = self.offered(q)
        return self.as_read(planned, self.seen(q, place))

    def as_read(self, planned: Measurements, seen: Seen) -> Measurements:
        """Planned rows with what would be read there."""
        data, n = self.data, len(planned)
        return replace(
            planned, position=None, measured_axes=data.measured_axes, rotation=None, reading=self.kind.expected(seen),
            point=seen.place, point_names=data.point_names, instrument=data.kind,
            second=seen.second if len(seen.second) else None, second_names=data.second_names,
            lever=None if data.lever is None else np.ones(n),
        )  # fmt: skip

    def second(self, q: Array) -> Array:
        """(N, m) the joints of a second arm at postures (N, w); NaN where another instrument is used."""
        return q[:, self.robot.n :]

    def columns(self, q: Array) -> dict[str, tuple[str, ...]]:
        """Column of the file of measurements -> what stands there beside the joints of each posture (N, w)."""
        if not self.kind.label:
            return {}
        place, _ = self.offered(q)
        return {self.kind.label: tuple(self.data.point_names[k] for k in place)}

    def columns_by_row(self, q: Array) -> dict[str, tuple[tuple[str, ...], ...]]:
        """Column -> for each posture (N, w) its cells, where several rows of the file are of one posture."""
        return {}


def moved_parameters(residuals: Residuals, x: Array) -> dict[str, float]:
    """Parameter of the arm, without those of effects -> its deviation in a fit x (k,) [rad or m]."""
    known = residuals.robot.parameters
    return {
        p.source: float(v)
        for p, v in zip(residuals.parameters, x, strict=True)
        if p.source in known and p.code <= 0  # of several tools the first
    }


def _nowhere(aspect: Array) -> tuple[Array, Array]:
    """Bounds that nothing is within."""
    m = aspect.shape[1]
    return np.full(m, np.inf), np.full(m, -np.inf)
