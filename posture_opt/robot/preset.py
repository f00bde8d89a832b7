"""Robots that travel with the package: one YAML file each in ``presets/``, with the source of every number."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from posture_opt.errors import InputError, Issue, as_given, either, listed
from posture_opt.files import packaged
from posture_opt.files import preset_names as preset_names
from posture_opt.robot.dh import DhRobot
from posture_opt.robot.format import FrameSpec, RobotFormat
from posture_opt.robot.joint_velocities import with_velocities
from posture_opt.robot.mdh import MdhRobot
from posture_opt.robot.preset_likeness import presets_like
from posture_opt.robot.robot import Factor, Repeatability, Robot
from posture_opt.robot.shape_section import shaped
from posture_opt.spec import Spec
from posture_opt.units import Length, Mass


class RepeatabilitySpec(Spec):
    """A data sheet's position repeatability, with its source; not ``verified`` where the sheet was not at hand."""

    value: Length
    verified: bool = True
    source: str


class RatedPayloadSpec(Spec):
    """The largest load that the maker rates the arm for, with its source."""

    value: Mass
    source: str


class PresetFile(Spec):
    """A file of ``presets/``: ``robot`` is a section as in a problem file, the other keys say where it is from.

    Args:
        title: name of the arm with its maker.
        source: group of numbers (``geometry``, ``masses``, …) -> where it was published.
        robot: DH or MDH table; lengths and angles with their units.
        first_frame: frame in front of the first row of the table, in the base frame; turned where an arm counts its
            first joint against the z axis of its base. It is part of the arm, no part of a stated ``base``.
        repeatability: of the data sheet, if it states one; ``rated_payload`` likewise.
        mounting_below: how far below the xy plane of the base frame the surface is that the arm stands on [m].
        notes: what is known to be missing or assumed.
    """

    title: str
    source: dict[str, str]
    robot: Annotated[DhRobot | MdhRobot, Field(discriminator="kind")]
    first_frame: FrameSpec = FrameSpec()
    repeatability: RepeatabilitySpec | None = None
    rated_payload: RatedPayloadSpec | None = None
    mounting_below: Length = 0.0
    notes: tuple[str, ...] = ()

    def build(self) -> Robot:
        """The preset in numbers, with the source of each group of numbers."""
        given, robot = self.repeatability, self.robot.build(Path())
        return replace(
            robot,
            name=self.title,
            links=((*self._first_factors(), *robot.links[0]), *robot.links[1:]),
            sources=tuple(self.source.items()),
            notes=self.notes,
            repeatability=Repeatability(given.value, given.source) if given else None,
            mounting_below=self.mounting_below,
        )

    def _first_factors(self) -> tuple[Factor, ...]:
        """``first_frame`` as constants: errors of it are those of the base."""
        factors = self.first_frame.factors("base")
        return tuple(Factor(factor.kind, factor.axis, factor.nominal) for factor in factors if factor.nominal)


class PresetRobot(RobotFormat):
    """A robot of ``preset_names()``; keys given along with the name replace those of the preset."""

    kind: Literal["preset"] = "preset"
    name: str = Field(description="of the preset: `optimize-posture list` has them")

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
    if name not in preset_names():
        hint = f"{presets_meant(name)} presets: {listed(preset_names())}".lstrip()
        raise InputError(Issue(f"there is no preset {as_given(name)}", ("name",), name, hint))
    return packaged("posture_opt.robot", "presets", f"{name}.yaml")


def presets_meant(word: str) -> str:
    """``did you mean 'x' or 'y'?`` where names, types or makers of presets are like a word; else empty."""
    heads = {
        name: packaged("posture_opt.robot", "presets", f"{name}.yaml").split("\n", 1)[0] for name in preset_names()
    }
    alike = presets_like(word, {name: head.removeprefix("title: ") for name, head in heads.items()})
    return f"did you mean {either(alike)}?" if alike else ""


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
