"""``Aligner``: what an arm can give of the tool axis that a task asks for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.selection.program.optimisation_problem import Alignment
from posture_opt.selection.program.pose_request import request_for
from posture_opt.selection.program.task_target import Reach, TaskTarget
from posture_opt.selection.search.inverse_kinematics import TOLERANCE, InverseKinematics, axis_can_reach
from posture_opt.selection.tasks import Task

ALIGNMENT_TRIALS = 96  # random postures: where one in twenty arrives aligned, all of them fail at 0.7 % of the targets


@dataclass(frozen=True)
class Aligner:
    """The arm and the tool axis that is asked of it.

    Six joints can point a tool anywhere at most targets, and a planar or five-joint arm at some or none: what a file
    asks for in one line is then decided by trying.

    Args:
        arm: n joints; ``task`` with its tool axis and tilt.
        reach: which directions the tool point moves in, and what freedom the axis has.
        compiled: None compiles where a C compiler is found; False never; True or an error.
        whole: the arm with all of its joints and ranges, where ``arm`` has fewer.
    """

    arm: Arm
    task: Task
    reach: Reach
    compiled: bool | None
    whole: Arm

    def at(self, target: TaskTarget) -> Alignment:
        """Whether the tool axis is asked for, and what the arm can give at such a target.

        ``free``: not constrained; ``exact``: two rows hold it; ``loose``: it is held within a slack, for arms with too
        few joints to hold it exactly. Where no random posture arrives aligned, an arm whose axis could get near is
        ``loose``, and so is one that only lacks joints that the file holds.
        """
        given = self._given(target)
        if given == "free" and self.whole is not self.arm and self._of_whole.at(target) != "free":
            return "loose"
        return given

    def _given(self, target: TaskTarget) -> Alignment:
        """What the arm can give with the joints and ranges that it is left."""
        reach = self.reach
        if self.task.axis_request == "free" or reach.axis_rank == 0:
            return "free"
        if reach.axis_freedom == 2 and reach.orients_at_point:
            return "exact"
        # Too few joints to turn the tool at will: it depends on direction and target, so try.
        if self._can_align(target, 0.0):
            return "exact" if reach.axis_rank == 1 else "loose"
        if self._can_align(target, reach.axis_slack / 2):
            return "loose"
        can_turn = target.kind != "point" or reach.orients_at_point
        nearly = can_turn and axis_can_reach(self.arm, self.task.tool_axis, target, reach.axis_slack)
        return "loose" if nearly else "free"

    def _can_align(self, target: TaskTarget, slack: float) -> bool:
        """Whether any of some random postures arrives at the target with its axis within ``slack`` [rad]."""
        rng, ik = np.random.default_rng(0), self._trial
        request = request_for(target, ALIGNMENT_TRIALS, True, rng, whole_box=True, slack_of_axis=slack)
        return bool(np.min(ik.solve(ik.random_postures(ALIGNMENT_TRIALS, rng), request, enough=1)[1]) < TOLERANCE)

    @cached_property
    def _of_whole(self) -> Aligner:
        """The same question to the whole arm."""
        return Aligner(self.whole, self.task, Reach.of(self.whole, self.task.tool_axis), self.compiled, self.whole)

    @cached_property
    def _trial(self) -> InverseKinematics:
        """The inverse kinematics of position and axis."""
        return InverseKinematics(self.arm, self.task.tool_axis, self.reach.directions, self.compiled)
