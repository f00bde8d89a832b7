"""Commented problem files to start from, for presets and URDFs, solvable as they are."""

from __future__ import annotations

import math
import os
import string
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posture_opt.errors import InputError, Issue, either, listed
from posture_opt.files import packaged
from posture_opt.measurements.measurements import nominal_poses
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array, Mask
from posture_opt.problem.load import problem_from_dict
from posture_opt.problem.yaml_source import dump_flow, parse_yaml
from posture_opt.robot import load_preset
from posture_opt.robot.preset import calibrated_presets
from posture_opt.robot.robot import Robot
from posture_opt.robot.urdf import UrdfRobot
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.texts import one_line
from posture_opt.units import joint_text

_STARTER_TEMPLATE = string.Template(packaged("posture_opt.problem", "starter.yaml"))

_REPEATABILITY_TEMPLATE = string.Template("""\
  # $source
  repeatability: $value
  # or the standard deviations of single parameters, JOINT.PARAMETER, in place of it:
  # sigma:
$sigma
  # correlation:
  #   - [$first, $second, 0.5]
""")

_SIGMA_TEMPLATE = string.Template("""\
  sigma:                            # standard deviations, JOINT.PARAMETER
$sigma
  # correlation:
  #   - [$first, $second, 0.5]
  # or the data sheet's figure of ISO 9283 in place of it:
  # repeatability: 0.05 mm
""")


@dataclass(frozen=True)
class StarterTarget:
    """Where a starter's task is done: what its lines in the file say."""

    direction: str  # of the task, as the file has it, world frame
    position: tuple[float, ...] | None  # (3,) of the target [m], world frame; None: it is part of the answer
    above_table: bool  # whether links have to stay above the table


def starter_text(preset: str, file: str = "") -> str:
    """The text of a problem file for a preset, with comments; ``file`` has the maker's calibration of the arm."""
    robot = load_preset(preset)
    # Well off the base axis and well within reach; a SCARA, which has no wrist to turn down, may stretch further.
    turns, stretched = all(joint.type == "revolute" for joint in robot.joints), _stretched(robot)
    x, y = (0.45, 0.15) if turns else (0.6, 0.3)
    middle = [(joint.lower + joint.upper) / 2 for joint in robot.joints]
    height = 0.0 if is_planar(robot) else 0.1 * stretched if turns else float(Arm(robot).position(middle)[2])
    # The arm of a SCARA stays at its height and its quill has to go below it; a planar arm lies in its table.
    above = turns and not is_planar(robot)
    target = StarterTarget(sensible_direction(robot), (x * stretched, y * stretched, height), above)
    named = f"  file: {dump_flow(file)}\n" if file else ""
    section = f"  kind: preset\n  name: {preset}\n{named}  # joints: {', '.join(robot.joint_names)}"
    return filled_starter(robot, section, target)


def calibrated_starter_text(file: Path, folder: Path) -> str:
    """The text of a problem file for the preset that a controller's calibration belongs to."""
    own, refusals = calibrated_presets(file)
    if not own:
        raise refusals[0]
    if len(own) > 1:
        said = f"it is of {either(own)}, and does not say of which"
        hint = f"write robot: {{kind: preset, name: {own[0]}, file: {file.name}}}"
        raise InputError(Issue(said, value=str(file), hint=hint))
    return starter_text(own[0], str(file) if file.is_absolute() else Path(os.path.relpath(file, folder)).as_posix())


def filled_starter(robot: Robot, section: str, target: StarterTarget) -> str:
    """The text of a problem file for a robot."""
    reach = min(1.0, _stretched(robot))  # m: a small arm does not reach to the places of a large one
    x, y, z = target.position or (0.5 * reach, 0.2 * reach, 0.1 * reach)
    position = f"position: {_point([x, y, z])}"
    above = "    - {kind: link_height, at_least: 50 mm}      # elbow and wrist stay above the table: world z\n"
    return _STARTER_TEMPLATE.substitute(
        title=dump_flow(f"Insertion with the {robot.name}"),
        robot=section,
        uncertainty=_uncertainty(robot),
        direction=target.direction,
        position=f"  {position}" if target.position else f"  # {position}",
        minimum=_point([x, -y, z]),
        maximum=_point([1.2 * x, y, z]),
        table=above * target.above_table,
    )


def sensible_direction(robot: Robot) -> str:
    """Down, and of a planar arm a direction in its plane."""
    return "[0, -1, 0]" if is_planar(robot) else "[0, 0, -1]"


def _uncertainty(robot: Robot) -> str:
    sigma_of = {"revolute": ("theta", "0.02 deg"), "prismatic": ("d", "0.01 mm")}
    own = [f"{joint.name}.{sigma_of[joint.type][0]}" for joint in robot.joints]
    values = [f"{dump_flow(name)}: {sigma_of[joint.type][1]}" for name, joint in zip(own, robot.joints, strict=True)]
    first, second, *_ = dict.fromkeys([*own, *robot.parameters])  # a robot may have one joint
    if robot.repeatability is None:
        sigma = "\n".join(f"    {value}" for value in values)
        return _SIGMA_TEMPLATE.substitute(sigma=sigma, first=dump_flow(first), second=dump_flow(second))
    sigma = "\n".join(f"  #   {value}" for value in values)
    value, source = f"{robot.repeatability.value * 1e3:g} mm", " ".join(robot.repeatability.source.split())
    return _REPEATABILITY_TEMPLATE.substitute(
        sigma=sigma, first=dump_flow(first), second=dump_flow(second), value=value, source=source
    )


def _stretched(robot: Robot) -> float:
    """The length of all links laid in one line [m]: an upper bound of the reach."""
    return sum(abs(factor.nominal) for factor in robot.factors if factor.kind == "translate")


def is_planar(robot: Robot) -> bool:
    """Whether all joints turn about the z axis of the base and no link leaves its plane."""
    rotations = [factor for factor in robot.factors if factor.kind == "rotate"]
    slides = any(factor.kind == "translate" and factor.joint is not None for factor in robot.factors)
    turned_about = {factor.axis for factor in rotations if factor.nominal or factor.joint is not None}
    return turned_about == {2} and not slides


def _point(values: list[float]) -> str:
    """A point (3,) [m] as the file has it, to the centimetre."""
    return f"[{', '.join(f'{value:.2f} m' for value in values)}]"


def urdf_starter_text(file: Path, base_link: str | None, tip_link: str | None, folder: Path) -> str:
    """The text of a problem file for a URDF, with comments; it solves as it is."""
    spec = UrdfRobot(kind="urdf", file=str(file.absolute()), base_link=base_link, tip_link=tip_link)
    robot = spec.build(Path())
    # The problem file names the URDF relative to itself, or as it was named where that was a whole path.
    section = _section(spec, robot, str(file) if file.is_absolute() else Path(os.path.relpath(file, folder)).as_posix())
    solved = _section(spec, robot, str(file.absolute()))
    for target in _targets(robot):
        problem = problem_from_dict(parse_yaml(filled_starter(robot, solved, target)).data)
        with suppress(InputError):  # the arm cannot be asked for this: no joint changes the height of its links, say
            if PostureSelector(problem, compiled=False).feasible(4):
                return filled_starter(robot, section, target)
    return filled_starter(robot, section, StarterTarget(sensible_direction(robot), None, False))


def _targets(robot: Robot) -> Iterator[StarterTarget]:
    direction = sensible_direction(robot)
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    room = 0.1 * (upper - lower)  # of its range that a joint keeps from either limit
    q = np.random.default_rng(0).uniform(lower + room, upper - room, (20_000, robot.n))
    points, rotations = nominal_poses(robot, q)
    wanted = np.array(parse_yaml(f"direction: {direction}").data["direction"], dtype=float)
    along = rotations[:, :, 2] @ wanted > math.cos(math.radians(20))  # the search does the rest
    ends = [replace(robot, links=robot.links[: k + 1], tool=()) for k in range(robot.n)]
    heights = np.column_stack([nominal_poses(end, q)[0][:, 2] for end in ends])
    # All links that can be lifted end 60 mm above the table: they have to stay 50 mm above it.
    raised = np.all(heights[:, np.ptp(heights, axis=0) > 0] > 0.06, axis=1)
    if direction == "[0, 0, -1]" and (raised & along).any():
        yield StarterTarget(direction, _pleasant_place(points, raised & along), True)
    yield StarterTarget(direction, _pleasant_place(points, along if along.any() else ~along), False)


def _pleasant_place(points: Array, usable: Mask) -> tuple[float, ...]:
    """A usable point (3,) in whole centimetres, off the base axis and well within reach [m]."""
    wanted = np.array([0.5, 0.2, 0.15]) * np.linalg.norm(points, axis=1).max()
    chosen = points[usable]
    near = chosen[np.argmin(np.linalg.norm(chosen - wanted, axis=1))]
    return tuple(float(round(value, 2)) + 0.0 for value in near)


def _section(spec: UrdfRobot, robot: Robot, file: str) -> str:
    source = dict(robot.sources)
    links = [
        "kind: urdf",
        f"file: {dump_flow(file)}",
        f"base_link: {dump_flow(source['base_link'])}",
        f"tip_link: {dump_flow(source['tip_link'])}      # the tool point is its origin, unless tool: says otherwise",
    ]
    tip = spec.chosen_tip(Path())
    remarks = [
        f"joint {joint} is taken for a finger of a gripper ({why}): the chain ends before it"
        for joint, why in tip.fingers
    ]
    if tip.others:
        others = listed(tip.others, 8)
        remarks.append(f"the chain could also end at {others}: write it there, or --tip-link LINK")
    remarks.append("joints of the chain, with the limits of the URDF:")
    width = max(map(len, robot.joint_names))
    for joint in robot.joints:
        lower, upper = joint_text(joint.lower, joint.unit), joint_text(joint.upper, joint.unit)
        remarks.append(f"  {joint.name:{width}}  {joint.type}, {lower} to {upper}")
    remarks += [note for note in robot.notes if note not in tip.notes()]
    if bare := [joint.name for joint in robot.joints if not math.isfinite(joint.mass)]:
        remarks.append(f"no <inertial> behind {', '.join(bare)}: effects of gravity need masses, all else does not")
    remarks += robot.shape_notes
    return "\n".join(f"  {line}" for line in (*links, *(f"# {one_line(line)}" for line in remarks)))
