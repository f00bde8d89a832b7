"""``ArmState``: the nominal arm at its postures with what loads it, as effects want to know it; their ``Inputs``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.model.chain import ZERO, Scalar, Vector, Walk, add, cross, dot, factor_values, scale, subtract, walk
from posture_opt.numerics import Codes
from posture_opt.robot.robot import Robot

REFERENCE_TEMPERATURE = 20.0
"""degC at which the lengths of a model hold (ISO 1); a task without a temperature is done there."""


UPRIGHT = 0.1
"""Sine of the tilt of an axis below which gravity loads its joint with next to nothing: 6°."""


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of effects at one posture, or at N of them as arrays (N,).

    Args:
        payload: mass at the tool point [kg].
        approach: (n,) side from which each joint arrived, -1 or +1; 0 where it is not known. Empty: all unknown.
        approach_length: (n,) length of that last move [rad or m]; empty: long moves.
        temperature: above the reference temperature [K].
        time: since the first measurement [s]; rows are counted where no time is given.
        stated: names of the joints whose side is known.
    """

    payload: Scalar = 0.0
    approach: Sequence[Scalar] = ()
    approach_length: Sequence[Scalar] = ()
    temperature: Scalar = 0.0
    time: Scalar = 0.0
    stated: tuple[str, ...] = ()

    def take(self, rows: Codes) -> Inputs:
        """The inputs of some of N postures; the time stays the one since the first measurement of all."""
        return Inputs(
            self.payload[rows], [side[rows] for side in self.approach], [way[rows] for way in self.approach_length],
            self.temperature[rows], self.time[rows], self.stated,
        )  # fmt: skip

    def side(self, joint: int) -> Scalar:
        """The side from which a joint arrived."""
        return self.approach[joint] if len(self.approach) else 0.0

    def travel(self, joint: int) -> Scalar:
        """The length of the last move of a joint, endless where nobody says [rad or m]."""
        return self.approach_length[joint] if len(self.approach_length) else 1e6


@dataclass(frozen=True)
class Frame:
    """A frame of the chain in the world: columns of its rotation, and its origin [m]."""

    columns: tuple[Vector, Vector, Vector]
    origin: Vector

    def point(self, local: Sequence[float]) -> Vector:
        """The point with these coordinates in the frame, in the world [m]."""
        moved = self.origin
        for axis in range(3):
            moved = add(moved, scale(local[axis], self.columns[axis]))
        return moved


@dataclass(frozen=True, eq=False)
class ArmState:
    """The arm without effects at the commanded joints ``q`` (n scalars) under ``inputs``.

    ``p`` holds deviations of parameters from the file's arm, of frames that were found from data for example;
    ``carried`` what whole joints stand beyond their commands, as another joint carries them along [rad or m].
    """

    robot: Robot
    q: Sequence[Scalar]
    inputs: Inputs = field(default_factory=Inputs)
    p: Mapping[str, Scalar] = field(default_factory=dict)
    carried: Mapping[int, Scalar] = field(default_factory=dict)

    @cached_property
    def _values(self) -> list[Any]:
        """The value of every factor of the chain."""
        stands = [value + self.carried[i] if i in self.carried else value for i, value in enumerate(self.q)]
        return factor_values(self.robot.factors, stands, self.p)

    @cached_property
    def walk(self) -> Walk:
        """The chain without effects."""
        return walk(self.robot.factors, self._values)

    @property
    def tool(self) -> Vector:
        """The tool point in the world [m]."""
        return self.walk.position

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """(n,) the frame behind every joint, which moves with its link."""
        factors, ends, end = self.robot.factors, [], len(self.robot.base)
        for link in self.robot.links:
            end += len(link)
            ends.append(end)
        parts = [walk(factors[:end], self._values[:end]) for end in ends]
        return tuple(Frame(part.columns, part.position) for part in parts)

    def axis(self, joint: int) -> tuple[Vector, Vector]:
        """Unit vector along the axis of a joint and a point on it, world frame."""
        screw = self.walk.screws[self.robot.driven[joint]]
        return screw.axis, screw.origin

    def leaning(self, joint: int) -> float:
        """Sine of the largest angle between the axis of a joint and the vertical; 1 of a prismatic joint."""
        axis, g = self.axis(joint)[0], self.robot.gravity
        weight = math.hypot(*g)
        if self.robot.joints[joint].type == "prismatic" or not weight:
            return 1.0
        across = np.stack(np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in cross(axis, g))))
        return float(np.max(np.linalg.norm(across, axis=0))) / weight

    @property
    def weighed(self) -> bool:
        """Whether mass and centre of mass of every link are known; one that turns about the vertical loads nothing."""
        joints = self.robot.joints
        axis, g = self.axis(0)[0], self.robot.gravity
        upright = joints[0].type == "revolute" and all(abs(v) < 1e-2 * math.hypot(*g) for v in cross(axis, g))
        return all(math.isfinite(j.mass) and all(map(math.isfinite, j.com)) for j in joints[upright:])

    @cached_property
    def loads(self) -> tuple[tuple[int, Scalar, Vector], ...]:
        """(joint that carries it, mass [kg], place in the world [m]) of every known link and of the payload."""
        links = [
            (i, joint.mass, self.frames[i].point(joint.com))
            for i, joint in enumerate(self.robot.joints)
            if math.isfinite(joint.mass) and joint.mass > 0 and all(map(math.isfinite, joint.com))
        ]
        return (*links, (self.robot.n - 1, self.inputs.payload, self.tool))

    def torque(self, joint: int) -> Any:
        """The generalised force of gravity on a joint [N m, or N], which pulls it that way."""
        total: Any = 0.0
        for carrier, mass, place in self.loads:
            if carrier >= joint:
                total = total + mass * self.unit_torque(joint, place)
        return total

    def payload_torque(self, joint: int) -> Any:
        """The part of `torque` that comes from the payload."""
        return self.inputs.payload * self.unit_torque(joint, self.tool)

    def unit_torque(self, joint: int, place: Vector) -> Any:
        """The generalised force on a joint of 1 kg at a place of the world."""
        axis, origin = self.axis(joint)
        g = self.robot.gravity
        if self.robot.joints[joint].type == "prismatic":
            return dot(axis, g)
        return dot(cross(axis, subtract(place, origin)), g)

    def moment(self, carrier: int, about: Vector) -> Vector:
        """The moment about a point of the weights of all links behind joint ``carrier`` and of the payload [N m].

        ``carrier`` -1 counts every link.
        """
        total = ZERO
        for behind, mass, place in self.loads:
            if behind > carrier:
                weight = scale(mass, self.robot.gravity)
                total = add(total, cross(subtract(place, about), weight))
        return total
