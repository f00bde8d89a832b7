"""Robots that travel with the package: one YAML file each in ``presets/``, with the source of every number."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from posture_opt.errors import InputError, Issue, as_given, either, listed
from posture_opt.files import packaged
from posture_opt.files import preset_names as preset_names
from posture_opt.robot.controller_file import CALIBRATED_MAKERS, controller_values
from posture_opt.robot.corrections import corrections_of, deviated, with_velocities
from posture_opt.robot.dh import DhRobot, MdhRobot
from posture_opt.robot.format import FrameSpec, RobotFormat
from posture_opt.robot.robot import Factor, Repeatability, Robot
from posture_opt.robot.shape_section import shaped
from posture_opt.spec import Spec
from posture_opt.units import Length, Mass

# Public calibrations of UR5, UR5e and UR10 move no length of the type by more than 1 mm.
_CALIBRATED_WITHIN_M = 0.005


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
        # As constants: errors of the first frame are those of the base.
        first = [Factor(f.kind, f.axis, f.nominal) for f in self.first_frame.factors("base") if f.nominal]
        return replace(
            robot,
            name=self.title,
            links=((*first, *robot.links[0]), *robot.links[1:]),
            sources=tuple(self.source.items()),
            notes=self.notes,
            repeatability=Repeatability(given.value, given.source) if given else None,
            mounting_below=self.mounting_below,
        )


class PresetRobot(RobotFormat):
    """A robot of ``preset_names()``; keys given along with the name replace those of the preset."""

    kind: Literal["preset"] = "preset"
    name: str = Field(description="of the preset: `optimize-posture list` has them")
    file: str | None = Field(
        None, description="calibration of this arm by its maker: a UR's calibration.conf, the YAML of its ROS driver"
    )

    def nominal(self, folder: Path) -> Robot:
        """The preset in numbers, as the maker calibrated this arm."""
        robot = load_preset(self.name)
        if self.file is not None:
            robot = deviated(robot, controller_values(robot, folder, self.file))
        given = self.model_fields_set
        if "base" in given:
            robot = replace(robot, base=self.base.factors("base"), base_free=self.base.free)
        if "tool" in given:
            robot = replace(
                robot, tool=self.tool.factors("tool"), tool_free=self.tool.free, tool_radius=self.tool.radius
            )
        robot = replace(robot, **{key: getattr(self, key) for key in ("payload", "gravity") if key in given})
        return with_velocities(shaped(robot, self.shape), self.velocity)


def calibrated_presets(file: Path) -> tuple[list[str], list[InputError]]:
    """The presets that a maker's calibration moves least, and why others are not meant."""
    found: dict[str, float] = {}
    refusals: list[InputError] = []
    for name in preset_names():
        arm = load_preset(name)
        if not arm.name.startswith(CALIBRATED_MAKERS):
            continue
        try:
            moved = corrections_of(arm, PresetRobot(name=name, file=str(file.absolute())).nominal(Path()))
        except InputError as error:
            refusals.append(error)
            continue
        shifts = [abs(v) for parameter, v in moved.items() if arm.parameters[parameter].kind == "translate"]
        found[name] = max(shifts)
    most = min(2.0 * min(found.values(), default=0.0) + 1e-9, _CALIBRATED_WITHIN_M)
    return [name for name, shift in found.items() if shift <= most], refusals


def preset_text(name: str) -> str:
    """The text of a preset's file."""
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
    """The preset ``name`` in numbers; its tool point is the flange. Each is read once in a process."""
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return PresetFile.model_validate(yaml.load(preset_text(name), loader)).build()


def presets_like(word: str, titles: Mapping[str, str]) -> tuple[str, ...]:
    """Presets that a word may mean, the likeliest alone if one is; case, blanks, ``-`` and ``_`` do not count. In this
    order: the name; a name behind its maker; beginnings of names, or parts of titles; the name written most like it,
    sought in its family (``kr120``: all ``kr…``), else that family."""
    asked = _plain(word)
    names = {_plain(name): name for name in titles}
    if asked in names:
        return (names[asked],)
    behind_maker = [name for plain, name in names.items() if asked.endswith(plain)]
    if behind_maker:
        return (max(behind_maker, key=len),)
    begun = [name for plain, name in names.items() if asked and plain.startswith(asked)]
    # A shorter word is in the title of nearly every arm.
    titled = [name for name, title in titles.items() if len(asked) >= 3 and asked in _plain(title)]
    if begun or titled:
        return tuple(begun or titled)
    family = [plain for plain in names if _letters(plain) == _letters(asked) != ""]
    # Ratio of difflib from which two names are alike, its own default.
    found = difflib.get_close_matches(asked, family or names, 1, 0.6)
    return tuple(names[plain] for plain in found or family)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", unicodedata.normalize("NFKD", name).lower())


def _letters(plain: str) -> str:
    return re.split(r"\d", plain, maxsplit=1)[0]
