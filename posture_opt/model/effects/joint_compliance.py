"""Compliance of a joint under the torque of gravity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar, Literal

from posture_opt.model.arm_state import MIN_LEANING_SINE, ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.base.cause import Abscissa
from posture_opt.model.effects.base.effect import NOT_NEGATIVE, Effect, Excitation
from posture_opt.model.effects.base.joint_effect import GravityLoaded, JointEffect
from posture_opt.model.effects.base.plausible_range import LARGEST_TURN, SOURCE, PlausibleRange, least_stiffness
from posture_opt.robot.robot import Robot
from posture_opt.units import number

_UNKNOWN_LOADS_INSPECTION = (
    "{target}: state 'mass' and 'com' of every joint, then compare its stiffness with the maker's; if clearly softer: "
    "the tension of its belt or cable, if it has one; else bolts of the links, output bearing, gear"
)


class JointCompliance(GravityLoaded, JointEffect):
    """``dq = c τ(q, m)``, τ the torque of gravity from links and payload [N m], c in rad/(N m).

    With ``loads: points`` the masses of the links are unknown and are modelled as point masses at the frames beyond the
    joint: ``dq = Σ_i θ_i τ_i(q)``, τ_i the torque of 1 kg at frame i and θ_i compliance times mass.
    """

    summary: ClassVar[str] = "the joint is compliant under the torque of gravity and payload"
    phrase: ClassVar[str] = "{target} is compliant under gravity"
    measurement: ClassVar[str] = "measure the same postures under two payloads"
    inspection: ClassVar[str] = (
        "{target}: compare with the maker's stiffness or an equal arm; if clearly softer: bolts of the links, output "
        "bearing, gear, a belt if it has one"
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

    yields: ClassVar[str] = "turns by"

    kind: Literal["joint_compliance"] = "joint_compliance"

    @property
    def limits(self) -> tuple[float, float]:  # type: ignore[override] # of this very instance
        """Not below zero; unbounded for unknown loads, as a counterweight or a compensation by the controller is one of
        them."""
        return NOT_NEGATIVE if self.loads == "masses" else Effect.limits

    @property
    def less_likely(self) -> bool:
        """Never: joints are most of an arm's compliance."""
        return False

    def inspect(self, robot: Robot) -> str:
        """What to look at; without masses there is no stiffness to compare."""
        if self.unstated_loads:
            return _UNKNOWN_LOADS_INSPECTION.format(target=self.target)
        return super().inspect(robot)

    def acts(self, state: ArmState) -> bool:
        return state.leaning(self.index(state)) > MIN_LEANING_SINE

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(τ,) [N m], or (k,) the torque of 1 kg at each point [N m/kg], and that of the payload [N m]."""
        if self.loads == "masses":
            return (state.torque(joint),)
        return tuple(mass * state.unit_torque(joint, place) for mass, place in self.masses(state))

    def plausible(self, robot: Robot) -> PlausibleRange | None:
        """Down to `least_stiffness` of the joint, by the class of gear that carries its load; of unknown loads the turn
        by which such a gear twists at most."""
        softest = least_stiffness(robot, robot.joint_names.index(self.joint))
        if self.unstated_loads:
            needs = "a joint that turns by more than its gear twists under the largest load that it is made for"
            return PlausibleRange(-LARGEST_TURN, LARGEST_TURN, "angle", needs, SOURCE)
        needs = (
            f"a joint softer than {number(softest / 1e3)} kN m/rad, softer than any gear that carries its load (loose "
            "couplings and slack belts are)"
        )
        return PlausibleRange(0.0, 1 / softest, "angle per torque", needs, SOURCE)

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa | None:
        """The torque of gravity [N m]; None for unknown loads."""
        if self.unstated_loads:
            return None
        return Abscissa.of(state, state.torque(self.index(state)), f"torque of gravity on {self.joint} [N m]")

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        if "masses" in case.inputs:
            return [cls(joint=name) for name in case.moving("revolute")]
        return []

    @classmethod
    def unknown_loads(cls, case: Excitation) -> Iterator[tuple[Effect, tuple[str, ...]]]:
        """Every moving revolute joint, with the frames behind it."""
        names = case.robot.joint_names
        for name in case.moving("revolute"):
            yield cls(joint=name, loads="points"), cls.frames_of_load(case, names.index(name))
