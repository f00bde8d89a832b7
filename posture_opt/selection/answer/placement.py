"""``PlacementRange``: where a workpiece may stand: x, y, z [m] and yaw [rad], each fixed or between two ends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import TURN, Array, Mask
from posture_opt.selection.tasks.workpiece import Workpiece
from posture_opt.statements import Quantity

COORDINATES = ("x", "y", "z", "yaw")
_IRRATIONAL_STEPS = np.sqrt([2.0, 3.0, 5.0, 7.0])
# What a person sets up: 0.1 mm and 0.01 degrees.
_SETTING_STEPS = np.array([1e-4, 1e-4, 1e-4, math.radians(0.01)])


@dataclass(frozen=True)
class PlacementRange:
    """A box of placements w = (x, y, z, yaw), ``Trans(x, y, z) Rz(yaw)`` in the world.

    Args:
        lower, upper: (4,) [m, m, m, rad]; equal where a coordinate is fixed.
    """

    lower: Array
    upper: Array

    @classmethod
    def of(cls, workpiece: Workpiece | None) -> PlacementRange:
        """What a task says of its workpiece; its frame is the world's where it says nothing."""
        stated = workpiece or Workpiece()
        return cls(np.array(stated.lower), np.array(stated.upper))

    @property
    def free(self) -> Mask:
        """(4,) which coordinates may be chosen."""
        return np.asarray(self.upper > self.lower)

    @property
    def centre(self) -> Array:
        """(4,) the middle of the box."""
        return (self.lower + self.upper) / 2

    @property
    def all_round(self) -> bool:
        """Whether the yaw goes through a whole turn, so that its ends are none."""
        return bool(self.upper[3] - self.lower[3] >= TURN - 1e-9)

    @property
    def without_seam(self) -> PlacementRange:
        """The same box for a local search: half a turn more to either side where the yaw goes all round."""
        if not self.all_round:
            return self
        more = np.array([0.0, 0.0, 0.0, TURN / 2])
        return PlacementRange(self.lower - more, self.upper + more)

    def drawn(self, count: int, rng: np.random.Generator) -> Array:
        """(count, 4) placements that fill the box evenly: multiples of irrational steps from a random start.

        Source: R. D. Richtmyer, Los Alamos report LA-1342 (1951).
        """
        steps = np.outer(np.arange(1, count + 1), _IRRATIONAL_STEPS)
        return self.lower + ((steps + rng.random(4)) % 1.0) * (self.upper - self.lower)

    def near(self, w: Array, share: float, count: int, rng: np.random.Generator) -> Array:
        """(count, 4) placements in a box of that ``share`` of this one about ``w``."""
        away = rng.uniform(-0.5, 0.5, (count, 4)) * share * (self.upper - self.lower)
        return np.clip(w + away, self.lower, self.upper)

    def tidied(self, w: Array) -> Array:
        """(4,) a placement as people write it: tenths of a millimetre, hundredths of a degree, turns taken off."""
        turned = np.array(w)
        if self.all_round:
            turned[3] = self.lower[3] + (turned[3] - self.lower[3]) % TURN
        rounded = np.where(self.free, np.rint(turned / _SETTING_STEPS) * _SETTING_STEPS, turned)
        return np.clip(rounded, self.lower, self.upper)


def placement_text(w: Array, placement: PlacementRange) -> str:
    """A placement in a line, with the coordinates that are fixed or at an end of their range.

    Args:
        w: (4,) x, y, z [m] and yaw [rad].
    """
    texts = []
    for k, name in enumerate(COORDINATES):
        text = f"{name} {Quantity(float(w[k]), 'coordinate' if k < 3 else 'joint angle')}"
        if not placement.free[k]:
            text += " (fixed)"
        elif k < 3 or not placement.all_round:
            text += " (end of its range)" * bool(min(w[k] - placement.lower[k], placement.upper[k] - w[k]) < 1e-9)
        texts.append(text)
    return ", ".join(texts)


def placement_json(w: Array) -> dict[str, float]:
    """x, y, z [m] and yaw [rad] by name."""
    return dict(zip(COORDINATES, map(float, w), strict=True))
