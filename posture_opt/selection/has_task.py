"""``HasTask``: what a selection needs of a problem, and what it refuses to begin with."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.model.arm import Arm
from posture_opt.robot.robot import Robot
from posture_opt.selection.solvers import Solver
from posture_opt.selection.tasks import Task
from posture_opt.uncertainty.sources import Sources


class HasTask(Protocol):
    """What a selection needs of a ``Problem``."""

    @property
    def name(self) -> str: ...
    @property
    def robot(self) -> Robot: ...
    @property
    def arm(self) -> Arm: ...
    @property
    def sources(self) -> Sources: ...
    @property
    def task(self) -> Task | None: ...
    @property
    def solver(self) -> Solver: ...
    @property
    def notes(self) -> tuple[str, ...]: ...


def task_of(problem: HasTask) -> Task:
    """The task, or an InputError where there is none."""
    if problem.task is None:
        raise InputError(Issue("the problem states no task", ("task",), mend="add task: {kind: insert}"))
    return problem.task


def sources_of(problem: HasTask) -> Sources:
    """The sources of error, or an InputError where there are none that could make a difference."""
    # Stricter than for one posture: a spread of zero is an answer there, but no ground to choose by.
    if problem.sources.empty or not np.any(np.diag(problem.sources.covariance) > 0):
        mend = "add uncertainty: {sigma: {JOINT.theta: 0.02 deg}} or uncertainty: {repeatability: 0.05 mm}"
        raise InputError(
            Issue("nothing is uncertain, so no posture is better than another", ("uncertainty",), mend=mend)
        )
    return problem.sources
