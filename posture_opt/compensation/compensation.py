"""``Compensation``: joint values that bring this arm to its targets, how joints arrive there, and what is left."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from posture_opt.collision.pairs import Clearance
from posture_opt.collision.scene import scene_statements
from posture_opt.compensation.nearest_postures import Poses, pose_misses
from posture_opt.compensation.targets import Targets
from posture_opt.model.arm import Arm
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE, Inputs
from posture_opt.numerics import Array, Mask, rms
from posture_opt.result import Result
from posture_opt.robot.robot import Joint
from posture_opt.selection.answer.other_postures import configurations
from posture_opt.selection.answer.solution_statements import beyond_measured, free_frames
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Quantity, Statement, state
from posture_opt.statements.notation import listed_lines
from posture_opt.texts import csv_line
from posture_opt.uncertainty.joint_digits import JointDigits
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.tool_point import ToolPoint
from posture_opt.units import fixed


@dataclass(frozen=True, eq=False)
class Arrivals:
    side: Array  # (N, n) direction of the last move of each joint, +1 or −1; 0 where unknown
    way: Array  # (N, n) length of that move [rad or m]

    def inputs(self, arm: Arm, rows: Targets, stated: Sequence[str] = ()) -> Inputs:
        """Inputs of effects in every row, its own columns first; sides not ``stated`` are sources of error."""
        given, n = arm.inputs, len(rows)
        warmth = None if rows.temperature is None else rows.temperature - REFERENCE_TEMPERATURE
        return Inputs(
            payload=np.full(n, given.payload) if rows.payload is None else rows.payload,
            approach=list(self.side.T),
            approach_length=list(self.way.T),
            temperature=np.full(n, given.temperature) if warmth is None else warmth,
            time=np.full(n, given.time) if rows.time is None else rows.time,
            stated=tuple(stated),
        )


def arrivals_of(arm: Arm, rows: Targets, q: Array) -> Arrivals:
    """``side_k = sign(q_k − q_{k−1})`` of commands (N, n) or the last move before; the first comes from far."""
    step = np.diff(q, axis=0, prepend=q[:1])
    last = np.where(np.abs(step) > 1e-12, np.arange(len(q))[:, None], 0)
    move = np.take_along_axis(step, np.maximum.accumulate(last, axis=0), axis=0)
    task = [arm.inputs.side(j) if joint.name in arm.inputs.stated else 0.0 for j, joint in enumerate(arm.robot.joints)]
    side = np.where(move != 0, np.sign(move), np.array(task, dtype=float))
    way = np.where(move != 0, np.abs(move), 1e6)  # rad or m: hysteresis of the first row is complete
    return Arrivals(np.where(rows.side != 0, rows.side, side), way)


def sided_joints(arm: Arm) -> Mask:
    """(n,) joints with an effect that depends on the side of arrival."""
    asked = {effect.target for effect in arm.effects if "approach" in effect.needs}
    return np.array([joint.name in asked for joint in arm.robot.joints])


@dataclass(frozen=True, eq=False)
class ExpectedMiss:
    """Of N commands against their targets."""

    off: Array  # (N,) distance of the expected tool point [m]
    turned: Array  # (N,) angle of the expected orientation [rad]
    rms: Array  # (N,) root mean square distance of the tool point, uncertainty and scatter included [m]
    rms_turned: Array  # (N,) of the angle [rad]


def expected_miss(arm: Arm, sources: Sources, rows: Targets, wanted: Poses, q: Array, came: Arrivals) -> ExpectedMiss:
    """``rms² = |E f(q) − x|² + tr Cov f(q)`` at commands q (N, n) [rad or m], f with effects and errors."""
    inputs = came.inputs(arm, rows)
    left = pose_misses(np.asarray(arm.under(inputs).pose(q), dtype=float), wanted)
    off, turned = np.linalg.norm(left.position, axis=1), np.linalg.norm(left.rotation, axis=1)
    squared, squared_turned = off**2, turned**2
    # Rows with the same known sides are evaluated together.
    patterns, group = np.unique(came.side != 0, axis=0, return_inverse=True)
    for k, known in enumerate(patterns):
        at = np.flatnonzero(group.ravel() == k)
        stated = tuple(joint.name for joint, is_known in zip(arm.robot.joints, known, strict=True) if is_known)
        tool_point = ToolPoint.of(arm.under(replace(inputs.take(at), stated=stated)), sources)
        columns = [np.ascontiguousarray(column) for column in np.asarray(q, dtype=float)[at].T]
        more, more_turned = _mean_square_spread(tool_point, columns, left.position[at])
        squared[at] += more
        squared_turned[at] += more_turned
    return ExpectedMiss(off, turned, np.sqrt(squared), np.sqrt(squared_turned))


def _mean_square_spread(tool_point: ToolPoint, q: Sequence[Array], left: Array) -> tuple[Array, Array]:
    """(N,) mean squares that uncertainty adds [m²], [rad²]; ``left`` (N, 3) target minus nominal tool point [m]."""
    moments, count = tool_point.moments(q), len(left)
    bias = np.broadcast_to(np.asarray(moments.mean - moments.position, dtype=float), (count, 3))
    total = np.broadcast_to(np.trace(np.asarray(moments.covariance, dtype=float), axis1=-2, axis2=-1), count)
    turns = np.asarray(tool_point.pose_first_order(q, moments.walk), dtype=float)[..., 3:, 3:]
    # |x̄ + b − target|² − |x̄ − target|², where left = target − x̄
    shifted = (bias**2).sum(axis=1) - 2 * (bias * left).sum(axis=1)
    return total + shifted, np.broadcast_to(np.trace(turns, axis1=-2, axis2=-1), count)


Origin = Literal["given", "given as targets", "first row", "task"]
"""Where the joint values of targets come from."""


class ConfigurationChange(NamedTuple):
    """Lines between which the arm changes its configuration, and how far [rad] a joint moves."""

    first: int
    last: int
    joint: str
    moved: float


@dataclass(frozen=True, eq=False, repr=False)
class Compensation(Result):
    """N targets with the commands that bring the tool to them, in the order of the targets.

    Args:
        problem: the arm with its corrections and effects.
        targets: as they were given; ``wanted``: the poses that they mean.
        near: (N, n) the postures to stay near [rad or m]: those given, else those of the nominal arm.
        q: (N, n) the compensated joint values, rounded to the digits that are written [rad or m].
        digits: how far they are rounded.
        reached: (N,) whether the arm comes to the target; ``reasons`` row -> why it is refused, where that is known.
        remarks: on where the postures come from.
        before: what is expected with ``near``; after: with ``q``.
        side: (N, n) +1 where a joint arrives with increasing values, −1 with decreasing ones, 0 where unknown.
        unsettled: (N, n) joints that hardly move, so that rounding decides from which side they arrive.
    """

    problem: ProblemData
    targets: Targets
    wanted: Poses
    near: Array
    q: Array
    digits: JointDigits
    reached: Mask
    reasons: Mapping[int, str]
    remarks: tuple[Statement, ...]
    before: ExpectedMiss
    after: ExpectedMiss
    side: Array
    unsettled: Mask

    def __len__(self) -> int:
        return len(self.q)

    @property
    def off(self) -> Array:
        """(N,) distance of the tool point from its target with the given joint values, as expected [m]."""
        return self.before.off

    @property
    def left(self) -> Array:
        """(N,) root mean square distance that is left after the compensation, as expected [m]."""
        return self.after.rms

    @property
    def oriented(self) -> bool:
        """Whether the orientation of the tool is wanted too."""
        return self.wanted.rotation is not None

    @cached_property
    def clearance(self) -> Clearance | None:
        """The least distance over all rows, and between which; None where nothing is checked."""
        return self.problem.scene.clearance(self.q)

    @property
    def postures(self) -> list[dict[str, float]]:
        """Joint name -> value [rad or m], in the order of the targets."""
        names = self.problem.robot.joint_names
        return [dict(zip(names, map(float, row), strict=True)) for row in self.q]

    @cached_property
    def headers(self) -> tuple[tuple[Joint, str, float], ...]:
        """Every joint with the head of its column and what one of its unit is [rad or m]."""
        return tuple((joint, *joint_column(self.targets, joint)) for joint in self.problem.robot.joints)

    def to_csv(self) -> str:
        """The targets with the joint values in place: their columns and units, then ``off [mm]`` and ``left [mm]``.

        Cells are separated as in the file of the targets, and numbers have its decimal mark.
        """
        targets, given = self.targets, self.targets.near is not None
        before = [] if given else [header for _, header, _ in self.headers]
        rows = [[*before, *(header.strip() for header in targets.headers), "off [mm]", "left [mm]"]]
        at = {targets.columns[joint.name].index: j for j, (joint, *_) in enumerate(self.headers)} if given else {}
        for k, cells in enumerate(targets.cells):
            values = zip(self.headers, self.q[k], strict=True)
            misses = [fixed(1e3 * float(v[k]), 5) for v in (self.off, self.left)]  # to 10 nm
            joints = [self.digits.text(j, v, f) for (j, _, f), v in values]
            *joints, off, left = (number.replace(".", targets.decimal) for number in (*joints, *misses))
            texts = [joints[at[i]] if i in at else cell for i, cell in enumerate(cells)]
            rows.append([*([] if given else joints), *texts, off, left])
        return "".join(csv_line(row, targets.separator) + "\n" for row in rows)

    def fields_json(self) -> dict[str, object]:
        """The document ``compensation.json``: SI units and radians."""
        return {
            "name": self.problem.name,
            "targets": [
                {
                    "line": self.targets.line[k],
                    "position": self.wanted.position[k],
                    "posture": posture,
                    "reached": self.reached[k],
                    "refused": self.reasons.get(k),
                    "off": self.off[k],
                    "left": self.left[k],
                    "off_rotation": self.before.turned[k] if self.oriented else None,
                    "left_rotation": self.after.rms_turned[k] if self.oriented else None,
                }
                for k, posture in enumerate(self.postures)
            ],
            "off_rms": rms(self.off),
            "left_rms": rms(self.left),
            "largest_joint_change": np.abs(self.q - self.near).max(),
            "configuration_changes": [change._asdict() for change in self.changes],
            "clearance": self.clearance and self.clearance.to_json(),
            "beyond_measured": self.problem.arm.beyond_measured(self.q),
            "notes": self.notes,
        }

    @cached_property
    def cautions(self) -> tuple[Statement, ...]:
        """Statements on what to check before the rows run."""
        return (*self.remarks, *_jumps(self), *_sides(self))

    @property
    def notes(self) -> tuple[str, ...]:
        """The sentences of the cautions."""
        return tuple(map(str, self.cautions))

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """Statements, the answer first."""
        return compensation_statements(self)

    @cached_property
    def changes(self) -> tuple[ConfigurationChange, ...]:
        """Changes of the configuration from row to row; of arms without named ones, a joint turned by over 60 deg."""
        robot, steps, lines = self.problem.robot, np.abs(np.diff(self.q, axis=0)), self.targets.line.tolist()
        turned = steps * np.array([joint.type == "revolute" for joint in robot.joints])
        names = configurations(robot, self.q)
        rows = [k for k, (a, b) in enumerate(pairwise(names)) if a != b]
        if not any(names[:1]):
            rows = np.flatnonzero(turned.max(axis=1, initial=0.0) >= math.radians(60.0)).tolist()
        return tuple(
            ConfigurationChange(lines[k], lines[k + 1], robot.joint_names[j], float(steps[k, j]))
            for k, j in ((k, int(np.argmax(turned[k]))) for k in rows)
        )

    @property
    def origin(self) -> Origin:
        """Where the joint values of the rows come from."""
        if self.targets.near is not None:
            return "given" if self.targets.position is not None else "given as targets"
        return "first row" if self.problem.task is None or self.remarks else "task"


def joint_column(targets: Targets, joint: Joint) -> tuple[str, float]:
    """Head and unit [rad or m] of a joint's column: as given, else deg and mm."""
    column = targets.columns.get(joint.name)
    if column is not None:
        return targets.headers[column.index].strip(), column.factor
    return (f"{joint.name} [deg]", float(np.pi / 180)) if joint.type == "revolute" else (f"{joint.name} [mm]", 1e-3)


def compensation_statements(found: Compensation) -> tuple[Statement, ...]:
    """All statements, the answer first."""
    off, left = rms(found.off), rms(found.left)
    known = off >= 1e-9  # m: less is rounding
    first = state("compensation.nothing-known", left=Quantity(left))
    if known:
        first = state("compensation.compensated", targets=len(found), left=Quantity(left), off=Quantity(off))
    return (
        first,
        *scene_statements(found.problem.scene, found.q),
        *beyond_measured(found.problem.arm, found.q),
        *([state("compensation.uncertain")] if known and left > 0.8 * off else []),
        *_large_change(found),
        *found.cautions,
        *free_frames(found.problem.robot),
        state("compensation.columns"),
        state("compensation.joint-convention"),
    )


def _large_change(found: Compensation) -> list[Statement]:
    robot = found.problem.robot
    turns = np.array([joint.type == "revolute" for joint in robot.joints])
    change = np.where(turns, np.abs(found.q - found.near), 0.0)
    row, joint = np.unravel_index(int(np.argmax(change)), change.shape)
    if found.targets.near is None or change[row, joint] < math.radians(5.0):
        return []
    line, angle = int(found.targets.line[row]), Quantity(float(change[row, joint]), "joint angle")
    return [state("compensation.large-change", robot.joint_names[joint], line=line, change=angle)]


def _jumps(found: Compensation) -> list[Statement]:
    name, said = "compensation.configuration-change", []
    for one in found.changes if found.targets.near is None else ():
        moved = Quantity(one.moved, "joint angle")
        said.append(state(name, one.joint, moved=moved, first=one.first, last=one.last))
    return said


def _sides(found: Compensation) -> list[Statement]:
    said, lines = [], found.targets.line
    joints = tuple(found.problem.robot.joint_names[j] for j in np.flatnonzero(found.unsettled.any(axis=0)))
    if joints:
        at = listed_lines(lines[found.unsettled.any(axis=1)].tolist())
        said.append(state("compensation.side-uncertain", joints[0], joints=joints, lines=at))
    moved, stated = np.sign(np.diff(found.q, axis=0)), found.targets.side[1:]
    other = np.any(sided_joints(found.problem.arm) & (stated != 0) & (moved != stated), axis=1)
    if other.any():
        said.append(state("compensation.side-contradicted", lines=listed_lines(lines[1:][other].tolist())))
    return said
