"""Capsules along the links: what stands in for the shape of an arm of which only the geometry is known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor, Joint, Robot
from posture_opt.robot.shape import BASE, TOOL, Capsule

STAND_IN = 0.04
"""Radius over the length of the arm where nothing else is known.

So thick are arms of known shape: the upper arm of a UR10 has 60 mm at 1.68 m, that of a Panda 60 mm at 1.39 m.
"""
_POINT = 1e-9  # m: what is shorter is no link


def stand_in(robot: Robot) -> tuple[Capsule, ...]:
    """Capsules for an arm of unknown shape: along the links, their radius 4 % of the arm's length."""
    return along_links(robot, STAND_IN * robot.length) if robot.length > 0 else ()


def along_links(robot: Robot, radius: float) -> tuple[Capsule, ...]:
    """Capsules of one radius [m] along every offset between the frames of the chain, without the tool.

    An offset behind a joint moves with it, one in front of it belongs to the link before. ``d`` and ``a`` of a DH link
    are two capsules with a corner, x, y and z of a URDF origin one straight capsule. What slides is as long as its
    stroke, so that it always reaches back to the link that carries it.
    """
    before, found = BASE, []
    for joint, link in zip(robot.joints, robot.links, strict=True):
        at = next(i for i, factor in enumerate(link) if factor.joint is not None)
        front, behind = link[:at], link[at + 1 :]
        found += [Capsule(before, a, b, radius) for a, b in _offsets(front, np.eye(4))]
        T_link_joint = np.linalg.inv(_product(behind)).astype(np.float64)
        spans = [*_stroke(joint, link[at], T_link_joint), *_offsets(behind, T_link_joint)]
        found += [Capsule(joint.name, a, b, radius) for a, b in spans]
        before = joint.name
    return tuple(found)


def tool_line(robot: Robot) -> tuple[Capsule, ...]:
    """The line from the flange to the tool point; nothing where the shape has the tool, or there is none."""
    if any(capsule.joint == TOOL for capsule in robot.shape):
        return ()
    T_tool_flange = np.linalg.inv(_product(robot.tool)).astype(np.float64)
    return tuple(Capsule(TOOL, a, b, 0.0) for a, b in _span(T_tool_flange[:3, 3], np.zeros(3)))


Span = tuple[tuple[float, float, float], tuple[float, float, float]]


def _offsets(factors: Sequence[Factor], T: Array) -> Iterator[Span]:
    """Both ends of every offset among ``factors``, which start at the frame ``T`` (4, 4)."""
    start, last = T[:3, 3], -1
    for factor in factors:
        # Translations along x, y, z in this order are one offset; z before x are d and a of a DH link.
        if factor.kind == "rotate" or factor.axis <= last:
            yield from _span(start, T[:3, 3])
            start, last = T[:3, 3], -1
        T = T @ _transform(factor)
        last = factor.axis if factor.kind == "translate" else -1
    yield from _span(start, T[:3, 3])


def _span(a: Array, b: Array) -> Iterator[Span]:
    if np.linalg.norm(b - a) > _POINT:
        yield _point(a), _point(b)


def _stroke(joint: Joint, factor: Factor, T_link_joint: Array) -> Iterator[Span]:
    """From where a slide is to where its carrier can be, seen from the slide."""
    if factor.kind == "translate":
        ends = factor.nominal + joint.lower, factor.nominal + joint.upper, 0.0
        axis = T_link_joint[:3, factor.axis]
        yield from _span(T_link_joint[:3, 3] - max(ends) * axis, T_link_joint[:3, 3] - min(ends) * axis)


def _product(factors: Sequence[Factor]) -> Array:
    T = np.eye(4)
    for factor in factors:
        T = T @ _transform(factor)
    return T


def _transform(factor: Factor) -> Array:
    T = np.eye(4)
    if factor.kind == "translate":
        T[factor.axis, 3] = factor.nominal
        return T
    i, j = (factor.axis + 1) % 3, (factor.axis + 2) % 3
    c, s = math.cos(factor.nominal), math.sin(factor.nominal)
    T[i, i], T[i, j], T[j, i], T[j, j] = c, -s, s, c
    return T


def _point(p: Array) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in np.where(np.abs(p) < _POINT, 0.0, p))
    return x, y, z
