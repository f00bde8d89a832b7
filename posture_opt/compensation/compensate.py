"""``compensate``: joint values with which this arm, flaws and all, brings its tool to targets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.compensation.arrival_sides import Arrivals, arrivals_of, sided_joints
from posture_opt.compensation.compensation import Compensation, joint_column
from posture_opt.compensation.expected_miss import expected_miss
from posture_opt.compensation.nearest_postures import NearestPostures, Poses
from posture_opt.compensation.refusal import refusal_text
from posture_opt.compensation.requirements import Requirements
from posture_opt.compensation.starting_postures import starting_postures
from posture_opt.compensation.targets import Targets, read_targets
from posture_opt.errors import NoSolutionError
from posture_opt.interrupts import interruptible
from posture_opt.measurements.table import TableLike
from posture_opt.model.arm import Arm
from posture_opt.numerics import Array, Mask
from posture_opt.robot.robot import Robot
from posture_opt.selection.answer.held_joints import with_held_joints
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.spread.joint_digits import JointDigits, joint_digits
from posture_opt.units import number

_MAX_ROUNDS = 40  # of effects and chain in turn; effects of a thousandth of a joint's motion converge in five
_FREE_SIDE_ROUNDS = 12  # rounds after which a joint's side stays what it is: one that hardly moves may not converge
_JOINT_TOLERANCE = 1e-10  # rad or m


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
    try:
        return _compensated(problem, rows)
    except NoSolutionError:
        if not problem.above_assumed_mounting:
            raise
    return _compensated(replace(problem, without_mounting=True), rows)


def _compensated(problem: ProblemData, rows: Targets) -> Compensation:
    """The compensation of targets in the cell of a problem, its mounting plane included.

    Raises:
        NoSolutionError: targets that are refused.
    """
    wanted, arm = _wanted_poses(problem, rows), _planned_arm(problem)
    solver = NearestPostures(arm.robot)
    start = starting_postures(problem, solver, rows, wanted)
    exact, solved_for, reached = _settled_postures(arm, solver, rows, start.aim, start.kept)
    digits = joint_digits(problem, exact)
    q = _rounded_joints(problem.robot, rows, exact, digits)
    came = arrivals_of(arm, rows, q)
    refused = {**_off_plane(solver, arm.under(came.inputs(arm, rows)), wanted, q), **start.refused}
    met = reached & ~np.isin(np.arange(len(q)), list(refused))
    refused |= Requirements(problem).broken(q, start.kept, np.flatnonzero(met))
    reached[list(refused)] = False
    found = Compensation(
        problem, rows, wanted, start.near, q, digits, reached, refused, start.notes,
        before=expected_miss(arm, problem.sources, rows, wanted, start.near, arrivals_of(arm, rows, start.near)),
        after=expected_miss(arm, problem.sources, rows, wanted, q, came),
        side=came.side, unsettled=sided_joints(arm) & (came.side != solved_for.side),
    )  # fmt: skip
    if not reached.all():
        raise NoSolutionError(refusal_text(found), found)
    return found


def _planned_arm(problem: ProblemData) -> Arm:
    """The arm, with the joints held that its task holds."""
    return problem.arm if problem.task is None else with_held_joints(problem.arm, problem.task)


def _wanted_poses(problem: ProblemData, rows: Targets) -> Poses:
    """Wanted poses (N, world): as the file says, or where the nominal arm would be with the given joints."""
    if rows.position is not None:
        return Poses(rows.position, rows.rotation)
    assert rows.near is not None, "without a place there are joints"
    T = np.asarray(Arm(problem.nominal).pose(rows.near), dtype=float)
    return Poses(T[:, :3, 3], T[:, :3, :3])


def _settled_postures(
    arm: Arm, solver: NearestPostures, rows: Targets, wanted: Poses, near: Array
) -> tuple[Array, Arrivals, Mask]:
    """Postures (N, n) [rad or m], the arrivals that they were solved for, and whether they reach their poses (N,).

    What effects add at the present postures is subtracted from the targets, the chain is solved for these, and again,
    up to `_MAX_ROUNDS` times: the side from which a joint arrives depends on the postures found. The fixed point
    contracts by the slope of the effects, a thousandth or so.
    """
    if not arm.effects:
        q = solver.solve(wanted, near)
        return q, arrivals_of(arm, rows, q), solver.reached(q, wanted)
    q, came, aimed = near, arrivals_of(arm, rows, near), wanted
    for round_ in range(_MAX_ROUNDS):
        aimed = _without_effects(arm.under(came.inputs(arm, rows)), wanted, q)
        moved = solver.solve(aimed, near, q)
        there = solver.reached(moved, aimed)  # the others would not converge
        change, q = float(np.abs(moved - q)[there].max(initial=0.0)), moved
        fresh = arrivals_of(arm, rows, q)
        if round_ >= _FREE_SIDE_ROUNDS:
            fresh = Arrivals(came.side, fresh.way)
        if change < _JOINT_TOLERANCE and (fresh.side == came.side).all():
            break
        came = fresh
    return q, came, solver.reached(q, aimed)


def _without_effects(arm: Arm, wanted: Poses, q: Array) -> Poses:
    """The poses that the chain has to reach so that the arm with its effects comes to the wanted ones.

    ``p_chain = p_wanted − (p_arm − p_bare)`` and ``R_chain = (R_arm R_bareᵀ)ᵀ R_wanted``, all at the postures q (N, n).
    """
    T, bare = np.asarray(arm.pose(q), dtype=float), np.asarray(Arm(arm.robot).pose(q), dtype=float)
    position = wanted.position - (T[:, :3, 3] - bare[:, :3, 3])
    back = (T[:, :3, :3] @ bare[:, :3, :3].transpose(0, 2, 1)).transpose(0, 2, 1)
    rotation = None if wanted.rotation is None else back @ wanted.rotation
    axis = None if wanted.axis is None else np.einsum("nij,nj->ni", back, wanted.axis)
    return replace(wanted, position=position, rotation=rotation, axis=axis)


def _off_plane(solver: NearestPostures, arm: Arm, wanted: Poses, q: Array) -> dict[int, str]:
    """Row -> why it is refused, of targets outside of the plane that the arm moves in; its postures are q (N, n)."""
    p, bare = np.asarray(arm.position(q), dtype=float), np.asarray(Arm(arm.robot).position(q), dtype=float)
    distance = solver.off_plane(p, p - bare, wanted)
    return {
        int(k): f"the target lies {number(1e3 * distance[k])} mm outside the plane that this arm moves in"
        for k in np.flatnonzero(distance)
    }


def _rounded_joints(robot: Robot, rows: Targets, q: Array, digits: JointDigits) -> Array:
    """Joint values (N, n) [rad or m] as they are written: rounded in the unit of each column."""
    columns = []
    for joint, values in zip(robot.joints, q.T, strict=True):
        _, factor = joint_column(rows, joint)
        columns.append(np.round(values / factor, digits.decimals(joint, factor)) * factor)
    return np.column_stack(columns)
