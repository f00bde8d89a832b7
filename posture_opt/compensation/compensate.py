"""``compensate``: joint values with which this arm, flaws and all, brings its tool to targets."""

from __future__ import annotations

import math
from dataclasses import replace

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
from posture_opt.compensation.starting_postures import starting_postures
from posture_opt.compensation.targets import Targets, read_targets
from posture_opt.compensation.task_postures import broken_requirements
from posture_opt.errors import NoSolutionError
from posture_opt.interrupts import interruptible
from posture_opt.measurements.table import TableLike
from posture_opt.model.arm import Arm
from posture_opt.model.chain import stretched
from posture_opt.numerics import Array, Mask
from posture_opt.selection.problem_data import ProblemData, with_fallbacks
from posture_opt.selection.program.optimisation_problem import with_held_joints
from posture_opt.uncertainty.spread.joint_digits import joint_digits
from posture_opt.units import number


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
