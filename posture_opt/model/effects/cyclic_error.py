"""Cyclic error of a joint whose period is not known in advance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.errors import enumerated
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar, cos, sin
from posture_opt.model.effects.base.cause import FittedSizes, Size
from posture_opt.model.effects.base.effect import Effect, Excitation
from posture_opt.model.effects.base.joint_effect import Harmonic
from posture_opt.numerics import TURN, Array
from posture_opt.units import Angle, number, plus_minus

MIN_CYCLES, MAX_CYCLES = 2.5, 300.0
"""Cycles per revolution between which lines are searched; below lie eccentricity and second harmonic."""
_SLOW_BELOW_CYCLES = 5.0
"""Cycles per revolution below which it is one of the slow curves over its joint."""
OVERSAMPLING = 3.0
"""Grid points per spacing 2π / range at which neighbouring frequencies are independent."""
_SAME_VALUE_RAD = 1e-3
"""Joint values nearer to each other than this [rad] are one: a twentieth of the shortest period."""
_MIN_JOINT_VALUES = 10
"""Different values of a joint; fewer are met by some line of thousands whatever the errors are."""
_ALIAS_WINDOW = 0.9
"""Value of the spectral window from which two lines have columns that are alike in all but rounding."""
_HARMONIC_TOLERANCE, _MAX_HARMONIC = 0.03, 12
"""A line within this share of the fundamental of its multiple, up to the twelfth, is a harmonic."""
_CHANCE_LEVEL = 0.05
"""Largest probability that the multiples which make a line the fundamental are none."""
_MAX_LISTED_LINES = 3
"""Harmonics, and further lines, in a sentence."""
_WINDOW_VALUES = 500
"""Joint values that the spectral window is taken of; chosen for time."""


class CyclicError(Harmonic):
    """``dq = Σ_i a_i sin(k_i (q − q0)) + b_i cos(k_i (q − q0))``: a periodic error of a joint, by one line or several.

    With q0 in the middle of the data, sines and cosines do not depend on small errors of k. Harmonics of one wheel, and
    what else its shape takes, are lines of one error: its first is the fundamental, or the strongest.
    """

    summary: ClassVar[str] = "joint error whose cycles per revolution are found from the data"
    measurement: ClassVar[str] = (
        "measure many values of {target} that lie on no regular grid, in postures that differ in all other joints"
    )
    rivals: ClassVar[Mapping[str, str]] = {
        "gear_ripple": "measure many joint values that lie on no regular grid, and state 'gear_ratio'",
        "quantisation": "log the joint values that the controller reached, and measure many off any regular grid",
    }
    shape: ClassVar[tuple[str, ...]] = ("cycles", "centre")
    shape_units: ClassVar[Mapping[str, str]] = {"centre": "rad"}
    relative_shape: ClassVar[bool] = False
    family: ClassVar[Literal["named", "steps", "periodic"]] = "periodic"

    kind: Literal["cyclic_error"] = "cyclic_error"
    cycles: float = Field(gt=0, description="k, cycles per revolution of the joint")
    centre: Angle = Field(0.0, description="q0, the joint value that sine and cosine are referred to")

    further: tuple[float, ...] = Field((), description="cycles per revolution of its other lines")

    @property
    def dimensions(self) -> tuple[tuple[str, str], ...]:
        """Name and dimension of sine and cosine of each line [rad]: ``sin``, ``cos``, then ``sin 2``, ``cos 2``, …"""
        more = range(2, len(self.further) + 2)
        return (*self.parameters, *((f"{part} {i}", "angle") for i in more for part in ("sin", "cos")))

    @property
    def lines(self) -> tuple[float, ...]:
        """Cycles per revolution of all lines."""
        return (self.cycles, *self.further)

    @property
    def smooth_shape(self) -> str:
        """The cycles of a single line; several lines close together would run into each other."""
        return "" if self.further else "cycles"

    @property
    def frequency(self) -> float:
        """k of the first line, cycles per revolution of the joint."""
        return self.cycles

    @property
    def frequencies(self) -> tuple[float, ...]:
        """Cycles per revolution of all its lines."""
        return self.lines

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(2 l,) sine and cosine of ``k_i (q − q0)`` of each of l lines, in the order of `dimensions`."""
        angles = [cycles * (state.q[joint] - self.centre) for cycles in self.lines]
        return tuple(wave(angle) for angle in angles for wave in (sin, cos))

    @property
    def spectral_lines(self) -> tuple[float, ...]:
        """Cycles per revolution of all its lines."""
        return self.lines

    @property
    def slow(self) -> bool:  # type: ignore[override] # of this very instance
        """Whether the first line is so slow that it is a curve over the joint's range rather than a ripple."""
        return self.cycles < _SLOW_BELOW_CYCLES

    @property
    def name(self) -> str:
        """``cyclic_error(JOINT k)``: a joint may have several."""
        return f"{self.kind}({self.target} {self.cycles:.4g})"

    @property
    def words(self) -> str:
        """The cause in one clause, with its first lines."""
        return f"{self.joint} has a cyclic error of {self._lines_text(_MAX_LISTED_LINES)}"

    @property
    def qualifier(self) -> str:
        """Its cycles per revolution, all lines included."""
        return self._lines_text(len(self.further))

    def _lines_text(self, most: int) -> str:
        """Its cycles, and the first ``most`` of its harmonics and of its further lines."""
        multiples = [str(n) for n in map(self._harmonic_order, self.further) if n]
        others = [number(k, 3) for k in self.further if not self._harmonic_order(k)]
        harmonics = f"harmonic{'s' * (len(multiples) > 1)} {_first_listed(multiples, most)}" if multiples else ""
        others_text = f"further line{'s' * (len(others) > 1)} at {_first_listed(others, most)}" if others else ""
        more = " and ".join(filter(None, (harmonics, others_text)))
        return f"{number(self.cycles, 4)} cycles per revolution" + (f" with {more}" if more else "")

    def _harmonic_order(self, cycles: float) -> int:
        """Which harmonic of the first line another one is; 0 for none."""
        n = round(cycles / self.cycles)
        return n if 1 < n <= _MAX_HARMONIC and abs(cycles / self.cycles - n) < _HARMONIC_TOLERANCE else 0

    @classmethod
    def joined(cls, lines: Sequence[CyclicError]) -> CyclicError:
        """One error of several lines of a joint, the largest first.

        It is led by the line that most others are harmonics of, if that is no chance: of two lines that have nothing to
        do with each other one is a multiple with the probability 2 ``_HARMONIC_TOLERANCE``, and each line might lead.
        """
        chances = [line._chance_probability(lines) for line in lines]
        least = min(range(len(lines)), key=chances.__getitem__)
        first = lines[least] if len(lines) * chances[least] < _CHANCE_LEVEL else lines[0]
        further = tuple(line.cycles for line in lines if line is not first)
        return first.model_copy(update={"further": further})

    def _chance_probability(self, lines: Sequence[CyclicError]) -> float:
        """The probability that as many of the lines are multiples of this one by chance (binomial)."""
        eligible = sum(1.5 < line.cycles / self.cycles < _MAX_HARMONIC + 0.5 for line in lines)
        met = sum(bool(self._harmonic_order(line.cycles)) for line in lines)
        p = 2 * _HARMONIC_TOLERANCE
        return math.fsum(math.comb(eligible, k) * p**k * (1 - p) ** (eligible - k) for k in range(met, eligible + 1))

    @property
    def exclusive(self) -> tuple[object, ...]:
        """Kind, joint and cycles to one decimal: one joint may have several lines."""
        return self.kind, self.target, round(self.cycles, 1)  # one joint may have several lines

    def bracket(self, span: float) -> tuple[float, float]:
        """Cycles between which a better single line can lie: one step of the grid to either side; ``span`` of the
        joint [rad].
        """
        step = TURN / span / OVERSAMPLING
        return self.cycles - step, self.cycles + step

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """Amplitude and phase of the first line, its cycles, and the amplitudes of the others [mrad]."""
        value, std = estimate.entry("cycles")
        cycles = plus_minus(value, std) if math.isfinite(std) else number(value, 4)
        first = (*super().sizes(estimate), Size("cycles per revolution", cycles))
        more = [
            f"{number(math.hypot(*(estimate.entry(f'{part} {i}')[0] for part in ('sin', 'cos'))) * 1e3, 2)} mrad at "
            f"{number(cycles, 4)}"
            for i, cycles in enumerate(self.further, 2)
        ]
        return (*first, Size("further lines", "; ".join(more))) if more else first

    def to_dict(self) -> dict[str, Any]:
        """The entry of ``effects:``; a centre of zero is left out."""
        entry = super().to_dict()
        return entry if self.centre else {key: value for key, value in entry.items() if key != "centre"}

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        """None: there are thousands, and a diagnosis scans the grid itself."""
        return []  # thousands: the diagnosis scans the grid by itself

    @classmethod
    def grid(cls, span: float) -> np.ndarray:
        """Cycles per revolution (k,) to search where the joint ranges over ``span`` [rad].

        The step is ``2π / span / OVERSAMPLING``; half a period must fit the range.
        """
        step = TURN / max(span, 1e-3) / OVERSAMPLING
        # Half a period must fit the range of the joint: what is longer is no cycle but a curve.
        first = max(MIN_CYCLES, math.pi / max(span, 1e-3))
        return np.arange(first, MAX_CYCLES, step)

    @classmethod
    def resolved(cls, q: Array) -> Array:
        """Cycles per revolution (k,) that the values q (N,) [rad] of a joint resolve.

        None by few values, on a lattice the lower half: values spaced by δ cannot separate k from ``2π/δ − k``, and the
        spectral window ``|Σ exp(i k q)| / N`` is one at 2π/δ.
        """
        values = np.unique(np.round(q / _SAME_VALUE_RAD))
        if len(values) < _MIN_JOINT_VALUES:
            return np.zeros(0)
        cycles = cls.grid(float(np.ptp(q)))
        return np.asarray(cycles[cycles <= _alias_period(q) / 2])

    @classmethod
    def about(cls, joint: str, q: Array) -> CyclicError:
        """A line of a joint that is referred to the middle of its values q (N,) [rad]."""
        return cls(joint=joint, cycles=MIN_CYCLES, centre=f"{(np.min(q) + np.max(q)) / 2:.2f} rad")


def _alias_period(q: Array) -> float:
    """The least distance of two lines that the values q (N,) [rad] cannot separate [cycles per revolution]; inf for
    none.
    """
    q = q[:: -(-len(q) // _WINDOW_VALUES)]
    cycles = CyclicError.grid(float(np.ptp(q)))
    far = np.concatenate([cycles, cycles + MAX_CYCLES])
    far = far[far * np.ptp(q) > 4 * math.pi]  # nearer, the window has its own main lobe
    window = np.abs(np.exp(1j * np.outer(far, q)).mean(axis=1))
    aliased = far[window > _ALIAS_WINDOW]
    return float(aliased[0]) if len(aliased) else math.inf


def _first_listed(texts: Sequence[str], most: int) -> str:
    """The first of many texts, and how many more there are."""
    more = len(texts) - most
    return enumerated([*texts[:most], f"{more} more"] if more > 0 else texts)
