"""``Cause``: what a diagnosis names, or sets against what it names, with its own words and the axis of its figure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.numerics import Array
from posture_opt.units import plus_minus, shown

_ANY = "measure postures in which the two predict different errors"


@dataclass(frozen=True)
class Size:
    """One size of a cause in words; ``more`` explains the number."""

    label: str
    text: str
    more: str = ""

    def __str__(self) -> str:
        return f"{self.text}{self.more}"


@dataclass(frozen=True, eq=False)
class FittedSizes:
    """What a fit says of one cause.

    Args:
        values: parameter or shape -> (value, standard error, SI unit).
        covariance: (k, k) of the linear parameters, where it is known [SI].
        timed: whether the rows have times; without them, what happens in time is counted in rows.
        turn: least and largest turn of its joint in the data, where it turns one [rad].
    """

    values: Mapping[str, tuple[float, float, str]]
    covariance: Array | None = None
    timed: bool = True
    turn: tuple[float, float] | None = None

    def entry(self, name: str) -> tuple[float, float]:
        """Value and standard error [SI]."""
        value, std, _ = self.values[name]
        return value, std


class Cause:
    """A named effect, a kind of noise, a geometric deviation or an unnamed component, at one target.

    Subclasses have ``kind`` and ``target``, the names that stand in files.
    """

    phrase: ClassVar[str] = ""
    """What is wrong, in one clause; ``{target}`` stands for the target."""
    measurement: ClassVar[str] = ""
    """What to measure to see this cause by itself."""
    decisive: ClassVar[bool] = False
    """Whether that measurement discriminates it from any other cause."""
    rivals: ClassVar[Mapping[str, str]] = {}
    """Kind that could be confused with it -> the measurement that discriminates the two; a pair needs one entry."""

    if TYPE_CHECKING:

        @property
        def kind(self) -> str: ...

        @property
        def target(self) -> str: ...

    @property
    def words(self) -> str:
        """The cause in one clause: "elbow is compliant under gravity"."""
        return self.phrase.format(target=self.target)

    @property
    def title(self) -> str:
        """The kind as it is read: "joint compliance"."""
        return self.kind.replace("_", " ")

    @property
    def place(self) -> str:
        """What a label says of the target; nothing where the kind says it already."""
        return "" if self.target in (*self.title.split(), "all", "data") else self.target

    @property
    def qualifier(self) -> str:
        """What tells two causes of one kind and target apart, such as the cycles per revolution."""
        return ""

    @property
    def label(self) -> str:
        """Kind and target: "cyclic error (elbow, 12.00 cycles per revolution)"."""
        more = ", ".join(filter(None, (self.place, self.qualifier)))
        return f"{self.title} ({more})" if more else self.title

    @property
    def exclusive(self) -> tuple[object, ...]:
        """Causes for which this is equal are shapes of one cause: only one of them can be true."""
        return self.kind, self.target

    @property
    def spectral_lines(self) -> tuple[float, ...]:
        """Cycles per revolution at which it stands in the periodogram of its joint; none where it is no line."""
        return ()

    @property
    def moved_joint(self) -> str:
        """The joint whose value it changes; empty where it changes none or several."""
        return ""

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """How large it is, the most telling size first."""
        return ()

    def headline(self, estimate: FittedSizes) -> str:
        """The size that stands beside the words in one line; empty where no single number says it."""
        sizes = self.sizes(estimate)
        return sizes[0].text if sizes else ""

    def discrimination(self, rival: Cause) -> str:
        """What to measure so that one of the two is refuted."""
        if self.kind == rival.kind and self.moved_joint and rival.moved_joint:
            return f"move {self.moved_joint} while {rival.moved_joint} stands still, and vice versa"
        pair = self.rivals.get(rival.kind) or rival.rivals.get(self.kind, "")
        if pair:
            return pair.format(target=self.target)
        each = [cause.measurement.format(target=cause.target) for cause in (self, rival) if cause.measurement]
        decisive = [cause.measurement.format(target=cause.target) for cause in (self, rival) if cause.decisive]
        return "; ".join(dict.fromkeys(decisive[:1] or each)) or _ANY


def amplitude(sin: float, cos: float, covariance: Array | None) -> tuple[float, float]:
    """Length of the vector (sin, cos) and its standard error from the covariance (2, 2), to first order."""
    size = math.hypot(sin, cos)
    if covariance is None or size == 0:
        return size, math.nan
    gradient = (sin / size, cos / size)
    variance = sum(gradient[i] * float(covariance[i, j]) * gradient[j] for i in (0, 1) for j in (0, 1))
    return size, math.sqrt(max(variance, 0.0))


def listed(texts: Sequence[str]) -> str:
    """Some words in one: "a, b and c"."""
    return " and ".join(filter(None, (", ".join(texts[:-1]), *texts[-1:])))


def compliance_size(name: str, value: float, std: float) -> Size:
    """A compliance [rad/(N m)] with the stiffness that it is the inverse of."""
    text = shown(value, "angle per torque", std)
    if value <= 0:
        return Size(name, text, " (negative, so that it stands for something else)")
    return Size(name, text, f" (stiffness {plus_minus(1e-3 / value, 1e-3 * std / value**2, 1.0, 'kN m/rad')})")


@dataclass(frozen=True, eq=False)
class Abscissa:
    """Values (N,) of one axis.

    Args:
        label: quantity and unit.
        side: (N,) side of approach −1 or +1 where the effect is one curve for each, 0 where no one knows it.
    """

    values: Array
    label: str
    side: Array

    @classmethod
    def of(cls, state: ArmState, values: Scalar, label: str, side: Scalar = 1.0) -> Abscissa:
        """An axis of values that are the same in all rows, or one a row."""
        n = len(np.atleast_1d(np.asarray(state.q[0])))
        return cls(_rows(values, n), label, _rows(side, n))


def _rows(values: Any, n: int) -> Array:
    return np.broadcast_to(np.asarray(values, dtype=float), (n,))


def over_joint(state: ArmState, joint: int, note: str = "", side: Scalar = 1.0) -> Abscissa:
    """The value of a joint."""
    of = state.robot.joints[joint]
    factor, unit = (math.degrees(1.0), "deg") if of.type == "revolute" else (1e3, "mm")
    return Abscissa.of(state, factor * np.asarray(state.q[joint]), f"{of.name} [{unit}]{note}", side)


def over_phase(state: ArmState, joint: int, cycles: float) -> Abscissa:
    """The phase of an error of so many cycles per revolution of a joint."""
    phase = np.degrees(np.mod(cycles * np.asarray(state.q[joint]), 2 * np.pi))
    return Abscissa.of(state, phase, f"phase of the cycle [deg], {cycles:.4g} cycles per revolution")


def over_time(state: ArmState, timed: bool) -> Abscissa:
    """The time of each row; its number where no times are logged."""
    time = np.asarray(state.inputs.time, dtype=float)
    return (
        Abscissa.of(state, time / 60, "time [min]")
        if timed
        else Abscissa.of(state, time + 1.0, "row, in the order of measuring")
    )
