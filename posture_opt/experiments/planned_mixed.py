"""Plans for files of several instruments: each posture is for one of them, by the rule of its kind."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.experiments.planned_kind import (
    BoardPosePlaces,
    KindPlaces,
    PairPlaces,
    PicturePlaces,
    moved_parameters,
)
from posture_opt.measurements.kinds import BoardPose, MarkerPixels, Member, Mixed, PairContact
from posture_opt.measurements.kinds.mixed import SLOTS
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.robot.robot import Joint


@dataclass(frozen=True, eq=False)
class MixedPlaces(KindPlaces):
    """The places of several instruments, and which of these is used from each posture."""

    parts: tuple[KindPlaces, ...] = ()  # the places of each instrument

    @classmethod
    def of_instruments(cls, residuals: Residuals, x: Array) -> MixedPlaces:
        """From the given rows and the fit to them; ``of_one`` is the rule of one instrument."""
        data, values, moved = residuals.data, residuals.places(x), moved_parameters(residuals, x)
        kind, part = _kind(data), data.part
        assert part is not None, "a row is a number of a reading"
        parts, more, second = [], len(kind.names), 1
        for k, member in enumerate(kind.members):
            # The readings of one instrument, one a row, as if they were the whole file.
            own = np.flatnonzero(part // SLOTS == k)
            whole = data.take(own[np.unique(data.line[own], return_index=True)[1]])
            touched = whole.second - second if member.seconds and whole.second is not None else None
            names = tuple(place for place in member.places if place)
            rows = replace(
                whole, part=None, instrument=member.kind, point=whole.point - member.first, point_names=names,
                second=touched, second_names=member.seconds, lever=None,
            )  # fmt: skip
            first = range(member.first, member.first + len(member.places))
            at = values[[*first, *range(more, more + len(member.more))], : member.kind.width]
            rule = _RULES.get(type(member.kind), KindPlaces)
            parts.append(rule(rows, residuals.robot, moved, at))
            more, second = more + len(member.more), second + len(member.seconds)
        return cls(data, residuals.robot, moved, values, tuple(parts))

    @property
    def members(self) -> tuple[Member, ...]:
        """The instruments."""
        return _kind(self.data).members

    @cached_property
    def axes(self) -> tuple[Codes, ...]:
        """Of each instrument, the numbers of a reading that were measured."""
        assert self.data.part is not None, "a row is a number of a reading"
        own, slot = np.divmod(self.data.part, SLOTS)
        return tuple(np.unique(slot[own == k]) for k in range(len(self.parts)))

    @cached_property
    def numbers(self) -> tuple[int, ...]:
        """Of each instrument, how many numbers are read at a posture."""
        return tuple(part.each * len(axes) for part, axes in zip(self.parts, self.axes, strict=True))

    @property
    def each(self) -> int:
        """How many rows stand for one posture; instruments that read less leave some without weight."""
        return max(self.numbers)

    @cached_property
    def further(self) -> tuple[tuple[str, Joint], ...]:
        """Names and joints of a second arm, where one of the instruments is its touch."""
        return next((part.further for part in self.parts if part.further), ())

    @property
    def fixed(self) -> int:
        """The instrument."""
        return 1

    def offered(self, q: Array) -> tuple[Codes, Mask]:
        """(N,) the place among those of the instrument of each posture, and whether it can be measured."""
        place, can = np.zeros(len(q), dtype=np.intp), np.zeros(len(q), dtype=bool)
        for _, part, own, rows in self._by_instrument(q):
            place[own], can[own] = part.offered(rows)
        return place, can

    def weights(self, q: Array) -> Array:
        """(N, each) how much each number counts; those behind the last of an instrument not at all."""
        found = np.zeros((len(q), self.each))
        for k, part, own, rows in self._by_instrument(q):
            found[own, : self.numbers[k]] = np.repeat(part.weights(rows), len(self.axes[k]), axis=1)
        return found

    def hidden(self, q: Array, placed: PlacedCapsules) -> Mask:
        """(N,) whether a link is in the way."""
        found = np.zeros(len(q), dtype=bool)
        for _, part, own, rows in self._by_instrument(q):
            found[own] = part.hidden(rows, placed)
        return found

    def drawn(self, rng: np.random.Generator, count: int, lower: Array, upper: Array) -> Array:
        """(count, w) postures, as many for each instrument."""
        found, n = np.zeros((count, len(lower) + 1)), self.robot.n
        found[:, -1] = np.arange(count) % len(self.parts)
        for k, part in enumerate(self.parts):
            own, w = np.flatnonzero(found[:, -1] == k), n + len(part.further)
            found[own, :w] = part.drawn(rng, len(own), lower[:w], upper[:w])
        return found

    def touching(self, q: Array) -> Array:
        """Postures of instruments that touch, led to the nearest place."""
        found = q.copy()
        for _, part, own, rows in self._by_instrument(q):
            found[own, : rows.shape[1]] = part.touching(rows)
        return found

    def rows(self, planned: Measurements, q: Array) -> Measurements:
        """Planned rows, one for each number of a reading; the first one again behind the last of an instrument."""
        shape = len(q), self.each
        point, second, part_of = (np.zeros(shape, dtype=np.intp) for _ in range(3))
        assert self.data.reading is not None, "something was read"
        reading = np.zeros((*shape, self.data.reading.shape[1]))
        seconds = 1
        for k, part, own, rows in self._by_instrument(q):
            read = part.rows(planned.take(own), rows)
            at = np.arange(self.each) % self.numbers[k]
            number, slot = at // len(self.axes[k]), self.axes[k][at % len(self.axes[k])]
            index = np.arange(len(own))[:, None] * part.each + number
            assert read.reading is not None, "every instrument reads something"
            width = min(reading.shape[2], read.reading.shape[1])
            reading[own, :, :width] = read.reading[index][:, :, :width]
            point[own] = self.members[k].first + read.point[index]
            if read.second is not None:
                second[own] = seconds + read.second[index]
            part_of[own] = SLOTS * k + slot
            seconds += len(self.members[k].seconds)
        data, whole = self.data, planned.take(np.repeat(np.arange(len(q)), self.each))
        return replace(
            whole, position=None, measured_axes=data.measured_axes, rotation=None,
            reading=reading.reshape(len(whole), -1), point=point.ravel(), point_names=data.point_names,
            second=second.ravel(), second_names=data.second_names, part=part_of.ravel(), instrument=data.kind,
            lever=None if data.lever is None else np.ones(len(whole)),
        )  # fmt: skip

    def second(self, q: Array) -> Array:
        """(N, m) the joints of a second arm; NaN at postures of other instruments."""
        found = np.full((len(q), len(self.further)), np.nan)
        for _, part, own, rows in self._by_instrument(q):
            if part.further:
                found[own] = part.second(rows)
        return found

    def columns(self, q: Array) -> dict[str, tuple[str, ...]]:
        """The instrument, and the places of each in its own column."""
        found = {"instrument": [self.members[int(k)].name for k in q[:, -1]]}
        for _, part, own, rows in self._by_instrument(q):
            for label, names in part.columns(rows).items():
                cells = found.setdefault(label, [""] * len(q))
                for i, name in zip(own, names, strict=True):
                    cells[i] = name
        return {label: tuple(cells) for label, cells in found.items()}

    def columns_by_row(self, q: Array) -> dict[str, tuple[tuple[str, ...], ...]]:
        """Those of each instrument; one empty cell at the postures of others."""
        found: dict[str, list[tuple[str, ...]]] = {}
        for _, part, own, rows in self._by_instrument(q):
            for label, every in part.columns_by_row(rows).items():
                cells = found.setdefault(label, [("",)] * len(q))
                for i, names in zip(own, every, strict=True):
                    cells[i] = names
        return {label: tuple(cells) for label, cells in found.items()}

    def _by_instrument(self, q: Array) -> list[tuple[int, KindPlaces, Codes, Array]]:
        """Number and places of each instrument, the postures (m,) that are for it, and what it sees of them (m, w)."""
        found, n = [], self.robot.n
        for k, part in enumerate(self.parts):
            own = np.flatnonzero(q[:, -1] == k)
            found.append((k, part, own, q[own, : n + len(part.further)]))
        return found


def _kind(data: Measurements) -> Mixed:
    assert isinstance(data.kind, Mixed), "a file of several instruments"
    return data.kind


_RULES: dict[type, type[KindPlaces]] = {
    MarkerPixels: PicturePlaces, BoardPose: BoardPosePlaces, PairContact: PairPlaces,
}  # fmt: skip
"""Kinds that look at more than the aspect of the tool beside a place."""


def planned_places(residuals: Residuals, x: Array) -> KindPlaces:
    """The places of the given rows by a fit x (k,) to them [rad, m], by the rule of their kind."""
    kind = residuals.data.kind
    if isinstance(kind, Mixed):
        return MixedPlaces.of_instruments(residuals, x)
    return _RULES.get(type(kind), KindPlaces).of(residuals, x)
