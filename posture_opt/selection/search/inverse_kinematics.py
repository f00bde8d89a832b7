"""Feasible first: damped least squares from many random postures onto the target, all rows of a batch at once.

Random starts under hard equality constraints fail an interior-point method about every second time, and it
then calls a reachable target infeasible. The damped least squares step used here is Sugihara's (2011,
eq. 27–30): the damping is proportional to the squared error, so that it is robust far away and quadratic close by.
A joint at a limit that the gradient pushes outward is held for the step, as in the projected Newton method (Bertsekas
1982): clipped steps stall near the limits, and of a Panda's random postures 65 % arrive instead of 50 %.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca
import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.model.c_source import c_file
from posture_opt.model.chain import stack
from posture_opt.model.compiled import BatchFunction, RowLoop
from posture_opt.numerics import Array
from posture_opt.robot.posture import drawn_between
from posture_opt.selection.program.optimisation_problem import Alignment
from posture_opt.selection.program.task_target import FREE, Reach, TaskTarget, spin_axis
from posture_opt.selection.tasks import Task

ROW_TOLERANCE = 1e-6  # largest violation of a row [m, rad or 1] of a posture that counts as feasible
TOLERANCE = 1e-7  # largest error [m and rad, combined] of a posture that counts as feasible
STEPS = 20  # what has not arrived by then is given up: on 36 arms the fewest steps for an arrival, failures counted
PATIENT_STEPS = 48  # where nothing arrived: near a singular posture steps converge slowly
STALL_WINDOW = 5  # a part of the steps in which an error that falls by less than `STALL_RATIO` will not get to zero:
STALL_RATIO = 0.9  # of a Panda's arrivals 4 % are lost, and each costs a quarter fewer steps; of a UR10's 1 % and 13 %
LONGEST_IK_STEP = 1.0  # rad or m: longer steps of a linear model of a rotation mean nothing


_LOOP = c_file("posture_opt.selection.search", "inverse_kinematics.c", {"WINDOW": STALL_WINDOW, "RATIO": STALL_RATIO})


class InverseKinematics:
    """The batch solver of one robot and tool axis, for positions in the span of U = ``directions`` (3, r).

    The residual of a row is ``(w₁ Uᵀ(x − x*), w₂ (a − a*), w₃ (s − s*))`` with the tool point x [m], the tool axis a
    and the spin vector s, world; parts within a slack or a cone do not count. ``step``: ``(q, request) -> (next q,
    error)``; joints ``whole`` are drawn between their limits, however wide.
    """

    def __init__(
        self,
        arm: Arm,
        tool_axis: tuple[float, float, float],
        directions: Array,
        compiled: bool | None,
        *,
        spun: bool = False,
        whole: Collection[int] = (),
    ) -> None:
        self._drawn = drawn_between(arm.robot, whole)
        self._compiled = compiled
        self.step: ca.Function = _step_function(arm, tool_axis, directions, spun)

    @cached_property
    def _loop(self) -> RowLoop:
        return RowLoop({"ik_step": self.step}, _LOOP, self._compiled)

    @cached_property
    def _batch(self) -> BatchFunction:
        return BatchFunction(self.step, compiled=False)

    def random_postures(self, count: int, rng: np.random.Generator) -> Array:
        """(count, n) uniform postures between the limits, in one turn where turns are alike."""
        low, high = self._drawn
        return rng.uniform(low, high, (count, len(low)))

    def stepped(self, Q: Array, request: Array) -> tuple[Array, Array]:
        """One step of each posture (N, n) [rad or m] towards its row of the request (N, 16), and the errors (N,) before
        it.
        """
        moved, error = self._batch(Q, request)
        return moved, error[:, 0]

    def solve(
        self, Q: Array, request: PoseRequest, enough: int | None = None, steps: int = PATIENT_STEPS
    ) -> tuple[Array, Array]:
        """Move postures Q (N, n) onto the request (N rows, or one): the nearest ones (N, n) and their errors (N,).

        A row ends on arrival, when its error no longer falls, or after ``steps``; after ``enough`` arrivals the others
        have an infinite error.
        """
        best, error = np.ascontiguousarray(Q).copy(), np.full(len(Q), np.inf)
        rows, wanted = np.ascontiguousarray(request.rows), len(Q) if enough is None else enough
        if self._loop.compiled:
            stride = rows.shape[1] if len(rows) > 1 else 0
            self._loop(len(best), best.shape[1], best, rows, stride, steps, wanted, TOLERANCE, error)
        else:
            self._solve_interpreted(best, error, rows, wanted, steps)
        return best, error

    def _solve_interpreted(self, best: Array, error: Array, targets: Array, wanted: int, steps: int) -> None:
        rows, now, window = np.arange(len(best)), best.copy(), steps // STALL_WINDOW
        past = np.full((steps, len(best)), np.inf)
        for k in range(steps):
            moved, distance = self.stepped(now, targets)
            better = distance < error[rows]
            best[rows[better]], error[rows[better]] = now[better], distance[better]
            past[k, rows] = distance
            alive = distance >= TOLERANCE
            if k >= window:
                alive &= distance < STALL_RATIO * past[k - window, rows]
            if not np.any(alive):
                break
            rows, now = rows[alive], moved[alive]
            targets = targets[alive] if len(targets) == len(alive) else targets
        after = np.cumsum(error < TOLERANCE) - (error < TOLERANCE) >= wanted
        error[after] = np.inf

    def reached(self, groups: Sequence[Array], requests: Sequence[PoseRequest]) -> list[Array]:
        """Postures of each group (M, n) that reach its request, in one batch with the first one's weights."""
        rows = [np.broadcast_to(request.rows, (len(Q), WIDTH)) for request, Q in zip(requests, groups, strict=True)]
        position, axis, spin, _, slack, cone = np.split(np.vstack(rows), PARTS[1:-1], axis=1)
        batch = PoseRequest(position, axis, spin, requests[0].weights, slack, cone)
        moved, errors = self.solve(np.vstack(groups), batch)
        ends = np.cumsum([len(Q) for Q in groups])[:-1]
        parts = zip(np.split(moved, ends), np.split(errors < TOLERANCE, ends), strict=True)
        return [postures[arrived] for postures, arrived in parts]


def unlimited(arm: Arm) -> Arm:
    """The arm with joints that turn freely and slides that go far."""
    joints = tuple(
        replace(j, lower=-2 * np.pi, upper=2 * np.pi)
        if j.type == "revolute"
        else replace(j, lower=j.lower - 10.0, upper=j.upper + 10.0)
        for j in arm.robot.joints
    )
    return replace(arm, robot=replace(arm.robot, joints=joints))


def axis_can_reach(arm: Arm, tool_axis: tuple[float, float, float], target: TaskTarget, slack: float) -> bool:
    """Whether the tool axis can come within tilt and ``slack`` [rad] of the wanted one, joints turning freely."""
    ik = InverseKinematics(unlimited(arm), tool_axis, np.eye(3), compiled=False)
    request = PoseRequest(np.zeros(3), target.axis, target.axis_basis[:, 0], np.array([0.0, 1.0, 0.0]))
    _, errors = ik.solve(ik.random_postures(64, np.random.default_rng(0)), request)
    return bool(np.min(errors) <= 2 * np.sin(target.tilt / 2) + slack)


def _step_function(arm: Arm, tool_axis: tuple[float, float, float], directions: Array, spun: bool) -> ca.Function:
    """``(q, request) -> (next q, error at q)``: ``dq = −(JᵀJ + (λ ‖r‖² + μ) I)⁻¹ Jᵀ r`` within the limits.

    r is the residual, J its Jacobian, columns of held joints zero; dq is shortened to `LONGEST_IK_STEP`, then clipped.
    """
    q, request = ca.SX.sym("q", arm.robot.n), ca.SX.sym("request", WIDTH)
    position, axis, spin, weights, slack, cone = ca.vertsplit(request, list(PARTS))
    robot, reached = arm.robot, arm.walk(q)
    R = ca.SX(stack(list(zip(*reached.columns, strict=True))))
    a, b = np.array(tool_axis) / np.linalg.norm(tool_axis), spin_axis(tool_axis)
    # a - d has its only minimum at a = d; the cross product would also vanish with the tool upside down.
    residual = ca.vertcat(
        weights[0] * (ca.SX(directions.T) @ _beyond(ca.SX(stack(reached.position)) - position, slack)),
        weights[1] * _outside_cone(R @ ca.DM(a) - axis, cone),
        weights[2] * (R @ ca.DM(b) - spin) if spun else ca.SX(0, 1),
    )
    J = ca.densify(ca.jacobian(residual, q))
    squared, slope = ca.sumsqr(residual), J.T @ residual
    lower, upper = ca.DM(robot.lower), ca.DM(robot.upper)
    held = ca.fmax((q <= lower) * (slope > 0), (q >= upper) * (slope < 0))
    J = J * ca.repmat((1 - held).T, J.shape[0], 1)
    # A half (Sugihara 2011, eq. 27 to 30) takes a third more steps; the bias keeps the last ones quadratic
    damping = 0.1 * squared + 1e-9
    dq = -ca.ldl_solve((1 - held) * slope, *ca.ldl(J.T @ J + damping * ca.SX.eye(robot.n), False))
    longest = ca.mmax(ca.fabs(dq))
    dq = dq * LONGEST_IK_STEP / ca.fmax(longest, LONGEST_IK_STEP)
    moved = ca.fmin(ca.fmax(q + dq, lower), upper)
    return ca.Function("ik_step", [q, request], ca.cse([moved, ca.sqrt(squared)]))


def _beyond(offset: ca.SX, slack: ca.SX) -> ca.SX:
    """How far an offset (r,) lies outside a box of half sides ``slack`` (r,) about zero [m]; zero within."""
    return ca.fmax(offset - slack, 0) + ca.fmin(offset + slack, 0)


def _outside_cone(difference: ca.SX, cone: ca.SX) -> ca.SX:
    """The part (3,) of a difference of unit vectors that lies beyond the length ``cone``; zero within the cone."""
    length = ca.sqrt(ca.sumsqr(difference) + 1e-24)
    return difference * ca.fmax(1 - cone / length, 0)


PARTS = (0, 3, 6, 9, 12, 15, 16)  # where position, axis, spin, weights, slack and cone of a request begin
WIDTH = PARTS[-1]  # numbers of one request
_INSIDE = 0.999  # of the tilt: an axis drawn a little inside the cone satisfies the row, an inequality


@dataclass(frozen=True)
class PoseRequest:
    """What every row of a batch is to reach, as weighted residuals."""

    position: Array  # (N, 3) or (3,) tool point [m]
    axis: Array  # (N, 3) or (3,) tool axis, world
    spin: Array  # (N, 3) or (3,) spin vector, world
    weights: Array  # (3,) of position, axis, spin; zero leaves a part out
    slack: Array = field(
        default_factory=lambda: np.zeros(3)
    )  # (N, 3) or (3,) half sides of a box [m] as good as the point
    cone: Array = field(default_factory=lambda: np.zeros(1))  # (N, 1) or (1,) distance as good as ``axis``

    @property
    def rows(self) -> Array:
        """(N, 16) or (1, 16) all parts side by side, as the step takes them."""
        parts = (self.position, self.axis, self.spin, self.weights, self.slack, self.cone)
        rows = np.empty((max(len(part) if part.ndim == 2 else 1 for part in parts), WIDTH))
        for part, first in zip(parts, PARTS, strict=False):
            rows[:, first : first + part.shape[-1]] = part
        return rows


def request_for(
    target: TaskTarget,
    count: int,
    aligned: bool,
    rng: np.random.Generator,
    *,
    whole_box: bool = False,
    slack_of_axis: float = 0.0,
) -> PoseRequest:
    """What ``count`` starts aim at: the point, or points of the region; axes within the tilt, where ``aligned``.

    ``whole_box``: any point of the region, as an arm with few joints cannot align its tool at a drawn one;
    ``slack_of_axis`` [rad] is as good as none.
    """
    anywhere = target.kind == "anywhere"
    position, slack = np.zeros(3) if anywhere else target.lower, np.zeros(3)
    if target.kind == "region":
        # Half of the starts aim at drawn points; the others take any point, as a branch must that reaches a part only.
        position = rng.uniform(target.lower, target.upper, (count, 3))
        any_point = np.full(count, True) if whole_box else np.arange(count) // 2 % 2 == 1
        position[any_point] = (target.lower + target.upper) / 2
        slack = np.where(any_point[:, None], (target.upper - target.lower) / 2, 0.0)
    axis, cone = target.axis, np.array([slack_of_axis])
    if aligned and target.tilt > 0:
        # Half of the starts aim at drawn axes; the others take any axis of the cone, as an arm must that cannot
        # turn its tool everywhere.
        axis, any_axis = _within_tilt(target, count, rng), np.arange(count) % 2 == 1
        axis[any_axis] = target.axis
        cone = np.where(any_axis, 2 * np.sin(_INSIDE * target.tilt / 2), 0.0)[:, None]
    weights = np.array([0.0 if anywhere else 1.0, 1.0 if aligned else 0.0, float(target.spun)])
    assert np.all(np.abs(position) < FREE)
    return PoseRequest(position, axis, target.spin, weights, slack, cone)


def held_request(target: TaskTarget, aligned: bool, slack_of_axis: float) -> PoseRequest:
    """What holds a posture on its target and no more: any point of a region, any axis within the tilt."""
    anywhere = target.kind == "anywhere"
    middle, half = (target.lower + target.upper) / 2, (target.upper - target.lower) / 2
    weights = np.array([0.0 if anywhere else 1.0, 1.0 if aligned else 0.0, float(target.spun)])
    cone = max(2 * np.sin(target.tilt / 2), slack_of_axis)
    return PoseRequest(middle, target.axis, target.spin, weights, half, np.array([cone]))


def _within_tilt(target: TaskTarget, count: int, rng: np.random.Generator) -> Array:
    """(count, 3) unit vectors spread by area over the cone of the tilt, every fourth one straight."""
    tilt = _INSIDE * target.tilt * np.sqrt(rng.uniform(size=count)) * (np.arange(count) % 4 != 0)
    turn = rng.uniform(0, 2 * np.pi, count)
    sideways = np.cos(turn)[:, None] * target.axis_basis[:, 0] + np.sin(turn)[:, None] * target.axis_basis[:, 1]
    return np.asarray(np.cos(tilt)[:, None] * target.axis + np.sin(tilt)[:, None] * sideways)


@dataclass(frozen=True)
class Aligner:
    """What the arm can give of the tool axis: of some arms and targets that is found by trying."""

    arm: Arm
    task: Task
    reach: Reach
    compiled: bool | None  # None: where a C compiler is found
    whole: Arm  # with all joints and ranges, where ``arm`` has fewer

    def at(self, target: TaskTarget) -> Alignment:
        """``free``: the axis is not constrained; ``exact``: two rows hold it; ``loose``: held within a slack."""
        given = self._given(target)
        if (
            given == "free"
            and self.whole is not self.arm
            and Aligner(self.whole, self.task, Reach.of(self.whole, self.task.tool_axis), self.compiled, self.whole).at(
                target
            )
            != "free"
        ):
            return "loose"
        return given

    def _given(self, target: TaskTarget) -> Alignment:
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
        # Where one in 20 arrives aligned, all 96 fail at 0.7 % of the targets
        request = request_for(target, 96, True, rng, whole_box=True, slack_of_axis=slack)
        return bool(np.min(ik.solve(ik.random_postures(96, rng), request, enough=1)[1]) < TOLERANCE)

    @cached_property
    def _trial(self) -> InverseKinematics:
        return InverseKinematics(self.arm, self.task.tool_axis, self.reach.directions, self.compiled)
