"""Forward kinematics of a URDF by Pinocchio, joints addressed by name."""

from __future__ import annotations

from importlib.metadata import files
from pathlib import Path

import numpy as np
import pinocchio

from posture_opt.robot.shape_section import ShapeSection

BARE = ShapeSection(replace=())
"""The key ``shape`` of an arm whose meshes are not read: capsules about them take most of the time."""


def robots_folder():
    """The folder of example-robot-data that holds one folder a robot."""
    urdf = next(f for f in files("example-robot-data") if f.name == "ur10_robot.urdf")
    return Path(urdf.locate()).resolve().parents[2]


class PinArm:
    """A URDF file or text in Pinocchio; other joints than the named ones stay at zero."""

    def __init__(self, urdf):
        text = urdf.read_text() if isinstance(urdf, Path) else urdf
        self.model = pinocchio.buildModelFromXML(text)
        self.data = self.model.createData()

    def configuration(self, q):
        """Pinocchio's vector for joint values by name; a continuous joint takes cosine and sine."""
        full = pinocchio.neutral(self.model)
        for name, value in q.items():
            joint = self.model.joints[self.model.getJointId(name)]
            full[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
        return full

    def pose(self, q, base, tip):
        """(4, 4) T_base_tip."""
        pinocchio.framesForwardKinematics(self.model, self.data, self.configuration(q))
        T_world_base, T_world_tip = (self.data.oMf[self.model.getFrameId(link)] for link in (base, tip))
        return (T_world_base.inverse() * T_world_tip).homogeneous

    def centre(self, q, joint, base):
        """Mass [kg] and centre of mass (3,) [m] in ``base`` of all that is fixed behind ``joint``."""
        pinocchio.framesForwardKinematics(self.model, self.data, self.configuration(q))
        index = self.model.getJointId(joint)
        T_base_world = self.data.oMf[self.model.getFrameId(base)].inverse()
        body = self.model.inertias[index]
        return body.mass, (T_base_world * self.data.oMi[index]).act(body.lever)
