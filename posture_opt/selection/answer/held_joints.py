"""Joints that a task holds: the arm with them, and which of them is in the way where nothing is feasible."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.posture import Posture
from posture_opt.robot.robot import Robot
from posture_opt.selection.answer.infeasible import Explanation
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.search.relaxation import Reason, Relaxation
from posture_opt.selection.tasks import Task
from posture_opt.selection.terms.near_posture import NearPosture
from posture_opt.units import JointQuantity, joint_text

_DISTANCE_WEIGHT = 1e4  # of the distance beside the spread: what is sought is the value next to the held one


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
    """The same task with those joints free, and as near to their values as the other requirements allow.

    It is solved where the held arm finds nothing: the joints that move are in the way.
    """
    dimensions = {"revolute": "angle", "prismatic": "length"}
    values = {
        robot.joints[k].name: JointQuantity(value, dimensions[robot.joints[k].type])
        for k, value in held_joints(robot, task).items()
    }
    near = NearPosture(kind="near_posture", posture=values, weight=_DISTANCE_WEIGHT)
    others = tuple(term for term in task.subject_to if not term.held(robot))
    return task.model_copy(update={"subject_to": others, "minimize": (near,)})


def explain_held(robot: Robot, held: Mapping[int, float], q: Array) -> Explanation:
    """Which held joints would have to stand elsewhere, by the nearest posture (n,) with all of them free."""
    reasons, changes, cost = [], [], 0.0
    for k, value in held.items():
        joint, amount = robot.joints[k], abs(float(q[k]) - value)
        if amount > ROW_TOLERANCE:
            there, here = joint_text(float(q[k]), joint.unit), joint_text(value, joint.unit)
            message = f"{joint.name} is held at {here}; the task can be done with it at {there}"
            reasons.append(Reason(f"fixed_joints of {joint.name}", message, amount, joint.unit))
            changes.append(f"hold {joint.name} at {there} (now {here})")
            cost += amount
    posture = Posture(robot, q)
    return Explanation(q, tuple(reasons), (Relaxation(" and ".join(changes), tuple(reasons), posture, cost),))
