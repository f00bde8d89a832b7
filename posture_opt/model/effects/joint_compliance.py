"""Compliance of a joint under the torque of gravity."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.model.arm_state import MIN_LEANING_SINE, ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.base.catalogue_entry import Input
from posture_opt.model.effects.base.cause import Abscissa, FittedSizes, Size, compliance_size
from posture_opt.model.effects.base.effect import NOT_NEGATIVE, Effect, Excitation
from posture_opt.model.effects.base.gear_stiffness import LARGEST_TURN, SOURCE, least_stiffness
from posture_opt.model.effects.base.joint_effect import JointEffect
from posture_opt.model.effects.base.plausible_range import PlausibleRange
from posture_opt.robot.robot import Robot
from posture_opt.units import number


class JointCompliance(JointEffect):
    """``dq = c τ(q, m)``, τ the torque of gravity from links and payload [N m], c in rad/(N m).

    With ``loads: points`` the masses of the links are unknown and are modelled as point masses at the frames beyond the
    joint: ``dq = Σ_i θ_i τ_i(q)``, τ_i the torque of 1 kg at frame i and θ_i compliance times mass.
    """

    summary: ClassVar[str] = "the joint is compliant under the torque of gravity and payload"
    phrase: ClassVar[str] = "{target} is compliant under gravity"
    measurement: ClassVar[str] = "measure the same postures under two payloads"
    inspection: ClassVar[str] = (
        "gear, output bearing and belt of {target}, and the bolts that join its links: worn or loose"
    )
    rivals: ClassVar[Mapping[str, str]] = {
        "gear_eccentricity": "measure the same postures under two payloads: a compliance is proportional to the load, "
        "a gear error does not depend on it",
        "gear_second_harmonic": "measure the same postures under two payloads: a gear error does not depend on the "
        "load",
        "link_bending": "measure the orientation of the tool too, under two payloads: bending turns the end of the "
        "link by another share than a joint does",
        "base_compliance": "measure targets fixed to the base in every posture: a compliant base moves them",
    }

    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("compliance", "angle per torque"),)

    kind: Literal["joint_compliance"] = "joint_compliance"
    loads: Literal["masses", "points"] = Field("masses", description="masses of the file, or unknown point masses")
    points: tuple[str, ...] = Field((), description="joints behind which unknown masses are, `tool` for the tool point")

    @property
    def dimensions(self) -> tuple[tuple[str, str], ...]:
        """The compliance; or one product of compliance and mass for each point [rad kg/(N m)]."""
        if self.loads == "masses":
            return self.parameters
        return tuple((f"mass at {name}", "angle mass per torque") for name in self.points)

    @property
    def asks(self) -> frozenset[Input]:
        """The masses of the links, unless they are unknown."""
        return frozenset({"masses"}) if self.loads == "masses" else frozenset()

    @property
    def limits(self) -> tuple[float, float]:  # type: ignore[override] # of this very instance
        """Not below zero; unbounded for unknown loads, as a counterweight or a compensation by the controller is one
        of them.
        """
        return Effect.limits if self.unstated_loads else NOT_NEGATIVE

    def acts(self, state: ArmState) -> bool:
        """Whether the axis of the joint leans against the vertical in some posture."""
        return state.leaning(self.index(state)) > MIN_LEANING_SINE

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(τ,) [N m], or (k,) the torque of 1 kg at each point [N m/kg]."""
        if self.loads == "masses":
            return (state.torque(joint),)
        names = state.robot.joint_names
        places = [state.tool if p == "tool" else state.frames[names.index(p)].origin for p in self.points]
        return tuple(state.unit_torque(joint, place) for place in places)

    @property
    def unstated_loads(self) -> bool:
        """Whether masses are unknown, so that no parameter is the compliance itself."""
        return self.loads == "points"

    def plausible(self, robot: Robot) -> PlausibleRange | None:
        """Down to `least_stiffness` of the joint, by the class of gear that carries its load; of unknown loads the turn
        by which such a gear gives in at most.
        """
        softest = least_stiffness(robot, robot.joint_names.index(self.joint))
        if self.unstated_loads:
            needs = "a joint that turns by more than its gear gives in under the largest load that it is made for"
            return PlausibleRange(-LARGEST_TURN, LARGEST_TURN, "angle", needs, SOURCE)
        needs = (
            f"a joint softer than {number(softest / 1e3)} kN m/rad, softer than any gear that carries its load (loose "
            "couplings and slack belts are)"
        )
        return PlausibleRange(0.0, 1 / softest, "angle per torque", needs, SOURCE)

    def plausible_size(self, estimate: FittedSizes) -> tuple[float, float]:
        """The compliance [rad/(N m)]; of unknown loads half the range of the turn of the joint in the data [rad]."""
        if not self.unstated_loads:
            return super().plausible_size(estimate)
        low, high = estimate.turn or (0.0, 0.0)
        return (high - low) / 2, math.nan

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa | None:
        """The torque of gravity [N m]; None for unknown loads."""
        if self.unstated_loads:
            return None
        return Abscissa.of(state, state.torque(self.index(state)), f"torque of gravity on {self.joint} [N m]")

    def size(self, name: str, dimension: str, value: float, std: float) -> Size:
        """The compliance with the stiffness that it is the inverse of."""
        return compliance_size(name, value, std)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The compliance; of unknown loads the turn of the joint in the data [mrad] and what that costs."""
        if not self.unstated_loads:
            return super().sizes(estimate)
        low, high = estimate.turn or (math.nan, math.nan)
        masses = (
            f"the file states none, so {len(self.points)} products of load and compliance are estimated in place of "
            "one compliance: that costs certainty, and the stiffness stays open; state 'mass' and 'com' of every joint"
        )
        return Size("turns by", f"{number(1e3 * low)} to {number(1e3 * high)} mrad in these data"), Size(
            "masses", masses
        )

    def headline(self, estimate: FittedSizes) -> str:
        """The compliance; nothing for unknown loads."""
        return "" if self.unstated_loads else super().headline(estimate)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        """Every moving revolute joint, where the masses of the links are known."""
        if "masses" in case.inputs:
            return [cls(joint=name) for name in case.moving("revolute")]
        return []
