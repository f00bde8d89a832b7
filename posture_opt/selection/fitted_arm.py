"""``FittedArm``: what measurements say of an arm, in the terms of the problem that takes it over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from posture_opt.model.effects import Effect, NoiseEffect
from posture_opt.uncertainty.sources.sources import Sources

NEGLIGIBLE = {"m": 1e-11, "rad": 1e-13}
"""Below, a deviation is rounding: [m], and [rad] at any reach of an arm."""


@dataclass(frozen=True, eq=False)
class FittedArm:
    """The arm that fits measurements: deviations of its parameters, its effects, and what is still uncertain of both.

    Args:
        label: what the arm is called beside the name of its problem, ``calibrated``; empty for no new name.
        deviations: of named parameters of the robot from the values of the problem [rad or m]; a frame with
            deviations is known from now on, and no longer free.
        known: covariance of the errors that stay, of effects too; ``None`` leaves all that the problem states.
        scatter: JOINT.theta or JOINT.d -> standard deviation from repeat to repeat beside that of effects [rad or m].
        effects: with their estimates, which add to those of the problem; ``noises`` likewise.
        gravity: in the world of the data [m/s²]; ``None`` leaves that of the problem.
        header: what a file of this arm says of itself in its first lines.
        second_arms: name -> the arm that this one touched, as far as it was found with it.
    """

    label: str
    deviations: Mapping[str, float]
    known: Sources | None = None
    scatter: Mapping[str, float] = field(default_factory=dict)
    effects: tuple[Effect, ...] = ()
    noises: tuple[NoiseEffect, ...] = ()
    gravity: tuple[float, float, float] | None = None
    header: tuple[str, ...] = ()
    second_arms: Mapping[str, FittedArm] = field(default_factory=dict)

    @property
    def covariance_file(self) -> str:
        """What the file of the covariance is called."""
        return f"{self.label}_covariance.csv"
