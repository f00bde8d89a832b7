"""Where the compensation of each target starts: joint values that were given, those near the plan, or of a search."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from posture_opt.compensation.nearest_postures import NearestPostures, Poses
from posture_opt.compensation.targets import Targets
from posture_opt.compensation.task_postures import Found, TaskPostures
from posture_opt.errors import InputError, NoSolutionError
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.posture import drawn_between
from posture_opt.robot.robot import Robot
from posture_opt.selection.answer.other_postures import configurations
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.task_target import spin_axis
from posture_opt.selection.search.inverse_kinematics import InverseKinematics, PoseRequest
from posture_opt.selection.select_posture import select_posture
from posture_opt.selection.tasks import Task
from posture_opt.statements import Statement, state

_TOOL_AXIS = (0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class StartingPostures:
    """Where the compensation of N targets starts."""

    near: Array  # (N, n) joint values of the arm without corrections and effects, given or found [rad or m]
    kept: Array  # (N, n) postures to stay near: those given, or those at which this arm meets what the task requires
    aim: Poses  # the poses to be reached, with what is held of the orientation
    refused: Mapping[int, str] = field(default_factory=dict)  # row -> why its target is refused
    notes: tuple[Statement, ...] = ()  # what the reader should know of them


def starting_postures(problem: ProblemData, solver: NearestPostures, rows: Targets, wanted: Poses) -> StartingPostures:
    """Joint values of the file, else postures near the plan of the task."""
    if rows.near is not None:
        aim = wanted if wanted.rotation is not None else _axis_held(problem, wanted, rows.near)
        return StartingPostures(rows.near, rows.near, aim)
    if wanted.rotation is not None and solver.turns < 3:
        near = _searched_postures(problem.nominal, solver, wanted)
        return StartingPostures(near, near, wanted)
    return _near_plan(problem, wanted)


def _near_plan(problem: ProblemData, wanted: Poses) -> StartingPostures:
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
    found = _in_fewest_configurations(search, found, wanted.position, wanted.rotation)
    kept = np.array([one.q for one in found])
    refused = {row: one.reason for row, one in enumerate(found) if one.reason}
    aim = wanted if wanted.rotation is not None else _axis_held(problem, wanted, kept, as_reached=True)
    # Nothing is to be solved for what is refused: its poses are those that it has.
    rows, T = list(refused), np.asarray(problem.arm.pose(kept), dtype=float)
    position, rotation = aim.position.copy(), None if aim.rotation is None else aim.rotation.copy()
    position[rows] = T[rows, :3, 3]
    if rotation is not None:
        rotation[rows] = T[rows, :3, :3]
    aim = replace(aim, position=position, rotation=rotation)
    return StartingPostures(NearestPostures(problem.nominal).solve(aim, kept), kept, aim, refused, notes)


def _in_fewest_configurations(search: TaskPostures, found: Sequence[Found], p: Array, R: Array | None) -> list[Found]:
    """Postures at p (N, 3) [m], R (N, 3, 3) with the fewest changes of configuration, then the least motion."""
    robot = search.problem.robot
    rows = [k for k, one in enumerate(found) if not one.reason]
    named = configurations(robot, np.reshape([found[k].q for k in rows], (-1, robot.n)))
    if len(set(named)) < 2:
        return [*found]
    ways: list[tuple[float, list[tuple[tuple[str, ...], Array]]]] = [(0.0, [])]
    for k, name in zip(rows, named, strict=True):
        options = {**search.branches(p[k], None if R is None else R[k]), name: found[k].q}
        ways = [
            min(((cost + _step(way, end), [*way, end]) for cost, way in ways), key=lambda one: one[0])
            for end in options.items()
        ]
    _, way = min(ways, key=lambda one: one[0])
    best = dict(zip(rows, (q for _, q in way), strict=True))
    return [Found(best[k]) if k in best else one for k, one in enumerate(found)]


def _step(way: Sequence[tuple[tuple[str, ...], Array]], end: tuple[tuple[str, ...], Array]) -> float:
    """Cost of the next posture [rad]: a change of configuration is more than all joints together move."""
    if not way:
        return 0.0
    name, q = way[-1]
    return 1e3 * (name != end[0]) + float(np.abs(q - end[1]).max())


def _axis_held(problem: ProblemData, wanted: Poses, q: Array, *, as_reached: bool = False) -> Poses:
    """Points with the tool axis held as postures q (N, n) have it, else brought within the tilt."""
    task = problem.task
    if task is None or task.axis_request == "free":
        return wanted
    size = math.hypot(*task.tool_axis)
    x, y, z = (component / size for component in task.tool_axis)
    tool_axis = (x, y, z)
    axis = np.asarray(problem.arm.pose(q), dtype=float)[:, :3, :3] @ np.array(tool_axis)
    if not as_reached:
        axis = _within_tilt(task, axis)
    return replace(wanted, axis=axis, tool_axis=tool_axis)


def _within_tilt(task: Task, axis: Array) -> Array:
    """Axes (N, 3) brought within the tilt where they are at most 1 deg beyond it; else NaN, which holds nothing."""
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
    return np.where((angle <= task.tilt + math.radians(1.0))[:, None], held, np.nan)


def _searched_postures(drawn: Robot, chain: NearestPostures, wanted: Poses) -> Array:
    """Postures (N, n) [rad or m] of the nominal arm at poses that ``chain`` reaches, from those before or random."""
    before = np.mean(drawn_between(chain.robot), axis=0)
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
    led, errors = search.solve(search.random_postures(200, rng), request)
    led = led[np.argsort(errors, kind="stable")[:24]]
    every = one.repeated(len(led))
    led = chain.followed(every, np.broadcast_to(before, led.shape), led)
    left = chain.misses(led, every)
    off = np.linalg.norm(left.position @ chain.directions, axis=1) + np.linalg.norm(left.rotation, axis=1)
    good = off <= off.min() + (1e-3 if chain.turns < 3 else 1e-6)  # rad
    distance = np.where(good, np.abs(led - before).max(axis=1), np.inf)
    return chain.solve(one, before[None], led[[int(np.argmin(distance))]])
