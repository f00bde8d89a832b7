"""The shape of an arm: capsules that its links, its base and what it holds lie in."""

from __future__ import annotations

import math
from dataclasses import dataclass

BASE = "base"
TOOL = "tool"
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Capsule:
    """All points within ``radius`` of the segment from ``start`` to ``end``: a segment swept by a sphere.

    Args:
        joint: the joint whose link it belongs to, ``base`` for what stands still, ``tool`` for what is held.
        start, end: (3,) [m] in the frame behind that joint (of the robot's base, of the tool); equal for a sphere.
        radius: [m].
    """

    joint: str
    start: Point
    end: Point
    radius: float

    @property
    def length(self) -> float:
        """Of the segment [m]; the capsule is longer by both radii."""
        return math.dist(self.start, self.end)

    @property
    def volume(self) -> float:
        """``π r² l + 4/3 π r³`` [m³]."""
        return math.pi * self.radius**2 * (self.length + 4 / 3 * self.radius)
