"""Commented problem files to start from: one for every preset, each solvable as it is.

Numbers follow the size of the robot: target and region are shares of its stretched length.
"""

from __future__ import annotations

import string
from dataclasses import dataclass

from posture_opt.model.arm import Arm
from posture_opt.problem.yaml_source import dump_scalar
from posture_opt.robot import load_preset
from posture_opt.robot.robot import Robot

_STARTER_TEMPLATE = string.Template("""\
# A problem file of posture_opt: in which posture does the position scatter of this arm hurt the task least?
#
#   optimize-posture --problem THIS_FILE.yaml
#
# Every number with a dimension carries its unit: 1 deg, 20 arcsec, 0.05 mm, 2.5 kg; only 0 needs none. A line behind
# '#' is a suggestion; 'optimize-posture list' names tasks and terms, 'optimize-posture schema' every key.

name: $title

robot:
$robot
  # base: {xyz: [0 m, 0 m, 0 m], rpy: [0 deg, 0 deg, 0 deg]}     # the base in the world
  # tool: {xyz: [0 m, 0 m, 0.1 m], rpy: [0 deg, 0 deg, 0 deg]}   # the tool point in the flange
  # payload: 2 kg

# cell:                             # obstacles around the arm, in the world; cell: none checks no collisions at all
#   obstacles:
#     - {name: table, kind: box, size: [1.2 m, 0.8 m, 20 mm], xyz: [0.5 m, 0 m, -10 mm]}
#     - {name: post, kind: cylinder, radius: 60 mm, length: 0.8 m, xyz: [0.3 m, 0.5 m, 0.4 m]}
#   clearance: 20 mm                # of the arm to all of them, and of its links to each other

uncertainty:
$uncertainty
task:
  kind: insert                      # insert | drill | probe | measure | trace | place
  direction: $direction             # in the world
$position
  # In place of it, a box to put the workpiece in; without both it may stand anywhere in reach, and its place is part
  # of the answer.
  # region: {min: $minimum, max: $maximum}
  # tool_axis: [0, 0, 1]            # of the tool, laid along the direction where the arm can
  # tilt: 5 deg                     # how far it may lean
  # clearance: 0.2 mm               # radial play of the hole: gives the probability of success
  # criterion: worst                # worst | trace | area | miss
  subject_to:
    - {kind: limit_margin, at_least: 5 deg}     # no joint near its end
$table
solver: {kind: ipopt, seed: 0}
""")

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

_TABLE_LINE = "    - {kind: link_height, at_least: 50 mm}      # elbow and wrist stay above the table: world z\n"


_PRESET_TEMPLATE = string.Template("""\
  kind: preset
  name: $preset
  # joints: $joints""")


@dataclass(frozen=True)
class StarterTarget:
    """Where a starter's task is done: what its lines in the file say.

    Args:
        direction: of the task, as the file has it, world frame.
        position: (3,) of the target [m], world frame; None: it is part of the answer.
        above_table: whether links have to stay above the table.
    """

    direction: str
    position: tuple[float, ...] | None
    above_table: bool


def starter_text(preset: str) -> str:
    """The text of a problem file for a preset, with comments.

    Raises:
        InputError: no preset has this name; the nearest is offered.
    """
    robot = load_preset(preset)
    # Well off the base axis and well within reach; a SCARA, which has no wrist to turn down, may stretch further.
    x, y = (0.45, 0.15) if _all_turn(robot) else (0.6, 0.3)
    place = (x * _stretched(robot), y * _stretched(robot), _height(robot))
    # The arm of a SCARA stays at its height and its quill has to go below it; a planar arm lies in its table.
    target = StarterTarget(sensible_direction(robot), place, _all_turn(robot) and not is_planar(robot))
    return filled_starter(
        robot, _PRESET_TEMPLATE.substitute(preset=preset, joints=", ".join(robot.joint_names)), target
    )


def filled_starter(robot: Robot, section: str, target: StarterTarget) -> str:
    """The text of a problem file for a robot.

    Args:
        section: the first lines of the section ``robot``, indented.
        target: without a position, one is suggested in a comment.
    """
    reach = min(1.0, _stretched(robot))  # m: a small arm does not reach to the places of a large one
    x, y, z = target.position or (0.5 * reach, 0.2 * reach, 0.1 * reach)
    position = f"position: {_point([x, y, z])}"
    return _STARTER_TEMPLATE.substitute(
        title=dump_scalar(f"Insertion with the {robot.name}"),
        robot=section,
        uncertainty=_uncertainty(robot),
        direction=target.direction,
        position=f"  {position}" if target.position else f"  # {position}",
        minimum=_point([x, -y, z]),
        maximum=_point([1.2 * x, y, z]),
        table=_TABLE_LINE if target.above_table else "",
    )


def sensible_direction(robot: Robot) -> str:
    """Down, and of a planar arm a direction in its plane."""
    return "[0, -1, 0]" if is_planar(robot) else "[0, 0, -1]"


def _uncertainty(robot: Robot) -> str:
    """The section ``uncertainty``: the data sheet's repeatability with its source, else 0.02 deg or 0.01 mm a joint."""
    sigma_of = {"revolute": ("theta", "0.02 deg"), "prismatic": ("d", "0.01 mm")}
    own = [f"{joint.name}.{sigma_of[joint.type][0]}" for joint in robot.joints]
    values = [f"{dump_scalar(name)}: {sigma_of[joint.type][1]}" for name, joint in zip(own, robot.joints, strict=True)]
    first, second, *_ = dict.fromkeys([*own, *robot.parameters])  # a robot may have one joint
    if robot.repeatability is None:
        sigma = "\n".join(f"    {value}" for value in values)
        return _SIGMA_TEMPLATE.substitute(sigma=sigma, first=dump_scalar(first), second=dump_scalar(second))
    sigma = "\n".join(f"  #   {value}" for value in values)
    value, source = f"{robot.repeatability.value * 1e3:g} mm", " ".join(robot.repeatability.source.split())
    return _REPEATABILITY_TEMPLATE.substitute(
        sigma=sigma, first=dump_scalar(first), second=dump_scalar(second), value=value, source=source
    )


def _stretched(robot: Robot) -> float:
    """The length of all links laid in one line [m]: an upper bound of the reach."""
    return sum(abs(factor.nominal) for factor in robot.factors if factor.kind == "translate")


def _height(robot: Robot) -> float:
    """A height that the tool reaches easily [m, world z]: 0 of a planar arm, a tenth of the stretched length of an arm
    that turns, the height in the middle of the ranges of any other.
    """
    if is_planar(robot):
        return 0.0
    if _all_turn(robot):
        return 0.1 * _stretched(robot)
    middle = [(joint.lower + joint.upper) / 2 for joint in robot.joints]
    return float(Arm(robot).position(middle)[2])


def _all_turn(robot: Robot) -> bool:
    """Whether all joints are revolute."""
    return all(joint.type == "revolute" for joint in robot.joints)


def is_planar(robot: Robot) -> bool:
    """Whether all joints turn about the z axis of the base and no link leaves its plane.

    Then the tool point stays at one height, and tasks need a direction in the plane.
    """
    rotations = [factor for factor in robot.factors if factor.kind == "rotate"]
    slides = any(factor.kind == "translate" and factor.joint is not None for factor in robot.factors)
    turned_about = {factor.axis for factor in rotations if factor.nominal or factor.joint is not None}
    return turned_about == {2} and not slides


def _point(values: list[float]) -> str:
    """A point (3,) [m] as the file has it, to the centimetre."""
    return f"[{', '.join(f'{value:.2f} m' for value in values)}]"
