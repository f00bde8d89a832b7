"""Which configuration an arm is in: shoulder left or right, elbow up or down, wrist flipped, where it has them.

Postures of one configuration are joined by motions that pass no singular posture of this kind; they differ by the spin
of the tool, or by what a redundant arm has over. The signs are those of the factors that vanish there: for six turning
joints (D. Pieper 1968; R. Paul, B. Shimano, G. Mayer, IEEE Trans. SMC 11 (1981) 449, for arms with a spherical wrist)
the distance of the wrist from the first axis, the bend of the elbow, and the sine of the fifth joint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from posture_opt.model.chain import Vector, factor_values, stack, walk
from posture_opt.numerics import Array, Mask
from posture_opt.robot.robot import Robot

_PARALLEL = 0.02  # sine [1] up to which axes are parallel, cosine up to which they are perpendicular; corrections lean
_ROUNDING = 1e-12  # m² or 1: a sign of less is that of a singular posture, which counts as not positive
_MEETING_SHARE = 5e-3  # of the length of the arm: axes that pass each other nearer than this meet


def configurations(robot: Robot, Q: Array) -> list[tuple[str, ...]]:
    """Of each posture of Q (N, n) [rad or m] the names of its configuration; empty for arms whose configurations have
    none.

    Planar arms with two or three turning joints, SCARA among them, have an elbow; arms of six joints with parallel
    second and third axes and a spherical wrist, or a fourth axis parallel to these, have shoulder, elbow and wrist;
    those of seven whose axes are perpendicular in turn have the signs of these three.
    """
    low, high = (np.clip(np.array(ends), -1.0, 1.0) for ends in (robot.lower, robot.upper))
    regular = low + (high - low) * np.linspace(0.31, 0.73, robot.n)  # off all singular postures
    every = _Axes.at(robot, np.vstack([regular, *Q]))
    named = _structure(every.rows(slice(0, 1)), _MEETING_SHARE * robot.length)
    return [()] * len(Q) if named is None else list(zip(*named(every.rows(slice(1, None))), strict=True))


@dataclass(frozen=True)
class _Axes:
    """The turning axes of an arm at N postures: directions z (k, N, 3), points on them o (k, N, 3) [m]; directions of
    slides (s, N, 3), and the tool point (N, 3) [m]."""

    z: Array
    o: Array
    slides: Array
    tool: Array

    @classmethod
    def at(cls, robot: Robot, Q: Array) -> _Axes:
        """The axes at Q (N, n) of the chain without effects."""
        reached = walk(robot.factors, factor_values(robot.factors, list(Q.T)))
        screws = [reached.screws[i] for i in robot.driven]

        def stacked(vectors: list[Vector]) -> Array:
            rows = [np.broadcast_to(stack(vector), (len(Q), 3)) for vector in vectors]
            return np.array(rows).reshape(-1, len(Q), 3)

        z, o = ([getattr(screw, name) for screw in screws if screw.rotates] for name in ("axis", "origin"))
        slides = [screw.axis for screw in screws if not screw.rotates]
        return cls(stacked(z), stacked(o), stacked(slides), stacked([reached.position])[0])

    def rows(self, chosen: slice) -> _Axes:
        """The axes at some of the postures."""
        return _Axes(self.z[:, chosen], self.o[:, chosen], self.slides[:, chosen], self.tool[chosen])

    def parallel(self, i: int, j: int) -> bool:
        """Whether two axes have one direction."""
        return bool(np.all(np.linalg.norm(np.cross(self.z[i], self.z[j]), axis=1) < _PARALLEL))

    def perpendicular(self, i: int, j: int) -> bool:
        """Whether two axes have perpendicular directions."""
        return bool(np.all(np.abs(_dot(self.z[i], self.z[j])) < _PARALLEL))

    def meeting(self, i: int, j: int) -> Array:
        """(N, 3) the point of axis i that is nearest to axis j, which is not parallel to it."""
        across = np.cross(self.z[i], self.z[j])
        along = _dot(np.cross(self.o[j] - self.o[i], self.z[j]), across) / _dot(across, across)
        return np.asarray(self.o[i] + along[:, None] * self.z[i])

    def passes(self, point: Array, i: int, distance: float) -> bool:
        """Whether axis i passes points (N, 3) within a distance [m]."""
        return bool(np.all(np.linalg.norm(np.cross(point - self.o[i], self.z[i]), axis=1) <= distance))

    def triple(self, i: int, j: int, k: int) -> Array:
        """(N,) ``(z_i × z_k) · z_j``: the sine of joint j where the axes are perpendicular in turn."""
        return _dot(np.cross(self.z[i], self.z[k]), self.z[j])


Names = tuple[list[str], ...]
"""Of each posture a name for each sign."""


def _dot(u: Array, v: Array) -> Array:
    """(N,) products of the rows of two arrays (N, 3)."""
    return np.asarray(np.sum(u * v, axis=1))


def _either(holds: Mask, yes: str, no: str) -> list[str]:
    """(N,) one name where something holds, else the other."""
    return [yes if one else no for one in holds]


def _structure(at: _Axes, near: float) -> Callable[[_Axes], Names] | None:
    """What names the configurations of an arm, found at one posture off all singular ones; None for other arms.

    Args:
        near: distance [m] within which axes meet.
    """
    turning, slides = len(at.z), len(at.slides)
    if turning in (2, 3) and all(at.parallel(0, k) for k in range(turning)):
        return _planar if np.all(np.linalg.norm(np.cross(at.slides, at.z[0]), axis=2) < _PARALLEL) else None
    if turning == 7 and not slides and all(at.perpendicular(k, k + 1) for k in range(6)):
        return _seven
    if turning != 6 or slides or not at.perpendicular(0, 1) or not at.parallel(1, 2) or at.parallel(4, 5):
        return None
    wrist = at.meeting(4, 5)
    if not at.passes(wrist, 5, near):
        return None
    if at.passes(wrist, 3, near) and not at.parallel(2, 3):
        return _spherical
    return _parallel_wrist if at.parallel(2, 3) else None


def _planar(at: _Axes) -> Names:
    """The elbow left or right of the line from the first axis to the third, or to the tool; the first axis is up."""
    end = at.o[2] if len(at.z) == 3 else at.tool
    left = _dot(np.cross(end - at.o[0], at.o[1] - at.o[0]), at.z[0]) > _ROUNDING
    return (_either(left, "elbow left", "elbow right"),)


def _spherical(at: _Axes) -> Names:
    """Shoulder and elbow by the centre of the wrist."""
    return _shoulder_elbow_wrist(at, at.meeting(4, 5), at.meeting(4, 5))


def _parallel_wrist(at: _Axes) -> Names:
    """The elbow by the fourth axis, the shoulder by the point where the last two meet."""
    return _shoulder_elbow_wrist(at, at.meeting(4, 5), at.o[3])


def _shoulder_elbow_wrist(at: _Axes, wrist: Array, forearm: Array) -> Names:
    """The names by the ends (N, 3) of wrist and forearm [m].

    Looking from the first axis to the wrist, the second axis points right or left; the elbow lies above or below the
    line from the shoulder to the end of the forearm, the first axis being up; the fifth joint's sine is positive, or
    the wrist is flipped.
    """
    across = np.cross(at.z[0], at.z[1])
    right = _dot(across, wrist - at.o[0]) > _ROUNDING
    line, bend = forearm - at.o[1], at.o[2] - at.o[1]
    ahead = np.where(right, 1.0, -1.0)[:, None] * across
    up = _dot(line, ahead) * _dot(bend, at.z[0]) - _dot(line, at.z[0]) * _dot(bend, ahead) > _ROUNDING
    return (
        _either(right, "shoulder right", "shoulder left"),
        _either(up, "elbow up", "elbow down"),
        _either(at.triple(3, 4, 5) > _ROUNDING, "wrist not flipped", "wrist flipped"),
    )


def _seven(at: _Axes) -> Names:
    """The signs of the sines of the second, fourth and sixth joint: the rest is the redundancy of the arm."""
    named = zip(("shoulder", "elbow", "wrist"), (0, 2, 4), strict=True)
    return tuple(
        _either(at.triple(k, k + 1, k + 2) > _ROUNDING, f"{name} not flipped", f"{name} flipped") for name, k in named
    )
