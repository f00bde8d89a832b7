"""``Cause``: what a diagnosis names or weighs, with its words and the axis of its figure; ``CatalogueEntry``: those of
a file."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import WithJsonSchema

from posture_opt.encoding import Encoded
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.numerics import TURN, Array
from posture_opt.robot.robot import Robot
from posture_opt.spec import Spec
from posture_opt.units import plus_minus, shown

# What to measure where neither of two causes says it
_ANY_MEASUREMENT = "measure postures in which the two predict different errors"


@dataclass(frozen=True)
class Size:
    """One size of a cause, as text."""

    label: str  # what it is, amplitude say
    text: str  # the number with its unit and standard error
    more: str = ""  # explains the number; empty where nothing is to be explained

    def __str__(self) -> str:
        return f"{self.text}{self.more}"


ROWS = "rows"  # Unit of a time where none is logged: rows are counted


@dataclass(frozen=True, eq=False)
class FittedSizes:
    """What a fit says of one cause."""

    values: Mapping[str, tuple[float, float, str]]  # parameter or shape -> (value, standard error, SI unit)
    covariance: Array | None = None  # (k, k) of the linear parameters, where it is known [SI]
    turn: tuple[float, float] | None = None  # least and largest turn of its joint in the data, where it turns one [rad]
    # root mean square of that turn about its mean, with its standard error [rad]
    rms: tuple[float, float] | None = None
    span: float = 0.0  # range of that joint in the data [rad]; 0 where it is not known
    resolution: float = 0.0  # distance up to which its values do not tell two frequencies apart [cycles per revolution]

    @property
    def timed(self) -> bool:
        """Whether the rows have times; without them, what happens in time is counted in rows."""
        return all(unit != ROWS for _, _, unit in self.values.values())

    def entry(self, name: str) -> tuple[float, float]:
        """Value and standard error [SI] of a parameter or a shape."""
        value, std, _ = self.values[name]
        return value, std

    def length(self, names: Iterable[str]) -> tuple[float, float]:
        """Length of a vector of parameters [SI] and its standard error, its parts taken as independent."""
        parts = [self.entry(name) for name in names]
        size = math.hypot(*(value for value, _ in parts))
        return size, math.hypot(*(value * std for value, std in parts)) / size if size else math.nan

    def shift_length(self) -> Size:
        """Length of the shift x, y, z."""
        length, std = self.length("xyz")
        return Size("shift length", shown(length, "length", std))


class Cause:
    """A named effect, a kind of noise, a geometric deviation or an unnamed component, at one target. Subclasses have
    ``kind`` and ``target``, the names in files."""

    phrase: ClassVar[str] = ""  # What is wrong, in one clause; {target} stands for the target
    measurement: ClassVar[str] = ""  # What to measure to see this cause by itself
    inspection: ClassVar[str] = ""  # What to look at on the arm, or at the instrument; {target} stands for the target
    # Why it is looked at before the arm works on, {target} the target; empty where the arm can
    urgent: ClassVar[str] = ""
    decisive: ClassVar[bool] = False  # Whether that measurement discriminates it from any other cause
    # Kind that could be confused with it -> the measurement that discriminates the two; a pair needs one entry
    rivals: ClassVar[Mapping[str, str]] = {}

    if TYPE_CHECKING:

        @property
        def kind(self) -> str: ...

        @property
        def target(self) -> str: ...

    @property
    def words(self) -> str:
        """The cause in one clause: "elbow is compliant under gravity"."""
        return self.phrase.format(target=self.target)

    def worded(self, estimate: FittedSizes) -> str:
        """The cause in one clause, as its fitted size has it; `words` where the size does not change them."""
        return self.words

    def inspect(self, robot: Robot) -> str:
        """What to look at on the arm, or at the instrument, in one line."""
        return self.inspection.format(target=self.target)

    def inspect_fitted(self, robot: Robot, estimate: FittedSizes) -> str:
        """What to look at, as its fitted size has it; `inspect` where the size does not change it."""
        return self.inspect(robot)

    @property
    def title(self) -> str:
        return self.kind.replace("_", " ")

    @property
    def place(self) -> str:
        """What a label says of the target; nothing where the kind says it already."""
        return "" if self.target in (*self.title.split(), "all", "data") else self.target

    @property
    def qualifier(self) -> str:
        """What distinguishes two causes of one kind and target, such as the cycles per revolution."""
        return ""

    @property
    def label(self) -> str:
        """Kind and target: "cyclic error (elbow, 12.0 cycles per revolution)"."""
        more = ", ".join(filter(None, (self.place, self.qualifier)))
        return f"{self.title} ({more})" if more else self.title

    @property
    def title_or_words(self) -> str:
        """The label; the words of what has no name, which its label says to those only who know the search."""
        return self.label

    def labelled(self, estimate: FittedSizes) -> str:
        """The label, as its fitted size has it; `label` where the size does not change it."""
        return self.label

    @property
    def looks_like(self) -> str:
        """The words of a cause of a size that no arm has: "an error that looks like joint compliance of elbow"."""
        named = f"{self.title} of {self.place}" if self.place else self.title
        return f"an error that looks like {named}{f', {self.qualifier}' if self.qualifier else ''}"

    @property
    def exclusive(self) -> tuple[object, ...]:
        """Causes with equal values are shapes of one cause: only one of them can be true."""
        return self.kind, self.target

    @property
    def spectral_lines(self) -> tuple[float, ...]:
        """Cycles per revolution in the periodogram of its joint."""
        return ()

    @property
    def moved_joint(self) -> str:
        """The one joint whose value it changes, or an empty text."""
        return ""

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The size that says most first."""
        return ()

    def headline(self, estimate: FittedSizes) -> str:
        """The size next to the words in one line; empty where no single number says it."""
        sizes = self.sizes(estimate)
        return sizes[0].text if sizes else ""

    def discrimination(self, rival: Cause) -> str:
        """What to measure so that one of the two is refuted. First what the pair says of each other, then a measurement
        that is decisive alone, then both measurements."""
        if self.kind == rival.kind and self.moved_joint and rival.moved_joint:
            return f"move {self.moved_joint} while {rival.moved_joint} is at rest, and vice versa"
        pair = self.rivals.get(rival.kind) or rival.rivals.get(self.kind, "")
        if pair:
            return pair.format(target=self.target)
        each = [cause.measurement.format(target=cause.target) for cause in (self, rival) if cause.measurement]
        decisive = [cause.measurement.format(target=cause.target) for cause in (self, rival) if cause.decisive]
        return "; ".join(dict.fromkeys(decisive[:1] or each)) or _ANY_MEASUREMENT


def amplitude(sin: float, cos: float, covariance: Array | None) -> tuple[float, float]:
    """``√(sin² + cos²)`` [rad] and its standard error to first order, by the covariance (2, 2) [rad²] or NaN."""
    size = math.hypot(sin, cos)
    if covariance is None or size == 0:
        return size, math.nan
    gradient = (sin / size, cos / size)
    variance = sum(gradient[i] * float(covariance[i, j]) * gradient[j] for i in (0, 1) for j in (0, 1))
    return size, math.sqrt(max(variance, 0.0))


def compliance_size(name: str, value: float, std: float) -> Size:
    """A compliance [rad/(N m)] ± std with the stiffness ``1/c ± std/c²``."""
    text = shown(value, "angle per torque", std)
    if value <= 0:
        return Size(name, text, " (negative, so that it represents something else)")
    return Size(name, text, f" (stiffness {plus_minus(1e-3 / value, 1e-3 * std / value**2, 1.0, 'kN m/rad')})")


@dataclass(frozen=True, eq=False)
class Abscissa:
    """Values (N,) of one axis of a figure."""

    values: Array  # (N,) in the unit of the label
    label: str  # quantity and unit
    side: Array  # (N,) side of approach −1 or +1 where the effect is one curve for each, 0 where it is not known

    @classmethod
    def of(cls, state: ArmState, values: Scalar, label: str, side: Scalar = 1.0) -> Abscissa:
        """An axis of values and sides, numbers or (N,)."""
        n = len(np.atleast_1d(np.asarray(state.q[0])))
        return cls(_as_rows(values, n), label, _as_rows(side, n))


def _as_rows(values: Any, n: int) -> Array:
    return np.broadcast_to(np.asarray(values, dtype=float), (n,))


def over_joint(state: ArmState, joint: int, note: str = "", side: Scalar = 1.0) -> Abscissa:
    """The value of a joint, in degrees or millimetres. side: (N,) where the effect is one curve for each side."""
    of = state.robot.joints[joint]
    factor, unit = (math.degrees(1.0), "deg") if of.type == "revolute" else (1e3, "mm")
    return Abscissa.of(state, factor * np.asarray(state.q[joint]), f"{of.name} [{unit}]{note}", side)


def over_phase(state: ArmState, joint: int, cycles: float) -> Abscissa:
    """The phase of an error of so many cycles per revolution of a joint, 0 to 360 deg."""
    phase = np.degrees(np.mod(cycles * np.asarray(state.q[joint]), TURN))
    return Abscissa.of(state, phase, "phase of the cycle [deg]")


def over_time(state: ArmState, timed: bool) -> Abscissa:
    """The time of each row [min]; its number from 1 where no times are logged."""
    time = np.asarray(state.inputs.time, dtype=float)
    return (
        Abscissa.of(state, time / 60, "time [min]")
        if timed
        else Abscissa.of(state, time + 1.0, "row, in the order of measuring")
    )


Input = str  # A key of INPUTS
# A number for a ratio, else a text with a unit; read where the dimension of the parameter is known
Quantity = Annotated[Any, WithJsonSchema({"type": ["string", "number"]})]


@dataclass(frozen=True)
class NeededInput:
    """What an effect may need to be seen."""

    words: str  # its name in reports
    hint: str  # how to supply it


# Key of an input -> its name and how to supply it
INPUTS: dict[Input, NeededInput] = {
    "approach": NeededInput(
        "both sides", "approach each joint value from both sides; columns 'JOINT.approach' state them"
    ),
    "payload": NeededInput("payload", "measure with two payloads or more, in a column 'payload [kg]'"),
    "temperature": NeededInput("temperature", "log it as it changes, in a column 'temperature [degC]'"),
    "time": NeededInput("time", "log it in a column 'time [s]'"),
    "speed": NeededInput("motion", "measure along a moving path and log the time of its rows in a column 'time [s]'"),
    "masses": NeededInput("masses", "state 'mass' and 'com' of every joint in the problem file"),
    "gear_ratio": NeededInput("gear ratio", "state 'gear_ratio' of every joint in the problem file"),
}


@dataclass(frozen=True)
class Limit(Encoded, json="kind target reason hint mend=hint"):
    """A cause that cannot be known from data of a kind: an entry of ``unknowable`` in ``diagnosis.json``."""

    kind: str  # kind, target: of the cause
    target: str
    reason: str  # why not
    hint: str  # what would show it


@dataclass(frozen=True)
class Evidence:
    """What one robot's data are made of."""

    positions: bool  # whether an instrument measured lengths, in place of touched points and planes
    lengths: tuple[str, ...]  # names of the arm's lengths that the data could say something about


class CatalogueEntry(Cause, Spec):
    """One kind of the catalogue at one target: an entry of ``effects:`` in a problem file."""

    summary: ClassVar[str]  # One line for optimize-posture list
    shape_units: ClassVar[Mapping[str, str]] = {}  # SI units of the fields that have one
    needs: ClassVar[frozenset[Input]] = frozenset()  # Inputs without which the effect cannot be seen

    kind: str

    @property
    @abstractmethod
    def target(self) -> str:
        """What the effect is of: a joint, a length, base, tool, payload, instrument or data."""

    @property
    def name(self) -> str:
        """``kind(target)``."""
        return f"{self.kind}({self.target})"

    @property
    def stated_words(self) -> str:
        """Kind, target and stated size: "joint compliance of elbow 8.00 µrad/(N m) (stiffness 125 kN m/rad)"."""
        named = f"{self.title} of {self.place}" if self.place else self.title
        qualifier = f", {self.qualifier}" if self.qualifier else ""
        return f"{named} {self.stated_size}{qualifier}"

    @property
    @abstractmethod
    def stated_size(self) -> str: ...

    @classmethod
    def kind_name(cls) -> str:
        """The ``kind`` of every instance."""
        return str(cls.model_fields["kind"].default)

    def check_robot(self, robot: Robot) -> None:
        """Refuse a robot that lacks what the effect is about."""

    @classmethod
    def unknowable(cls, evidence: Evidence) -> Limit | None:
        """Why no data of this kind can ever show the effect, whatever its size; ``None`` where they can."""
        return None

    def to_dict(self) -> dict[str, Any]:
        """The entry of ``effects:`` in a problem file, with units; empty and absent fields are left out."""
        entry = {key: value for key, value in self.model_dump(exclude_none=True).items() if value not in ({}, ())}
        for name, unit in self.shape_units.items():
            if name in entry:
                entry[name] = f"{entry[name]:.12g} {unit}"
        return {key: list(value) if isinstance(value, tuple) else value for key, value in entry.items()}
