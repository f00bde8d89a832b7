"""``Cause``: what a diagnosis names, or sets against what it names, with its own words and the axis of its figure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.numerics import TURN, Array
from posture_opt.units import plus_minus, shown

if TYPE_CHECKING:
    from posture_opt.robot.robot import Robot

_ANY_MEASUREMENT = "measure postures in which the two predict different errors"
"""What to measure where neither of two causes says it."""


@dataclass(frozen=True)
class Size:
    """One size of a cause in words.

    Args:
        label: what it is, ``amplitude`` say.
        text: the number with its unit and standard error.
        more: explains the number; empty where nothing is to be explained.
    """

    label: str
    text: str
    more: str = ""

    def __str__(self) -> str:
        return f"{self.text}{self.more}"


ROWS = "rows"
"""Unit of a time where none is logged: rows are counted."""


@dataclass(frozen=True, eq=False)
class FittedSizes:
    """What a fit says of one cause.

    Args:
        values: parameter or shape -> (value, standard error, SI unit).
        covariance: (k, k) of the linear parameters, where it is known [SI].
        turn: least and largest turn of its joint in the data, where it turns one [rad].
        rms: root mean square of that turn about its mean, with its standard error [rad].
        span: range of that joint in the data [rad]; 0 where it is not known.
        resolution: distance up to which its values do not tell two frequencies apart [cycles per revolution].
    """

    values: Mapping[str, tuple[float, float, str]]
    covariance: Array | None = None
    turn: tuple[float, float] | None = None
    rms: tuple[float, float] | None = None
    span: float = 0.0
    resolution: float = 0.0

    @property
    def timed(self) -> bool:
        """Whether the rows have times; without them, what happens in time is counted in rows."""
        return all(unit != ROWS for _, _, unit in self.values.values())

    def entry(self, name: str) -> tuple[float, float]:
        """Value and standard error [SI] of a parameter or a shape.

        Raises:
            KeyError: the fit has none of this name.
        """
        value, std, _ = self.values[name]
        return value, std


class Cause:
    """A named effect, a kind of noise, a geometric deviation or an unnamed component, at one target.

    Subclasses have ``kind`` and ``target``, the names in files.
    """

    phrase: ClassVar[str] = ""
    """What is wrong, in one clause; ``{target}`` stands for the target."""
    measurement: ClassVar[str] = ""
    """What to measure to see this cause by itself."""
    inspection: ClassVar[str] = ""
    """What to look at on the arm, or at the instrument; ``{target}`` stands for the target."""
    urgent: ClassVar[str] = ""
    """Why it is looked at before the arm works on, ``{target}`` the target; empty where the arm can."""
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

    def worded(self, estimate: FittedSizes) -> str:
        """The cause in one clause, as its fitted size has it; `words` where the size does not change them.

        Args:
            estimate: values and standard errors of its parameters and shapes.
        """
        return self.words

    def inspect(self, robot: Robot) -> str:
        """What to look at on the arm, or at the instrument, in one line.

        Args:
            robot: the arm, whose gear ratios say which part turns how often.
        """
        return self.inspection.format(target=self.target)

    def inspect_fitted(self, robot: Robot, estimate: FittedSizes) -> str:
        """What to look at, as its fitted size has it; `inspect` where the size does not change it."""
        return self.inspect(robot)

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
        """Causes for which this is equal are shapes of one cause: only one of them can be true."""
        return self.kind, self.target

    @property
    def spectral_lines(self) -> tuple[float, ...]:
        """Cycles per revolution at which it appears in the periodogram of its joint; none where it is no line."""
        return ()

    @property
    def moved_joint(self) -> str:
        """The joint whose value it changes; empty where it changes none or several."""
        return ""

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """How large it is, the size that says most first.

        Args:
            estimate: values and standard errors of its parameters and shapes.
        """
        return ()

    def headline(self, estimate: FittedSizes) -> str:
        """The size next to the words in one line; empty where no single number says it."""
        sizes = self.sizes(estimate)
        return sizes[0].text if sizes else ""

    def discrimination(self, rival: Cause) -> str:
        """What to measure so that one of the two is refuted.

        First what the pair says of each other, then a measurement that is decisive alone, then both measurements.
        """
        if self.kind == rival.kind and self.moved_joint and rival.moved_joint:
            return f"move {self.moved_joint} while {rival.moved_joint} is at rest, and vice versa"
        pair = self.rivals.get(rival.kind) or rival.rivals.get(self.kind, "")
        if pair:
            return pair.format(target=self.target)
        each = [cause.measurement.format(target=cause.target) for cause in (self, rival) if cause.measurement]
        decisive = [cause.measurement.format(target=cause.target) for cause in (self, rival) if cause.decisive]
        return "; ".join(dict.fromkeys(decisive[:1] or each)) or _ANY_MEASUREMENT


def amplitude(sin: float, cos: float, covariance: Array | None) -> tuple[float, float]:
    """``√(sin² + cos²)`` and its standard error, to first order.

    Args:
        sin, cos: the two coefficients [rad].
        covariance: (2, 2) of them [rad²]; NaN as standard error where it is not known, or the vector is zero.

    Example:
        >>> amplitude(3.0, 4.0, np.eye(2))
        (5.0, 1.0)
    """
    size = math.hypot(sin, cos)
    if covariance is None or size == 0:
        return size, math.nan
    gradient = (sin / size, cos / size)
    variance = sum(gradient[i] * float(covariance[i, j]) * gradient[j] for i in (0, 1) for j in (0, 1))
    return size, math.sqrt(max(variance, 0.0))


def compliance_size(name: str, value: float, std: float) -> Size:
    """A compliance [rad/(N m)] with the stiffness that it is the inverse of.

    Args:
        name: label of the size.
        value, std: estimate and standard error [rad/(N m)]; the stiffness ``1/c`` has ``std/c²``.
    """
    text = shown(value, "angle per torque", std)
    if value <= 0:
        return Size(name, text, " (negative, so that it represents something else)")
    return Size(name, text, f" (stiffness {plus_minus(1e-3 / value, 1e-3 * std / value**2, 1.0, 'kN m/rad')})")


@dataclass(frozen=True, eq=False)
class Abscissa:
    """Values (N,) of one axis of a figure.

    Args:
        values: (N,) in the unit of the label.
        label: quantity and unit.
        side: (N,) side of approach −1 or +1 where the effect is one curve for each, 0 where it is not known.
    """

    values: Array
    label: str
    side: Array

    @classmethod
    def of(cls, state: ArmState, values: Scalar, label: str, side: Scalar = 1.0) -> Abscissa:
        """An axis of values that are the same in all rows, or one a row.

        Args:
            state: of N rows.
            values, side: numbers or (N,).
            label: quantity and unit.
        """
        n = len(np.atleast_1d(np.asarray(state.q[0])))
        return cls(_as_rows(values, n), label, _as_rows(side, n))


def _as_rows(values: Any, n: int) -> Array:
    """(N,) a number repeated, or the values as they are."""
    return np.broadcast_to(np.asarray(values, dtype=float), (n,))


def over_joint(state: ArmState, joint: int, note: str = "", side: Scalar = 1.0) -> Abscissa:
    """The value of a joint, in degrees or millimetres.

    Args:
        state: of N rows.
        joint: index.
        note: behind the label.
        side: (N,) where the effect is one curve for each side.
    """
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
