"""A wrong geometric parameter or frame as a cause with its words."""

from __future__ import annotations

from dataclasses import dataclass

from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.model.effects import Cause, FittedSizes, Size
from posture_opt.robot.robot import Robot
from posture_opt.units import ERROR_UNITS, plus_minus

_KIND_OF_PARAMETER = {
    "theta": "joint_offset",
    "yaw": "joint_offset",
    "a": "link_length",
    "x": "link_length",
    "y": "link_length",
    "d": "link_offset",
    "z": "link_offset",
    "alpha": "link_twist",
    "roll": "link_twist",
    "pitch": "link_twist",
    "beta": "axis_tilt",
}
_PHRASES = {
    "joint_offset": "{target} has a zero offset",
    "link_length": "the length of the {link} differs from the file",
    "link_offset": "the offset along the axis of {target} differs from the file",
    "link_twist": "the twist of the {link} differs from the file",
    "axis_tilt": "the axis behind {target} is tilted from what the file states",
    "base_frame": "the base frame differs from the file",
    "tool_frame": "the tool frame differs from the file",
    "geometry": "many geometric parameters differ from the file",
}
_NOUNS = {
    "joint_offset": "zero of {target}",
    "link_length": "length of the {link}",
    "link_offset": "offset along the axis of {target}",
    "link_twist": "twist of the {link}",
    "axis_tilt": "tilt of the axis behind {target}",
}
_INSPECTIONS = {
    "joint_offset": "zero mark of {target}: was it mastered again, its motor or encoder changed, or its belt moved?",
    "link_length": "type and version of the arm in the file; the {link}: exchanged, or bent",
    "link_offset": "type and version of the arm in the file; spacers and flange of {target}",
    "link_twist": "flange and seat of the {link}: a collision, dirt, or bolts tightened unevenly",
    "axis_tilt": "flange and bearing seat behind {target}: a collision, dirt, or bolts tightened unevenly",
    "base_frame": "where the base is mounted, and how its frame was measured",
    "tool_frame": "mounting of tool and reflector, and the offsets that the file has of them",
    "geometry": "type and version of the arm in the file; the maker's calibration of this arm in its controller",
}


@dataclass(frozen=True)
class GeometricDeviation(Cause):
    """A wrong geometric parameter of a joint or link, a wrong frame, or many of them together.

    Args:
        kind: ``joint_offset``, ``link_length``, ``link_offset``, ``link_twist``, ``axis_tilt``, ``base_frame``,
            ``tool_frame`` or ``geometry``.
        target: the joint or frame; ``all`` of ``geometry``.
    """

    kind: str
    target: str

    @classmethod
    def of(cls, parameter: Parameter) -> GeometricDeviation:
        """The deviation of one parameter.

        The kind follows from the last part of its name: ``theta`` is an offset of the joint, ``a`` a length, and so on.
        """
        prefix, _, last = parameter.name.rpartition(".")
        if parameter.group in ("base", "tool"):
            return cls(f"{parameter.group}_frame", parameter.group)
        prismatic_value = last == "d" and parameter.unit == "rad"
        return cls("joint_offset" if prismatic_value else _KIND_OF_PARAMETER[last], prefix)

    @classmethod
    def of_all(cls) -> GeometricDeviation:
        """Many parameters together, none of which is prominent."""
        return cls("geometry", "all")

    def noun_on(self, robot: Robot) -> str:
        """The parameter in words: "twist of the link from elbow to wrist_1"."""
        return _NOUNS[self.kind].format(target=self.target, link=robot.link_words(self.target))

    @property
    def single(self) -> bool:
        """Whether it is one parameter, or one frame."""
        return self.kind != "geometry"

    @property
    def words(self) -> str:
        """The cause in a sentence of a report."""
        return _PHRASES[self.kind].format(target=self.target, link=f"link behind {self.target}")

    def inspect(self, robot: Robot) -> str:
        """What to look at on the arm."""
        return _INSPECTIONS[self.kind].format(target=self.target, link=robot.link_words(self.target))

    @property
    def moved_joint(self) -> str:
        """The joint whose zero is off; empty for all other kinds."""
        return self.target if self.kind == "joint_offset" else ""

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """Estimates in mm and mrad with their standard errors, in the units of all causes."""
        one = len(estimate.values) == 1
        return tuple(
            Size("deviation" if one else name, plus_minus(v, s, *ERROR_UNITS[unit]))
            for name, (v, s, unit) in estimate.values.items()
        )
