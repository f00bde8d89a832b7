"""``compensate``: joint values with which this arm, flaws and all, brings its tool to targets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from posture_opt.compensation.compensation import (
    Arrivals,
    Compensation,
    arrivals_of,
    expected_miss,
    joint_column,
    sided_joints,
)
from posture_opt.compensation.nearest_postures import NearestPostures, Poses
from posture_opt.compensation.targets import Targets, read_targets
from posture_opt.compensation.task_postures import Found, TaskPostures, broken_requirements
from posture_opt.errors import InputError, NoSolutionError
from posture_opt.interrupts import interruptible
from posture_opt.measurements.table import TableLike
from posture_opt.model.arm import Arm
from posture_opt.model.chain import stretched
from posture_opt.numerics import Array, Mask
from posture_opt.robot.posture import drawn_between
from posture_opt.robot.robot import Robot
from posture_opt.selection.answer.other_postures import configurations
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData, with_fallbacks
from posture_opt.selection.program.optimisation_problem import with_held_joints
from posture_opt.selection.program.task_target import spin_axis
from posture_opt.selection.search.inverse_kinematics import InverseKinematics, PoseRequest
from posture_opt.selection.select_posture import select_posture
from posture_opt.selection.tasks import Task
from posture_opt.statements import Statement, state
from posture_opt.uncertainty.joint_digits import joint_digits
from posture_opt.units import number

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


@interruptible()
def compensate(problem: ProblemData, targets: TableLike | Targets) -> Compensation:
    """The joint values that bring the tool of the arm of ``problem``, corrections and effects included, to targets.

    Of all postures that do, each row's is the one with the smallest sum of squared joint motions [rad, m] from the
    posture given for it, ``min |q − q_near|²`` subject to ``f(q, u) = target`` and the limits. Without joint columns
    the posture of the nominal arm takes its place. The side from which a joint arrives, and how far it moved, is that
    of its ``approach`` column, or follows from the row before as it is commanded; the first row's is the task's. An arm
    with too few joints for an orientation comes as near to it as it can.

    Args:
        problem: names ``arm``, ``nominal`` and ``sources``: a calibrated or extended problem.
        targets: the path of a CSV file, a table, or `read_targets`.

    Returns:
        ``Compensation``: ``q`` (N, n) [rad or m], and of each target how far the tool would be ``off`` and is
        ``left`` [m], (N,).

    Raises:
        InputError: everything wrong with the targets, each with line and column.
        NoSolutionError: targets out of reach, each with its line; ``solution`` is the compensation with what comes
            nearest.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_calibrated")
        >>> found = po.compensate(problem, {"x [mm]": [1000.0, 1100.0], "y [mm]": [300.0, 300.0]})
        >>> found.q.shape, bool(found.reached.all()), bool((found.before.off < 1e-6).all())
        ((2, 2), True, True)
    """
    rows = targets if isinstance(targets, Targets) else read_targets(targets, problem.robot)
    return with_fallbacks(problem, lambda one: _compensated(one, rows))


def _compensated(problem: ProblemData, rows: Targets) -> Compensation:
    arm = problem.arm if problem.task is None else with_held_joints(problem.arm, problem.task)
    wanted, solver = _wanted_poses(problem, rows), NearestPostures(arm.robot)
    start = starting_postures(problem, solver, rows, wanted)
    exact, solved_for, reached = _settled_postures(arm, solver, rows, start.aim, start.kept)
    digits, q = joint_digits(problem, exact), exact.copy()
    for j, joint in enumerate(problem.robot.joints):  # as they are written, in the unit of each column
        _, factor = joint_column(rows, joint)
        q[:, j] = np.round(exact[:, j] / factor, digits.decimals(joint, factor)) * factor
    came = arrivals_of(arm, rows, q)
    bent, bare = arm.under(came.inputs(arm, rows)), Arm(arm.robot)
    p, p_bare = (np.asarray(of.position(q), dtype=float) for of in (bent, bare))
    away = solver.off_plane(p, p - p_bare, wanted)
    refused = {
        int(k): f"the target lies {number(1e3 * away[k])} mm outside the plane that this arm moves in"
        for k in np.flatnonzero(away)
    } | dict(start.refused)
    met = reached & ~np.isin(np.arange(len(q)), list(refused))
    refused |= broken_requirements(problem, q, start.kept, np.flatnonzero(met))
    reached[list(refused)] = False
    found = Compensation(
        problem, rows, wanted, start.near, q, digits, reached, refused, start.notes,
        before=expected_miss(arm, problem.sources, rows, wanted, start.near, arrivals_of(arm, rows, start.near)),
        after=expected_miss(arm, problem.sources, rows, wanted, q, came),
        side=came.side, unsettled=sided_joints(arm) & (came.side != solved_for.side),
    )  # fmt: skip
    if not reached.all():
        raise NoSolutionError(_refusal_text(found), found)
    return found


def _wanted_poses(problem: ProblemData, rows: Targets) -> Poses:
    if rows.position is not None:
        return Poses(rows.position, rows.rotation)
    assert rows.near is not None, "without a place there are joints"
    T = np.asarray(Arm(problem.nominal).pose(rows.near), dtype=float)
    return Poses(T[:, :3, 3], T[:, :3, :3])


def _settled_postures(
    arm: Arm, solver: NearestPostures, rows: Targets, wanted: Poses, near: Array
) -> tuple[Array, Arrivals, Mask]:
    """Postures (N, n) [rad or m], effects subtracted and the chain solved in turn; their arrivals; which arrive."""
    if not arm.effects:
        q = solver.solve(wanted, near)
        return q, arrivals_of(arm, rows, q), solver.reached(q, wanted)
    q, came, aimed = near, arrivals_of(arm, rows, near), wanted
    for round_ in range(40):  # effects of a thousandth of a joint's motion converge in five
        aimed = _without_effects(arm.under(came.inputs(arm, rows)), wanted, q)
        moved = solver.solve(aimed, near, q)
        there = solver.reached(moved, aimed)  # the others would not converge
        change, q = float(np.abs(moved - q)[there].max(initial=0.0)), moved
        fresh = arrivals_of(arm, rows, q)
        if round_ >= 12:  # a side that hardly moves may not converge
            fresh = Arrivals(came.side, fresh.way)
        if change < 1e-10 and (fresh.side == came.side).all():  # rad or m
            break
        came = fresh
    return q, came, solver.reached(q, aimed)


def _without_effects(arm: Arm, wanted: Poses, q: Array) -> Poses:
    """``p_chain = p_wanted − (p_arm − p_bare)``, ``R_chain = (R_arm R_bareᵀ)ᵀ R_wanted`` at postures q (N, n)."""
    T, bare = np.asarray(arm.pose(q), dtype=float), np.asarray(Arm(arm.robot).pose(q), dtype=float)
    position = wanted.position - (T[:, :3, 3] - bare[:, :3, 3])
    back = (T[:, :3, :3] @ bare[:, :3, :3].transpose(0, 2, 1)).transpose(0, 2, 1)
    rotation = None if wanted.rotation is None else back @ wanted.rotation
    axis = None if wanted.axis is None else np.einsum("nij,nj->ni", back, wanted.axis)
    return replace(wanted, position=position, rotation=rotation, axis=axis)


def _refusal_text(found: Compensation) -> str:
    bad, targets = np.flatnonzero(~found.reached), found.targets
    lines = [f"{len(bad)} of {len(found)} targets cannot be reached"]
    for k in bad[:20].tolist():
        lines.append(f"{targets.file}:{targets.line[k]}: {found.reasons.get(k) or _unreached_reason(found, k)}")
    lines += [f"and {len(bad) - 20} more"] if len(bad) > 20 else []
    lines += _common_hint(found)
    if targets.near is not None and targets.position is not None and found.reasons:
        hint = (
            "postures stay near the joint values of the file: without these columns others are found, if there are any"
        )
        lines.append(hint)
    return "\n".join(lines)


def _unreached_reason(found: Compensation, k: int) -> str:
    robot = found.problem.robot
    held = [
        f"{joint.name} at its {'upper' if value > (joint.lower + joint.upper) / 2 else 'lower'} limit"
        for joint, value in zip(robot.joints, found.q[k], strict=True)
        if min(value - joint.lower, joint.upper - value) < max(1e-9, found.digits.turn)
    ]
    because = f" ({', '.join(held)})" if held else ""
    off, turned = found.after.off[k], found.after.turned[k]
    if off > 10 * found.digits.turn * robot.length + 1e-6:
        return f"the tool point stays {number(1e3 * off)} mm away{because}"
    return f"the tool comes there only turned by {number(math.degrees(turned))} deg{because}"


def _common_hint(found: Compensation) -> list[str]:
    first, longest = stretched(found.problem.robot)
    away = np.linalg.norm(found.wanted.position - first, axis=1)
    if not (away > longest).all():
        return []
    stretches = f"the arm stretches to {longest * 1e3:.0f} mm"
    if float(away.min()) > 3.0 * longest:
        return [f"{stretches}: is the unit of x, y, z right?"]
    origin = ", ".join(f"{1e3 * float(x):.0f}" for x in first)
    return [
        f"{stretches} from its first joint, at ({origin}) mm in the world frame of the problem file: "
        'if the targets are in the frame of the robot, add --base "0, 0, 0"'
    ]
