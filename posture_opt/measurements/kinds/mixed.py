"""Several instruments in one file: every row is one number of a reading of one of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np

from posture_opt.errors import enumerated
from posture_opt.measurements.kinds.kind import Kind, MeasuredQuantity, Seen, Slots, Vector
from posture_opt.measurements.kinds.second_arm import SecondArm
from posture_opt.numerics import Array, Codes, Json, Mask

SLOTS = 6
"""Numbers of a reading at most."""
_DEFAULT_SIGMAS = {"m": 1e-4, "rad": 1e-4, "px": 0.2}
"""SI unit of a reading -> its standard deviation where the file states none."""


@dataclass(frozen=True, eq=False)
class Member:
    """One instrument of a mixed file.

    Args:
        name: in the column ``instrument``; ``kind``: what it reads.
        first: of its places among all; ``places``: (P,) their names in the file, one without a name where it has none.
        seconds: (M,) what its second column names.
    """

    name: str
    kind: Kind
    first: int
    places: tuple[str, ...]
    seconds: tuple[str, ...] = ()

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

    Args:
        members: the instruments; their places follow each other, a place of nothing comes last.
        fixed: whether the base is no unknown.
    """

    kind: ClassVar[str] = "mixed"
    error_words: ClassVar[str] = "error of a reading"
    number_words: ClassVar[str] = "reading"
    axis_names: ClassVar[tuple[str, ...]] = ("of a reading",)

    members: tuple[Member, ...] = ()
    fixed: bool = True
    width: int = 6  # type: ignore[misc]
    noun: str = "readings"  # type: ignore[misc]
    fixed_to_base: bool = True  # type: ignore[misc]
    oriented: bool = False  # type: ignore[misc]
    blind_spot: str = ""  # type: ignore[misc]
    remedy: str = ""  # type: ignore[misc]

    @classmethod
    def of_members(cls, members: Sequence[Member], fixed: bool) -> Mixed:
        """The kind of a file with these instruments; it is blind where all are."""
        blind = all(member.kind.blind_spot for member in members)
        return cls(
            names=tuple(key for member in members for key in member.keys), members=tuple(members), fixed=fixed,
            width=max(member.kind.width for member in members),
            noun=enumerated(dict.fromkeys(member.kind.noun for member in members)), fixed_to_base=fixed,
            oriented=any(member.kind.oriented for member in members),
            blind_spot="; ".join(dict.fromkeys(m.kind.blind_spot for m in members)) if blind else "",
            remedy=next((m.kind.remedy for m in members if m.kind.remedy), ""),
        )  # fmt: skip

    @property
    def fixes_size(self) -> bool:
        """Whether any of the instruments shows a length."""
        return any(member.kind.fixes_size for member in self.members)

    @cached_property
    def quantities(self) -> tuple[tuple[Member, MeasuredQuantity], ...]:
        """What has a standard deviation of its own: each instrument with each quantity that it reads."""
        return tuple((member, one) for member in self.members for one in member.quantities)

    @property
    def quantity_names(self) -> tuple[str, ...]:
        """What `quantities` are called: the instrument, or what it reads beside, with its name where several do."""
        further = [one.key for member, one in self.quantities if one in member.kind.further]
        return tuple(
            member.name
            if one.key not in further
            else one.key
            if further.count(one.key) < 2
            else f"{member.name} {one.key}"
            for member, one in self.quantities
        )

    def quantity_of(self, part: Codes) -> Codes:
        """(N,) which of `quantities` each row is."""
        found = np.zeros(SLOTS * len(self.members), dtype=np.intp)
        for code, (member, one) in enumerate(self.quantities):
            found[SLOTS * self.members.index(member) + np.array(one.slots, dtype=np.intp)] = code
        return found[part]

    def weighed(self, names: Sequence[str], place: Codes, part: Codes | None) -> tuple[Sequence[str], Codes]:
        """The places, and behind them what instruments read beside."""
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
        for member, part in zip(self.members, _parts(self, seen), strict=True):
            if member.kind.oriented:
                found[part.rows] = member.kind.orientations(part.seen)
        return found

    def touched_points(self, names: Sequence[str]) -> Mapping[str, int]:
        """Those of all instruments."""
        every = [(member.first, member.kind.touched_points(member.places)) for member in self.members]
        return {name: first + code for first, own in every for name, code in own.items()}

    @property
    def second_arms(self) -> Mapping[str, SecondArm]:
        """Those of all instruments."""
        return {name: arm for member in self.members for name, arm in member.kind.second_arms.items()}

    @property
    def place_noun(self) -> str:
        """What all their places are called."""
        return enumerated(dict.fromkeys(m.kind.place_noun for m in self.members if m.kind.place_noun)) or "instruments"

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> Mixed:
        """All instruments with their reference values."""
        parts = _parts(self, seen)
        kinds = [m.kind.prepared(p.seen, moving, up) for m, p in zip(self.members, parts, strict=True)]
        return replace(self, members=tuple(replace(m, kind=kind) for m, kind in zip(self.members, kinds, strict=True)))

    def alternatives(self, seen: Seen) -> Sequence[tuple[Kind, Codes]]:
        """Those of each instrument."""
        found = []
        for k, (member, part) in enumerate(zip(self.members, _parts(self, seen), strict=True)):
            for other, own in member.kind.alternatives(part.seen):
                members = (*self.members[:k], replace(member, kind=other), *self.members[k + 1 :])
                found.append((replace(self, members=members), part.rows[own]))
        return found

    def levers(self, seen: Seen) -> Array | None:
        """(N,) those of each instrument, 1 of readings in metres; None where all are."""
        found, any_other = np.ones(len(seen.place)), False
        for member, part in zip(self.members, _parts(self, seen), strict=True):
            own = member.kind.levers(part.seen)
            if own is not None:
                found[part.rows], any_other = own, True
        return found if any_other else None

    def places(self, names: Sequence[str]) -> Sequence[str]:
        """Those of all instruments, what their second columns name, and one of nothing."""
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
        """Those of the instrument that the place is of."""
        own = self._of(place)
        return () if own is None else own[0].kind.unknowns(own[1])

    def slots(self, place: str) -> Sequence[int]:
        """Those of the instrument that the place is of."""
        own = self._of(place)
        return () if own is None else own[0].kind.slots(own[1])

    def prior_sigma(self, place: str, name: str) -> float:
        """That of the instrument that the place is of."""
        own = self._of(place)
        return 0.0 if own is None else own[0].kind.prior_sigma(own[1], name)

    def open_notes(self, errors: Mapping[str, float]) -> tuple[str, ...]:
        """Those of all instruments."""
        return tuple(note for member in self.members for note in member.kind.open_notes(errors))

    def parameter(self, place: str, name: str) -> str:
        """``plane[table].offset``; of an instrument without named places, its own name comes first."""
        own = self._of(place)
        return f"{place}.{name}" if own is None or not own[1] else own[0].kind.parameter(own[1], name)

    def described(self, place: str, values: Array) -> dict[str, Json]:
        """A place as its instrument describes it."""
        own = self._of(place)
        return {} if own is None else own[0].kind.described(own[1], values)

    def start(self, seen: Seen, places: int) -> Array:
        """Those of each instrument."""
        found, more = np.zeros((places, self.width)), len(self.names)
        for member, part in zip(self.members, _parts(self, seen), strict=True):
            count = len(member.places)
            own = member.kind.start(part.seen, count + len(member.more))
            found[member.first : member.first + count, : own.shape[1]] = own[:count]
            found[more : more + len(member.more), : own.shape[1]] = own[count:]
            more += len(member.more)
        return found

    def error(self, seen: Seen) -> Slots:
        """The number of the row's own instrument."""
        return self.gathered(seen, lambda kind, part: kind.error(part.seen))

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """The number of the row's own instrument."""
        return self.gathered(seen, lambda kind, part: kind.slope(part.seen, part.of_rows(shift), part.of_rows(turn)))

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """The number of the row's own instrument; zero of one that has no such unknown."""

        return _unknown_slope(self, seen, axis)

    def sigmas(self, measurement: object) -> dict[str, float]:
        """Those of each instrument; a tenth of a millimetre, of a milliradian, or a pixel where none is stated."""
        found: dict[str, float] = {}
        for member in self.members:
            stated = float(getattr(measurement, member.kind.sigma_key, None) or 0.0)
            own = [member.kind.sigma_of(place, stated) for place in member.places]
            found |= {key: s or _DEFAULT_SIGMAS[member.kind.unit] for key, s in zip(member.keys, own, strict=True)}
            for one in member.kind.further:
                found[_key(member, one)] = float(getattr(measurement, one.key, None) or _DEFAULT_SIGMAS[one.unit])
        return found

    def gathered(self, seen: Seen, of_part: Callable[[Kind, _Part], Slots]) -> Slots:
        """One number a row, from what each instrument says of its own rows."""
        found = np.zeros(len(seen.place))
        for member, part in zip(self.members, _parts(self, seen), strict=True):
            slots = of_part(member.kind, part)
            for slot, own, rows in part.numbers:
                value = slots[slot]
                found[rows] = value[own] if np.ndim(value) else value
        return (found,)

    def _of(self, place: str) -> tuple[Member, str] | None:
        """The instrument of a place and its name in the file; None of the place of nothing."""
        for member in self.members:
            for key, name in (*zip(member.keys, member.places, strict=True), *((n, n) for n in member.more)):
                if key == place and place:
                    return member, name
        return None


def _key(member: Member, quantity: MeasuredQuantity) -> str:
    """What an instrument reads beside the numbers in which errors count, among all that has a σ of its own."""
    return f"{member.name}.{quantity.key}"


@dataclass(frozen=True, eq=False)
class _Part:
    """The rows of one instrument, and what is seen there.

    Args:
        rows: (n,) indices; numbers: number of a reading, and where it is among these rows and among all.
        axes: which unknowns its places have.
    """

    rows: Codes
    numbers: tuple[tuple[int, Codes, Codes], ...]
    seen: Seen
    axes: frozenset[int]

    def of_rows(self, vector: Vector) -> Vector:
        """Three coordinates at these rows, each a number or (n,)."""
        return [v[self.rows] if np.ndim(v) else v for v in vector]


@lru_cache(maxsize=4)
def _parts(kind: Mixed, seen: Seen) -> tuple[_Part, ...]:
    """What each instrument sees."""
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
        found.append(_Part(rows, tuple((one, k, rows[k]) for one, k in at.items()), own, axes))
        first_second += len(member.seconds)
    return tuple(found)


@lru_cache(maxsize=32)
def _unknown_slope(kind: Mixed, seen: Seen, axis: int) -> Slots:
    """By an unknown of a place, of whatever instrument: fits ask for it once for each place."""

    def own(kind: Kind, part: _Part) -> Slots:
        return kind.unknown_slope(part.seen, axis) if axis in part.axes else (0.0,) * SLOTS

    return kind.gathered(seen, own)
