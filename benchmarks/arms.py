"""The two arms of the benchmark, read once from the URDF files of example-robot-data.

Every way gets the same chain: joints, limits and tool point of one URDF, with the branches that do not carry the
tool (fingers) and all meshes cut away, so that no library pays for what the task does not need.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import distribution
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

Array = NDArray[np.float64]

MILLIRADIAN = 1e-3
KEPT = ("origin", "parent", "child", "axis", "limit")


@dataclass(frozen=True)
class Arm:
    """One arm and its part of the benchmark.

    Args:
        urdf: name of the URDF file inside example-robot-data.
        base, tip: links between which the chain runs; `tip` is the tool point, its z axis the tool axis.
        sigma: (n,) standard deviations of the joints [rad].
        lower, upper: (3,) corners of the box of targets in the base frame [m].
        analytic: whether the arm has a closed-form inverse (6R with a known decomposition).
    """

    name: str
    urdf: str
    base: str
    tip: str
    sigma: tuple[float, ...]
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    analytic: bool

    @cached_property
    def path(self) -> Path:
        """The URDF file in the installed example-robot-data."""
        package = distribution("example-robot-data")
        for file in package.files or ():
            if file.name == self.urdf:
                return Path(str(package.locate_file(file))).resolve()
        raise FileNotFoundError(f"{self.urdf} is not in the installed example-robot-data")

    @cached_property
    def chain(self) -> str:
        """The URDF text with the links and joints from `base` to `tip` alone, without meshes."""
        robot = ElementTree.parse(self.path).getroot()
        joints = {_link(joint, "child"): joint for joint in robot.findall("joint") if joint.find("child") is not None}
        kept, links, link = [], {self.tip}, self.tip
        while link != self.base:
            kept.append(joints[link])
            link = _link(joints[link], "parent")
            links.add(link)
        chain = ElementTree.Element("robot", name=self.name)
        chain.extend(ElementTree.Element("link", name=name) for name in links)
        for joint in kept:
            for extra in [child for child in joint if child.tag not in KEPT]:
                joint.remove(extra)
        chain.extend(reversed(kept))
        return ElementTree.tostring(chain, encoding="unicode")

    @cached_property
    def model(self) -> pin.Model:
        """The chain in Pinocchio."""
        return pin.buildModelFromXML(self.chain)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        return tuple(self.model.names)[1:]

    @property
    def limits(self) -> tuple[Array, Array]:
        """Lower and upper joint limits, (n,) each [rad]."""
        return self.model.lowerPositionLimit.copy(), self.model.upperPositionLimit.copy()

    @property
    def tip_id(self) -> int:
        return int(self.model.getFrameId(self.tip))

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """The coordinate axis of each joint: "x", "y" or "z"."""
        return tuple(joint.shortname()[-1].lower() for joint in tuple(self.model.joints)[1:])

    @cached_property
    def placements(self) -> tuple[Array, ...]:
        """The fixed transforms in front of each joint, and the one behind the last: n + 1 arrays (4, 4)."""
        fixed = [placement.homogeneous for placement in tuple(self.model.jointPlacements)[1:]]
        return (*fixed, self.model.frames[self.tip_id].placement.homogeneous)


def _link(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    assert element is not None
    return element.attrib["link"]


PANDA = Arm(
    name="Panda",
    urdf="panda.urdf",
    base="panda_link0",
    tip="panda_hand_tcp",
    sigma=tuple(s * MILLIRADIAN for s in (0.3, 0.3, 0.3, 0.3, 0.5, 0.5, 0.5)),
    lower=(0.30, -0.35, 0.05),
    upper=(0.65, 0.35, 0.40),
    analytic=False,
)
UR10 = Arm(
    name="UR10",
    urdf="ur10_robot.urdf",
    base="base_link",
    tip="tool0",
    sigma=tuple(s * MILLIRADIAN for s in (0.3, 0.3, 0.3, 0.5, 0.5, 0.5)),
    lower=(0.40, -0.50, 0.0),
    upper=(0.95, 0.50, 0.5),
    analytic=True,
)
ARMS = (PANDA, UR10)
