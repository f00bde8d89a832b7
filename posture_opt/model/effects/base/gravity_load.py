"""``GravityLoaded``: effects that yield to the weight of the arm, whose masses the file states or not."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar, Vector, cross, scale, subtract
from posture_opt.model.effects.base.catalogue_entry import Input
from posture_opt.model.effects.base.cause import FittedSizes, Size, compliance_size
from posture_opt.model.effects.base.effect import NOT_NEGATIVE, Effect, Excitation
from posture_opt.units import number, shown

PAYLOAD = "payload"
"""The point of the payload whose mass is stated."""


class GravityLoaded(Effect):
    """An effect that is a compliance times a load.

    With ``loads: points`` the masses of the links are unknown and are modelled as point masses at frames beyond: in
    place of one compliance c times the load of all masses there are products ``θ_i = c m_i``, each times the load of
    1 kg at frame i. A payload that is stated and varies has a known mass: with it, c itself is among the parameters.
    """

    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("compliance", "angle per torque"),)
    yields: ClassVar[str]
    """What its size says in words: ``turns by`` of a joint, ``tilts by`` of a base."""

    loads: Literal["masses", "points"] = Field("masses", description="masses of the file, or unknown point masses")
    points: tuple[str, ...] = Field(
        (),
        description="joints behind which unknown masses are, `tool` for one at the tool point, `payload` for the "
        "payload as stated",
    )

    @property
    def dimensions(self) -> tuple[tuple[str, str], ...]:
        """The compliance; or one product of compliance and mass for each point [rad kg/(N m)], of the payload again the
        compliance.
        """
        if self.loads == "masses":
            return self.parameters
        one = self.parameters[0]
        return tuple(one if p == PAYLOAD else (f"mass at {p}", "angle mass per torque") for p in self.points)

    @property
    def asks(self) -> frozenset[Input]:
        """The masses of the links, unless they are unknown; the payload, where it is one of the loads."""
        if self.loads == "masses":
            return frozenset({"masses"})
        return frozenset({"payload"}) if PAYLOAD in self.points else frozenset()

    @property
    def limits(self) -> tuple[float, float]:  # type: ignore[override] # of this very instance
        """Not below zero, the compliance and its products with masses."""
        return NOT_NEGATIVE

    @property
    def less_likely(self) -> bool:
        """Of links and base without masses: joints are most of an arm's compliance."""
        return self.loads == "points"

    @property
    def unstated_loads(self) -> bool:
        """Whether masses are unknown, and the payload is too, so that no parameter is the compliance itself."""
        return self.loads == "points" and PAYLOAD not in self.points

    def moments(self, state: ArmState, carrier: int, about: Vector) -> list[Vector]:
        """The moment (3,) for each parameter, about a point (3,) [m], world: of all weights [N m], or of 1 kg at each
        point [N m/kg], of the payload [N m].

        Args:
            state: the arm under its loads.
            carrier: index of the joint behind which weights count; −1 counts every link.
            about: the point [m], world.
        """
        if self.loads == "masses":
            return [state.moment(carrier, about)]
        weights = (scale(mass, state.robot.gravity) for mass, _ in self.masses(state))
        places = (place for _, place in self.masses(state))
        return [cross(subtract(place, about), weight) for place, weight in zip(places, weights, strict=True)]

    def masses(self, state: ArmState) -> list[tuple[Scalar, Vector]]:
        """Mass for each parameter, 1 kg where it is unknown [kg], and where it is (3,) [m], world."""
        names = state.robot.joint_names
        found: list[tuple[Scalar, Vector]] = []
        for point in self.points:
            place = state.tool if point in ("tool", PAYLOAD) else state.frames[names.index(point)].origin
            found.append((state.inputs.payload if point == PAYLOAD else 1.0, place))
        return found

    @classmethod
    def frames_of_load(cls, case: Excitation, first: int) -> tuple[str, ...]:
        """Where masses may be: the payload, if it is stated and varies, the tool point, and frames behind joints.

        Args:
            first: index of the first of these joints; the last of them comes first.
        """
        payload = (PAYLOAD,) if "payload" in case.inputs else ()
        return (*payload, "tool", *reversed(case.robot.joint_names[first:-1]))

    def size(self, name: str, dimension: str, value: float, std: float) -> Size:
        """The compliance with the stiffness that it is the inverse of."""
        return compliance_size(name, value, std)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The compliance; of unknown loads the turn in the data [mrad] and what that costs."""
        if not self.unstated_loads:
            return (self.size("compliance", self.parameters[0][1], *estimate.entry("compliance")),)
        low, high = estimate.turn or (math.nan, math.nan)
        masses = (
            f"not stated: {len(self.points)} products of load and compliance in place of one compliance, and the "
            "stiffness stays open; state 'mass' and 'com' of every joint"
        )
        return Size(self.yields, f"{number(1e3 * low)} to {number(1e3 * high)} mrad in these data"), Size(
            "masses", masses
        )

    def headline(self, estimate: FittedSizes) -> str:
        """The compliance and the stiffness that it is the inverse of.

        Of unknown loads the turn that it makes in the data, root mean square about its mean.
        """
        if not self.unstated_loads:
            compliance = estimate.entry("compliance")[0]
            stiffness = f", {number(1e-3 / compliance)} kN m/rad" if compliance > 0 else ""
            return f"{super().headline(estimate)}{stiffness}"
        return (
            "" if not estimate.rms or not estimate.rms[0] else f"{shown(estimate.rms[0], 'angle', estimate.rms[1])} RMS"
        )

    def plausible_size(self, estimate: FittedSizes) -> tuple[float, float]:
        """The compliance [rad/(N m)]; of unknown loads half the range of the turn in the data [rad]."""
        if not self.unstated_loads:
            return super().plausible_size(estimate)
        low, high = estimate.turn or (0.0, 0.0)
        return (high - low) / 2, math.nan
