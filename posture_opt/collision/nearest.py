"""``Clearance``: how near an arm comes to its cell and to itself, and where."""

from __future__ import annotations

from typing import NamedTuple

from posture_opt.numerics import Json


class Nearest(NamedTuple):
    """The least distance of some pairs.

    Args:
        distance: [m]; zero or less where bodies overlap, but not how deep.
        between: two joints, or a joint and an obstacle.
    """

    distance: float
    between: tuple[str, str]

    def to_json(self) -> dict[str, Json]:
        """Distance and names."""
        return {"distance": self.distance, "between": list(self.between)}


class Clearance(NamedTuple):
    """The least distances and where they are.

    Args:
        cell: of the arm to obstacles and mounting plane; None where it is checked against neither.
        own: of the arm to itself; None where that is not checked.
    """

    cell: Nearest | None
    own: Nearest | None

    @property
    def nearest(self) -> Nearest:
        """The least of both."""
        return min((part for part in self if part is not None), key=lambda part: part.distance)

    @property
    def distance(self) -> float:
        """The least distance [m]."""
        return self.nearest.distance

    @property
    def between(self) -> tuple[str, str]:
        """Where that is."""
        return self.nearest.between

    def to_json(self) -> dict[str, Json]:
        """The key ``clearance`` of a document."""
        parts = {"cell": self.cell, "self": self.own}
        return {**self.nearest.to_json(), **{key: part and part.to_json() for key, part in parts.items()}}
