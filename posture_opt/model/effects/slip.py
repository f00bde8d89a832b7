"""A slip: from some moment on a joint, or the base, stands elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.model.chain import cross, subtract
from posture_opt.model.effects.effect import Case, Effect, Move
from posture_opt.model.scalars import at_least
from posture_opt.model.site import ZERO, Site
from posture_opt.robot.robot import Robot
from posture_opt.units import Time

_STEPS = 150  # moments at which a slip is looked for
_AXES = np.eye(3)


class Slip(Effect):
    """``dq = h (t ≥ t0)`` of a joint; of the base a shift, or a slide and a turn on the floor, from ``t0`` on."""

    summary: ClassVar[str] = "a step at some moment: a coupling or the base slipped"
    shape: ClassVar = ("moment",)
    shape_units: ClassVar = {"moment": "s"}
    needs: ClassVar = frozenset({"time"})
    for_planning: ClassVar = False

    kind: Literal["slip"] = "slip"
    of: str = Field(description="a joint, or base")
    moment: Time = Field(description="t0, since the first measurement")
    turning: bool = Field(False, description="whether the base slid and turned on the floor, or was shifted in space")

    @property
    def target(self) -> str:
        return self.of

    @property
    def dimensions(self) -> tuple[tuple[str, str], ...]:
        if self.of != "base":
            return (("step", "angle"),)
        if self.turning:
            return ("x", "length"), ("y", "length"), ("yaw", "angle")
        return ("x", "length"), ("y", "length"), ("z", "length")

    def moves(self, site: Site) -> tuple[Move, ...]:
        after = at_least(site.inputs.time, self.moment)
        if self.of != "base":
            return (Move({site.robot.joint_names.index(self.of): after}),)
        foot = site.walk.screws[len(site.robot.base)].origin
        lever = subtract(site.tool, foot)
        vectors: list[Any] = [tuple(after * float(a) for a in axis) for axis in _AXES]
        shifts = [Move(twist=(v, ZERO)) for v in vectors]
        if not self.turning:
            return tuple(shifts)
        return shifts[0], shifts[1], Move(twist=(cross(vectors[2], lever), vectors[2]))

    @classmethod
    def candidates(cls, case: Case) -> Sequence[Effect]:
        if not cls.needs <= case.inputs or case.duration <= 0:
            return []
        moments = case.duration * (np.arange(_STEPS) + 0.5) / _STEPS
        joints = case.moving("revolute")
        return [
            cls(of=name, moment=f"{moment!r} s", turning=turning)
            for name, turning in (*((j, False) for j in joints), ("base", False), ("base", True))
            for moment in moments.tolist()
        ]

    def robot_fault(self, robot: Robot) -> str:
        known = ("base", *robot.joint_names)
        return "" if self.of in known else f"the robot has no joint '{self.of}'; write base or one of its joints"
