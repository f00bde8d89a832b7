"""Robots that travel with the package: one YAML file each in ``presets/``, with the source of every number."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from posture_opt.errors import InputError, Issue, as_given, one_of
from posture_opt.files import packaged
from posture_opt.files import preset_names as preset_names
from posture_opt.robot.dh import DhRobot
from posture_opt.robot.format import RobotFormat
from posture_opt.robot.joint_velocities import with_velocities
from posture_opt.robot.mdh import MdhRobot
from posture_opt.robot.robot import Repeatability, Robot
from posture_opt.robot.shape_section import shaped
from posture_opt.spec import Spec
from posture_opt.units import Length


class RepeatabilitySpec(Spec):
    """A data sheet's position repeatability, with its source."""

    value: Length
    source: str


class PresetFile(Spec):
    """A file of ``presets/``: ``robot`` is a section as in a problem file, the other keys say where it is from.

    Args:
        title: name of the arm with its maker.
        source: group of numbers (``geometry``, ``masses``, …) -> where it was published.
        robot: DH or MDH table; lengths and angles with their units.
        repeatability: of the data sheet, if it states one.
        mounting_below: how far below the xy plane of the base frame the surface is that the arm stands on [m].
        notes: what is known to be missing or assumed.
    """

    title: str
    source: dict[str, str]
    robot: Annotated[DhRobot | MdhRobot, Field(discriminator="kind")]
    repeatability: RepeatabilitySpec | None = None
    mounting_below: Length = 0.0
    notes: tuple[str, ...] = ()

    def build(self) -> Robot:
        """The preset in numbers, with the source of each group of numbers."""
        given = self.repeatability
        return replace(
            self.robot.build(Path()),
            name=self.title,
            sources=tuple(self.source.items()),
            notes=self.notes,
            repeatability=Repeatability(given.value, given.source) if given else None,
            mounting_below=self.mounting_below,
        )


class PresetRobot(RobotFormat):
    """A robot of ``preset_names()``; keys given along with the name replace those of the preset."""

    kind: Literal["preset"] = "preset"
    name: str

    def nominal(self, folder: Path) -> Robot:
        """The preset in numbers; ``folder`` is not needed.

        Raises:
            InputError: no preset has this name.
        """
        robot = load_preset(self.name)
        given = self.model_fields_set
        if "base" in given:
            robot = replace(robot, base=self.base.factors("base"), base_free=self.base.free)
        if "tool" in given:
            robot = replace(
                robot, tool=self.tool.factors("tool"), tool_free=self.tool.free, tool_radius=self.tool.radius
            )
        robot = replace(robot, **{key: getattr(self, key) for key in ("payload", "gravity") if key in given})
        return with_velocities(shaped(robot, self.shape), self.velocity)


def preset_text(name: str) -> str:
    """The text of a preset's file.

    Raises:
        InputError: no preset has this name; the message offers the nearest.
    """
    names = preset_names()
    if name not in names:
        raise InputError(Issue(f"there is no preset {as_given(name)}", ("name",), name, one_of(name, names, "presets")))
    return packaged("posture_opt.robot", "presets", f"{name}.yaml")


@cache
def load_preset(name: str) -> Robot:
    """The preset ``name`` in numbers; its tool point is the flange. Each is read once in a process.

    Raises:
        InputError: no preset has this name; the message offers the nearest.

    Example:
        >>> load_preset("ur10e").n
        6
    """
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return PresetFile.model_validate(yaml.load(preset_text(name), loader)).build()
