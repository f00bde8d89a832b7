"""Standard deviations that are all stated too small, or too large, by one factor."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.model.effects.base.cause import FittedSizes, Size
from posture_opt.model.effects.noise.noise_effect import NoiseEffect
from posture_opt.numerics import Array
from posture_opt.units import plus_minus


class StatedSigma(NoiseEffect):
    """``Σ = f² Σ0``: measurements scatter f times as much as stated."""

    summary: ClassVar[str] = "measurements scatter more, or less, than stated by one factor"
    phrase: ClassVar[str] = "the measurement noise differs from what the file states"
    inspection: ClassVar[str] = "certificate and set-up of the instrument, and how reflector or target is fastened"
    of_stated: ClassVar[bool] = True
    uneven_words: ClassVar[str] = "The errors are larger than the instrument accounts for, as if its noise were"

    kind: Literal["stated_sigma"] = "stated_sigma"
    factor: float = Field(gt=0, description="true σ over the stated one", examples=[1.8])

    @property
    def target(self) -> str:
        """``data``."""
        return "data"

    @property
    def stated(self) -> tuple[tuple[str, float, str], ...]:
        """The factor f."""
        return (("factor", self.factor, "factor"),)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The factor with its standard error."""
        return (Size("noise", f"{plus_minus(*estimate.entry('factor'))} times what is stated"),)

    def reading(self, sigma: Array, ranges: Array) -> Array:
        """(N,) ``f σ`` [m]."""
        return self.factor * sigma

    def turning(self, sigma: float) -> float:
        """``f σ`` [rad]."""
        return self.factor * sigma
