"""The shape of an arm: capsules that its links, its base and what it holds lie in."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.numerics import Array

BASE = "base"
"""``Capsule.joint`` of a body at rest: its frame is that of the robot's base."""
TOOL = "tool"
"""``Capsule.joint`` of a body held by the flange: its frame is that of the tool point."""
Point = tuple[float, float, float]
"""(3,) coordinates [m]; the frame is that of the capsule's joint."""


@dataclass(frozen=True)
class Capsule:
    """All points within ``radius`` of the segment from ``start`` to ``end``: a segment swept by a sphere.

    Args:
        joint: the joint whose link it belongs to, ``base`` for what is at rest, ``tool`` for what is held.
        start, end: (3,) [m], in the frame behind that joint (of the robot's base, of the tool); equal for a sphere.
        radius: [m]; zero for a bare line.

    Example:
        >>> Capsule("joint1", (0.0, 0.0, 0.0), (0.3, 0.0, 0.0), 0.05).length
        0.3
    """

    joint: str
    start: Point
    end: Point
    radius: float

    @property
    def length(self) -> float:
        """Length of the segment [m]; the capsule is longer by both radii."""
        return math.dist(self.start, self.end)

    @property
    def volume(self) -> float:
        """``π r² l + 4/3 π r³`` [m³]."""
        return math.pi * self.radius**2 * (self.length + 4 / 3 * self.radius)


def moved(capsule: Capsule, T: Array) -> Capsule:
    """The capsule in another frame.

    Args:
        capsule: in a frame a.
        T: (4, 4) T_b_a, lengths in [m]; a rotation and a shift, as radii are kept.
    """
    return replace(capsule, start=_moved_point(T, capsule.start), end=_moved_point(T, capsule.end))


def _moved_point(T: Array, point: Point) -> Point:
    """A point (3,) [m] in the other frame, ``T p``."""
    x, y, z = (T[:3, :3] @ np.array(point) + T[:3, 3]).tolist()
    return x, y, z
