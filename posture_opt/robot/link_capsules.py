"""Capsules along the links: what stands in for the shape of an arm of which only the geometry is known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor, Joint, Robot
from posture_opt.robot.shape import BASE, TOOL, Capsule

STAND_IN_RADIUS_RATIO = 0.04
"""Radius over the length of the arm where nothing else is known.

Arms of known shape are about as thick: the upper arm of a UR10 has 60 mm at 1.68 m, that of a Panda 60 mm at 1.39 m.
"""
TOOL_RADIUS_M = 0.02
"""Radius of a tool where none is stated: an ISO 9409-1 flange of 40 mm pitch circle, as small arms have it, carries
tools that are no thinner at the flange. Assumed; reports say so."""
_MIN_LENGTH_M = 1e-9
"""Offsets shorter than this are rounding, no links; coordinates below it are written as zero."""


def stand_in(robot: Robot) -> tuple[Capsule, ...]:
    """Capsules for an arm of unknown shape: along the links, their radius 4 % of the arm's length [m]; none for length
    0.
    """
    return along_links(robot, STAND_IN_RADIUS_RATIO * robot.length) if robot.length > 0 else ()


def along_links(robot: Robot, radius: float) -> tuple[Capsule, ...]:
    """Capsules of one radius [m] along every offset between the frames of the chain, without the tool.

    An offset behind a joint moves with it, one in front of it belongs to the link before. ``d`` and ``a`` of a DH link
    are two capsules with a corner, x, y and z of a URDF origin one straight capsule. What slides is as long as its
    stroke, so that it always reaches back to the link that carries it.

    Args:
        robot: the chain at its nominal values.
        radius: of every capsule [m].
    """
    before, found = BASE, []
    for joint, link in zip(robot.joints, robot.links, strict=True):
        at = next(i for i, factor in enumerate(link) if factor.joint is not None)
        front, behind = link[:at], link[at + 1 :]
        found += [Capsule(before, a, b, radius) for a, b in _offset_spans(front, np.eye(4))]
        T_link_joint = np.linalg.inv(_product_of(behind)).astype(np.float64)
        spans = [*_stroke_span(joint, link[at], T_link_joint), *_offset_spans(behind, T_link_joint)]
        found += [Capsule(joint.name, a, b, radius) for a, b in spans]
        before = joint.name
    return tuple(found)


def tool_capsule(robot: Robot, free_end: float = 0.0) -> tuple[Capsule, ...]:
    """The tool and what it holds: a capsule from the flange towards the tool point, in the tool frame.

    Empty where the shape has the tool already, or nothing of it is left.

    Args:
        robot: with its tool.
        free_end: length [m] in front of the tool point that does not belong to it, where the tool touches its target.
    """
    if any(capsule.joint == TOOL for capsule in robot.shape):
        return ()
    T_tool_flange = np.linalg.inv(_product_of(robot.tool)).astype(np.float64)
    flange = T_tool_flange[:3, 3]
    length = float(np.linalg.norm(flange))
    if length <= free_end + _MIN_LENGTH_M:
        return ()
    return tuple(Capsule(TOOL, a, b, tool_radius(robot)) for a, b in _span_between(flange, flange * free_end / length))


def tool_radius(robot: Robot) -> float:
    """Radius of the tool [m]: the stated one, else the default."""
    return TOOL_RADIUS_M if robot.tool_radius is None else robot.tool_radius


Span = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Start and end (3,), (3,) [m] of a segment, in one frame."""


def _offset_spans(factors: Sequence[Factor], T: Array) -> Iterator[Span]:
    """Both ends (3,), (3,) [m] of every offset among ``factors``, which start at the frame ``T`` (4, 4)."""
    start, last = T[:3, 3], -1
    for factor in factors:
        # Translations along x, y, z in this order are one offset; z before x are d and a of a DH link.
        if factor.kind == "rotate" or factor.axis <= last:
            yield from _span_between(start, T[:3, 3])
            start, last = T[:3, 3], -1
        T = T @ _factor_transform(factor)
        last = factor.axis if factor.kind == "translate" else -1
    yield from _span_between(start, T[:3, 3])


def _span_between(a: Array, b: Array) -> Iterator[Span]:
    """The segment from a (3,) to b (3,) [m]; nothing where they coincide."""
    if np.linalg.norm(b - a) > _MIN_LENGTH_M:
        yield _rounded_point(a), _rounded_point(b)


def _stroke_span(joint: Joint, factor: Factor, T_link_joint: Array) -> Iterator[Span]:
    """The segment (3,), (3,) [m] that a slide covers back to its carrier, frame behind the joint; nothing of a turning
    joint.

    It reaches from the carrier at the longest stroke to that at the shortest, the slide's own zero included.
    """
    if factor.kind == "translate":
        ends = factor.nominal + joint.lower, factor.nominal + joint.upper, 0.0
        axis = T_link_joint[:3, factor.axis]
        yield from _span_between(T_link_joint[:3, 3] - max(ends) * axis, T_link_joint[:3, 3] - min(ends) * axis)


def _product_of(factors: Sequence[Factor]) -> Array:
    """(4, 4) the product of factors at their nominal values, lengths in [m]."""
    T = np.eye(4)
    for factor in factors:
        T = T @ _factor_transform(factor)
    return T


def _factor_transform(factor: Factor) -> Array:
    """(4, 4) one factor at its nominal value."""
    T = np.eye(4)
    if factor.kind == "translate":
        T[factor.axis, 3] = factor.nominal
        return T
    i, j = (factor.axis + 1) % 3, (factor.axis + 2) % 3
    c, s = math.cos(factor.nominal), math.sin(factor.nominal)
    T[i, i], T[i, j], T[j, i], T[j, j] = c, -s, s, c
    return T


def _rounded_point(p: Array) -> tuple[float, float, float]:
    """A point (3,) as plain floats, with exact zeros in place of rounding."""
    x, y, z = (float(v) for v in np.where(np.abs(p) < _MIN_LENGTH_M, 0.0, p))
    return x, y, z
