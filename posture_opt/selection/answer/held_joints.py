"""Joints that a task holds: the arm with them, and the task without."""

from __future__ import annotations

from dataclasses import replace

from posture_opt.model.arm import Arm
from posture_opt.robot.robot import Robot
from posture_opt.selection.tasks import Task


def held_joints(robot: Robot, task: Task) -> dict[int, float]:
    """Joint index -> value [rad or m] of all that terms of the task hold."""
    return {joint: value for term in task.subject_to for joint, value in term.held(robot).items()}


def with_held_joints(arm: Arm, task: Task) -> Arm:
    """The arm whose joints that the task holds have their value as both limits: neither starts nor steps move them."""
    held = held_joints(arm.robot, task)
    if not held:
        return arm
    joints = tuple(
        replace(joint, lower=held[k], upper=held[k]) if k in held else joint for k, joint in enumerate(arm.robot.joints)
    )
    return replace(arm, robot=replace(arm.robot, joints=joints))


def released(robot: Robot, task: Task) -> Task:
    """The same task without the terms that hold joints: the inquiry into a failure asks what they are in the way of."""
    return task.model_copy(update={"subject_to": tuple(term for term in task.subject_to if not term.held(robot))})
