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
from posture_opt.model.effects.base.cause import FittedSizes, Size, amplitude
from posture_opt.model.effects.base.effect import Effect, Excitation
from posture_opt.model.effects.base.joint_effect import Harmonic
from posture_opt.model.effects.base.multiples import COMMON_RATIOS, cycles_error, cycles_text, harmonic_order
from posture_opt.numerics import TURN, Array
from posture_opt.robot.robot import Robot
from posture_opt.units import Angle, number, plus_minus, shown

# Cycles per revolution between which lines are searched; below lie eccentricity and second harmonic
MIN_CYCLES, MAX_CYCLES = 2.5, 300.0
OVERSAMPLING = 3.0  # Grid points per spacing 2π / range at which neighbouring frequencies are independent
_SLOW_INSPECTION = "{target} over its whole range: encoder or gear off centre, a bent shaft, cables and hoses that pull"
_LINE_UNITS = " (amplitudes at cycles per revolution)"


class CyclicError(Harmonic):
    """``dq = Σ_i a_i sin(k_i (q − q0)) + b_i cos(k_i (q − q0))``: a periodic error of a joint, by one line or several.

    With q0 in the middle of the data, sines and cosines do not depend on small errors of k. What the shape of the error
    takes are lines of one cause, the largest first.
    """

    summary: ClassVar[str] = "joint error whose cycles per revolution are found from the data"
    measurement: ClassVar[str] = (
        "measure many values of {target} that lie on no regular grid, in postures that differ in all other joints"
    )
    inspection: ClassVar[str] = (
        "what comes {cycles} times per revolution of {target}: bolts of a flange, rollers, encoder periods, a gear "
        "stage or belt; {motor}"
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
    def size_parts(self) -> tuple[slice, ...]:
        """Sine and cosine of each line: a line that data leave open says nothing of the others."""
        return tuple(slice(2 * i, 2 * i + 2) for i in range(len(self.lines)))

    def of_parts(self, parts: Sequence[int]) -> CyclicError:
        """The error of some of its lines alone."""
        if len(parts) == len(self.lines):
            return self
        first, *further = (self.lines[i] for i in parts)
        fewer = self.model_copy(update={"cycles": first, "further": tuple(further), "estimate": {}})
        values = self.values
        own = [values[2 * i + k] for i in parts for k in (0, 1)]
        found = fewer.with_estimate(own) if self.estimate else fewer
        assert isinstance(found, CyclicError)
        return found

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
        return self.lines

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(2 l,) sine and cosine of ``k_i (q − q0)`` of each of l lines, in the order of `dimensions`."""
        angles = [cycles * (state.q[joint] - self.centre) for cycles in self.lines]
        return tuple(wave(angle) for angle in angles for wave in (sin, cos))

    @property
    def spectral_lines(self) -> tuple[float, ...]:
        return self.lines

    @property
    def slow(self) -> bool:  # type: ignore[override] # of this very instance
        """Whether all lines are curves over the joint's range rather than ripple."""
        return max(self.lines) < 5.0  # cycles per revolution below which it is one of the slow curves over its joint

    @property
    def name(self) -> str:
        """``cyclic_error(JOINT k)``: a joint may have several."""
        return f"{self.kind}({self.target} {self.cycles:.4g})"

    @property
    def words(self) -> str:
        if not self.further:
            return f"{self.joint} has a cyclic error of {cycles_text(self.cycles)} cycles per revolution"
        texts = [cycles_text(k) for k in self.lines[:3]]
        listed = ", ".join(texts) + " …" if len(self.lines) > len(texts) else enumerated(texts)
        return f"{self.joint} has a cyclic error of {len(self.lines)} lines ({listed} cycles per revolution)"

    def worded(self, estimate: FittedSizes) -> str:
        slow = f"{self.joint} has a slow error over its range"
        bands = self.bands(estimate)
        if not bands:
            return slow
        noun = "lines" if all(len(band) == 1 for band in bands) else "bands"
        many = f"{len(bands)} {noun}, the largest at " if len(bands) > 1 else ""
        largest = f"{many}{self._cycles_known(bands[0], estimate)} cycles per revolution"
        if 0 not in self.sharp(estimate.span):
            return f"{slow} and a cyclic error of {largest}"
        return f"{self.joint} has a cyclic error of {largest}"

    def sharp(self, span: float) -> tuple[int, ...]:
        """The lines with a frequency within a range of the joint [rad]; all if it is unknown."""
        # Periods within the range of a joint from which on an error has a frequency; fewer are a curve.
        return tuple(i for i, k in enumerate(self.lines) if not span > 0 or k * span / TURN >= 1.5)

    def bands(self, estimate: FittedSizes) -> tuple[tuple[int, ...], ...]:
        """Lines with a frequency, those together that the joint values do not tell apart; the strongest band and line
        first."""
        found: list[list[int]] = []
        for i in sorted(self.sharp(estimate.span), key=lambda i: self.lines[i]):
            if found and self.lines[i] - self.lines[found[-1][-1]] <= estimate.resolution:
                found[-1].append(i)
            else:
                found.append([i])
        sizes = [size for size, _ in self._amplitudes(estimate)]
        return tuple(tuple(sorted(band)) for band in sorted(found, key=lambda band: -_together(sizes, band)))

    def band_text(self, band: Sequence[int]) -> str:
        """Cycles per revolution of the lines of a band: "17.3", or from, to "15 to 18"."""
        every = [self.lines[i] for i in band]
        if len(every) == 1:
            return cycles_text(every[0])
        return f"{math.floor(min(every))} to {math.ceil(max(every))}"

    def _cycles_known(self, band: Sequence[int], estimate: FittedSizes) -> str:
        error = math.nan if self.further else estimate.values.get("cycles", (0.0, math.nan, ""))[1]
        if not math.isfinite(error) and estimate.span > 0:
            error = cycles_error(self._amplitudes(estimate)[band[0]], estimate.span)
        # Standard error of cycles per revolution from which on it is said: smaller ones change nothing that is looked
        # at.
        if len(band) > 1 or not error > 0.05:
            return self.band_text(band)
        digits = max(-math.floor(math.log10(error)), 0)
        return f"{self.lines[band[0]]:.{digits}f} ± {error:.{digits}f}"

    @property
    def qualifier(self) -> str:
        if self.further:
            return f"{cycles_text(self.cycles)}/rev + {len(self.further)} more"
        return f"{cycles_text(self.cycles)} cycles per revolution"

    def labelled(self, estimate: FittedSizes) -> str:
        bands = self.bands(estimate)
        if not bands:
            return f"{self.title} ({self.joint}, slow)"
        more = f" + {len(bands) - 1} more" if len(bands) > 1 else ""
        slow = "" if 0 in self.sharp(estimate.span) else "slow and "
        return f"{self.title} ({self.joint}, {slow}{self.band_text(bands[0])}/rev{more})"

    def inspect(self, robot: Robot) -> str:
        return self._inspect(robot, tuple(range(len(self.lines))), cycles_text(self.cycles))

    def inspect_fitted(self, robot: Robot, estimate: FittedSizes) -> str:
        bands = self.bands(estimate)
        if not bands:
            return _SLOW_INSPECTION.format(target=self.joint)
        return self._inspect(robot, [i for band in bands for i in band], self._cycles_known(bands[0], estimate))

    def _inspect(self, robot: Robot, lines: Sequence[int], cycles: str) -> str:
        """What turns as often as some lines, the largest of which has so many ``cycles``."""
        own = self.of_parts(lines)
        assert isinstance(own, CyclicError)
        for part in own.rotating_parts(robot):
            return f"{part.part} of {self.joint}: {part.words}"
        ratio = {joint.name: joint.gear_ratio for joint in robot.joints}.get(self.joint, math.nan)
        known = math.isfinite(ratio)
        slowest = abs(ratio) if known else min(COMMON_RATIOS)
        motor = "too slow for the motor" if own.cycles < slowest else "no whole number per turn of the motor"
        motor += f" at {number(slowest)}:1" if known else " at usual ratios"
        return self.inspection.format(target=self.joint, cycles=cycles, motor=motor)

    @classmethod
    def joined(cls, lines: Sequence[CyclicError], amplitudes: Sequence[float]) -> CyclicError:
        """One error of several lines of a joint, the largest of the ``amplitudes`` [rad] first."""
        order = sorted(range(len(lines)), key=lambda i: -amplitudes[i])
        first, *further = (lines[i] for i in order)
        return first.model_copy(update={"further": tuple(line.cycles for line in further)})

    @property
    def exclusive(self) -> tuple[object, ...]:
        """Kind, joint and cycles to one decimal: one joint may have several lines."""
        return self.kind, self.target, round(self.cycles, 1)

    def bracket(self, span: float) -> tuple[float, float]:
        """One step of the grid to either side; ``span`` of the joint [rad]."""
        step = TURN / span / OVERSAMPLING
        return self.cycles - step, self.cycles + step

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        if self.further:
            # Over whole cycles √(Σ (a² + b²) / 2); in the data, lines that run into each other cancel in part.
            whole = math.sqrt(sum(a**2 for a, _ in self._amplitudes(estimate)) / 2), math.nan
            rms, std = estimate.rms or whole
            together = Size("size", f"{shown(rms, 'angle', std)} RMS", f", {len(self.lines)} lines together")
            return together, Size("lines", "; ".join(self._line_texts(estimate)), _LINE_UNITS)
        value, std = estimate.entry("cycles")
        cycles = plus_minus(value, std) if math.isfinite(std) else cycles_text(value)
        return (*super().sizes(estimate), Size("cycles per revolution", cycles))

    def _amplitudes(self, estimate: FittedSizes) -> list[tuple[float, float]]:
        """Amplitude of each line with its standard error [rad]."""
        found = []
        for i in range(len(self.lines)):
            sin_i, cos_i = (f"{part} {i + 1}" if i else part for part in ("sin", "cos"))
            own = slice(2 * i, 2 * i + 2)
            C = None if estimate.covariance is None else estimate.covariance[own, own]
            found.append(amplitude(estimate.entry(sin_i)[0], estimate.entry(cos_i)[0], C))
        return found

    def _line_texts(self, estimate: FittedSizes) -> list[str]:
        sizes = self._amplitudes(estimate)
        bands = self.bands(estimate)
        slow = [(i,) for i in range(len(self.lines)) if not any(i in band for band in bands)]
        alone = {band[0] for band in bands if len(band) == 1}
        texts = []
        for band in sorted([*slow, *bands]):
            size, first = _together([size for size, _ in sizes], band), band[0]
            n = harmonic_order(self.lines, sizes, first, estimate.span) if first and {0, first} <= alone else 0
            harmonic = f" (harmonic {n})" if n else ""
            texts.append(f"{number(size * 1e3, 2)} mrad at {self.band_text(band)}{harmonic}")
        return texts

    def to_dict(self) -> dict[str, Any]:
        """The entry of ``effects:``; a centre of zero is left out."""
        entry = super().to_dict()
        return entry if self.centre else {key: value for key, value in entry.items() if key != "centre"}

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        """None: there are thousands, and a diagnosis scans the grid itself."""
        return []

    @classmethod
    def grid(cls, span: float) -> np.ndarray:
        """Cycles per revolution (k,) to search over a ``span`` [rad], in steps of ``2π / span / OVERSAMPLING``."""
        step = TURN / max(span, 1e-3) / OVERSAMPLING
        # Half a period must fit the range of the joint: what is longer is no cycle but a curve.
        first = max(MIN_CYCLES, math.pi / max(span, 1e-3))
        return np.arange(first, MAX_CYCLES, step)

    @classmethod
    def resolved(cls, q: Array) -> Array:
        """Cycles per revolution (k,) that the values q (N,) [rad] of a joint resolve. None by few values, on a lattice
        the lower half: values spaced by δ cannot separate k from ``2π/δ − k``, and the spectral window ``|Σ exp(i k q)|
        / N`` is one at 2π/δ."""
        # Joint values nearer to each other than this [rad] are one: a twentieth of the shortest period.
        values = np.unique(np.round(q / 1e-3))
        # Different values of a joint; fewer are met by some line of thousands whatever the errors are.
        if len(values) < 10:
            return np.zeros(0)
        cycles = cls.grid(float(np.ptp(q)))
        return np.asarray(cycles[cycles <= _alias_period(q) / 2])

    @classmethod
    def about(cls, joint: str, q: Array) -> CyclicError:
        """A line of a joint that is referred to the middle of its values q (N,) [rad]."""
        return cls(joint=joint, cycles=MIN_CYCLES, centre=f"{(np.min(q) + np.max(q)) / 2:.2f} rad")


def _alias_period(q: Array) -> float:
    """The least distance of two lines that the values q (N,) [rad] cannot separate [cycles per revolution], or inf."""
    q = q[:: -(-len(q) // 500)]  # joint values that the spectral window is taken of; chosen for time
    cycles = CyclicError.grid(float(np.ptp(q)))
    far = np.concatenate([cycles, cycles + MAX_CYCLES])
    far = far[far * np.ptp(q) > 4 * math.pi]  # nearer, the window has its own main lobe
    window = np.abs(np.exp(1j * np.outer(far, q)).mean(axis=1))
    # Value of the spectral window from which two lines have columns that are alike in all but rounding.
    aliased = far[window > 0.9]
    return float(aliased[0]) if len(aliased) else math.inf


def _together(amplitudes: Sequence[float], band: Sequence[int]) -> float:
    """The amplitude of a single line of the same RMS, √Σ A²."""
    return math.sqrt(sum(amplitudes[i] ** 2 for i in band))
