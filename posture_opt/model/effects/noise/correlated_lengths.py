"""Two lengths whose errors are correlated from one robot of a type to the next."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field, model_validator

from posture_opt.errors import BadValueError, one_of
from posture_opt.model.effects.base.cause import Evidence, FittedSizes, Limit, Size
from posture_opt.model.effects.noise.noise_effect import NoiseEffect
from posture_opt.robot.robot import Robot
from posture_opt.units import plus_minus

MIN_ROBOTS = 10  # Robots of a type below which their correlations are not worth stating


class CorrelatedLengths(NoiseEffect):
    """``Σ_ab = ρ σ_a σ_b``: off the diagonal of what is not known of the geometry, as of parts made together."""

    summary: ClassVar[str] = (
        "the errors of two lengths are correlated from robot to robot, as of parts made on one machine"
    )
    phrase: ClassVar[str] = "the errors of {target} are correlated from robot to robot"
    inspection: ClassVar[str] = "machine and fixture that these parts are made on; nothing on one arm"
    of_arm: ClassVar[bool] = True

    kind: Literal["correlated_lengths"] = "correlated_lengths"
    lengths: tuple[str, str] = Field(description="two lengths with a stated σ", examples=[["joint1.a", "joint2.a"]])
    rho: float = Field(ge=-1, le=1, description="coefficient of correlation", examples=[0.8])

    @model_validator(mode="after")
    def _are_two(self) -> CorrelatedLengths:
        if self.lengths[0] == self.lengths[1]:
            raise BadValueError(f"'{self.lengths[0]}' is correlated with itself", "name two different lengths")
        return self

    @property
    def target(self) -> str:
        return ", ".join(self.lengths)

    @property
    def stated(self) -> tuple[tuple[str, float, str], ...]:
        """The coefficient of correlation, −1 to 1."""
        return (("correlation", self.rho, "factor"),)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        return (Size("correlation", plus_minus(*estimate.entry("correlation"))),)

    @property
    def correlation(self) -> tuple[tuple[str, str, float], ...]:
        """Both lengths with their coefficient."""
        return ((*self.lengths, self.rho),)

    def check_robot(self, robot: Robot) -> None:
        """Refuse names that are no lengths."""
        known = [name for name, factor in robot.parameters.items() if factor.kind == "translate"]
        for name in self.lengths:
            if name not in known:
                raise BadValueError(f"'{name}' is no length of the robot", one_of(name, known, "lengths"))

    @classmethod
    def unknowable(cls, evidence: Evidence) -> Limit | None:
        """Why one robot can never show it; None where fewer than two lengths are in question."""
        if len(evidence.lengths) < 2:
            return None
        return Limit(
            cls.kind_name(),
            ", ".join(evidence.lengths[:2]),
            "whether lengths err together shows only from robot to robot: one robot has one error of each",
            f"measure {MIN_ROBOTS} robots of the type or more, with a column 'robot'",
        )
