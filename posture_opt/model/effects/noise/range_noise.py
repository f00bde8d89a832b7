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

_SLOPES = np.linspace(-2.5, 2.5, 51)
_LEAST = 1e-2  # of the largest σ: a line that falls below zero is none of standard deviations
_FEW = 8


class RangeNoise(NoiseEffect):
    """``σ = a + b r`` of every measured coordinate, r the distance from the instrument at the world's origin."""

    summary: ClassVar[str] = "the noise of the instrument grows with distance"
    phrase: ClassVar[str] = "the noise of the instrument grows with distance"
    measurement: ClassVar[str] = "repeat postures near the instrument and far from it, moving away in between"
    rivals: ClassVar[Mapping[str, str]] = {"stated_sigma": "repeat postures near the instrument and far from it"}
    uneven: ClassVar[bool] = True
    uneven_words: ClassVar[str] = "The errors grow with the distance from the {target}, as its noise could"
    shape_units: ClassVar[Mapping[str, str]] = {"a": "m", "b": "m/m"}

    kind: Literal["range_noise"] = "range_noise"
    a: Length | None = Field(None, description="σ at no distance; the stated σ of the instrument if left out")
    b: LengthPerLength = Field(description="growth of σ with the distance")

    @property
    def target(self) -> str:
        return "instrument"

    @property
    def stated(self) -> tuple[tuple[str, float, str], ...]:
        return (*([("a", self.a, "length")] if self.a is not None else []), ("b", self.b, "length per length"))

    @property
    def of_stated(self) -> bool:  # type: ignore[override] # of this very instance
        return self.a is None

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        times = number(1 + estimate.entry("growth")[0], 2)
        return (Size("noise", f"{times} times larger at the farthest point than at the nearest"),)

    def reading(self, sigma: Array, ranges: Array) -> Array:
        found = (sigma if self.a is None else self.a) + self.b * ranges
        return np.maximum(found, _LEAST * float(np.max(found, initial=0.0)))

    def shape(self, rows: Rows) -> Array | None:
        if rows.ranges is None:
            return None
        own = self.reading(np.full(len(rows.ranges), rows.sigma), rows.ranges) / rows.sigma
        return np.asarray(own[:, None, None] ** 2 * np.eye(rows.levers.shape[2]))

    @classmethod
    def patterns(cls, rows: Rows) -> Sequence[Pattern]:
        if rows.ranges is None or np.ptp(rows.ranges) <= 1e-6 or len(rows.ranges) <= _FEW:
            return []
        return [Growing(rows.ranges, rows.sigma, rows.levers.shape[2])]


class Growing(Pattern):
    """Rows whose σ grows with their range: its logarithm does, so that it stays above zero on the whole grid."""

    effect: type[NoiseEffect] = RangeNoise
    target: str = "instrument"
    grid = _SLOPES
    quantity: tuple[str, str] = ("growth", "1")

    def __init__(self, ranges: Array, sigma: float, dimension: int) -> None:
        self.z: Array = (ranges - ranges.mean()) / np.ptp(ranges)
        self.ranges: Array = ranges
        self.sigma: float = sigma
        self.dimension: int = dimension

    def level(self, value: float) -> Array:
        return np.asarray(2 * value * self.z)

    def size(self, value: float, s2: float) -> float:
        """Growth of σ from the nearest to the farthest row."""
        return float(np.expm1(value))

    def error(self, value: float, s2: float) -> float:
        return float(np.exp(value) / np.sqrt(2 * self.dimension * np.sum(self.z**2)))

    def named(self, value: float, s2: float, std: float) -> RangeNoise:
        """The line through the nearest and the farthest row."""
        low, high = float(self.ranges.min()), float(self.ranges.max())
        near, far = (self.sigma * np.sqrt(s2) * np.exp(value * z) for z in (self.z.min(), self.z.max()))
        b = float(far - near) / (high - low)
        return RangeNoise(a=f"{float(near) - b * low!r} m", b=f"{b!r} m/m")
