"""An instrument that scatters the more the farther away it measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.model.effects.base.cause import FittedSizes, Size
from posture_opt.model.effects.noise.noise_effect import NoiseEffect, Pattern, Rows
from posture_opt.numerics import Array
from posture_opt.units import Length, LengthPerLength, number

# Values of the grid: the logarithm of σ grows by so much from the nearest to the farthest row
_LOG_GROWTHS = np.linspace(-2.5, 2.5, 51)


class RangeNoise(NoiseEffect):
    """``σ = a + b r`` of every measured coordinate, r the distance from the instrument at the world's origin [m]."""

    summary: ClassVar[str] = "the noise of the instrument grows with distance"
    phrase: ClassVar[str] = "the noise of the instrument grows with distance"
    measurement: ClassVar[str] = "repeat postures near the instrument and far from it, moving away in between"
    inspection: ClassVar[str] = (
        "line of sight, draught and warm air, and reflector or target: move the instrument nearer"
    )
    rivals: ClassVar[Mapping[str, str]] = {"stated_sigma": "repeat postures near the instrument and far from it"}
    uneven: ClassVar[bool] = True
    uneven_words: ClassVar[str] = "The errors grow with the distance from the {target}, as its noise could"
    shape_units: ClassVar[Mapping[str, str]] = {"a": "m", "b": "m/m"}

    kind: Literal["range_noise"] = "range_noise"
    a: Length | None = Field(None, description="σ at no distance; the stated σ of the instrument if left out")
    b: LengthPerLength = Field(description="growth of σ with the distance")

    @property
    def target(self) -> str:
        """``instrument``."""
        return "instrument"

    @property
    def stated(self) -> tuple[tuple[str, float, str], ...]:
        """a [m], where it is stated, and b [m/m]."""
        return (*([("a", self.a, "length")] if self.a is not None else []), ("b", self.b, "length per length"))

    @property
    def of_stated(self) -> bool:  # type: ignore[override] # of this very instance
        """Whether a is the instrument's stated σ."""
        return self.a is None

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        times = number(1 + estimate.entry("growth")[0], 2)
        return (Size("noise", f"{times} times larger at the farthest point than at the nearest"),)

    def reading(self, sigma: Array, ranges: Array) -> Array:
        """(N,) ``a + b r`` [m], at least 1 % of its largest value."""
        found = (sigma if self.a is None else self.a) + self.b * ranges
        # Of the largest σ: a line that falls below zero is none of standard deviations.
        return np.maximum(found, 1e-2 * float(np.max(found, initial=0.0)))

    def shape(self, rows: Rows) -> Array | None:
        """(N, d, d) ``(σ_i / σ)² I``; None where no distances are known."""
        if rows.ranges is None:
            return None
        own = self.reading(np.full(len(rows.ranges), rows.sigma), rows.ranges) / rows.sigma
        return np.asarray(own[:, None, None] ** 2 * np.eye(rows.levers.shape[2]))

    @classmethod
    def patterns(cls, rows: Rows) -> Sequence[Pattern]:
        """The one pattern, where enough rows lie at different distances."""
        # Rows up to which a growth with distance is not looked for.
        if rows.ranges is None or np.ptp(rows.ranges) <= 1e-6 or len(rows.ranges) <= 8:
            return []
        return [Growing(rows.ranges, rows.sigma, rows.levers.shape[2])]


class Growing(Pattern):
    """Rows whose σ grows with their range: its logarithm does, so that it stays above zero on the whole grid. ranges:
    (N,) [m]; sigma: the instrument's σ as stated [m]; dimension: d, measured coordinates of a row."""

    effect: type[NoiseEffect] = RangeNoise
    target: str = "instrument"
    grid = _LOG_GROWTHS
    quantity: tuple[str, str] = ("growth", "1")

    def __init__(self, ranges: Array, sigma: float, dimension: int) -> None:
        self.z: Array = (ranges - ranges.mean()) / np.ptp(ranges)
        self.ranges: Array = ranges
        self.sigma: float = sigma
        self.dimension: int = dimension

    def level(self, value: float) -> Array:
        """(N,) logarithm of the variance over s²: linear in the range, centred."""
        return np.asarray(2 * value * self.z)

    def size(self, value: float, s2: float) -> float:
        """Growth of σ from the nearest to the farthest row, ``exp(value) − 1``."""
        return float(np.expm1(value))

    def strength(self, value: float, s2: float) -> float:
        """Growth of the logarithm of σ with the range [1/m]: repeats span another range than all rows."""
        return value / float(np.ptp(self.ranges))

    def error(self, value: float, s2: float) -> float:
        """Standard error of that growth, to first order in the slope's."""
        return float(np.exp(value) / np.sqrt(2 * self.dimension * np.sum(self.z**2)))

    def named(self, value: float, s2: float, std: float) -> RangeNoise:
        """The noise whose line goes through σ of the nearest and of the farthest row."""
        low, high = float(self.ranges.min()), float(self.ranges.max())
        near, far = (self.sigma * np.sqrt(s2) * np.exp(value * z) for z in (self.z.min(), self.z.max()))
        b = float(far - near) / (high - low)
        return RangeNoise(a=f"{float(near) - b * low!r} m", b=f"{b!r} m/m")
