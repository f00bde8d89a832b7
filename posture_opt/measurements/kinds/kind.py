"""``Kind``: what a measurement shows of the pose of the tool, and what it leaves unknown."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from posture_opt.numerics import Array, Codes, Json, Mask

Vector = Sequence[Any] | Array  # Three coordinates, each a number or (N,)
Slots = tuple[Any, ...]  # The d numbers of a reading, each a number or (N,)


@dataclass(frozen=True, eq=False)
class Seen:
    """The tool at N rows, beside what was read there."""

    position: Vector  # of the tool point [m], world; three of (N,)
    columns: Sequence[Vector] | Array  # of the rotation R_world_tool, each three of (N,)
    reading: Array  # (N, D) what the instrument showed, in its SI unit
    place: Codes  # (N,) code of the plane, anchor or point that each row belongs to
    values: Array  # (N, u) the unknowns of that place, and of a second one where rows belong to two
    # (N,) codes in the second column of names, as markers that cameras see
    second: Codes = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    # (N,) instrument and number of its reading, where a file mixes instruments
    part: Codes = field(default_factory=lambda: np.zeros(0, dtype=np.intp))


@dataclass(frozen=True)
class MeasuredQuantity:
    """Numbers of a reading that share a unit and a standard deviation."""

    key: str  # under ``uncertainty: {measurement: …}``, and in documents
    unit: str  # SI
    slots: tuple[int, ...]  # places of the numbers in a reading


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of measurement: ``reading = h(T_world_tool; unknowns of its place) + noise``.

    A kind states ``h``, its change with a twist of the tool, and its change with each unknown; a fit, a diagnosis and a
    report follow from these. The twist is ``(v, ω)``: the shift of the tool point [m] and the turn of the tool [rad],
    both in the world.
    """

    kind: ClassVar[str]  # Its name in reports and documents
    noun: ClassVar[str]  # What one row is, in plural: ``touches of planes``
    unit: ClassVar[str] = "m"  # SI unit of a reading
    columns: ClassVar[Mapping[str, str]] = {}  # Column of numbers -> its dimension; all are required
    label: ClassVar[str] = ""  # Column that names the place of a row
    second_label: ClassVar[str] = ""  # Column that names what else a row belongs to, as the marker that a camera sees
    width: ClassVar[int] = 6  # Unknowns of a row at most
    example: ClassVar[str] = ""  # Headers to add to a file that measures nothing
    # Key under ``uncertainty: {measurement: …}`` that states its standard deviation
    sigma_key: ClassVar[str] = "position"
    # What is read beside the numbers in which errors count, as the orientation of a pose
    further: ClassVar[tuple[MeasuredQuantity, ...]] = ()
    settings: ClassVar[str] = ""  # Key of the section ``data`` with what is known of its places
    # Whether it contains a length, so that an arm of half the size would not fit as well
    size_known: ClassVar[bool] = True
    # Whether parts are taken to be within manufacturing tolerances, as such data do not show all of them
    leaves_geometry_open: ClassVar[bool] = True
    contact: ClassVar[bool] = False  # Whether the tool must be led to a place to measure it
    # Whether it stays at the tool on the way from one posture to the next, as a wire does
    attached: ClassVar[bool] = False
    held_out_by: ClassVar[Literal["pose", "place"]] = "pose"  # What a cross-validation leaves out together
    # Whether its places are taken in the frame of the base, which is then no unknown
    fixed_to_base: ClassVar[bool] = True
    oriented: ClassVar[bool] = False  # Whether it shows how the tool is turned
    # Whether errors count from the mean of a place, as nothing else says where it is
    about_mean: ClassVar[bool] = False
    error_words: ClassVar[str] = "position error"  # What the errors of a model are called
    number_words: ClassVar[str] = "coordinate"  # What one number of a reading is called
    # What the numbers of a reading are called, in a vector of three
    axis_names: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    blind_spot: ClassVar[str] = ""  # What such data cannot show, whatever the postures
    remedy: ClassVar[str] = ""  # What to add

    stated: Mapping[str, Any] = field(default_factory=dict)  # what the file says of places
    names: Sequence[str] = ()  # (P,) of all places

    @classmethod
    def of(cls, data: object, names: Sequence[str], seconds: Sequence[str] = ()) -> Kind:
        """The kind with what the section ``data`` of a problem says of its places; ``names`` (P,) of these."""
        return cls(getattr(data, cls.settings), names) if cls.settings else cls()

    @classmethod
    def columns_in(cls, data: object) -> Mapping[str, str]:
        """Its columns of numbers by the section ``data`` of a problem -> dimension; none: it is not in the file."""
        return cls.columns

    @classmethod
    def required(cls, data: object, there: Container[str]) -> frozenset[str]:
        """The columns without which a row is not of this kind; ``there`` are those of the file."""
        return frozenset({*cls.columns_in(data), *(name for name in (cls.label, cls.second_label) if name)})

    @property
    def read_columns(self) -> Mapping[str, str]:
        """The columns of numbers of these data -> dimension."""
        return self.columns_in(None)

    @property
    def fixes_size(self) -> bool:
        """Whether these data, with what is stated of their places, contain a length."""
        return self.size_known

    def axes(self, measured: Mask) -> Codes:
        """(d,) places of the numbers of a reading in a vector of three; ``measured`` (3,) are coordinates in a file."""
        return np.arange(len(self.axis_names))

    def numbers(self, measured: Mask) -> Codes:
        """(b,) places of all numbers of a reading: those of `axes`, then those of `further`."""
        return np.array([*self.axes(measured), *(slot for one in self.further for slot in one.slots)], dtype=np.intp)

    def in_own_frame(self) -> Kind:
        """The same instrument in a frame of its own of which nothing is known; itself where it measures in none."""
        return self

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> Kind:
        """The kind with reference values for its unknowns, by the nominal arm."""
        # seen: of the nominal arm; moving: (3,) world axes along which the tool can move; up: (3,) against gravity
        return self

    def alternatives(self, seen: Seen) -> Sequence[tuple[Kind, Codes]]:
        """Kinds with another reference that suits the nominal arm about as well, and (m,) the rows that it is of."""
        return ()

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        """(u,) names and SI units of what is unknown of a place."""
        return ()

    def places(self, names: Sequence[str]) -> Sequence[str]:
        """Its places: those that the file ``names``, or one without a name where something else is unknown."""
        return names if self.label else ("",) if self.unknowns("") else ()

    @property
    def place_noun(self) -> str:
        """What its places are called, in plural; empty where they are not in the cell."""
        return f"{self.label}s" if self.label else ""

    def parameter(self, place: str, name: str) -> str:
        """What an unknown of a place is called among the parameters of a fit."""
        return f"{self.label}[{place}].{name}" if place else f"{self.kind}.{name}"

    def slots(self, place: str) -> Sequence[int]:
        """(u,) where the unknowns of a place are in a row of all unknowns; rows of two places hold both."""
        return range(len(self.unknowns(place)))

    def second_place(self, seconds: Codes) -> Codes:
        """(N,) the second place of each row, by the codes of the second column of names."""
        raise NotImplementedError(f"a row of {self.kind} belongs to one place")

    def group(self, place: str, name: str) -> str:
        """Which parameters an unknown of a place belongs to: what is found anew in every file, or a second arm."""
        return "place"

    def nominal(self, place: str, name: str) -> float:
        """The value of an unknown of a place that its deviation counts from."""
        return 0.0

    def prior_sigma(self, place: str, name: str) -> float:
        """What the file states of an unknown of a place beforehand; 0 where it says nothing."""
        return 0.0

    def open_notes(self, errors: Mapping[str, float]) -> tuple[str, ...]:
        """Sentences on what stays open of the places, by the standard errors of their unknowns; infinite: not known."""
        return ()

    def touched_points(self, names: Sequence[str]) -> Mapping[str, int]:
        """Name -> place of the points that are touched, between which distances may be known; ``names`` of places."""
        return {}

    @property
    def second_arms(self) -> Mapping[str, Any]:
        """Name -> the other arms whose joints are in the rows."""
        return {}

    def levers(self, seen: Seen) -> Array | None:
        """(N,) length that one unit of a reading is at the tool, at the nominal arm [m]; None for one of metres."""
        return None

    def orientations(self, seen: Seen) -> Array:
        """(N, 3, 3) R_world_tool as it was read, NaN in rows that do not show it; of kinds that are `oriented`."""
        raise NotImplementedError(f"{self.kind} does not show how the tool is turned")

    def start(self, seen: Seen, places: int) -> Array:
        """(P, u) the unknowns that suit the tool at N rows best, roughly; zeros where references are `prepared`."""
        return np.zeros((places, self.width))

    @abstractmethod
    def error(self, seen: Seen) -> Slots:
        """The model's reading minus the instrument's."""

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """Change of the reading with a twist of the tool, ``∂h/∂T · (v, ω)``; of a position the shift itself."""
        return tuple(shift)

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """Change of the reading with one of the unknowns."""
        raise NotImplementedError(f"{self.kind} leaves nothing unknown")

    def aspect(self, seen: Seen) -> Array:
        """(N, m) what bounds whether a place can be measured from a posture: plans stay in the range of given rows."""
        return np.zeros((len(seen.place), 1))

    def bounds(self, place: int, given: Array) -> tuple[Array, Array]:
        """(m,), (m,) least and largest aspect from which a place can be measured, by those of given rows (n, m)."""
        return given.min(axis=0), given.max(axis=0)

    def expected(self, seen: Seen) -> Array:
        """(N, D) the reading that such rows would show, as far as slopes depend on it."""
        return np.zeros((len(seen.place), 3))

    def weighed(self, names: Sequence[str], place: Codes, part: Codes | None) -> tuple[Sequence[str], Codes]:
        """What may have a standard deviation of its own, and which of it each row is of: the places, by their names."""
        # names: of places; place: (N,) of each row; part: as of `Seen`, None where one instrument reads
        return names, place

    def sigmas(self, measurement: object) -> dict[str, float]:
        """Standard deviation of a reading at each place by the section ``measurement``; 0 where none is stated."""
        if not self.settings:
            return {}
        stated = float(getattr(measurement, self.sigma_key, None) or 0.0)
        return {name: self.sigma_of(name, stated) for name in self.names}

    def sigma_of(self, place: str, stated: float) -> float:
        """Standard deviation of a reading at a place; ``stated`` is that of the file, 0 where there is none."""
        return stated

    def described(self, place: str, values: Array) -> dict[str, Json]:
        """A place that was found, in the world [m, rad]; ``values`` (u,) of its unknowns."""
        return {name: float(v) for (name, _), v in zip(self.unknowns(place), values, strict=False)}


def dot(a: Vector, b: Vector) -> Any:
    """The scalar product of two vectors of three coordinates."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def stacked(vector: Vector, n: int) -> Array:
    """(n, 3) of three coordinates, each a number or (n,)."""
    return np.stack([np.broadcast_to(np.asarray(v, dtype=float), (n,)) for v in vector], axis=1)


def tool_pose(seen: Seen) -> tuple[Array, Array]:
    """R (N, 3, 3) and p (N, 3) of the tool in the world."""
    n = len(seen.place)
    return np.stack([stacked(column, n) for column in seen.columns], axis=2), stacked(seen.position, n)
