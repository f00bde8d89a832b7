"""Where the compensation of each target starts: joint values that were given, those near the plan, or of a search."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from posture_opt.compensation.configuration_choice import in_fewest_configurations
from posture_opt.compensation.nearest_postures import NearestPostures, Poses
from posture_opt.compensation.targets import Targets
from posture_opt.compensation.task_postures import Found, TaskPostures
from posture_opt.errors import InputError, NoSolutionError
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.joint_ranges import drawn_between
from posture_opt.robot.robot import Robot
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.pose_request import PoseRequest
from posture_opt.selection.program.task_target import spin_axis
from posture_opt.selection.search.inverse_kinematics import InverseKinematics
from posture_opt.selection.select_posture import select_posture
from posture_opt.selection.tasks import Task
from posture_opt.statements import Statement, state

_TOOL_AXIS = (0.0, 0.0, 1.0)
_RANDOM_STARTS = 200  # random postures that are led to a target which the posture before it does not lead to
_KEPT_STARTS = 24  # of them, those that come nearest
_SAME_ORIENTATION_RAD = 1e-3  # rad: orientations that are as near as each other
_ALONG_RAD = math.radians(1.0)  # a tool axis that is no farther off the task's direction is meant to be along it


@dataclass(frozen=True, eq=False)
class StartingPostures:
    """Where the compensation of N targets starts.

    Args:
        near: (N, n) joint values of the arm without corrections and effects, given or found [rad or m].
        kept: (N, n) postures to stay near: those given, or those at which this arm meets what the task requires.
        aim: the poses to be reached, with what is held of the orientation.
        refused: row -> why its target is refused.
        notes: what the reader should know of them.
    """

    near: Array
    kept: Array
    aim: Poses
    refused: Mapping[int, str] = field(default_factory=dict)
    notes: tuple[Statement, ...] = ()


def starting_postures(
    problem: ProblemData, solver: NearestPostures, rows: Targets, wanted: Poses
) -> StartingPostures:  # fmt: skip
    """The postures to start from: the file's joint values, else near the plan of the task.

    Where joint values or the task bring the tool axis along the direction of the task, it is held within the tilt.

    Args:
        solver: of the arm with its corrections.
        wanted: N poses, world.
    """
    if rows.near is not None:
        aim = wanted if wanted.rotation is not None else _axis_held(problem, wanted, rows.near)
        return StartingPostures(rows.near, rows.near, aim)
    if wanted.rotation is not None and solver.turns < 3:
        near = searched_postures(problem.nominal, solver, wanted)
        return StartingPostures(near, near, wanted)
    return _near_plan(problem, wanted)


def _near_plan(problem: ProblemData, wanted: Poses) -> StartingPostures:
    """The postures that the task allows at the targets, near those of its plan."""
    plan: tuple[Solution, ...] = ()
    notes: tuple[Statement, ...] = ()
    if problem.task is not None:
        try:
            plan = select_posture(problem).stations
        except (NoSolutionError, InputError):
            notes = (state("compensation.near-first-row"),)
    search = TaskPostures(problem, plan, wanted.rotation is not None)
    found: list[Found] = []
    for row, p in enumerate(wanted.position):
        R = None if wanted.rotation is None else wanted.rotation[row]
        found.append(search.at(p, R, found[-1].q if found else None))
    found = in_fewest_configurations(search, found, wanted.position, wanted.rotation)
    kept = np.array([one.q for one in found])
    refused = {row: one.reason for row, one in enumerate(found) if one.reason}
    aim = wanted if wanted.rotation is not None else _axis_held(problem, wanted, kept, as_reached=True)
    aim = _standing(problem, aim, kept, list(refused))
    return StartingPostures(NearestPostures(problem.nominal).solve(aim, kept), kept, aim, refused, notes)


def _standing(problem: ProblemData, aim: Poses, q: Array, rows: list[int]) -> Poses:
    """The poses, of some rows those that postures q (N, n) have: nothing is to be solved for what is refused."""
    T = np.asarray(problem.arm.pose(q), dtype=float)
    position, rotation = aim.position.copy(), None if aim.rotation is None else aim.rotation.copy()
    position[rows] = T[rows, :3, 3]
    if rotation is not None:
        rotation[rows] = T[rows, :3, :3]
    return replace(aim, position=position, rotation=rotation)


def _axis_held(problem: ProblemData, wanted: Poses, q: Array, *, as_reached: bool = False) -> Poses:
    """The wanted points, with the tool axis held where postures q (N, n) have it along the direction of the task.

    Args:
        as_reached: hold it as it is, since the postures meet the task; else it is brought within the tilt.
    """
    task = problem.task
    if task is None or task.axis_request == "free":
        return wanted
    x, y, z = task.tool_axis
    size = math.hypot(x, y, z)
    tool_axis = (x / size, y / size, z / size)
    axis = np.asarray(problem.arm.pose(q), dtype=float)[:, :3, :3] @ np.array(tool_axis)
    if not as_reached:
        axis = _within_tilt(task, axis)
    return replace(wanted, axis=axis, tool_axis=tool_axis)


def _within_tilt(task: Task, axis: Array) -> Array:
    """Unit vectors (N, 3) brought within the tilt of the direction, where they are no more than a degree beyond it.

    The others, and those of a workpiece that may be turned, are NaN: nothing is held.
    """
    if task.on_workpiece:
        return np.full_like(axis, np.nan)
    d = np.array(task.direction) / np.linalg.norm(task.direction)
    cosine = axis @ d
    across = axis - cosine[:, None] * d
    sine = np.linalg.norm(across, axis=1)
    angle = np.arctan2(sine, cosine)
    unit = across * np.divide(1.0, sine, out=np.zeros_like(sine), where=sine > 0)[:, None]
    kept = np.minimum(angle, task.tilt)
    held = np.cos(kept)[:, None] * d + np.sin(kept)[:, None] * unit
    return np.where((angle <= task.tilt + _ALONG_RAD)[:, None], held, np.nan)


def searched_postures(drawn: Robot, chain: NearestPostures, wanted: Poses) -> Array:
    """Postures (N, n) [rad or m] of the nominal arm at poses that the ``chain`` with corrections reaches.

    Each row starts from the one before it, so that the arm moves little. The first row, and one that cannot be reached
    so, takes of `_RANDOM_STARTS` random starts the posture nearest to the one before, or to the middle of the joints'
    ranges. Draws are seeded: the same targets give the same postures.

    Args:
        drawn: the robot without corrections; chain: the solver of the robot with them.
        wanted: N poses, world.
    """
    low, high = drawn_between(chain.robot)
    before = (low + high) / 2
    search = InverseKinematics(Arm(chain.robot), _TOOL_AXIS, chain.directions, None, spun=chain.turns >= 3)
    rng, found = np.random.default_rng(0), []
    for row in range(len(wanted.position)):
        one = wanted.take(np.arange(len(wanted.position)) == row)
        q = chain.solve(one, before[None]) if row else before[None]
        if not chain.reached(q, one)[0] and not chain.beyond(one)[0]:
            q = _searched_posture(search, chain, one, before, rng)
        found.append(q[0])
        before = q[0]
    return NearestPostures(drawn).solve(wanted, np.array(found))


def _searched_posture(
    search: InverseKinematics, chain: NearestPostures, one: Poses, before: Array, rng: np.random.Generator
) -> Array:
    """A posture (1, n) that random starts lead to, the nearest to ``before`` (n,); else what comes nearest."""
    oriented = one.rotation is not None and chain.turns >= 3
    R = np.eye(3) if one.rotation is None else one.rotation[0]
    request = PoseRequest(one.position[0], R[:, 2], R @ spin_axis(_TOOL_AXIS), np.array([1.0, *[float(oriented)] * 2]))
    led, errors = search.solve(search.random_postures(_RANDOM_STARTS, rng), request)
    led = led[np.argsort(errors, kind="stable")[:_KEPT_STARTS]]
    every = one.repeated(len(led))
    led = chain.followed(every, np.broadcast_to(before, led.shape), led)
    left = chain.misses(led, every)
    off = np.linalg.norm(left.position @ chain.directions, axis=1) + np.linalg.norm(left.rotation, axis=1)
    good = off <= off.min() + (_SAME_ORIENTATION_RAD if chain.turns < 3 else 1e-6)
    distance = np.where(good, np.abs(led - before).max(axis=1), np.inf)
    return chain.solve(one, before[None], led[[int(np.argmin(distance))]])
