"""Frequencies of periodic errors: as text, as multiples of each other, and as turns of the motor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.encoding import Encoded
from posture_opt.errors import enumerated
from posture_opt.numerics import TURN, Array
from posture_opt.units import number

# Distances at which the window is taken, and joint values that it is taken of; chosen for time
_WINDOW_POINTS, _WINDOW_VALUES = 200, 500


def harmonic_order(cycles: Sequence[float], sizes: Sequence[tuple[float, float]], line: int, span: float) -> int:
    """Which multiple of the first line another one is for sure, 0 for none: the ratio is whole within two standard
    errors, which are small. ``sizes`` [rad] with standard errors, ``span`` the range of the joint [rad]."""
    if not span > 0:
        return 0
    ratio = cycles[line] / cycles[0]
    errors = [cycles_error(sizes[i], span) / cycles[i] for i in (0, line)]
    # Standard errors by which the ratio of two lines may differ from a whole number.
    deviation = 2.0 * ratio * math.hypot(*errors)
    n = round(ratio)
    # Multiple of another line up to which a line can be its harmonic.
    # Largest deviation that still says something: a ratio known no better lies near some whole number by accident.
    sure = 1 < n <= 12 and deviation < 0.05
    return n if sure and abs(ratio - n) < deviation else 0


def cycles_error(size: tuple[float, float], span: float) -> float:
    """Standard error of the cycles of a line of amplitude A ± s [rad] over a range w [rad], ``√12 s / (A w)`` (Rife,
    Boorstyn 1974)."""
    return math.sqrt(12) * size[1] / (size[0] * span)


def resolution(q: Array) -> float:
    """The largest distance at which two lines look alike at the values q (N,) [rad] of a joint, cycles per revolution.
    Their columns do where the spectral window ``|Σ exp(i Δ q)| / N`` is above 0.5: Δ = 0.6 2π / range where
    the values spread evenly, and more where they come in clumps. What repeats beyond 2.0 is an alias."""
    span = float(np.ptp(q))
    if not span > 0:
        return 0.0
    # How far two lines may be apart to be two shapes of one error, in units of 2π / range; chosen on series A, B, D.
    near = np.linspace(0.0, 2.0 * TURN / span, _WINDOW_POINTS)
    window = np.abs(np.exp(1j * np.outer(near, q[:: -(-len(q) // _WINDOW_VALUES)])).mean(axis=1))
    # Spectral window of two lines above which the fit shares an error between them.
    return float(near[window > 0.5][-1])


def line_words(lines: Sequence[float]) -> str:
    listed = enumerated([cycles_text(k) for k in lines])
    return f"line{'s' * (len(lines) > 1)} at {listed} cycles per revolution"


def cycles_text(cycles: float) -> str:
    """Cycles per revolution to a tenth, and to three digits below ten."""
    # Cycles per revolution from which three digits would round to whole ones.
    return number(cycles, 3 if cycles < 100.0 else 4)


# Ratios of strain-wave gears with the circular spline at rest; one more where the flexspline is (Harmonic Drive)
_STRAIN_WAVE = (30.0, 50.0, 80.0, 100.0, 120.0, 160.0)
# Ratios of cycloidal gears that no strain-wave gear has (Nabtesco, RV-E)
_CYCLOIDAL = (57.0, 105.0, 129.0, 141.0, 145.0, 171.0, 185.0)
# Motor turns per turn of the joint
COMMON_RATIOS = tuple(sorted({*_STRAIN_WAVE, *(ratio + 1 for ratio in _STRAIN_WAVE), *_CYCLOIDAL}))
# How often a part errs while the motor turns once; wave generators are oval, so that two is as usual as one
_OFTEN = {1: "once", 2: "twice", 3: "three times", 4: "four times"}
# What errs so often in a turn of the motor (Ghorbel, Gandhi, Alpeter 2001, on strain-wave gears)
_PART = "wave generator or pinion, motor shaft and motor encoder"


@dataclass(frozen=True)
class RotatingPart(Encoded, json="cycles part ratio per_motor_turn=per_turn"):
    """A part that turns as often as an error repeats."""

    cycles: float  # of the error, per revolution of the joint
    ratio: float  # motor turns per turn of the joint; stated whether it is that of the file
    per_turn: int  # how often the error repeats in a turn of the motor
    stated: bool

    @property
    def part(self) -> str:
        """What errs so often."""
        return _PART

    @property
    def words(self) -> str:
        at = "" if self.stated else f" at a gear ratio of {number(self.ratio)}"
        often = (
            f"{cycles_text(self.cycles)} cycles per revolution is {_OFTEN[self.per_turn]} per revolution of the motor"
        )
        return f"{often}{at}"


def rotating_parts(lines: Sequence[float], stated: float) -> tuple[RotatingPart, ...]:
    """The parts that turn as often as lines of a joint repeat, one for each line that has some. Of the common ratios
    that explain the largest line, the one that explains most lines, with the fewest cycles per motor turn. A line alone
    may have several explanations; the simplest is named."""
    known = math.isfinite(stated)
    ratios = (abs(stated),) if known else COMMON_RATIOS
    found = [tuple(p for k in lines if (p := _part_of(k, ratio, known)) is not None) for ratio in ratios]
    if not known:
        found = [parts for parts in found if parts and parts[0].cycles == lines[0]]
    return max(found, key=lambda parts: (len(parts), -sum(p.per_turn for p in parts)), default=())


def _part_of(cycles: float, ratio: float, stated: bool) -> RotatingPart | None:
    times = round(cycles / ratio)
    # Cycles per revolution by which a line may be off: neighbouring ratios are one apart.
    if times in _OFTEN and abs(cycles - times * ratio) <= 0.4:
        return RotatingPart(cycles, ratio, times, stated)
    return None
