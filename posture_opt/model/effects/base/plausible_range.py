"""``PlausibleRange``: the sizes that a cause can have on a real arm, each with where the figures are published."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from posture_opt.model.arm_state import ArmState, Inputs
from posture_opt.numerics import Json
from posture_opt.robot.posture import drawn_between
from posture_opt.robot.robot import Robot
from posture_opt.units import DIMENSIONS, shown


@dataclass(frozen=True)
class PlausibleRange:
    """Least and largest size of a cause on an arm; beyond, an error only looks like that cause unless ``needs`` is
    true."""

    low: float  # low, high: [SI]
    high: float
    dimension: str  # of both, a key of `DIMENSIONS` or ratio
    needs: str  # what it would take for the cause to be real beyond the range; a clause without size
    source: str  # where the figures are published

    def holds(self, value: float, std: float) -> bool:
        """Whether a size [SI] is within the range, give or take two of its standard errors."""
        # Standard errors by which an estimate may be outside of a range: 95 % of them are within.
        error = 2.0 * std if math.isfinite(std) else 0.0
        return self.low - error <= value <= self.high + error

    def would_need(self, value: float) -> str:
        """What would have to be true for a cause of this size [SI] to be real."""
        if self.low == self.high == 0.0:
            return self.needs
        low, high = shown(self.low, self.dimension), shown(self.high, self.dimension)
        usual = f"{low} to {high}" if self.low > 0 else f"up to {high}"
        return f"{self.needs}: {shown(value, self.dimension)}, where {usual} is usual"

    def to_json(self) -> dict[str, Json]:
        """Ends of the range in SI units, with the source."""
        unit = "1" if self.dimension == "ratio" else DIMENSIONS[self.dimension][0]
        return {"low": self.low, "high": self.high, "unit": unit, "source": self.source}


_ARCMIN = np.pi / 180 / 60  # rad
# The gears by the torque that they are made for; above 265 N m joints have cycloidal gears
CATALOGUE = (
    # size, rated torque [N m], torsional stiffness [N m/rad]
    ("CSF-8", 2.4, 910.0),
    ("CSF-11", 5.0, 2.7e3),
    ("CSG-14", 7.8, 4.7e3),
    ("CSG-17", 24.0, 1.0e4),
    ("CSG-20", 40.0, 1.6e4),
    ("CSG-25", 67.0, 3.1e4),
    ("CSG-32", 137.0, 6.7e4),
    ("CSG-40", 265.0, 1.3e5),
    ("RV-40E", 412.0, 108 / _ARCMIN),
    ("RV-80E", 784.0, 196 / _ARCMIN),
    ("RV-160E", 1568.0, 392 / _ARCMIN),
    ("RV-320E", 3136.0, 980 / _ARCMIN),
    ("RV-450E", 4410.0, 1176 / _ARCMIN),
)
SOURCE = "Harmonic Drive, catalogue CSF and CSG; Nabtesco, catalogue RV-E"
# Turn [rad] of a joint under the torque that its gear is rated for, at the most: 1.7 to 2.6 mrad of a strain-wave gear
# by `CATALOGUE`, times 4.0
LARGEST_TURN = 1e-2


def least_stiffness(robot: Robot, joint: int) -> float:
    """Least stiffness [N m/rad] of a joint with a gear: ``K1 / 4`` of the smallest gear of `CATALOGUE` whose rated
    torque is that of gravity with the payload, the largest of all postures. Links without masses weigh 10 kg/m."""
    load = _largest_torques(robot)[joint]
    soft = next((stiffness for _, rated, stiffness in CATALOGUE if rated >= load), CATALOGUE[-1][2])
    # How much softer a joint may be than its gear: bearings, housing or a belt in series, a ratio of 30 for 100.
    return soft / 4.0


@lru_cache(maxsize=8)
def _largest_torques(robot: Robot) -> tuple[float, ...]:
    """(n,) torque of gravity on each joint [N m], the largest of 200 random ones."""
    joints = []
    for joint, link in zip(robot.joints, robot.links, strict=True):
        known = np.isfinite([joint.mass, *joint.com]).all()
        length = sum(abs(factor.nominal) for factor in link if factor.kind == "translate")
        # Links that state no mass have 10 kg/m: UR5 and UR10 have 15 to 20, and less is on the safe side.
        joints.append(joint if known else replace(joint, mass=10.0 * length, com=(0.0, 0.0, 0.0)))
    loaded = replace(robot, joints=tuple(joints))
    low, high = (np.clip(edges, -np.pi, np.pi) for edges in drawn_between(robot))  # a slide may have no limits
    # Random postures whose largest torque is that of the arm, to some percent.
    q = np.random.default_rng(0).uniform(low, high, size=(200, robot.n))
    state = ArmState(loaded, list(q.T), Inputs(payload=robot.payload))
    return tuple(float(np.max(np.abs(np.asarray(state.torque(i), dtype=float)))) for i in range(robot.n))
