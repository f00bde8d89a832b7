"""``Neighbourhood``: which targets of a map learn from which, and which of them are outliers.

In addition to the neighbours on the grid these are targets that joint 1 turns (or shifts) onto each other. Where the
task's direction is along its axis, the whole arm turns with the target and a posture at one azimuth serves at every
other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.numerics import Array, Codes

PARALLEL_ANGLE = 1e-6  # rad: a direction nearer than this to the axis of joint 1 lies along it
HEIGHT_ROUNDING = 1e-6  # of the largest coordinate: rounding of a grid's
RADIAL_PARTNERS = (1, 2)  # places away in the order by radius


Pairs = tuple[Codes, Codes]
"""Targets, and as many others whose postures are tried there."""


@dataclass(frozen=True, eq=False)
class Line:
    """Targets in a line with two others, which let expect a value of theirs.

    Args:
        at: (N,) targets; ``first`` and ``second`` (N,) two others each in one line with them.
        share: of the first in what both let expect: one half interpolates, two extrapolates.
    """

    at: Codes
    first: Codes
    second: Codes
    share: float


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """What joint 1 does to the whole arm: a turn about, or a shift along, a line that is fixed in the world.

    Args:
        axis: (3,) unit vector, world. frame: (3, 2) two unit vectors across it. point: (3,) on it [m].
        slides: whether joint 1 is prismatic.
        lower, upper: its limits [rad or m].
    """

    axis: Array
    frame: Array
    point: Array
    slides: bool
    lower: float
    upper: float

    @classmethod
    def of(cls, arm: Arm) -> BaseMotion:
        """Read off the Jacobian of joint 1, in which nothing before it moves."""
        joint = arm.robot.joints[0]
        q = (np.array(arm.robot.lower) + np.array(arm.robot.upper)) / 2
        position, (v, w) = np.asarray(arm.position(q), dtype=float), np.split(np.asarray(arm.jacobian(q))[:, 0], 2)
        slides = joint.type == "prismatic"
        axis = v / np.linalg.norm(v) if slides else w / np.linalg.norm(w)
        across = np.eye(3)[np.argmin(np.abs(axis))]
        e1 = across - axis * (axis @ across)
        e1 = e1 / np.linalg.norm(e1)
        # v = ω x (p - c), so that c = p + ω x v lies on the axis.
        point = position if slides else position + np.cross(w, v) / (w @ w)
        frame = np.column_stack([e1, np.cross(axis, e1)])
        return cls(axis, frame, point, slides, float(joint.lower), float(joint.upper))

    def keeps(self, direction: Array) -> bool:
        """Whether a direction (3,) is the same one after the motion."""
        return self.slides or float(np.linalg.norm(np.cross(self.axis, direction))) < PARALLEL_ANGLE

    def split(self, points: Array) -> tuple[Array, Array]:
        """(N, 2) what the motion leaves of points (N, 3) [m]: radius and height, or both offsets; (N,) its amount.

        The amount is the angle about the axis [rad], or the coordinate along it [m].
        """
        r = points - self.point
        along, across = r @ self.axis, r @ self.frame
        if self.slides:
            return across, along
        return np.column_stack([np.linalg.norm(across, axis=1), along]), np.arctan2(across[:, 1], across[:, 0])

    def moved(self, Q: Array, shift: Array) -> Array:
        """Postures (N, n), joint 1 of each moved, by whole turns more or less where its limits ask, else to its limit.

        Args:
            Q: (N, n) [rad or m].
            shift: (N,) of joint 1 [rad or m].
        """
        turn = 0.0 if self.slides else 2 * np.pi
        values = (Q[:, 0] + shift)[:, None] + turn * np.array([0.0, -1.0, 1.0])
        within = np.clip(values, self.lower, self.upper)
        nearest = np.argmin(np.abs(values - within), axis=1)
        return np.column_stack([within[np.arange(len(Q)), nearest], Q[:, 1:]])


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """Which targets try each other's postures.

    Args:
        motion: of joint 1.
        kept: (N, 2 or 3) the coordinates of each target that this motion does not change [m].
        amount: (N,) of the motion that brings the arm to each target [rad or m]; zeros where the task is not the same
            everywhere along it.
        on_grid: pairs of neighbours on the grid.
        turned: pairs of targets that joint 1 moves onto each other, or near to.
        lines: targets in a row, for outliers.
    """

    motion: BaseMotion
    kept: Array
    amount: Array
    on_grid: tuple[Pairs, ...]
    turned: tuple[Pairs, ...]
    lines: tuple[Line, ...]

    @classmethod
    def of(cls, arm: Arm, direction: Array, points: Array, on_grid: Sequence[Pairs]) -> Neighbourhood:
        """Of the targets at ``points`` (N, 3) [m], the task pointing along ``direction`` (3,), world.

        Args:
            on_grid: each direction of the grid, followed by the same pairs turned round.
        """
        lines = tuple(line for here, there in on_grid[::2] for line in _lines(len(points), here, there))
        motion = BaseMotion.of(arm)
        kept, amount = motion.split(points)
        if not motion.keeps(direction):
            return cls(motion, points, np.zeros(len(points)), tuple(on_grid), (), lines)
        turned = [pair for here, there in _nearest(kept) for pair in ((here, there), (there, here))]
        return cls(motion, kept, amount, tuple(on_grid), tuple(turned), lines)

    @property
    def pairs(self) -> tuple[Pairs, ...]:
        """All of them."""
        return *self.on_grid, *self.turned

    def distance(self, there: int, here: int) -> float:
        """How far inverse kinematics has to lead the posture of one target to serve another [m]."""
        return float(np.linalg.norm(self.kept[here] - self.kept[there]))

    def carried(self, Q: Array, there: Codes, here: Codes) -> Array:
        """Postures (N, n) of targets ``there``, joint 1 moved so that the arm faces the targets ``here``."""
        return self.motion.moved(Q, self.amount[here] - self.amount[there])

    def excess(self, values: Array) -> Array:
        """(N,) by what share each value lies above what two others in one line with it let expect.

        The largest over all lines; −inf where there is none, or a value is NaN.
        """
        worst = np.full(len(values), -np.inf)
        for line in self.lines:
            expected = line.share * values[line.first] + (1 - line.share) * values[line.second]
            above = (values[line.at] - expected) / np.maximum(np.abs(expected), np.finfo(float).tiny)
            worst[line.at] = np.fmax(worst[line.at], above)
        return worst


def _lines(count: int, here: Codes, there: Codes) -> list[Line]:
    """Between two neighbours; and on from the next two on either side."""
    ahead, behind = np.full(count, -1), np.full(count, -1)
    ahead[here], behind[there] = there, here
    at = np.flatnonzero((ahead >= 0) & (behind >= 0))
    lines = [Line(at, ahead[at], behind[at], 0.5)]
    for step in (ahead, behind):
        at = np.flatnonzero(step >= 0)
        at = at[step[step[at]] >= 0]
        lines.append(Line(at, step[at], step[step[at]], 2.0))
    return lines


def _nearest(kept: Array) -> list[Pairs]:
    """Targets that follow each other in the order by what the motion keeps (N, 2): at one height, by radius."""
    slack = 1e-9 + HEIGHT_ROUNDING * float(np.max(np.abs(kept)))
    height = np.round(kept[:, 1] / slack)
    order = np.lexsort((np.round(kept[:, 0] / slack), height))
    pairs = []
    for step in RADIAL_PARTNERS:
        here, there = order[:-step], order[step:]
        level = height[here] == height[there]
        pairs.append((here[level], there[level]))
    return pairs
