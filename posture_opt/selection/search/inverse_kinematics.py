"""Feasible first: damped least squares from many random postures onto the target, all rows of a batch at once.

Random starts under hard equality constraints fail an interior-point method about every second time, and it
then calls a reachable target infeasible. The damped least squares step used here is Sugihara's (2011,
eq. 27–30): the damping is proportional to the squared error, so that it is robust far away and quadratic close by.
A joint at a limit that the gradient pushes outward is held for the step, as in the projected Newton method (Bertsekas
1982): clipped steps stall near the limits, and of a Panda's random postures 65 % arrive instead of 50 %.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.model.chain import stack
from posture_opt.model.compiled import BatchFunction
from posture_opt.model.ldl import ldl, solved
from posture_opt.model.row_loop import RowLoop
from posture_opt.numerics import Array
from posture_opt.robot.joint_ranges import drawn_between
from posture_opt.selection.program.pose_request import PARTS, WIDTH, PoseRequest
from posture_opt.selection.program.task_target import TaskTarget, spin_axis

ROW_TOLERANCE = 1e-6
"""Largest violation of a row [m, rad or 1] of a posture that counts as feasible."""
TOLERANCE = 1e-7
"""Largest error [m and rad, combined] of a posture that counts as feasible."""
STEPS = 20
"""What has not arrived by then is given up: on 36 arms the fewest steps for an arrival, failures counted."""
PATIENT_STEPS = 48
"""Where nothing arrived: near a singular posture steps converge slowly."""
STALL_WINDOW = 5  # a part of the steps in which an error that falls by less than `STALL_RATIO` will not get to zero:
STALL_RATIO = 0.9  # of a Panda's arrivals 4 % are lost, and each costs a quarter fewer steps; of a UR10's 1 % and 13 %
LONGEST_IK_STEP = 1.0  # rad or m: longer steps of a linear model of a rotation mean nothing
DAMPING_FACTOR = 0.1  # of the squared error; a half, as Sugihara (2011, eq. 27 to 30) has it, takes a third more steps
DAMPING_BIAS = 1e-9  # rad² or m²: his bias, so small that the last steps stay quadratic


_LOOP = """
long long posture_opt_loop(long long rows, long long n, double* q, const double* request, long long request_step,
    long long steps, long long enough, double tolerance, double* error) {
  po_memory ik = {0};
  long long arrived = 0, row, i, step, window = steps / WINDOW;
  double *space = malloc((2 * n + steps + 1) * sizeof *space), *now = space, *next = space + n, *past = next + n;
  if (!space || !po_open(&ik, ik_step_work)) arrived = -1;
  for (row = 0; row < rows && arrived >= 0 && arrived < enough; ++row) {
    double *best = q + row * n, least = INFINITY, distance;
    for (i = 0; i < n; ++i) now[i] = best[i];
    for (step = 0; step < steps; ++step) {
      double* swap;
      ik.arg[0] = now; ik.arg[1] = request + row * request_step; ik.res[0] = next; ik.res[1] = &distance;
      ik_step(ik.arg, ik.res, ik.iw, ik.w, 0);
      if (distance < least) { least = distance; for (i = 0; i < n; ++i) best[i] = now[i]; }
      if (distance < tolerance) { ++arrived; break; }
      past[step] = distance;
      if (step >= window && !(distance < RATIO * past[step - window])) break;
      swap = now; now = next; next = swap;
    }
    error[row] = least;
  }
  free(space); po_close(&ik);
  return arrived;
}
""".replace("WINDOW", repr(STALL_WINDOW)).replace("RATIO", repr(STALL_RATIO))


class InverseKinematics:
    """The batch solver of one robot and tool axis, for positions in the span of ``directions`` (3, r).

    The residual of a row is ``(w₁ Uᵀ(x − x*), w₂ (a − a*), w₃ (s − s*))`` with the tool point x [m], the tool axis a
    and the spin vector s, all in the world; parts beyond a slack or a cone count, parts within do not.

    Args:
        compiled: None compiles where a C compiler is found; False never; True or an error.
        spun: whether the spin of the tool is part of the residual.
        whole: indices of joints that random postures are drawn for between the limits, however wide.

    Attributes:
        step: ``(q, request) -> (next q, error at q)``.
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
        """All steps of all rows in one call of C."""
        return RowLoop({"ik_step": self.step}, _LOOP, self._compiled)

    @cached_property
    def _batch(self) -> BatchFunction:
        """One step of all rows, interpreted."""
        return BatchFunction(self.step, compiled=False)

    def random_postures(self, count: int, rng: np.random.Generator) -> Array:
        """(count, n) postures drawn uniformly between the limits, in one turn of them where turns are alike."""
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
        """Move the postures (N, n) onto the request; returns the postures reached (N, n) and their errors (N,).

        A row ends when it has arrived, when its error no longer falls, or after ``steps`` steps; the posture of least
        error on its way is kept. Stops early when ``enough`` rows have arrived: those after the last of these have an
        infinite error.

        Args:
            Q: (N, n) starts within the limits [rad or m].
            request: N rows, or one for all.
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
        """The same loop, all rows a step at a time."""
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
        """Of each group of postures (M, n) those (m, n) that reach its request; all are moved in one batch.

        Requests of one batch differ in what is wanted, not in ``weights``: those of the first one count.
        """
        rows = [np.broadcast_to(request.rows, (len(Q), WIDTH)) for request, Q in zip(requests, groups, strict=True)]
        position, axis, spin, _, slack, cone = np.split(np.vstack(rows), PARTS[1:-1], axis=1)
        batch = PoseRequest(position, axis, spin, requests[0].weights, slack, cone)
        moved, errors = self.solve(np.vstack(groups), batch)
        ends = np.cumsum([len(Q) for Q in groups])[:-1]
        parts = zip(np.split(moved, ends), np.split(errors < TOLERANCE, ends), strict=True)
        return [postures[arrived] for postures, arrived in parts]


def unlimited(arm: Arm) -> Arm:
    """The same arm with joints that turn freely and slides that go far."""
    joints = tuple(
        replace(j, lower=-2 * np.pi, upper=2 * np.pi)
        if j.type == "revolute"
        else replace(j, lower=j.lower - 10.0, upper=j.upper + 10.0)
        for j in arm.robot.joints
    )
    return replace(arm, robot=replace(arm.robot, joints=joints))


def axis_can_reach(arm: Arm, tool_axis: tuple[float, float, float], target: TaskTarget, slack: float) -> bool:
    """Whether the tool axis can come within the allowed tilt and ``slack`` [rad] of the wanted one, anywhere.

    Joints turn freely for this question and the position does not count: where it fails, no target would help.
    """
    ik = InverseKinematics(unlimited(arm), tool_axis, np.eye(3), compiled=False)
    request = PoseRequest(np.zeros(3), target.axis, target.axis_basis[:, 0], np.array([0.0, 1.0, 0.0]))
    _, errors = ik.solve(ik.random_postures(64, np.random.default_rng(0)), request)
    return bool(np.min(errors) <= 2 * np.sin(target.tilt / 2) + slack)


def _step_function(arm: Arm, tool_axis: tuple[float, float, float], directions: Array, spun: bool) -> ca.Function:
    """``(q, request) -> (next q, error at q)``: one damped least squares step within the limits.

    ``dq = −(JᵀJ + (λ ‖r‖² + μ) I)⁻¹ Jᵀ r`` for the residual r and its Jacobian J, columns of held joints zero;
    shortened to `LONGEST_IK_STEP` in the joint that moves furthest, then clipped to the limits.
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
    damping = DAMPING_FACTOR * squared + DAMPING_BIAS
    dq = -solved(ldl(J.T @ J + damping * ca.SX.eye(robot.n)), (1 - held) * slope)
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
