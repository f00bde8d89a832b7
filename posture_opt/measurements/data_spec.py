"""The ``data`` section of the problem file: what is known about measurements besides their file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from posture_opt.spec import Spec
from posture_opt.units import Length

Distance = Annotated[tuple[str, str, Length], Field(examples=[["front/0", "front/1", "50 mm"]])]


class DataSpec(Spec):
    """What is known about the measurements: distances between touched points."""

    distances: tuple[Distance, ...] = Field((), description="[point, point, distance with its unit]")

    @field_validator("distances")
    @classmethod
    def _between_two_points(cls, distances: tuple[tuple[str, str, float], ...]) -> tuple[tuple[str, str, float], ...]:
        seen: set[frozenset[str]] = set()
        for a, b, length in distances:
            if a == b:
                raise ValueError(f"the distance of '{a}' to itself is given; name two different points")
            if length <= 0:
                raise ValueError(f"the distance of '{a}' and '{b}' is {length:g} m; a distance is greater than 0")
            if frozenset((a, b)) in seen:
                raise ValueError(f"the distance of '{a}' and '{b}' is given twice; keep one")
            seen.add(frozenset((a, b)))
        return distances
