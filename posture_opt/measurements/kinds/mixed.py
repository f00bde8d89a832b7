"""Several instruments in one file: every row is one number of a reading of one of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np

from posture_opt.errors import enumerated
from posture_opt.measurements.kinds.kind import Kind, MeasuredQuantity, Seen, Slots, Vector
from posture_opt.measurements.kinds.position import Position
from posture_opt.numerics import Array, Codes, Json, Mask

SLOTS = 6  # Numbers of a reading at most
# SI unit of a reading -> its standard deviation where the file states none
_DEFAULT_SIGMAS = {"m": 1e-4, "rad": 1e-4, "px": 0.2}


@dataclass(frozen=True, eq=False)
class Member:
    """One instrument of a mixed file."""

    name: str  # in the column ``instrument``
    kind: Kind  # what it reads
    first: int  # of its places among all
    places: tuple[str, ...]  # (P,) their names in the file, one without a name where it has none
    seconds: tuple[str, ...] = ()  # (M,) what its second column names

    @property
    def keys(self) -> tuple[str, ...]:
        """(P,) the names of its places among those of all instruments."""
        return tuple(f"{self.kind.label}[{place}]" if place else self.name for place in self.places)

    @property
    def quantities(self) -> tuple[MeasuredQuantity, ...]:
        """What it reads that has a standard deviation of its own: the numbers in which errors count come first."""
        main = tuple(slot for slot in range(SLOTS) if not any(slot in one.slots for one in self.kind.further))
        return (MeasuredQuantity(self.kind.sigma_key, self.kind.unit, main), *self.kind.further)

    @property
    def more(self) -> tuple[str, ...]:
        """The places that its second column leads to."""
        return tuple(self.kind.places(self.places))[len(self.places) :] if self.seconds else ()


@dataclass(frozen=True, eq=False)
class Mixed(Kind):
    """``h_i = h_k(i)(T; unknowns)_s(i)``: number s of a reading of the instrument k, for each row i.

    ``Measurements.part`` holds ``6 k + s``. A position is three rows of one posture, a pose six, a picture of a marker
    two. Turns count as what they shift at a lever of 1 m. All places are in the frame of the base unless positions are
    measured in a known frame.
    """

    kind: ClassVar[str] = "mixed"
    error_words: ClassVar[str] = "error of a reading"
    number_words: ClassVar[str] = "reading"
    axis_names: ClassVar[tuple[str, ...]] = ("of a reading",)

    members: tuple[Member, ...] = ()  # the instruments; their places follow each other, a place of nothing comes last
    width: int = 6  # type: ignore[misc]
    noun: str = "readings"  # type: ignore[misc]
    fixed_to_base: bool = True  # type: ignore[misc]  # whether the base is no unknown
    oriented: bool = False  # type: ignore[misc]
    blind_spot: str = ""  # type: ignore[misc]
    remedy: str = ""  # type: ignore[misc]

    @classmethod
    def of_members(cls, members: Sequence[Member], fixed: bool) -> Mixed:
        """The kind of a file with these instruments; it is blind where all are."""
        blind = all(member.kind.blind_spot for member in members)
        return cls(
            names=tuple(key for member in members for key in member.keys), members=tuple(members),
            width=max(member.kind.width for member in members),
            noun=enumerated(dict.fromkeys(member.kind.noun for member in members)), fixed_to_base=fixed,
            oriented=any(member.kind.oriented for member in members),
            blind_spot="; ".join(dict.fromkeys(m.kind.blind_spot for m in members)) if blind else "",
            remedy=next((m.kind.remedy for m in members if m.kind.remedy), ""),
        )  # fmt: skip

    @property
    def fixes_size(self) -> bool:
        return any(member.kind.fixes_size for member in self.members)

    @cached_property
    def quantities(self) -> tuple[tuple[Member, MeasuredQuantity], ...]:
        """What has a standard deviation of its own: each instrument with each quantity that it reads."""
        return tuple((member, one) for member in self.members for one in member.quantities)

    @property
    def quantity_names(self) -> tuple[str, ...]:
        """What `quantities` are called: the instrument, or what it reads beside, with its name where several do."""
        further = [one.key for member, one in self.quantities if one in member.kind.further]
        words = {1: "{1}", 0: "{0}"}
        return tuple(words.get(further.count(one.key), "{0} {1}").format(m.name, one.key) for m, one in self.quantities)

    def quantity_of(self, part: Codes) -> Codes:
        """(N,) which of `quantities` each row is."""
        found = np.zeros(SLOTS * len(self.members), dtype=np.intp)
        for code, (member, one) in enumerate(self.quantities):
            found[SLOTS * self.members.index(member) + np.array(one.slots, dtype=np.intp)] = code
        return found[part]

    def weighed(self, names: Sequence[str], place: Codes, part: Codes | None) -> tuple[Sequence[str], Codes]:
        own, further = np.array(place), [*names]
        assert part is not None, "rows of a mixed file are numbers of readings"
        code = self.quantity_of(part)
        for k, (member, one) in enumerate(self.quantities):
            if one in member.kind.further:
                own[code == k] = len(further)
                further.append(_key(member, one))
        return further, own

    def orientations(self, seen: Seen) -> Array:
        """(N, 3, 3) of the instruments that read any."""
        found = np.full((len(seen.place), 3, 3), np.nan)
        for part in _parts(self, seen):
            if part.kind.oriented:
                found[part.rows] = part.kind.orientations(part.seen)
        return found

    def touched_points(self, names: Sequence[str]) -> Mapping[str, int]:
        every = [(member.first, member.kind.touched_points(member.places)) for member in self.members]
        return {name: first + code for first, own in every for name, code in own.items()}

    @property
    def second_arms(self) -> Mapping[str, Any]:
        return {name: arm for member in self.members for name, arm in member.kind.second_arms.items()}

    @property
    def place_noun(self) -> str:
        return enumerated(dict.fromkeys(m.kind.place_noun for m in self.members if m.kind.place_noun)) or "instruments"

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> Mixed:
        kinds = [part.kind.prepared(part.seen, moving, up) for part in _parts(self, seen)]
        return replace(self, members=tuple(replace(m, kind=kind) for m, kind in zip(self.members, kinds, strict=True)))

    def alternatives(self, seen: Seen) -> Sequence[tuple[Kind, Codes]]:
        found = []
        for k, (member, part) in enumerate(zip(self.members, _parts(self, seen), strict=True)):
            for other, own in member.kind.alternatives(part.seen):
                members = (*self.members[:k], replace(member, kind=other), *self.members[k + 1 :])
                found.append((replace(self, members=members), part.rows[own]))
        return found

    def levers(self, seen: Seen) -> Array | None:
        """(N,) those of each instrument, 1 of readings in metres; None where all are."""
        found = np.ones(len(seen.place))
        levers = [(part.rows, part.kind.levers(part.seen)) for part in _parts(self, seen)]
        for rows, own in levers:
            found[rows] = 1.0 if own is None else own
        return None if all(own is None for _, own in levers) else found

    def places(self, names: Sequence[str]) -> Sequence[str]:
        return (*names, *(name for m in self.members for name in m.more), "")

    def second_place(self, seconds: Codes) -> Codes:
        """(N,) the second place of each row; that of nothing for rows of one place."""
        found = np.full(len(seconds), len(self.places(self.names)) - 1, dtype=np.intp)
        first, at = 1, len(self.names)
        for member in self.members:
            own = (seconds >= first) & (seconds < first + len(member.seconds))
            if member.seconds:
                found[own] = member.kind.second_place(seconds[own] - first) - len(member.places) + at
            first, at = first + len(member.seconds), at + len(member.more)
        return found

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        kind, name = self._of(place)
        return kind.unknowns(name)

    def slots(self, place: str) -> Sequence[int]:
        kind, name = self._of(place)
        return kind.slots(name)

    def prior_sigma(self, place: str, name: str) -> float:
        kind, own = self._of(place)
        return kind.prior_sigma(own, name)

    def open_notes(self, errors: Mapping[str, float]) -> tuple[str, ...]:
        return tuple(note for member in self.members for note in member.kind.open_notes(errors))

    def parameter(self, place: str, name: str) -> str:
        kind, own = self._of(place)
        return kind.parameter(own, name) if own else f"{place}.{name}"

    def described(self, place: str, values: Array) -> dict[str, Json]:
        kind, name = self._of(place)
        return kind.described(name, values)

    def start(self, seen: Seen, places: int) -> Array:
        found, more = np.zeros((places, self.width)), len(self.names)
        for member, part in zip(self.members, _parts(self, seen), strict=True):
            count = len(member.places)
            own = member.kind.start(part.seen, count + len(member.more))
            found[member.first : member.first + count, : own.shape[1]] = own[:count]
            found[more : more + len(member.more), : own.shape[1]] = own[count:]
            more += len(member.more)
        return found

    def error(self, seen: Seen) -> Slots:
        return self.gathered(seen, lambda part: part.kind.error(part.seen))

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        return self.gathered(seen, lambda part: part.kind.slope(part.seen, part.of_rows(shift), part.of_rows(turn)))

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        return _unknown_slope(self, seen, axis)

    def sigmas(self, measurement: object) -> dict[str, float]:
        found: dict[str, float] = {}
        for member in self.members:
            stated = float(getattr(measurement, member.kind.sigma_key, None) or 0.0)
            own = [member.kind.sigma_of(place, stated) for place in member.places]
            found |= {key: s or _DEFAULT_SIGMAS[member.kind.unit] for key, s in zip(member.keys, own, strict=True)}
            for one in member.kind.further:
                found[_key(member, one)] = float(getattr(measurement, one.key, None) or _DEFAULT_SIGMAS[one.unit])
        return found

    def gathered(self, seen: Seen, of_part: Callable[[_Part], Slots]) -> Slots:
        """One number a row, from what each instrument says of its own rows."""
        found = np.zeros(len(seen.place))
        for part in _parts(self, seen):
            slots = of_part(part)
            for slot, own, rows in part.numbers:
                value = slots[slot]
                found[rows] = value[own] if np.ndim(value) else value
        return (found,)

    def _of(self, place: str) -> tuple[Kind, str]:
        """The instrument that a place is of, and its name in the file; of nothing, one without unknowns."""
        for member in self.members if place else ():
            names = dict(zip((*member.keys, *member.more), (*member.places, *member.more), strict=True))
            if place in names:
                return member.kind, names[place]
        return Position(), ""


def _key(member: Member, quantity: MeasuredQuantity) -> str:
    """What an instrument reads beside the numbers in which errors count, among all that has a σ of its own."""
    return f"{member.name}.{quantity.key}"


@dataclass(frozen=True, eq=False)
class _Part:
    """The rows of one instrument, and what is seen there."""

    kind: Kind
    rows: Codes  # (n,) indices
    numbers: tuple[tuple[int, Codes, Codes], ...]  # number of a reading, and where it is among these rows and among all
    seen: Seen
    axes: frozenset[int]  # which unknowns its places have

    def of_rows(self, vector: Vector) -> Vector:
        """Three coordinates at these rows, each a number or (n,)."""
        return [v[self.rows] if np.ndim(v) else v for v in vector]


@lru_cache(maxsize=4)
def _parts(kind: Mixed, seen: Seen) -> tuple[_Part, ...]:
    found, first_second = [], 1
    n = len(seen.place)
    for k, member in enumerate(kind.members):
        rows = np.flatnonzero(seen.part // SLOTS == k)
        position = [np.broadcast_to(v, n)[rows] for v in seen.position]
        columns = [[np.broadcast_to(v, n)[rows] for v in column] for column in seen.columns]
        second = seen.second[rows] - first_second if member.seconds else np.zeros(0, dtype=np.intp)
        place = seen.place[rows] - member.first
        own = Seen(position, columns, seen.reading[rows], place, seen.values[rows], second)
        slot = seen.part[rows] % SLOTS
        at = {int(one): np.flatnonzero(slot == one) for one in np.unique(slot)}
        axes = frozenset(axis for name in (*member.places, *member.more) for axis in member.kind.slots(name))
        found.append(_Part(member.kind, rows, tuple((one, k, rows[k]) for one, k in at.items()), own, axes))
        first_second += len(member.seconds)
    return tuple(found)


@lru_cache(maxsize=32)
def _unknown_slope(kind: Mixed, seen: Seen, axis: int) -> Slots:
    def of_part(part: _Part) -> Slots:
        return part.kind.unknown_slope(part.seen, axis) if axis in part.axes else (0.0,) * SLOTS

    return kind.gathered(seen, of_part)
