"""Standard deviations that are all stated too small, or too large, by one factor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.model.effects.base.cause import FittedSizes, Size
from posture_opt.model.effects.noise.noise_effect import NoiseEffect, Pattern, Rows
from posture_opt.numerics import Array
from posture_opt.units import plus_minus

# Values of the grid: logarithm of how many times as far orientations scatter as positions, each in its stated σ
_LOG_RATIOS = np.linspace(-4.0, 4.0, 81)


class StatedSigma(NoiseEffect):
    """``Σ = f² Σ0``: measurements scatter f times as much as stated: all, or those of one quantity or instrument."""

    summary: ClassVar[str] = "measurements scatter more, or less, than stated by one factor"
    phrase: ClassVar[str] = "{target} differs from what the file states"
    inspection: ClassVar[str] = "certificate and set-up of the instrument, and how reflector or target is fastened"
    of_stated: ClassVar[bool] = True
    uneven_words: ClassVar[str] = "The {target} are larger than the instrument as stated accounts for"

    kind: Literal["stated_sigma"] = "stated_sigma"
    quantity: str | None = Field(
        None, min_length=1, description="of which σ: position, orientation, or an instrument; of all if left out"
    )
    factor: float = Field(gt=0, description="true σ over the stated one", examples=[1.8])

    @property
    def target(self) -> str:
        """The quantity, or the instrument; ``data`` where it is all."""
        return self.quantity or "data"

    @property
    def changed_sigma(self) -> str:
        """``orientation`` where it is that alone."""
        return "orientation" if self.quantity == "orientation" else "position"

    @property
    def words(self) -> str:
        measured = "the measurement noise" if self.quantity is None else f"the noise of measured {self.quantity}s"
        if self.quantity not in (None, "position", "orientation"):
            measured = f"the noise of {self.quantity}"
        return self.phrase.format(target=measured)

    @property
    def uneven_clause(self) -> str:
        return self.uneven_words.format(target=f"{self.quantity} errors" if self.quantity else "errors")

    @property
    def stated(self) -> tuple[tuple[str, float, str], ...]:
        return (("factor", self.factor, "factor"),)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        return (Size("noise", f"{plus_minus(*estimate.entry('factor'))} times what is stated"),)

    def reading(self, sigma: Array, ranges: Array) -> Array:
        """(N,) ``f σ`` [m]."""
        return sigma if self.quantity == "orientation" else self.factor * sigma

    def turning(self, sigma: float) -> float:
        """``f σ`` [rad]."""
        return sigma if self.quantity == "position" else self.factor * sigma

    @classmethod
    def patterns(cls, rows: Rows) -> Sequence[Pattern]:
        """The one pattern, where rows have positions and orientations."""
        return [Turning(rows)] if 0 < rows.turned < rows.levers.shape[2] else []


class Turning(Pattern):
    """Rows whose orientations scatter more, or less, than their positions, each in units of its stated σ. Its value is
    the logarithm of the ratio of both. It is a ratio alone: which of both σ's is wrong, repeats say."""

    effect: type[NoiseEffect] = StatedSigma
    target: str = "orientation"
    grid = _LOG_RATIOS
    quantity: tuple[str, str] = ("factor", "1")

    def __init__(self, rows: Rows) -> None:
        self.count: int = rows.levers.shape[1]
        self.d: int = rows.levers.shape[2]
        self.rank: int = rows.turned

    def along(self, sets: Array) -> Array:
        """(F, N) squared lengths of the orientation's part."""
        part = sets[:, :, -self.rank :]
        return np.asarray(np.einsum("fnd,fnd->fn", part, part))

    def inflation(self, value: float) -> Array:
        """(N,) the square of the ratio."""
        return np.full(self.count, np.exp(2 * value))

    def units(self, value: float) -> Array:
        """(d,) the ratio of orientations, 1 of positions."""
        return np.concatenate([np.ones(self.d - self.rank), np.full(self.rank, np.exp(value))])

    def size(self, value: float, s2: float) -> float:
        """The ratio."""
        return float(np.exp(value))

    def error(self, value: float, s2: float) -> float:
        """Its standard error, that of the logarithm of a ratio of two σ's times the ratio."""
        return float(np.exp(value) * np.sqrt(sum(1 / (2 * self.count * k) for k in (self.rank, self.d - self.rank))))

    def named(self, value: float, s2: float, std: float) -> StatedSigma:
        """The effect with that ratio."""
        return StatedSigma(quantity="orientation", factor=self.size(value, s2))
