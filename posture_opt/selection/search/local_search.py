"""``LocalSearch``: sequential quadratic programming from many feasible starts at once, in one call of generated C.

Each step of :mod:`posture_opt.selection.search.newton_step` is followed by one of the inverse kinematics, which brings
the posture back onto target and tool axis: the objective of two postures can then be compared, and full steps are
accepted nearly always.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import casadi as ca
import numpy as np
import numpy.typing as npt

from posture_opt.model.compiled import BatchFunction
from posture_opt.model.row_loop import RowLoop
from posture_opt.numerics import Array, Codes
from posture_opt.selection.program.nlp import Nlp
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.search.newton_step import newton_step

MET = 1e-9
"""Largest violation of a row [m, rad or 1] of a posture that counts as optimal, as IPOPT is asked for."""
STEP_REDUCTION = 0.25  # of a step that made the merit worse
MERIT_TOLERANCE = 1e-7  # of the merit: its rounding
VIOLATION_ALLOWANCE = (
    100.0,
    1e-5,
)  # of the merit for each m or rad of violation, and at most: what the last digits of rows cost
STANDSTILL_STEP = 1e-12  # rad or m: a step that moves no joint further is none,
MAX_IDLE_STEPS = 2  # and after two of them, the multipliers settled, no other follows: where rows cannot be met, say
MIN_STEP_LENGTH = 1e-4  # of a step: what is no better then stays where it is

_LOOP = (
    """
long long posture_opt_loop(long long rows, long long n, long long size, double* q, double* y, const double* parameters,
    long long parameter_step, const double* request, long long request_step, const double* lower, const double* upper,
    long long steps, double stationary, double met, double* result) {
  po_memory newton = {0}, ik = {0};
  long long failed = 0, row, k;
  long long step, i;
  double *space = malloc((4 * n + 2 * size + 8) * sizeof *space);
  if (!space || !po_open(&newton, newton_step_work) || !po_open(&ik, restore_work)) failed = -1;
  for (row = 0; row < rows && !failed; ++row) {
    double *x = space, *direction = x + n, *way = direction + n;
    double *back = way + n, *given = back + n, *next = given + size;
    double *base = q + row * n, *kept = y + row * size, *out = result + 5 * row;
    double values[6], distance, furthest, merit = INFINITY, length = 1;
    long long still = 0;
    for (i = 0; i < n; ++i) x[i] = base[i];
    for (i = 0; i < size; ++i) given[i] = kept[i];
    for (step = 0; step < steps; ++step) {
      newton.arg[0] = x; newton.arg[1] = given; newton.arg[2] = parameters + row * parameter_step;
      newton.res[0] = way; newton.res[1] = next;
      for (k = 0; k < 6; ++k) newton.res[2 + k] = values + k;
      newton_step(newton.arg, newton.res, newton.iw, newton.w, 0);
      if (step == 0 || values[0] <= merit + NO_WORSE * fmax(1, fabs(merit)) + fmin(PRICE * out[1], MOST)) {
        merit = values[1]; length = 1;
        for (i = 0; i < n; ++i) { base[i] = x[i]; direction[i] = way[i]; }
        for (i = 0; i < size; ++i) kept[i] = next[i];
        out[0] = values[2]; out[1] = values[3]; out[2] = values[4]; out[3] = values[5];
        if (values[4] <= stationary && values[3] <= met) { ++step; break; }
      } else length *= BACK;
      if (!(length >= SHORTEST)) { ++step; break; }
      for (i = 0; i < n; ++i) back[i] = fmin(fmax(base[i] + length * direction[i], lower[i]), upper[i]);
      for (i = 0; i < size; ++i) given[i] = kept[i];
      ik.arg[0] = back; ik.arg[1] = request + row * request_step; ik.res[0] = x; ik.res[1] = &distance;
      restore(ik.arg, ik.res, ik.iw, ik.w, 0);
      for (furthest = 0, i = 0; i < n; ++i) furthest = fmax(furthest, fabs(x[i] - base[i]));
      still = furthest > STANDSTILL ? 0 : still + 1;
      if (still == STILL) { ++step; break; }
    }
    out[4] = (double)step;
  }
  free(space); po_close(&newton); po_close(&ik);
  return failed;
}
""".replace("NO_WORSE", repr(MERIT_TOLERANCE))
    .replace("BACK", repr(STEP_REDUCTION))
    .replace("SHORTEST", repr(MIN_STEP_LENGTH))
    .replace("STANDSTILL", repr(STANDSTILL_STEP))
    .replace("STILL", repr(MAX_IDLE_STEPS))
    .replace("PRICE", repr(VIOLATION_ALLOWANCE[0]))
    .replace("MOST", repr(VIOLATION_ALLOWANCE[1]))
)


@dataclass(frozen=True)
class LocalOptima:
    """Where N local searches ended, or were stopped.

    Args:
        q: (N, n) postures [rad or m].
        multipliers: (N, m + n) of rows and bounds, to go on from.
        objective: (N,); violation: (N,) the largest of a row; stationarity: (N,) residual of the first-order
            conditions.
        gain: (N,) what the next step promises of the objective, large where the quadratic model says nothing.
        optimal: (N,) whether first-order conditions hold within the tolerances.
    """

    q: Array
    multipliers: Array
    objective: Array
    violation: Array
    stationarity: Array
    gain: Array
    optimal: npt.NDArray[np.bool_]

    @property
    def excess(self) -> Array:
        """(N,) violation of the rows, zero where they count as met."""
        return np.where(self.violation <= ROW_TOLERANCE, 0.0, self.violation)

    def rows(self, chosen: Codes) -> LocalOptima:
        """The ``chosen`` ones, in this order."""
        return LocalOptima(*(getattr(self, field.name)[chosen] for field in fields(self)))


class LocalSearch:
    """The local search of one nonlinear program: Newton's step, a step back onto the target, and shortening by the
    merit.

    Args:
        nlp: n variables, m rows.
        restore: ``(x, request) -> (next x, error)`` brings a point back onto its target, as a step of the inverse
            kinematics does.
        tolerance: of stationarity, at an optimum.
        compiled: None compiles where a C compiler is found; False never; True or an error.
    """

    def __init__(self, nlp: Nlp, restore: ca.Function, tolerance: float, compiled: bool | None) -> None:
        self._nlp, self._restore, self._tolerance = nlp, restore, tolerance
        self._step = newton_step(nlp)
        self._loop = RowLoop({"newton_step": self._step, "restore": restore}, _LOOP, compiled)

    def descend(
        self, Q: Array, parameters: Array, request: Array, steps: int, multipliers: Array | None = None
    ) -> LocalOptima:
        """At most ``steps`` steps from each posture of Q (N, n).

        A step is taken where the augmented Lagrangian does not grow beyond its rounding, else shortened by
        `STEP_REDUCTION`; what has not moved for `MAX_IDLE_STEPS` steps ends where it is.

        Args:
            parameters: (p,) or (N, p) of the target.
            request: (1, w) or (N, w) what the inverse kinematics holds: the whole region, the whole cone.
            multipliers: (N, m + n) of an earlier call, to go on from.
        """
        size = len(self._nlp.rows) + Q.shape[1]
        y = np.zeros((len(Q), size)) if multipliers is None else multipliers.copy()
        q, result = np.ascontiguousarray(Q, dtype=float).copy(), np.zeros((len(Q), 5))
        parameters, request = np.atleast_2d(parameters), np.ascontiguousarray(np.atleast_2d(request))
        run = self._run_compiled if self._loop.compiled else self._run_interpreted
        run(q, y, parameters, request, steps, result)
        objective, violation, stationarity, gain, _ = result.T
        optimal = (stationarity <= self._tolerance) & (violation <= MET)
        return LocalOptima(q, y, objective, violation, stationarity, gain, optimal)

    def _run_compiled(self, q: Array, y: Array, parameters: Array, request: Array, steps: int, result: Array) -> None:
        """The loop in C; ``q``, ``y`` and ``result`` (N, 5) are overwritten."""
        strides = [array.shape[1] if len(array) > 1 else 0 for array in (parameters, request)]
        lower, upper = self._nlp.variable_bounds
        self._loop(
            len(q), q.shape[1], y.shape[1], q, y, parameters, strides[0], request, strides[1], lower, upper,
            steps, self._tolerance, MET, result,
        )  # fmt: skip

    @cached_property
    def _batches(self) -> tuple[BatchFunction, BatchFunction]:
        """Newton's step and the step back onto the target for all rows, interpreted."""
        return BatchFunction(self._step, compiled=False), BatchFunction(self._restore, compiled=False)

    def _run_interpreted(
        self, q: Array, y: Array, parameters: Array, request: Array, steps: int, result: Array
    ) -> None:
        """The same loop without a compiler, all rows a step at a time; the answers agree to rounding.

        Args:
            q: (N, n), ``y`` (N, m + n) and ``result`` (N, 5) are overwritten: objective, violation, stationarity,
                gain, steps.
        """
        (newton, restored), (lower, upper) = self._batches, self._nlp.variable_bounds
        rows = np.arange(len(q))
        x, given = q.copy(), y.copy()
        direction, merit, length = np.zeros_like(q), np.full(len(q), np.inf), np.ones(len(q))
        still = np.zeros(len(q), dtype=int)
        for step in range(steps):
            way, following, *values = newton(x[rows], given[rows], _of(parameters, rows))
            before, after, *reported = (value[:, 0] for value in values)
            allowed = MERIT_TOLERANCE * np.fmax(1, np.abs(merit[rows])) + np.fmin(
                VIOLATION_ALLOWANCE[0] * result[rows, 1], VIOLATION_ALLOWANCE[1]
            )
            better = before <= merit[rows] + allowed
            taken = better if step else np.ones(len(rows), dtype=bool)
            at = rows[taken]
            merit[at], length[at], q[at], direction[at] = after[taken], 1.0, x[at], way[taken]
            y[at], result[at, :4] = following[taken], np.column_stack(reported)[taken]
            length[rows[~taken]] *= STEP_REDUCTION
            result[rows, 4] = step + 1
            ended = taken & (result[rows, 2] <= self._tolerance) & (result[rows, 1] <= MET)
            rows = rows[~ended & (length[rows] >= MIN_STEP_LENGTH)]
            if not len(rows):
                return
            back = np.fmin(np.fmax(q[rows] + length[rows, None] * direction[rows], lower), upper)
            x[rows], _ = restored(back, _of(request, rows))
            moved = np.max(np.abs(x[rows] - q[rows]), axis=1) > STANDSTILL_STEP
            still[rows] = np.where(moved, 0, still[rows] + 1)
            rows = rows[still[rows] < MAX_IDLE_STEPS]
            given[rows] = y[rows]


def _of(array: Array, rows: Codes) -> Array:
    """The rows of an array that has one for each, or one for all."""
    return array[rows] if len(array) > 1 else array
