"""``robot.shape`` in the problem file: capsules one by one, or one radius for all links."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from pydantic import Field

from posture_opt.errors import InputError, Issue, did_you_mean
from posture_opt.robot.link_capsules import along_links
from posture_opt.robot.robot import Robot
from posture_opt.robot.shape import BASE, TOOL, Capsule
from posture_opt.spec import Spec
from posture_opt.units import Length

_Radius = Annotated[Length, Field(gt=0)]


class CapsuleSpec(Spec):
    """All points within ``radius`` of the segment from ``from`` to ``to``, in the frame behind ``joint``.

    That is the DH or MDH frame, or the child link of a URDF joint; ``base`` is at rest, ``tool`` is the tool frame.
    """

    joint: str
    start: tuple[Length, Length, Length] = Field(alias="from")
    """(3,) [m], the key ``from``."""
    end: tuple[Length, Length, Length] = Field(alias="to")
    """(3,) [m], the key ``to``."""
    radius: _Radius

    def capsule(self) -> Capsule:
        """The capsule in numbers."""
        return Capsule(self.joint, self.start, self.end, self.radius)


class LinksShape(Spec):
    """Capsules of one ``radius`` along all links, for an arm whose shape is not known any better."""

    radius: _Radius


ShapeSpec = tuple[CapsuleSpec, ...] | LinksShape
"""What the key ``shape`` of a robot section may hold: a list of capsules, or one radius for all links."""


def shaped(robot: Robot, given: ShapeSpec | None) -> Robot:
    """The robot with the shape that its section gives in place of its own; without one, the robot itself.

    Args:
        robot: as its format describes it.
        given: the key ``shape``; ``None`` keeps what the format says.

    Raises:
        InputError: capsules of joints that the robot lacks; keys relative to the ``robot`` section.
    """
    if given is None:
        return robot
    if isinstance(given, LinksShape):
        return replace(robot, shape=along_links(robot, given.radius))
    known = (*robot.joint_names, BASE, TOOL)
    issues = [
        Issue("the robot has no such joint", ("shape", i, "joint"), spec.joint, did_you_mean(spec.joint, known))
        for i, spec in enumerate(given)
        if spec.joint not in known
    ]
    if issues:
        raise InputError(issues)
    capsules = tuple(spec.capsule() for spec in given)
    return replace(robot, shape=capsules, shape_notes=_dropped_links(robot, capsules))


def _dropped_links(robot: Robot, capsules: tuple[Capsule, ...]) -> tuple[str, ...]:
    """A note on the links of the arm's own shape that the given capsules leave out; empty where none is lost."""
    gone = [joint for joint in dict.fromkeys(c.joint for c in robot.shape) if joint not in {c.joint for c in capsules}]
    if not gone:
        return ()
    return (f"shape replaces the arm's own capsules: nothing of {', '.join(gone)} is checked for collisions",)
