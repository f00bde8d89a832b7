"""``robot.shape`` in the problem file: capsules that are added or replace others, or one radius for all links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

from pydantic import Field, model_validator

from posture_opt.errors import BadValueError, InputError, Issue, did_you_mean, listed
from posture_opt.limits import MOST_CAPSULES
from posture_opt.numerics import Array
from posture_opt.robot.link_capsules import along_links
from posture_opt.robot.robot import Robot
from posture_opt.robot.shape import BASE, TOOL, Capsule, moved
from posture_opt.spec import Spec
from posture_opt.units import Length

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
        """The section as it is, where it says one thing.

        Raises:
            BadValueError: nothing is stated, or two that replace the robot's own.
        """
        if self.radius is not None and self.replace is not None:
            raise BadValueError("radius and replace are both given", "keep one of them: each replaces the robot's own")
        if self.radius is None and self.replace is None and not self.add:
            example = "add: [{joint: tool, from: [0 m, 0 m, -120 mm], to: [0 m, 0 m, -40 mm], radius: 45 mm}]"
            raise BadValueError("the shape states nothing", f"write for example {example}")
        return self


ShapeSpec = tuple[CapsuleSpec, ...] | ShapeSection
"""What the key ``shape`` of a robot section may hold; a plain list adds to the shape of a robot that brings its own."""


def replaces_shape(given: ShapeSpec | None) -> bool:
    """Whether the section leaves nothing of the shape that the robot brings."""
    return isinstance(given, ShapeSection) and (given.replace is not None or given.radius is not None)


def shaped(robot: Robot, given: ShapeSpec | None, T_last: Array | None = None) -> Robot:
    """The robot with the shape that its section states, added to its own or in its place.

    Args:
        robot: as its format describes it, with the shape that the format brings.
        given: the key ``shape``; None keeps what the format says.
        T_last: (4, 4) the frame in which capsules of the last joint are stated, in the frame behind that joint, lengths
            in [m]; None where they are the same.

    Raises:
        InputError: capsules of joints that the robot lacks; keys relative to the ``robot`` section.
    """
    if given is None:
        return robot
    section = given if isinstance(given, ShapeSection) else ShapeSection.model_construct(add=given)
    parts = {"replace": section.replace or (), "add": section.add}
    issues = [
        issue if isinstance(given, ShapeSection) else replace(issue, key=("shape", *issue.key[2:]))
        for part, specs in parts.items()
        for issue in (*_unknown_joints(robot, part, specs), *_repeated(part, specs))
    ]
    if issues:
        raise InputError(issues)
    MOST_CAPSULES.check_at(sum(map(len, parts.values())), ("shape",))
    capsules = tuple(_located(spec.capsule(), robot, T_last) for specs in parts.values() for spec in specs)
    if section.radius is not None:
        return replace(robot, shape=(*along_links(robot, section.radius), *capsules))
    if section.replace is not None:
        gone = _gone(robot, capsules)
        notes = (f"shape replaces the arm's own capsules: nothing of {listed(gone)} is checked for collisions",)
        return replace(robot, shape=capsules, shape_notes=notes if gone else (), unshaped=gone)
    plain = not isinstance(given, ShapeSection) and robot.shape
    notes = ("shape, a plain list, is added to the arm's own capsules (replace: [...] would replace them)",)
    return replace(robot, shape=(*robot.shape, *capsules), shape_notes=robot.shape_notes + (notes if plain else ()))


def _located(capsule: Capsule, robot: Robot, T_last: Array | None) -> Capsule:
    """The capsule in the frame behind its joint."""
    return moved(capsule, T_last) if T_last is not None and capsule.joint == robot.joint_names[-1] else capsule


def _unknown_joints(robot: Robot, part: str, specs: Sequence[CapsuleSpec]) -> list[Issue]:
    """The capsules of a list whose joints the robot lacks."""
    known = (*robot.joint_names, BASE, TOOL)
    return [
        Issue("the robot has no such joint", ("shape", part, i, "joint"), spec.joint, did_you_mean(spec.joint, known))
        for i, spec in enumerate(specs)
        if spec.joint not in known
    ]


def _repeated(part: str, specs: Sequence[CapsuleSpec]) -> list[Issue]:
    """The capsules that are in a list before."""
    first = {spec.capsule(): i for i, spec in reversed([*enumerate(specs)])}
    return [
        Issue(f"the same capsule as entry {first[spec.capsule()]}", ("shape", part, i), hint="leave one of the two out")
        for i, spec in enumerate(specs)
        if first[spec.capsule()] != i
    ]


def _gone(robot: Robot, capsules: Sequence[Capsule]) -> tuple[str, ...]:
    """Joints with a capsule of the arm's own shape and none of the given ones."""
    given = {capsule.joint for capsule in capsules}
    return tuple(dict.fromkeys(capsule.joint for capsule in robot.shape if capsule.joint not in given))
