"""Which configuration an arm is in: shoulder left or right, elbow up or down, wrist flipped, where it has them.

Postures of one configuration are joined by motions that pass no singular posture of this kind; they differ by the spin
of the tool, or by what a redundant arm has over. The signs are those of the factors that vanish there: for six turning
joints (D. Pieper 1968; R. Paul, B. Shimano, G. Mayer, IEEE Trans. SMC 11 (1981) 449, for arms with a spherical wrist)
the distance of the wrist from the first axis, the bend of the elbow, and the sine of the fifth joint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot

_PARALLEL = 0.02  # sine [1] up to which axes are parallel, cosine up to which they are perpendicular; corrections lean
_MEETING_SHARE = 5e-3  # of the length of the arm: axes that pass each other nearer than this meet


def configurations(robot: Robot, postures: Sequence[Array] | Array) -> list[tuple[str, ...]]:
    """Of each posture (n,) [rad or m] the names of its configuration; empty for arms whose configurations have none.

    Planar arms with two or three turning joints, SCARA among them, have an elbow; arms of six joints with parallel
    second and third axes and a spherical wrist, or a fourth axis parallel to these, have shoulder, elbow and wrist;
    those of seven whose axes are perpendicular in turn have the signs of these three.
    """
    named = _structure(robot)
    return [named(_Axes.at(robot, q)) if named is not None else () for q in postures]


@dataclass(frozen=True)
class _Axes:
    """The turning axes of an arm at a posture: directions z (k, 3), points on them o (k, 3) [m]; directions of slides
    (s, 3), and the tool point (3,) [m]."""

    z: Array
    o: Array
    slides: Array
    tool: Array

    @classmethod
    def at(cls, robot: Robot, q: Array) -> _Axes:
        """The axes at ``q`` (n,) of the chain without effects."""
        reached = walk(robot.factors, factor_values(robot.factors, [float(value) for value in q]))
        screws = [reached.screws[i] for i in robot.driven]
        z = np.array([screw.axis for screw in screws if screw.rotates], dtype=float).reshape(-1, 3)
        o = np.array([screw.origin for screw in screws if screw.rotates], dtype=float).reshape(-1, 3)
        slides = np.array([screw.axis for screw in screws if not screw.rotates], dtype=float).reshape(-1, 3)
        return cls(z, o, slides, np.array(reached.position, dtype=float))

    def parallel(self, i: int, j: int) -> bool:
        """Whether two axes have one direction."""
        return bool(np.linalg.norm(np.cross(self.z[i], self.z[j])) < _PARALLEL)

    def perpendicular(self, i: int, j: int) -> bool:
        """Whether two axes have perpendicular directions."""
        return bool(abs(self.z[i] @ self.z[j]) < _PARALLEL)

    def meeting(self, i: int, j: int) -> Array:
        """(3,) the point of axis i that is nearest to axis j, which is not parallel to it."""
        across = np.cross(self.z[i], self.z[j])
        return np.asarray(
            self.o[i] + np.cross(self.o[j] - self.o[i], self.z[j]) @ across / (across @ across) * self.z[i]
        )

    def distance(self, point: Array, i: int) -> float:
        """Of a point (3,) from axis i [m]."""
        return float(np.linalg.norm(np.cross(point - self.o[i], self.z[i])))

    def triple(self, i: int, j: int, k: int) -> float:
        """``(z_i × z_k) · z_j``: the sine of joint j where the axes are perpendicular in turn."""
        return float(np.cross(self.z[i], self.z[k]) @ self.z[j])


Naming = Callable[["_Axes"], tuple[str, ...]]


def _structure(robot: Robot) -> Naming | None:
    """What names the configurations of an arm, found at one posture off all singular ones; None for other arms."""
    low, high = (np.clip(np.array(ends), -1.0, 1.0) for ends in (robot.lower, robot.upper))
    at = _Axes.at(robot, low + (high - low) * np.linspace(0.31, 0.73, robot.n))
    turning, near = len(at.z), _MEETING_SHARE * robot.length
    slides = len(at.slides)
    if turning in (2, 3) and all(at.parallel(0, k) for k in range(turning)):
        along = np.linalg.norm(np.cross(at.slides, at.z[0]), axis=1)
        return _planar if np.all(along < _PARALLEL) else None
    if turning == 7 and not slides and all(at.perpendicular(k, k + 1) for k in range(6)):
        return _seven
    if turning != 6 or slides or not at.perpendicular(0, 1) or not at.parallel(1, 2) or at.parallel(4, 5):
        return None
    wrist = at.meeting(4, 5)
    if at.distance(wrist, 5) > near:
        return None
    if at.distance(wrist, 3) <= near and not at.parallel(2, 3):
        return _spherical
    return _parallel_wrist if at.parallel(2, 3) else None


def _planar(at: _Axes) -> tuple[str, ...]:
    """The elbow left or right of the line from the first axis to the third, or to the tool; the first axis is up."""
    end = at.o[2] if len(at.z) == 3 else at.tool
    return ("elbow left" if np.cross(end - at.o[0], at.o[1] - at.o[0]) @ at.z[0] > 0 else "elbow right",)


def _spherical(at: _Axes) -> tuple[str, ...]:
    """Shoulder and elbow by the centre of the wrist."""
    return _shoulder_elbow_wrist(at, at.meeting(4, 5), at.meeting(4, 5))


def _parallel_wrist(at: _Axes) -> tuple[str, ...]:
    """The elbow by the fourth axis, the shoulder by the point where the last two meet."""
    return _shoulder_elbow_wrist(at, at.meeting(4, 5), at.o[3])


def _shoulder_elbow_wrist(at: _Axes, wrist: Array, forearm: Array) -> tuple[str, ...]:
    """The names by the ends (3,) of wrist and forearm [m].

    Looking from the first axis to the wrist, the second axis points right or left; the elbow lies above or below the
    line from the shoulder to the end of the forearm, the first axis being up; the fifth joint's sine is positive, or
    the wrist is flipped.
    """
    across = np.cross(at.z[0], at.z[1])
    shoulder = 1.0 if across @ (wrist - at.o[0]) > 0 else -1.0
    line, bend = forearm - at.o[1], at.o[2] - at.o[1]
    ahead = shoulder * across
    up = (line @ ahead) * (bend @ at.z[0]) - (line @ at.z[0]) * (bend @ ahead) > 0
    return (
        "shoulder right" if shoulder > 0 else "shoulder left",
        "elbow up" if up else "elbow down",
        "wrist not flipped" if at.triple(3, 4, 5) > 0 else "wrist flipped",
    )


def _seven(at: _Axes) -> tuple[str, ...]:
    """The signs of the sines of the second, fourth and sixth joint: the rest is the redundancy of the arm."""
    named = zip(("shoulder", "elbow", "wrist"), (0, 2, 4), strict=True)
    return tuple(f"{name}{' not' * (at.triple(k, k + 1, k + 2) > 0)} flipped" for name, k in named)
