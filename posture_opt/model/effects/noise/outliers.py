"""Single rows that are grossly wrong."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.model.effects.base.cause import FittedSizes, Size
from posture_opt.model.effects.noise.noise_effect import NoiseEffect
from posture_opt.units import number


class Outliers(NoiseEffect):
    """``(1 − w) N(0, Σ0) + w (anything)``: a share w of the rows says nothing.

    A fit finds them one by one; what is planned counts with as many fewer rows.
    """

    summary: ClassVar[str] = "single rows are grossly wrong"

    phrase: ClassVar[str] = "some rows are outliers"
    inspection: ClassVar[str] = "these rows: reflector seated, line of sight free, arm at rest when it was read"

    kind: Literal["outliers"] = "outliers"
    share: float = Field(gt=0, lt=0.5, description="of the rows", examples=[0.02])

    @property
    def target(self) -> str:
        """``data``."""
        return "data"

    @property
    def stated(self) -> tuple[tuple[str, float, str], ...]:
        return (("share", self.share, "share"),)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        return (Size("rows", number(estimate.entry("count")[0], 1)),)

    @property
    def usable(self) -> float:
        """1 − w."""
        return 1.0 - self.share
