"""``robot.shape`` in the problem file: capsules that are added or replace others, or one radius for all links."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from posture_opt.errors import BadValueError, InputError, Issue, did_you_mean, listed
from posture_opt.limits import MOST_CAPSULES
from posture_opt.numerics import Array
from posture_opt.robot.robot import BASE, TOOL, Capsule, Factor, Joint, Robot, moved
from posture_opt.spec import Spec
from posture_opt.units import Length

# Radius over the length of the arm where nothing else is known. Arms of known shape are about as thick: the upper arm
# of a UR10 has 60 mm at 1.68 m, that of a Panda 60 mm at 1.39 m.
STAND_IN_RADIUS_RATIO = 0.04
_MIN_LENGTH_M = 1e-9  # Offsets shorter than this are rounding, no links; coordinates below it are written as zero


def stand_in(robot: Robot) -> tuple[Capsule, ...]:
    """Capsules for an arm of unknown shape: along the links, their radius 4 % of the arm's length [m]; none for length
    0.
    """
    return along_links(robot, STAND_IN_RADIUS_RATIO * robot.length) if robot.length > 0 else ()


def along_links(robot: Robot, radius: float) -> tuple[Capsule, ...]:
    """Capsules of one radius [m] along every offset between the frames of the chain, without the tool. An offset behind
    a joint moves with it; ``d`` and ``a`` of a DH link are two capsules with a corner, x, y and z of a URDF origin one.
    A slide is as long as its stroke, so that it reaches back to its carrier."""
    before, found = BASE, []
    for joint, link in zip(robot.joints, robot.links, strict=True):
        at = next(i for i, factor in enumerate(link) if factor.joint is not None)
        front, behind = link[:at], link[at + 1 :]
        found += [Capsule(before, a, b, radius) for a, b in _offset_spans(front, np.eye(4))]
        T_link_joint = np.linalg.inv(product_of(behind)).astype(np.float64)
        spans = [*_stroke_span(joint, link[at], T_link_joint), *_offset_spans(behind, T_link_joint)]
        found += [Capsule(joint.name, a, b, radius) for a, b in spans]
        before = joint.name
    return tuple(found)


def tool_capsule(robot: Robot, free_end: float = 0.0) -> tuple[Capsule, ...]:
    """The tool as a capsule from the flange towards the tool point, ``free_end`` [m] before it, tool frame; empty if
    the shape has the tool."""
    if any(capsule.joint == TOOL for capsule in robot.shape):
        return ()
    T_tool_flange = np.linalg.inv(product_of(robot.tool)).astype(np.float64)
    flange = T_tool_flange[:3, 3]
    length = float(np.linalg.norm(flange))
    if length <= free_end + _MIN_LENGTH_M:
        return ()
    return tuple(Capsule(TOOL, a, b, tool_radius(robot)) for a, b in _span_between(flange, flange * free_end / length))


def tool_radius(robot: Robot) -> float:
    """Radius of the tool [m]: the stated one, else the default."""
    # Radius of a tool where none is stated: an ISO 9409-1 flange of 40 mm pitch circle, as small arms have it, carries
    # tools that are no thinner at the flange. Assumed; reports say so.
    return 0.02 if robot.tool_radius is None else robot.tool_radius


# Start and end (3,), (3,) [m] of a segment, in one frame
Span = tuple[tuple[float, float, float], tuple[float, float, float]]


def _offset_spans(factors: Sequence[Factor], T: Array) -> Iterator[Span]:
    """Both ends (3,), (3,) [m] of every offset among ``factors``, which start at the frame ``T`` (4, 4)."""
    start, last = T[:3, 3], -1
    for factor in factors:
        # Translations along x, y, z in this order are one offset; z before x are d and a of a DH link.
        if factor.kind == "rotate" or factor.axis <= last:
            yield from _span_between(start, T[:3, 3])
            start, last = T[:3, 3], -1
        T = T @ factor_transform(factor)
        last = factor.axis if factor.kind == "translate" else -1
    yield from _span_between(start, T[:3, 3])


def _span_between(a: Array, b: Array) -> Iterator[Span]:
    """The segment from a (3,) to b (3,) [m]; nothing where they coincide."""
    if np.linalg.norm(b - a) > _MIN_LENGTH_M:
        yield _rounded_point(a), _rounded_point(b)


def _stroke_span(joint: Joint, factor: Factor, T_link_joint: Array) -> Iterator[Span]:
    """The segment (3,), (3,) [m] that a slide covers back to its carrier, frame behind the joint; nothing of a turning
    joint."""
    if factor.kind == "translate":
        ends = factor.nominal + joint.lower, factor.nominal + joint.upper, 0.0
        axis = T_link_joint[:3, factor.axis]
        yield from _span_between(T_link_joint[:3, 3] - max(ends) * axis, T_link_joint[:3, 3] - min(ends) * axis)


def product_of(factors: Sequence[Factor]) -> Array:
    """(4, 4) the product of factors at their nominal values, lengths in [m]."""
    return functools.reduce(np.matmul, map(factor_transform, factors), np.eye(4))


def factor_transform(factor: Factor) -> Array:
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


_Radius = Annotated[Length, Field(gt=0)]


class CapsuleSpec(Spec):
    """All points within ``radius`` of the segment from ``from`` to ``to``, in the frame behind ``joint``.

    That is the DH or MDH frame, or the child link of a URDF joint; ``base`` is at rest, ``tool`` is the tool frame.
    """

    joint: str = Field(description="in whose frame (behind it) the capsule is fixed; or `base`, `tool`")
    start: tuple[Length, Length, Length] = Field(alias="from", description="one end of its axis")
    end: tuple[Length, Length, Length] = Field(alias="to", description="the other end")
    radius: _Radius = Field(description="distance of its surface from the axis")

    def capsule(self) -> Capsule:
        """The capsule in numbers."""
        return Capsule(self.joint, self.start, self.end, self.radius)


class ShapeSection(Spec):
    """Capsules to ``add`` to those that the robot brings, or to ``replace`` them by; or one ``radius`` along all links,
    for an arm whose shape is not known any better.
    """

    add: tuple[CapsuleSpec, ...] = Field((), description="capsules beside those that the robot brings")
    replace: tuple[CapsuleSpec, ...] | None = Field(None, description="capsules instead of those that the robot brings")
    radius: _Radius | None = Field(None, description="of capsules along all links, instead of those of the robot")

    @model_validator(mode="after")
    def _one_way(self) -> ShapeSection:
        if self.radius is not None and self.replace is not None:
            raise BadValueError("radius and replace are both given", "keep one of them: each replaces the robot's own")
        if self.radius is None and self.replace is None and not self.add:
            example = "add: [{joint: tool, from: [0 m, 0 m, -120 mm], to: [0 m, 0 m, -40 mm], radius: 45 mm}]"
            raise BadValueError("the shape states nothing", f"write for example {example}")
        return self


# What the key shape of a robot section may hold; a plain list adds to the shape of a robot that brings its own
ShapeSpec = tuple[CapsuleSpec, ...] | ShapeSection


def replaces_shape(given: ShapeSpec | None) -> bool:
    """Whether the section leaves nothing of the shape that the robot brings."""
    return isinstance(given, ShapeSection) and (given.replace is not None or given.radius is not None)


def shaped(robot: Robot, given: ShapeSpec | None, T_last: Array | None = None) -> Robot:
    """The robot with the capsules of its section added to its own or in their place. ``T_last`` (4, 4) [m] is the frame
    of capsules of the last joint, in the frame behind that joint."""
    if given is None:
        return robot
    section = given if isinstance(given, ShapeSection) else ShapeSection.model_construct(add=given)
    parts = {"replace": section.replace or (), "add": section.add}
    issues = [
        issue if isinstance(given, ShapeSection) else replace(issue, key=("shape", *issue.key[2:]))
        for part, specs in parts.items()
        for issue in _capsule_issues(robot, part, specs)
    ]
    if issues:
        raise InputError(issues)
    MOST_CAPSULES.check_at(sum(map(len, parts.values())), ("shape",))
    stated = [spec.capsule() for specs in parts.values() for spec in specs]
    last = robot.joint_names[-1]
    capsules = tuple(moved(c, T_last) if T_last is not None and c.joint == last else c for c in stated)
    if section.radius is not None:
        return replace(robot, shape=(*along_links(robot, section.radius), *capsules))
    if section.replace is not None:
        given_joints = {capsule.joint for capsule in capsules}
        gone = tuple(dict.fromkeys(c.joint for c in robot.shape if c.joint not in given_joints))
        notes = (f"shape replaces the arm's own capsules: nothing of {listed(gone)} is checked for collisions",)
        return replace(robot, shape=capsules, shape_notes=notes if gone else (), unshaped=gone)
    plain = not isinstance(given, ShapeSection) and robot.shape
    notes = ("shape, a plain list, is added to the arm's own capsules (replace: [...] would replace them)",)
    added = tuple(replace(capsule, added=bool(robot.shape)) for capsule in capsules)
    return replace(robot, shape=(*robot.shape, *added), shape_notes=robot.shape_notes + (notes if plain else ()))


def _capsule_issues(robot: Robot, part: str, specs: Sequence[CapsuleSpec]) -> Iterator[Issue]:
    known, capsules = (*robot.joint_names, BASE, TOOL), [spec.capsule() for spec in specs]
    for i, joint in enumerate(capsule.joint for capsule in capsules):
        if joint not in known:
            hint = did_you_mean(joint, known)
            yield Issue("the robot has no such joint", ("shape", part, i, "joint"), joint, hint)
    first = {capsule: i for i, capsule in reversed([*enumerate(capsules)])}
    for i, capsule in enumerate(capsules):
        if first[capsule] != i:
            same = f"the same capsule as entry {first[capsule]}"
            yield Issue(same, ("shape", part, i), hint="leave one of the two out")
