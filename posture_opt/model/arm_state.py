"""``ArmState``: the nominal arm at its postures with what loads it, as effects need it; their ``Inputs``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from posture_opt.model.chain import ZERO, Scalar, Vector, Walk, add, cross, dot, factor_values, scale, subtract, walk
from posture_opt.numerics import Codes
from posture_opt.robot.robot import Robot

# degC at which the lengths of a model hold (ISO 1); a task without a temperature is done there
REFERENCE_TEMPERATURE = 20.0


MIN_LEANING_SINE = 0.1  # Sine of the tilt of an axis below which gravity loads its joint with next to nothing: 6°


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of effects at one posture, or at N of them as arrays (N,)."""

    payload: Scalar = 0.0  # mass at the tool point [kg]
    # (n,) +1 where the joint value was increasing on arrival, −1 where it was decreasing, 0 where that is not known.
    # Empty: all unknown
    approach: Sequence[Scalar] = ()
    approach_length: Sequence[Scalar] = ()  # (n,) length of that last move [rad or m]; empty: long moves
    temperature: Scalar = 0.0  # above the reference temperature [K]
    time: Scalar = 0.0  # since the first measurement [s]; rows are counted where no time is given
    stated: tuple[str, ...] = ()  # names of the joints whose side is known
    speed: Sequence[Scalar] = ()  # (n,) of the joints at the moment of the row [rad/s or m/s]; empty: at rest

    def take(self, rows: Codes) -> Inputs:
        """The inputs of some of N postures, by index; the time stays the one since the first measurement of all."""
        return Inputs(
            self.payload[rows], [side[rows] for side in self.approach], [way[rows] for way in self.approach_length],
            self.temperature[rows], self.time[rows], self.stated, [speed[rows] for speed in self.speed],
        )  # fmt: skip

    def side(self, joint: int) -> Scalar:
        """Side of arrival: +1 as the joint value increased, −1 as it decreased, 0 if unknown."""
        return self.approach[joint] if len(self.approach) else 0.0

    def travel(self, joint: int) -> Scalar:
        """The length of the last move of a joint [rad or m]; 1e6, longer than any, where none is known."""
        return self.approach_length[joint] if len(self.approach_length) else 1e6


def _placed(frame: Walk, local: Sequence[float]) -> Vector:
    """The point (3,) of a frame in the world [m]."""
    (a, b, c), (x, y, z) = frame.columns, local
    return add(add(add(frame.position, scale(x, a)), scale(y, b)), scale(z, c))


@dataclass(frozen=True, eq=False)
class ArmState:
    """The arm without effects at the commanded joints ``q`` under ``inputs``: one posture, or N of them."""

    robot: Robot  # the chain, with masses and gravity
    q: Sequence[Scalar]  # (n,) commanded joints [rad or m]: numbers, arrays (N,) or CasADi expressions
    inputs: Inputs = field(default_factory=Inputs)  # payload, temperature, time, sides
    # deviations of parameters from the file's arm, of frames that were found from data for example [rad or m]
    p: Mapping[str, Scalar] = field(default_factory=dict)
    # joint index -> how far whole joints are off their commands, as another joint carries them along [rad]
    carried: Mapping[int, Scalar] = field(default_factory=dict)

    @cached_property
    def _factor_values(self) -> list[Scalar]:
        """The value of every factor of the chain [rad or m]."""
        joints = [value + self.carried[i] if i in self.carried else value for i, value in enumerate(self.q)]
        return factor_values(self.robot.factors, joints, self.p)

    @cached_property
    def walk(self) -> Walk:
        """The chain without effects: pose of the tool and all screws, world."""
        return walk(self.robot.factors, self._factor_values)

    @property
    def tool(self) -> Vector:
        """The tool point in the world [m]."""
        return self.walk.position

    @cached_property
    def frames(self) -> tuple[Walk, ...]:
        """(n,) the frame behind every joint, which moves with its link."""
        found, first = [], len(self.robot.base)
        here = walk(self.robot.base, self._factor_values[:first])
        for link in self.robot.links:
            here = walk(link, self._factor_values[first : first + len(link)], here)
            first += len(link)
            found.append(here)
        return tuple(found)

    def axis(self, joint: int) -> tuple[Vector, Vector]:
        """Unit vector (3,) along the axis of a joint and a point (3,) on it [m], world frame."""
        screw = self.walk.screws[self.robot.driven[joint]]
        return screw.axis, screw.origin

    def leaning(self, joint: int) -> float:
        """Sine of the largest angle of a joint's axis to the vertical over all postures; 1 of slides and without
        gravity."""
        axis, g = self.axis(joint)[0], self.robot.gravity
        weight = math.hypot(*g)
        if self.robot.joints[joint].type == "prismatic" or not weight:
            return 1.0
        across = np.stack(np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in cross(axis, g))))
        return float(np.max(np.linalg.norm(across, axis=0))) / weight

    @property
    def weighed(self) -> bool:
        """Whether all masses and centres are known, but of a first link that turns about the vertical: it loads no
        joint."""
        joints = self.robot.joints
        axis, g = self.axis(0)[0], self.robot.gravity
        upright = joints[0].type == "revolute" and all(abs(v) < 1e-2 * math.hypot(*g) for v in cross(axis, g))
        return all(math.isfinite(j.mass) and all(map(math.isfinite, j.com)) for j in joints[upright:])

    @cached_property
    def loads(self) -> tuple[tuple[int, Scalar, Vector], ...]:
        """(joint that carries it, mass [kg], place (3,) in the world [m]) of every known link, the payload last."""
        links = [
            (i, joint.mass, _placed(self.frames[i], joint.com))
            for i, joint in enumerate(self.robot.joints)
            if math.isfinite(joint.mass) and joint.mass > 0 and all(map(math.isfinite, joint.com))
        ]
        return (*links, (self.robot.n - 1, self.inputs.payload, self.payload_centre))

    @cached_property
    def payload_centre(self) -> Vector:
        """Of the payload, in the world [m]."""
        local = self.robot.payload_centre
        return _placed(self.walk, local) if any(local) else self.tool

    def torque(self, joint: int) -> Scalar:
        """Gravity on a joint [N m, or N]: ``τ_j = Σ_k m_k (a_j × (x_k − o_j)) · g`` over its loads, ``a_j · g`` of a
        slide."""
        total: Scalar = 0.0
        for carrier, mass, place in self.loads:
            if carrier >= joint:
                total = total + mass * self.unit_torque(joint, place)
        return total

    def payload_torque(self, joint: int) -> Scalar:
        """The payload's part of `torque` [N m, or N]."""
        return self.inputs.payload * self.unit_torque(joint, self.payload_centre)

    def unit_torque(self, joint: int, place: Vector) -> Scalar:
        """The generalised force [N m, or N] on a joint of 1 kg at a place (3,) of the world [m]."""
        axis, origin = self.axis(joint)
        g = self.robot.gravity
        if self.robot.joints[joint].type == "prismatic":
            return dot(axis, g)
        return dot(cross(axis, subtract(place, origin)), g)

    def moment(self, carrier: int, about: Vector) -> Vector:
        """Moment (3,) [N m] about a point (3,) [m], world, of all weights behind joint ``carrier``; −1 counts every
        link."""
        total = ZERO
        for behind, mass, place in self.loads:
            if behind > carrier:
                weight = scale(mass, self.robot.gravity)
                total = add(total, cross(subtract(place, about), weight))
        return total
