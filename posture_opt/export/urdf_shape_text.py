"""The capsules of an arm as ``visual`` and ``collision`` elements of a URDF: a cylinder with a ball at both ends."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.shape import Capsule

_BALL = 1e-9  # m: a shorter capsule is one ball


def shape_lines(capsules: Iterable[Capsule], T: Array) -> list[str]:
    """The elements of a link; T (4, 4) maps the frame that the capsules are given in to the link's."""
    return [line for capsule in capsules for line in _capsule(capsule, T)]


def _capsule(capsule: Capsule, T: Array) -> list[str]:
    """A cylinder with a ball at both ends; a ball alone where the ends are one point."""
    start, end = (T[:3, :3] @ np.array(point) + T[:3, 3] for point in (capsule.start, capsule.end))
    length = float(np.linalg.norm(end - start))
    ball = f'<sphere radius="{capsule.radius!r}"/>'
    if length < _BALL:
        return _both((start + end) / 2, (0.0, 0.0), ball)
    x, y, z = (end - start) / length
    turned = math.atan2(math.hypot(x, y), z), math.atan2(y, x)
    cylinder = f'<cylinder radius="{capsule.radius!r}" length="{length!r}"/>'
    middle = _both((start + end) / 2, turned, cylinder)
    return [*middle, *_both(start, (0.0, 0.0), ball), *_both(end, (0.0, 0.0), ball)]


def _both(at: Array, turned: tuple[float, float], geometry: str) -> list[str]:
    """The same body as ``visual`` and ``collision``: its axis z is turned by pitch and yaw [rad]."""
    place = " ".join(repr(float(v)) for v in at)
    origin = f'<origin xyz="{place}" rpy="0.0 {turned[0]!r} {turned[1]!r}"/>'
    return [f"    <{kind}>{origin}<geometry>{geometry}</geometry></{kind}>" for kind in ("visual", "collision")]
