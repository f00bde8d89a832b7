"""Links that grow and joints that turn with the temperature."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.errors import BadValueError
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.base.cause import Abscissa, Input
from posture_opt.model.effects.base.effect import Effect, Excitation, Sensitivity
from posture_opt.model.effects.base.joint_effect import JointEffect
from posture_opt.model.effects.base.plausible_range import PlausibleRange
from posture_opt.robot.robot import Factor, Robot

# Least and largest coefficient of expansion [1/K] of what arms are made of, with some room on either side
_EXPANSIONS = (5e-6, 30e-6)


class ThermalGrowth(Effect):
    """``dL = α L (T − T0)`` of one length, or of all lengths of the links; α in 1/K, T0 = 20 degC (ISO 1)."""

    summary: ClassVar[str] = "lengths expand with temperature"
    phrase: ClassVar[str] = "{target} expands with temperature"
    measurement: ClassVar[str] = "log the temperature through a warm-up and a cool-down"
    inspection: ClassVar[str] = (
        "what heats or cools the links: motors, brakes, sun or draught from one side; let the arm warm up"
    )
    rivals: ClassVar[Mapping[str, str]] = {
        "drift": "log the temperature through a warm-up and a cool-down: time only grows",
        "thermal_offset": "measure stretched and folded postures at the same temperatures: growth acts along the "
        "links, a drifting zero across them",
    }
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("expansion", "per temperature"),)
    needs: ClassVar[frozenset[Input]] = frozenset({"temperature"})

    kind: Literal["thermal_growth"] = "thermal_growth"
    length: str = Field("all", description="JOINT.a, JOINT.d, …; or all")

    @property
    def target(self) -> str:
        """The length, or ``all``."""
        return self.length

    @property
    def words(self) -> str:
        return self.phrase.format(target="the whole arm" if self.length == "all" else self.length)

    @property
    def place(self) -> str:
        return "all lengths" if self.length == "all" else self.length

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """``L (T − T0)`` [m K] for each length that grows."""
        grown = {
            name: factor.nominal * state.inputs.temperature
            for name, factor in _link_lengths(state.robot).items()
            if self.length in ("all", name)
        }
        return (Sensitivity(lengths=grown),)

    def plausible(self, robot: Robot) -> PlausibleRange | None:
        """5 to 30 ppm/K: cast iron has 10, steel 11 to 13, aluminium 23, magnesium 26; composites have less."""
        low, high = _EXPANSIONS
        needs = "a length that expands as no metal of an arm does; rather the stand, the floor or the instrument moves"
        source = "Kaye, Laby, Tables of Physical and Chemical Constants"
        return PlausibleRange(low, high, "per temperature", needs, source)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        return [cls(length=name) for name in ("all", *_link_lengths(case.robot))] if cls.needs <= case.inputs else []

    def check_robot(self, robot: Robot) -> None:
        """Refuse a length that the robot lacks."""
        known = ("all", *_link_lengths(robot))
        if self.length not in known:
            raise BadValueError(f"there is no length '{self.length}'", f"lengths: {', '.join(known)}")


def _link_lengths(robot: Robot) -> dict[str, Factor]:
    links = [f for link in robot.links for f in link]
    return {f.parameter: f for f in links if f.kind == "translate" and f.parameter and abs(f.nominal) > 1e-6}


_LARGEST_RATE = 1e-4  # rad/K: four times the expansion of aluminium


class ThermalOffset(JointEffect):
    """``dq = c (T − T0)``: the zero of the joint moves by c [rad/K]; T0 = 20 degC (ISO 1)."""

    summary: ClassVar[str] = "the zero of the joint drifts with temperature"
    phrase: ClassVar[str] = "the zero of {target} drifts with temperature"
    measurement: ClassVar[str] = "log the temperature through a warm-up and a cool-down"
    inspection: ClassVar[str] = "what heats {target}: motor, brake and gear; how its encoder is fastened"
    rivals: ClassVar[Mapping[str, str]] = {
        "drift": "log the temperature through a warm-up and a cool-down: time only grows"
    }
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("rate", "angle per temperature"),)
    needs: ClassVar[frozenset[Input]] = frozenset({"temperature"})

    kind: Literal["thermal_offset"] = "thermal_offset"

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(T − T0,) [K]."""
        return (state.inputs.temperature,)

    def plausible(self, robot: Robot) -> PlausibleRange | None:
        """Up to 100 µrad/K: the expansion of aluminium, 23 ppm/K, of a housing four times as long as it is wide."""
        needs = "a housing that is bent by heat more than its expansion can bend it"
        source = "Kaye, Laby, Tables of Physical and Chemical Constants"
        return PlausibleRange(-_LARGEST_RATE, _LARGEST_RATE, "angle per temperature", needs, source)

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """The temperature above 20 degC [K]."""
        return Abscissa.of(state, state.inputs.temperature, "temperature above 20 degC [K]")
