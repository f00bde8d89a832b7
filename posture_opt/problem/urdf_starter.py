"""A commented problem file for a URDF of the user's own: the chain that was chosen, and a target that it reaches.

A URDF says nothing of where the arm works. Postures are drawn at random, and the target is placed where many of them
hold the tool along the direction of the task.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from posture_opt.errors import InputError, listed
from posture_opt.measurements.measurements import nominal_poses
from posture_opt.numerics import Array, Mask
from posture_opt.problem.load import problem_from_dict
from posture_opt.problem.starter import StarterTarget, filled_starter, sensible_direction
from posture_opt.problem.yaml_source import dump_scalar, parse_yaml
from posture_opt.robot.robot import Joint, Robot
from posture_opt.robot.urdf import UrdfRobot
from posture_opt.robot.urdf_tip import ChosenTip
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.texts import one_line
from posture_opt.units import joint_text

_RANDOM_POSTURES = 20_000  # postures, among which one that holds the tool along the direction is looked for
_LIMIT_MARGIN_SHARE = 0.1  # of its range that a joint keeps from either limit there
_MIN_ALIGNMENT_COSINE = math.cos(math.radians(20))  # of the tool axis with the direction: the search does the rest
_TRIAL_STARTS = 4
_MIN_LINK_HEIGHT_M = 0.06  # m; links stay 50 mm above it
_MAX_LISTED_LINKS = 8
_TARGET_SHARES = np.array([0.5, 0.2, 0.15])
"""Where the target should lie, as shares of the farthest that the tool comes."""


def urdf_starter_text(file: Path, base_link: str | None, tip_link: str | None, folder: Path) -> str:
    """The text of a problem file for a URDF, with comments; it solves as it is.

    Args:
        file: the URDF; ``base_link`` and ``tip_link`` the ends of the chain, None: found.
        folder: of the problem file, which names the URDF from there.

    Raises:
        InputError: everything wrong with the URDF; several last links without ``tip_link``, which are then listed.
    """
    spec = UrdfRobot(kind="urdf", file=str(file.absolute()), base_link=base_link, tip_link=tip_link)
    robot = spec.build(Path())
    section = _section(spec, robot, _named_from(folder, file))
    solved = _section(spec, robot, str(file.absolute()))
    for target in _targets(robot):
        if _solves(filled_starter(robot, solved, target)):
            return filled_starter(robot, section, target)
    return filled_starter(robot, section, StarterTarget(sensible_direction(robot), None, False))


def _named_from(folder: Path, file: Path) -> str:
    """The URDF as the problem file names it: relative to it, or where it was named as a whole path, as it was."""
    return str(file) if file.is_absolute() else Path(os.path.relpath(file, folder)).as_posix()


def _solves(text: str) -> bool:
    """Whether the problem of a text has a posture that meets its requirements."""
    problem = problem_from_dict(parse_yaml(text).data)
    try:
        return PostureSelector(problem, compiled=False).feasible(_TRIAL_STARTS)
    except InputError:  # the arm cannot be asked for this: no joint changes the height of its links, say
        return False


def _targets(robot: Robot) -> Iterator[StarterTarget]:
    """Targets to try in turn: if it goes, elbow and wrist stay above the table."""
    direction = sensible_direction(robot)
    q, points, along = _postures(robot, direction)
    raised = _links_above(robot, q)
    if direction == "[0, 0, -1]" and (raised & along).any():
        yield StarterTarget(direction, _pleasant_place(points, raised & along), True)
    yield StarterTarget(direction, _pleasant_place(points, along if along.any() else ~along), False)


def _postures(robot: Robot, direction: str) -> tuple[Array, Array, Mask]:
    """Postures drawn at random, their tool points, and which of them hold the tool axis along the direction.

    Returns (N, n) [rad or m], (N, 3) [m, world frame] and (N,); joints keep a tenth of their range from either limit,
    "along" is within 20 degrees.
    """
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    room = _LIMIT_MARGIN_SHARE * (upper - lower)
    q = np.random.default_rng(0).uniform(lower + room, upper - room, (_RANDOM_POSTURES, robot.n))
    points, rotations = nominal_poses(robot, q)
    wanted = np.array(parse_yaml(f"direction: {direction}").data["direction"], dtype=float)
    return q, points, rotations[:, :, 2] @ wanted > _MIN_ALIGNMENT_COSINE


def _links_above(robot: Robot, q: Array) -> Mask:
    """(N,) whether all links that can be lifted end well above the table."""
    ends = [replace(robot, links=robot.links[: k + 1], tool=()) for k in range(robot.n)]
    heights = np.column_stack([nominal_poses(end, q)[0][:, 2] for end in ends])
    lifted = np.ptp(heights, axis=0) > 0
    return np.asarray(np.all(heights[:, lifted] > _MIN_LINK_HEIGHT_M, axis=1))


def _pleasant_place(points: Array, usable: Mask) -> tuple[float, ...]:
    """A usable point (3,) in whole centimetres, off the base axis and well within reach [m]."""
    wanted = _TARGET_SHARES * np.linalg.norm(points, axis=1).max()
    chosen = points[usable]
    near = chosen[np.argmin(np.linalg.norm(chosen - wanted, axis=1))]
    return tuple(float(round(value, 2)) + 0.0 for value in near)


def _section(spec: UrdfRobot, robot: Robot, file: str) -> str:
    """The lines of the section ``robot``, with what the file says of the joints as comments."""
    source = dict(robot.sources)
    links = [
        "kind: urdf",
        f"file: {dump_scalar(file)}",
        f"base_link: {dump_scalar(source['base_link'])}",
        f"tip_link: {dump_scalar(source['tip_link'])}      # the tool point is its origin, unless tool: says otherwise",
    ]
    tip = spec.chosen_tip(Path())
    remarks = (*_tip_remarks(tip), *(line for line in _remarks(robot) if line not in tip.notes()))
    return "\n".join(f"  {line}" for line in (*links, *(f"# {one_line(line)}" for line in remarks)))


def _tip_remarks(tip: ChosenTip) -> Iterator[str]:
    """Why this link is the end of the chain, and what else it could be."""
    for joint, why in tip.fingers:
        yield f"joint {joint} is taken for a finger of a gripper ({why}): the chain ends before it"
    if tip.others:
        yield f"the chain could also end at {listed(tip.others, _MAX_LISTED_LINKS)}: write it there, or --tip-link LINK"


def _remarks(robot: Robot) -> Iterator[str]:
    """What is to be known of the chain: limits, masses, what was assumed, and what is left out of it."""
    yield "joints of the chain, with the limits of the URDF:"
    width = max(map(len, robot.joint_names))
    yield from (f"  {joint.name:{width}}  {_limits(joint)}" for joint in robot.joints)
    yield from robot.notes
    bare = [joint.name for joint in robot.joints if not math.isfinite(joint.mass)]
    if bare:
        yield f"no <inertial> behind {', '.join(bare)}: effects of gravity need masses, all else does not"
    yield from robot.shape_notes


def _limits(joint: Joint) -> str:
    """Type and limits of a joint, as the file would have them."""
    lower, upper = joint_text(joint.lower, joint.unit), joint_text(joint.upper, joint.unit)
    return f"{joint.type}, {lower} to {upper}"
