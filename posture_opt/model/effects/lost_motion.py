"""Lost motion: backlash, hysteresis, and lost motion that grows with the load of the joint."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.model.arm_state import MIN_LEANING_SINE, ArmState
from posture_opt.model.chain import Scalar, exp, magnitude
from posture_opt.model.effects.base.cause import Abscissa, FittedSizes, Input, Size, over_joint
from posture_opt.model.effects.base.effect import Effect, Excitation
from posture_opt.model.effects.base.joint_effect import LostMotion
from posture_opt.units import Angle, plus_minus

_WHOLE = "whole width"  # What the size of a play is: drawings state it so, others its half to either side


class Backlash(LostMotion):
    """``dq = −b s / 2``: both directions of approach end b [rad] apart; b > 0 stops short (see `LostMotion`)."""

    summary: ClassVar[str] = "lost motion: the joint stops short of its command, by half a width from either direction"
    phrase: ClassVar[str] = "{target} has backlash and stops short of its command"
    measurement: ClassVar[str] = "approach each posture from both sides, in random order"
    inspection: ClassVar[str] = (
        "free play of {target} by hand against a dial gauge, brake released, drive holding; gear mesh, couplings "
        "between motor and joint, a belt if it has one"
    )
    rivals: ClassVar[Mapping[str, str]] = {
        "hysteresis": "approach from both sides after short moves and after long ones: backlash is constant, "
        "hysteresis grows with the move",
        "load_backlash": "approach from both sides under two payloads",
    }
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("width", "angle"),)

    kind: Literal["backlash"] = "backlash"

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(−s/2,) for the parameter ``width`` [rad]; 0 where the side is not known."""
        return (self.lag(state, joint) / 2,)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The width b: the whole distance between both directions of approach."""
        return tuple(replace(size, more=f"{size.more}, {_WHOLE}") for size in super().sizes(estimate))

    def headline(self, estimate: FittedSizes) -> str:
        return f"{super().headline(estimate)} {_WHOLE}"

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """The joint value [deg or mm], a curve for each side."""
        joint = self.index(state)
        return over_joint(state, joint, ", by side of approach", np.sign(state.inputs.side(joint)))


# Travels d0 [rad] that are tried: from 1 to 90 degrees, by factors of about two
_TRAVEL_GRID_RAD = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.5)


class Hysteresis(LostMotion):
    """``dq = −h s (1 − exp(−d / d0))``, d the length of the last move [rad].

    h [rad] is reached after long moves; h > 0 stops short (see `LostMotion`).
    """

    summary: ClassVar[str] = "lost motion that grows with the length of the last move"
    phrase: ClassVar[str] = "{target} has hysteresis: it stops short of its command, more so after long moves"
    measurement: ClassVar[str] = "approach each posture from both sides after short moves and after long ones"
    inspection: ClassVar[str] = "friction in {target}: seals, lubrication and bearing preload, a belt if it has one"
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("height", "angle"),)
    shape: ClassVar[tuple[str, ...]] = ("travel",)
    shape_units: ClassVar[Mapping[str, str]] = {"travel": "rad"}

    kind: Literal["hysteresis"] = "hysteresis"
    travel: Angle = Field(gt=0, description="d0, travel after which 63 % is reached")

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(−s (1 − exp(−d/d0)),) for the parameter ``height`` [rad]."""
        return (self.lag(state, joint) * (1 - exp(-state.inputs.travel(joint) / self.travel)),)

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """Length of the last move [deg], with the sign of its side."""
        joint = self.index(state)
        move = np.sign(state.inputs.side(joint)) * np.degrees(state.inputs.travel(joint))
        return Abscissa.of(state, move, f"last move of {self.joint} [deg]")

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The height and the travel d0 [deg]."""
        travel = plus_minus(*estimate.entry("travel"), math.degrees(1.0), "deg")
        return (*super().sizes(estimate), Size("63 % reached after", f"a move of {travel}"))

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        if not cls.needs <= case.inputs:
            return []
        return [cls(joint=name, travel=f"{d} rad") for name in case.moving("revolute") for d in _TRAVEL_GRID_RAD]


class LoadBacklash(LostMotion):
    """``dq = −h s |τ|``, τ the torque of gravity [N m], h in rad/(N m); h > 0 stops short (see `LostMotion`)."""

    summary: ClassVar[str] = "backlash in proportion to the load of the joint, as of friction"
    phrase: ClassVar[str] = "{target} stops short of its command in proportion to its load"
    measurement: ClassVar[str] = "approach each posture from both sides under two payloads"
    inspection: ClassVar[str] = "bearing preload, gear mesh and clamp screws of {target} under load; its counterbalance"
    rivals: ClassVar[Mapping[str, str]] = {
        "hysteresis": "approach from both sides, after short and long moves, under two payloads"
    }
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("height", "angle per torque"),)
    needs: ClassVar[frozenset[Input]] = frozenset({"approach", "masses"})

    kind: Literal["load_backlash"] = "load_backlash"

    def acts(self, state: ArmState) -> bool:
        return state.leaning(self.index(state)) > MIN_LEANING_SINE

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """``(−s |τ|,)`` [N m]; 0 where the side is not known."""
        return (self.lag(state, joint) * magnitude(state.torque(joint)),)

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """The size of the torque [N m], with the sign of the side."""
        joint = self.index(state)
        torque = np.sign(state.inputs.side(joint)) * np.abs(state.torque(joint))
        return Abscissa.of(state, torque, f"torque on {self.joint} [N m], with the sign of the side of approach")
