"""``GridRequest``: what a map is asked to cover."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from posture_opt.errors import InputError, Issue

Plane = Literal["xy", "xz", "yz"]

MOST = 20_000
"""Targets of a grid: more take minutes and no eye tells them apart."""


@dataclass(frozen=True)
class GridRequest:
    """What a map is asked to cover; what is left out is chosen to suit the task.

    Args:
        counts: (2,) in the plane, or (3,) along x, y, z of the world.
        low, high: (3,) corners of a box in the world [m].
        plane: of the world's axes; default: across the direction of the task.
    """

    counts: tuple[int, ...] | None = None
    low: tuple[float, float, float] | None = None
    high: tuple[float, float, float] | None = None
    plane: Plane | None = None

    def check(self) -> None:
        """Raise InputError where counts and corners make no grid, all faults at once."""
        issues = [*self._count_issues(), *self._corner_issues()]
        if self.plane is not None and self.plane not in get_args(Plane):
            mend = f"write one of: {', '.join(get_args(Plane))}"
            issues.append(Issue(f"there is no plane '{self.plane}'", ("--plane",), self.plane, mend))
        if issues:
            raise InputError(issues)

    def _count_issues(self) -> list[Issue]:
        if self.counts is None:
            return []
        text, key, mend = (
            "x".join(map(str, self.counts)),
            ("--grid",),
            "write for example 15x15, or 9x9x1 along x, y, z",
        )
        if len(self.counts) not in (2, 3) or min(self.counts) < 1:
            return [Issue(f"{text} is no grid", key, text, mend)]
        if max(self.counts) < 2:
            return [Issue("one target is no map", key, text, mend)]
        total = math.prod(self.counts)
        return [Issue(f"{total} targets are more than {MOST}", key, text, "take fewer")] if total > MOST else []

    def _corner_issues(self) -> list[Issue]:
        if (self.low is None) != (self.high is None):
            missing = "--min" if self.low is None else "--max"
            return [Issue("a box has two corners", (missing,), mend="give --min and --max")]
        issues = []
        for key, corner in (("--min", self.low), ("--max", self.high)):
            if corner is not None and (len(corner) != 3 or not all(map(math.isfinite, corner))):
                issues.append(Issue("a corner has three finite coordinates", (key,), corner, '"0.3 m, -0.2 m, 0.1 m"'))
        if self.low is None or self.high is None or issues:
            return issues
        sides = list(zip("xyz", self.low, self.high, strict=True))
        issues += [
            Issue(f"the box is empty in {name}: {low:g} m is above {high:g} m", ("--min",), low, "swap them")
            for name, low, high in sides
            if low > high
        ]
        if not issues and all(low == high for _, low, high in sides):
            issues.append(Issue("the box is one point", ("--max",), self.high, "give it a width in two directions"))
        return issues
