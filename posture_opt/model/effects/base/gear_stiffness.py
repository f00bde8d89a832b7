"""How soft the gear of a joint can be: the gear has to carry the joint's load, and catalogues say how stiff that is.

Strain-wave gears: Harmonic Drive, CSF and CSG series, rated torque at 2000 rpm and ratio 100, torsional stiffness K1,
the least of three, at small torque, for ratios of 80 and more. Cycloidal gears: Nabtesco, RV-E series, rated torque at
15 rpm and torsional rigidity, which is stated in N m/arcmin. Unverified: the catalogues were not at hand. The factor
`_IN_SERIES` leaves room for more than they could be off.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from posture_opt.model.arm_state import ArmState, Inputs
from posture_opt.robot.joint_ranges import drawn_between
from posture_opt.robot.robot import Factor, Joint, Robot

_ARCMIN = np.pi / 180 / 60
"""rad."""
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
"""The gears by the torque that they are made for; above 265 N m joints have cycloidal gears."""
SOURCE = "Harmonic Drive, catalogue CSF and CSG; Nabtesco, catalogue RV-E"
_IN_SERIES = 4.0
"""How much softer a joint may be than its gear: bearings, housing or a belt in series, a ratio of 30 for 100."""
LARGEST_TURN = 1e-2
"""Turn [rad] of a joint under the torque that its gear is rated for, at the most: 1.7 to 2.6 mrad of a strain-wave gear
by `CATALOGUE`, times `_IN_SERIES`."""
_KG_PER_M = 10.0
"""Mass of links that state none, per length: UR5 and UR10 have 15 to 20 kg/m, and less is on the safe side."""
_POSTURES = 200
"""Random postures whose largest torque is that of the arm, to some percent."""


def least_stiffness(robot: Robot, joint: int) -> float:
    """The stiffness [N m/rad] below which no joint with a gear is: that of the softest gear which carries its load.

    ``K1 / 4`` of the smallest gear of `CATALOGUE` whose rated torque is that of gravity on the joint, the largest of
    all postures, with the payload of the file. A wrist that carries nothing has the smallest gear.

    Args:
        robot: with its masses; where they are not stated, links weigh 10 kg/m.
        joint: index.
    """
    load = _largest_torques(robot)[joint]
    soft = next((stiffness for _, rated, stiffness in CATALOGUE if rated >= load), CATALOGUE[-1][2])
    return soft / _IN_SERIES


@lru_cache(maxsize=8)
def _largest_torques(robot: Robot) -> tuple[float, ...]:
    """(n,) torque of gravity on each joint [N m], the largest of `_POSTURES` random ones."""
    loaded = replace(robot, joints=tuple(map(_with_mass, robot.joints, map(_length, robot.links))))
    low, high = (np.clip(edges, -np.pi, np.pi) for edges in drawn_between(robot))  # a slide may have no limits
    q = np.random.default_rng(0).uniform(low, high, size=(_POSTURES, robot.n))
    state = ArmState(loaded, list(q.T), Inputs(payload=robot.payload))
    return tuple(float(np.max(np.abs(np.asarray(state.torque(i), dtype=float)))) for i in range(robot.n))


def _length(link: tuple[Factor, ...]) -> float:
    """Sum of the fixed lengths of a link [m]."""
    return float(sum(abs(factor.nominal) for factor in link if factor.kind == "translate"))


def _with_mass(joint: Joint, length: float) -> Joint:
    """The joint with the mass of its link: as stated, else `_KG_PER_M` at the end of the link."""
    known = np.isfinite([joint.mass, *joint.com]).all()
    return joint if known else replace(joint, mass=_KG_PER_M * length, com=(0.0, 0.0, 0.0))
