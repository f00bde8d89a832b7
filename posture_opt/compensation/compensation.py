"""``Compensation``: joint values that bring this arm to its targets, and what is left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from posture_opt.collision.nearest import Clearance
from posture_opt.compensation.compensation_statements import JUMP_RAD, cautions, compensation_statements
from posture_opt.compensation.configuration_choice import changes_of
from posture_opt.compensation.expected_miss import ExpectedMiss
from posture_opt.compensation.nearest_postures import Poses
from posture_opt.compensation.targets import Targets
from posture_opt.csv_text import csv_line
from posture_opt.numerics import Array, Json, Mask, rms
from posture_opt.result import Result
from posture_opt.robot.robot import Joint
from posture_opt.selection.answer.configurations import configurations
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Statement
from posture_opt.uncertainty.spread.joint_digits import JointDigits
from posture_opt.units import fixed

_LENGTH_DECIMALS = 5  # of a mm: off and left to 10 nm
Origin = Literal["given", "given as targets", "first row", "task"]
"""Where the joint values of targets come from."""


class ConfigurationChange(NamedTuple):
    """The line that the arm leaves for another in another configuration, and how far [rad] a joint moves at most."""

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
        """The number of targets."""
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
        rows = [[self._column_header(k) for k in range(len(self.targets.headers))]]
        rows[0] = [
            *([] if self._joints_given else [header for _, header, _ in self.headers]),
            *rows[0],
            "off [mm]",
            "left [mm]",
        ]
        at = (
            {self.targets.columns[joint.name].index: j for j, (joint, *_) in enumerate(self.headers)}
            if self._joints_given
            else {}
        )
        for k, cells in enumerate(self.targets.cells):
            values = zip(self.headers, self.q[k], strict=True)
            joints = [self._written(self.digits.text(j, v, f)) for (j, _, f), v in values]
            texts = [joints[at[i]] if i in at else cell for i, cell in enumerate(cells)]
            off, left = (self._written(fixed(1e3 * float(v[k]), _LENGTH_DECIMALS)) for v in (self.off, self.left))
            rows.append([*([] if self._joints_given else joints), *texts, off, left])
        return "".join(csv_line(row, self.targets.separator) + "\n" for row in rows)

    def _written(self, number: str) -> str:
        """A number with the decimal mark of the targets."""
        return number.replace(".", self.targets.decimal)

    @property
    def _joints_given(self) -> bool:
        """Whether the targets state joint values."""
        return self.targets.near is not None

    def _column_header(self, k: int) -> str:
        """The header of column k of the targets as it was given."""
        return self.targets.headers[k].strip()

    def fields_json(self) -> dict[str, Json]:
        """The document ``compensation.json``: SI units and radians."""
        rows = zip(self.targets.line, self.postures, self.reached, strict=True)
        return {
            "name": self.problem.name,
            "targets": [
                {
                    "line": int(line),
                    "position": self.wanted.position[k].tolist(),
                    "posture": posture,
                    "reached": bool(reached),
                    "refused": self.reasons.get(k),
                    "off": float(self.off[k]),
                    "left": float(self.left[k]),
                    "off_rotation": float(self.before.turned[k]) if self.oriented else None,
                    "left_rotation": float(self.after.rms_turned[k]) if self.oriented else None,
                }
                for k, (line, posture, reached) in enumerate(rows)
            ],
            "off_rms": rms(self.off),
            "left_rms": rms(self.left),
            "largest_joint_change": float(np.abs(self.q - self.near).max()),
            "configuration_changes": [change._asdict() for change in self.changes],
            "clearance": None if self.clearance is None else self.clearance.to_json(),
            "beyond_measured": [found.to_json() for found in self.problem.arm.beyond_measured(self.q)],
            "notes": list(self.notes),
        }

    @cached_property
    def cautions(self) -> tuple[Statement, ...]:
        """What to check before the rows run, and where their postures come from."""
        return (*self.remarks, *cautions(self))

    @property
    def notes(self) -> tuple[str, ...]:
        """The sentences of the cautions."""
        return tuple(map(str, self.cautions))

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """What the compensation has to say, the answer first."""
        return compensation_statements(self)

    @cached_property
    def changes(self) -> tuple[ConfigurationChange, ...]:
        """From which rows to which the arm changes its configuration; of arms whose configurations have no names, where
        a joint turns by more than 60 deg.
        """
        robot, steps = self.problem.robot, np.abs(np.diff(self.q, axis=0))
        turns = np.array([joint.type == "revolute" for joint in robot.joints])
        named = any(configurations(robot, self.q[:1]))
        far = np.flatnonzero((steps * turns).max(axis=1, initial=0.0) >= JUMP_RAD).tolist()
        rows = changes_of(robot, self.q) if named else far
        joints = [int(np.argmax(steps[k] * turns)) for k in rows]
        lines = self.targets.line
        return tuple(
            ConfigurationChange(int(lines[k]), int(lines[k + 1]), robot.joint_names[j], float(steps[k, j]))
            for k, j in zip(rows, joints, strict=True)
        )

    @property
    def origin(self) -> Origin:
        """Where the joint values of the rows come from."""
        if self._joints_given:
            return "given" if self.targets.position is not None else "given as targets"
        return "first row" if self.problem.task is None or self.remarks else "task"


def joint_column(targets: Targets, joint: Joint) -> tuple[str, float]:
    """The head of a joint's column and its unit [rad or m]: as given, else deg and mm."""
    column = targets.columns.get(joint.name)
    if column is not None:
        return targets.headers[column.index].strip(), column.factor
    return (f"{joint.name} [deg]", float(np.pi / 180)) if joint.type == "revolute" else (f"{joint.name} [mm]", 1e-3)
