"""Effects of one joint: of its value, or of the link behind it; those that are periodic in its value."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

from pydantic import Field

from posture_opt.errors import BadValueError
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar, cos, sin
from posture_opt.model.effects.base.cause import Abscissa, FittedSizes, Size, amplitude, over_phase
from posture_opt.model.effects.base.effect import Effect, Excitation, Sensitivity
from posture_opt.robot.robot import Robot
from posture_opt.units import fixed, number, shown

_ARCSEC = math.degrees(1.0) * 3600


class EffectOfJoint(Effect):
    """An effect of one joint, or of the link behind it."""

    types: ClassVar[tuple[str, ...]] = ("revolute",)

    joint: str = Field(description="the joint that errs")

    @property
    def target(self) -> str:
        return self.joint

    @property
    def moved_joint(self) -> str:
        return self.joint

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        return [cls.of_joint(name) for name in case.moving(*cls.types)] if cls.needs <= case.inputs else []

    @classmethod
    def of_joint(cls, joint: str, **shape: Any) -> Effect:
        """The effect of one joint, nothing estimated yet."""
        return cls(joint=joint, **shape)

    def check_robot(self, robot: Robot) -> None:
        types = {j.name: j.type for j in robot.joints}
        if self.joint not in types:
            raise BadValueError(f"the robot has no joint '{self.joint}'", f"its joints: {', '.join(types)}")
        if types[self.joint] not in self.types:
            message = f"{self.kind} is of {' and '.join(self.types)} joints, and {self.joint} is {types[self.joint]}"
            raise BadValueError(message)


class JointEffect(EffectOfJoint):
    """An effect that adds to one joint: ``dq = Σ θ_k φ_k(q, u)``."""

    @abstractmethod
    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """``φ_k`` of each parameter."""

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        joint = self.index(state)
        return tuple(Sensitivity({joint: feature}) for feature in self.features(state, joint))

    def index(self, state: ArmState) -> int:
        """Place of the joint in the arm."""
        return state.robot.joint_names.index(self.joint)


class Harmonic(JointEffect):
    """``dq = a sin(k q) + b cos(k q)``, k cycles per revolution."""

    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("sin", "angle"), ("cos", "angle"))

    @property
    @abstractmethod
    def frequency(self) -> float:
        """k, cycles per revolution of the joint."""

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        angle = self.frequency * state.q[joint]
        return sin(angle), cos(angle)

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa | None:
        return over_phase(state, self.index(state), self.frequency)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """Amplitude and phase, in place of sine and cosine."""
        (a, _), (b, _) = estimate.entry("sin"), estimate.entry("cos")
        size, std = amplitude(a, b, estimate.covariance)
        return (
            Size("amplitude", shown(size, "angle", std), f" ({number(_ARCSEC * size, 2)} arcsec)"),
            Size("phase", f"{fixed(math.degrees(math.atan2(b, a)), 0)} deg"),
        )
