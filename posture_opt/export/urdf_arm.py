"""The arm as URDF: its corrections in the origins of the joints, base and tool as fixed joints.

Source: ROS, "URDF XML specification": ``origin`` is ``Trans(x, y, z) Rz(yaw) Ry(pitch) Rx(roll)`` from the parent link
to the joint, whose axis is given in the joint frame; the child link's frame is the joint frame after the motion.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import ClassVar, Literal
from xml.sax.saxutils import quoteattr

import numpy as np

from posture_opt import __version__
from posture_opt.export.export_format import Exported, ExportFormat, ExportSource
from posture_opt.export.fixed_pose import fixed_pose
from posture_opt.export.urdf_corrected import corrected_document, relative_meshes
from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor, Joint, Robot, UrdfDescription
from posture_opt.robot.shape import BASE, TOOL, Capsule
from posture_opt.robot.urdf_chain import xyz_rpy
from posture_opt.texts import one_line

_EFFORT, _VELOCITY = 1000.0, 1.0  # N m or N, rad/s or m/s: the format requires limits, where nobody states one
_NO_MASSES = "masses are left out: a URDF wants tensors of inertia with them, and the problem file has none"
_BALL = 1e-9  # m: a shorter capsule is one ball


class UrdfArm(ExportFormat):
    """A URDF file whose forward kinematics is that of the corrected arm, from ``world`` to ``tool``.

    An arm that was read from a URDF comes back as that file with other origins: its meshes, masses, inertias, limits
    and further links as they were.
    """

    summary: ClassVar[str] = "the corrected arm as URDF, from link 'world' to link 'tool'"
    default: ClassVar[str] = "arm"

    kind: Literal["urdf"] = "urdf"

    def write(self, source: ExportSource) -> Exported:
        problem = source.problem
        effects = ", ".join(effect.name for effect in problem.arm.effects)
        left_out = (f"a URDF cannot hold effects: left out are {effects}",) if effects else ()
        free = [frame for frame in ("base", "tool") if getattr(problem.robot, f"{frame}_free")]
        found = tuple(f"the {frame} is free, to be found from data: here it is at its start value" for frame in free)
        if problem.robot.description is not None:
            notes = (*left_out, *found, *_kept_notes(problem.robot.description))
            text = corrected_document(problem.robot, problem.robot.description, self.stem, _comment(notes))
        else:
            notes = (*left_out, *found, *_placeholder_note(problem.robot), _NO_MASSES)
            text = urdf_text(problem.robot, self.stem, notes)
        return Exported({f"{self.stem}.urdf": text}, notes)


def _placeholder_note(robot: Robot) -> tuple[str, ...]:
    """Which limits of the joints nobody states."""
    unknown = [
        words
        for words, values in (
            ("effort", [joint.effort for joint in robot.joints]),
            ("velocity", robot.velocities),
        )
        if any(map(math.isnan, values))
    ]
    if not unknown:
        return ()
    return (f"{' and '.join(unknown)} limits of joints are placeholders where the problem file has none",)


def _kept_notes(description: UrdfDescription) -> tuple[str, ...]:
    """What is to be known of a file that is the arm's own with other origins."""
    files = relative_meshes(description.data)
    if not files:
        return ()
    return (f"meshes are named from the folder of the URDF, {files[0]} say: put this file beside it",)


def _comment(notes: Sequence[str]) -> str:
    """The lines of the comment at the top of the file."""
    lines = (f"Written by posture_opt {__version__}.", *notes)
    return "\n".join("  " + re.sub("-(?=-)", "- ", one_line(line)) for line in lines)


def urdf_text(robot: Robot, name: str, notes: Sequence[str] = ()) -> str:
    """The URDF of a chain; joint names, zeros, directions and limits are those of its joints.

    ``T_world_tool(q)`` agrees with the program's to 1e-9 m at every posture.

    Args:
        name: of the robot in the file.
        notes: lines of the comment at the top.
    """
    before, behind = _parts(robot)
    links = _unique(("world", "base", *(f"{joint.name}_link" for joint in robot.joints), "flange", "tool"))
    fixed = _unique((*robot.joint_names, "world_to_base", "to_flange", "flange_to_tool"))[robot.n :]
    origins = [before[0], *((*rest, *ahead) for rest, ahead in zip(behind[:-1], before[1:], strict=True))]
    joints = [_fixed(fixed[0], links[0], links[1], robot.base)]
    for k, (joint, origin) in enumerate(zip(robot.joints, origins, strict=True)):
        joints.append(_moving(joint, links[k + 1], links[k + 2], origin, robot.factors[robot.driven[k]].axis))
    joints.append(_fixed(fixed[1], links[-3], links[-2], behind[-1]))
    joints.append(_fixed(fixed[2], links[-2], links[-1], robot.tool))
    body = [*_links(robot, links, behind), *joints]
    head = f'<?xml version="1.0"?>\n<!--\n{_comment(notes)}\n-->\n<robot name={quoteattr(name)}>'
    return "\n".join([head, *body, "</robot>", ""])


def _links(robot: Robot, names: Sequence[str], behind: Sequence[Sequence[Factor]]) -> list[str]:
    """The links with the shape of the arm, whose capsules are given in the frames behind the joints."""
    carried = [BASE, *robot.joint_names, TOOL]
    frames = [np.eye(4), *map(fixed_pose, behind), np.eye(4)]
    link_of = dict(zip(carried, [*names[1:-2], names[-1]], strict=True))
    shown = {
        link_of[owner]: shape_lines([c for c in robot.shape if c.joint == owner], T)
        for owner, T in zip(carried, frames, strict=True)
    }
    found = []
    for name in names:
        inside = shown.get(name)
        found += (
            [f"  <link name={quoteattr(name)}>", *inside, "  </link>"]
            if inside
            else [f"  <link name={quoteattr(name)}/>"]
        )
    return found


def _parts(robot: Robot) -> tuple[list[tuple[Factor, ...]], list[tuple[Factor, ...]]]:
    """Of each link the factors up to its joint variable, whose own nominal value is among them, and those behind it.

    A turn by the nominal value and one by the joint variable are about one axis: the order of the two is free.
    """
    before, behind = [], []
    for link in robot.links:
        at = next(i for i, factor in enumerate(link) if factor.joint is not None)
        before.append(link[: at + 1])
        behind.append(link[at + 1 :])
    return before, behind


def _origin(factors: Iterable[Factor]) -> str:
    """The element ``origin`` of a product of factors: xyz [m] and rpy [rad]."""
    xyz, rpy = xyz_rpy(fixed_pose(factors))
    places, turns = (" ".join(repr(float(value) + 0.0) for value in part) for part in (xyz, rpy))
    return f'    <origin xyz="{places}" rpy="{turns}"/>'


def _fixed(name: str, parent: str, child: str, factors: Iterable[Factor]) -> str:
    """A fixed joint between two links."""
    head = f'  <joint name={quoteattr(name)} type="fixed">'
    return "\n".join([head, *_ends(parent, child), _origin(factors), "  </joint>"])


def _moving(joint: Joint, parent: str, child: str, factors: Iterable[Factor], axis: int) -> str:
    """A joint that moves along or about one axis of its own frame, with its limits."""
    along = " ".join("1" if k == axis else "0" for k in range(3))
    head = f'  <joint name={quoteattr(joint.name)} type="{joint.type}">'
    bounds = f'lower="{float(joint.lower)!r}" upper="{float(joint.upper)!r}"'
    effort = _EFFORT if math.isnan(joint.effort) else float(joint.effort)
    velocity = _VELOCITY if math.isnan(joint.velocity) else float(joint.velocity)
    limit = f'    <limit {bounds} effort="{effort!r}" velocity="{velocity!r}"/>'
    motion = f'    <axis xyz="{along}"/>'
    return "\n".join([head, *_ends(parent, child), _origin(factors), motion, limit, "  </joint>"])


def _ends(parent: str, child: str) -> tuple[str, str]:
    """The elements that name both links of a joint."""
    return f"    <parent link={quoteattr(parent)}/>", f"    <child link={quoteattr(child)}/>"


def _unique(names: Sequence[str]) -> list[str]:
    """The names, those that occur before with one more underscore."""
    found: list[str] = []
    for name in names:
        fresh = name
        while fresh in found:
            fresh += "_"
        found.append(fresh)
    return found


def shape_lines(capsules: Iterable[Capsule], T: Array) -> list[str]:
    """The elements of a link; T (4, 4) maps the frame that the capsules are given in to the link's."""
    return [line for capsule in capsules for line in _capsule(capsule, T)]


def _capsule(capsule: Capsule, T: Array) -> list[str]:
    """A cylinder with a ball at both ends; a ball alone where the ends are one point."""
    start, end = (T[:3, :3] @ np.array(point) + T[:3, 3] for point in (capsule.start, capsule.end))
    length = float(np.linalg.norm(end - start))
    ball = f'<sphere radius="{capsule.radius!r}"/>'
    if length < _BALL:
        return _both((start + end) / 2, (0.0, 0.0), ball)
    x, y, z = (end - start) / length
    turned = math.atan2(math.hypot(x, y), z), math.atan2(y, x)
    cylinder = f'<cylinder radius="{capsule.radius!r}" length="{length!r}"/>'
    middle = _both((start + end) / 2, turned, cylinder)
    return [*middle, *_both(start, (0.0, 0.0), ball), *_both(end, (0.0, 0.0), ball)]


def _both(at: Array, turned: tuple[float, float], geometry: str) -> list[str]:
    """The same body as ``visual`` and ``collision``: its axis z is turned by pitch and yaw [rad]."""
    place = " ".join(repr(float(v)) for v in at)
    origin = f'<origin xyz="{place}" rpy="0.0 {turned[0]!r} {turned[1]!r}"/>'
    return [f"    <{kind}>{origin}<geometry>{geometry}</geometry></{kind}>" for kind in ("visual", "collision")]
