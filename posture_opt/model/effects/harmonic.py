"""``Harmonic``: an error of a joint that is periodic in its value."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import ClassVar

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.abscissa import Abscissa, over_phase
from posture_opt.model.effects.cause import FittedSizes, Size, amplitude
from posture_opt.model.effects.joint_effect import JointEffect
from posture_opt.model.scalars import cos, sin
from posture_opt.units import fixed, number, shown

_ARCSEC = math.degrees(1.0) * 3600


class Harmonic(JointEffect):
    """``dq = a sin(k q) + b cos(k q)``, k cycles per revolution."""

    parameters: ClassVar = (("sin", "angle"), ("cos", "angle"))

    @property
    @abstractmethod
    def frequency(self) -> float:
        """k, cycles per revolution of the joint."""

    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        angle = self.frequency * site.q[joint]
        return sin(angle), cos(angle)

    def abscissa(self, site: ArmState, timed: bool = True) -> Abscissa | None:
        return over_phase(site, self.index(site), self.frequency)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """Amplitude and phase, in place of sine and cosine."""
        (a, _), (b, _) = estimate.entry("sin"), estimate.entry("cos")
        size, std = amplitude(a, b, estimate.covariance)
        return (
            Size("amplitude", shown(size, "angle", std), f" ({number(_ARCSEC * size, 2)} arcsec)"),
            Size("phase", f"{fixed(math.degrees(math.atan2(b, a)), 0)} deg"),
        )
