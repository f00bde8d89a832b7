"""``LocalSearch``: sequential quadratic programming from many feasible starts at once, in one call of generated C.

Each step of a :mod:`posture_opt.selection.search.quadratic_model` is followed by one of the inverse kinematics, which
brings the posture back onto target and tool axis: the objective of two postures can then be compared. A step that makes
the merit worse is tried again within a smaller radius.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import casadi as ca
import numpy as np

from posture_opt.collision.contacts import Contacts
from posture_opt.model.compiled import BatchFunction
from posture_opt.model.row_loop import RowLoop
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.selection.program.nlp import Nlp
from posture_opt.selection.search.derivatives import Derivatives
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.search.local_search_loop import (
    LARGER,
    LONGEST_STEP,
    LOOP_TEXT,
    MAX_IDLE_STEPS,
    MAX_MULTIPLIER,
    MERIT_TOLERANCE,
    MET,
    SMALLER,
    SMALLEST_RADIUS,
    STANDSTILL_STEP,
    VIOLATION_ALLOWANCE,
)
from posture_opt.selection.search.quadratic_model import INFINITE_BOUND, Curved, QuadraticModel, merit

_NOTHING_APART: tuple[int | float | Array, ...] = (0, 0, *[np.zeros(1)] * 5, 0.0)
"""What the loop receives of contacts where there are none."""


@dataclass(frozen=True)
class LocalOptima:
    """Where N local searches ended, or were stopped.

    Args:
        q: (N, n) postures [rad or m].
        state: (N, m + n + 1) multipliers of rows and bounds, and the radius, to go on from.
        objective: (N,); violation: (N,) the largest of a row; stationarity: (N,) residual of the first-order
            conditions.
        gain: (N,) what the next step promises of the objective, large where the quadratic model says nothing.
        optimal: (N,) whether first-order conditions hold within the tolerances.
    """

    q: Array
    state: Array
    objective: Array
    violation: Array
    stationarity: Array
    gain: Array
    optimal: Mask

    @property
    def excess(self) -> Array:
        """(N,) violation of the rows, zero where they count as met."""
        return np.where(self.violation <= ROW_TOLERANCE, 0.0, self.violation)

    def rows(self, chosen: Codes | slice) -> LocalOptima:
        """The ``chosen`` ones, in this order."""
        return LocalOptima(*(getattr(self, field.name)[chosen] for field in fields(self)))


class LocalSearch:
    """The local search of one nonlinear program: Newton's step, a step back onto the target, and shortening by the
    merit.

    Args:
        nlp: n variables, m rows.
        contacts: what an arm of these variables keeps apart too; compiled, or left out.
        restore: ``(x, request) -> (next x, error)`` brings a point back onto its target, as a step of the inverse
            kinematics does.
        tolerance: of stationarity, at an optimum.
        compiled: None compiles where a C compiler is found; False never; True or an error.
    """

    def __init__(
        self,
        nlp: Nlp,
        restore: ca.Function,
        tolerance: float,
        compiled: bool | None,
        contacts: Contacts | None = None,
    ) -> None:
        self._nlp, self._restore, self._tolerance = nlp, restore, tolerance
        self._functions = Derivatives.of(nlp)
        named = dict(zip(("values", "slopes", "hessian"), self._functions, strict=True))
        self._contacts = contacts
        frames = (
            ca.Function("frames", [ca.SX.sym("q", len(nlp.variables))], []) if contacts is None else contacts.frames
        )
        self._loop = RowLoop({**named, "restore": restore, "frames": frames}, LOOP_TEXT, compiled)

    def descend(
        self, Q: Array, parameters: Array, request: Array, steps: int, state: Array | None = None
    ) -> LocalOptima:
        """At most ``steps`` steps from each posture of Q (N, n).

        A step is taken where the augmented Lagrangian does not grow beyond its rounding, else tried again within a
        radius smaller by `SMALLER`; what has not moved for `MAX_IDLE_STEPS` steps ends where it is.

        Args:
            parameters: (p,) or (N, p) of the target.
            request: (1, w) or (N, w) what the inverse kinematics holds: the whole region, the whole cone.
            state: (N, m + n + 1) of an earlier call, to go on from.
        """
        if state is None:
            contacts = 0 if self._contacts is None else self._contacts.rows
            fresh = np.zeros(len(self._nlp.rows) + Q.shape[1] + contacts)
            state = np.tile(np.append(fresh, LONGEST_STEP), (len(Q), 1))
        state = state.copy()
        q, result = np.ascontiguousarray(Q, dtype=float).copy(), np.zeros((len(Q), 5))
        parameters, request = np.atleast_2d(parameters), np.ascontiguousarray(np.atleast_2d(request))
        run = self._run_compiled if self._loop.compiled else self._run_interpreted
        run(q, state, parameters, request, steps, result)
        objective, violation, stationarity, gain, _ = result.T
        optimal = (stationarity <= self._tolerance) & (violation <= MET)
        return LocalOptima(q, state, objective, violation, stationarity, gain, optimal)

    def _run_compiled(
        self, q: Array, state: Array, parameters: Array, request: Array, steps: int, result: Array
    ) -> None:
        """The loop in C; ``q``, ``state`` and ``result`` (N, 5) are overwritten."""
        strides = [array.shape[1] if len(array) > 1 else 0 for array in (parameters, request)]
        lower, upper = self._nlp.variable_bounds
        apart = _NOTHING_APART if self._contacts is None else self._contacts.arguments
        self._loop(
            len(q), q.shape[1], len(self._nlp.rows), q, state, parameters, strides[0], request, strides[1],
            lower, upper, steps, self._tolerance, MET, result, *apart,
        )  # fmt: skip

    @cached_property
    def _batches(self) -> tuple[BatchFunction, ...]:
        """Values, slopes, curvature and the step back onto the target for many rows, interpreted."""
        return tuple(BatchFunction(function, compiled=False) for function in (*self._functions, self._restore))

    def _run_interpreted(
        self, q: Array, state: Array, parameters: Array, request: Array, steps: int, result: Array
    ) -> None:
        """The same loop without a compiler, one trial of all rows at a time; the answers agree to rounding.

        Args:
            q: (N, n), ``state`` (N, m + n + 1) and ``result`` (N, 5) are overwritten: objective, violation,
                stationarity, gain, steps.
        """
        values = self._batches[0]
        rows, still, y, radius = np.arange(len(q)), np.zeros(len(q), dtype=int), state[:, :-1], state[:, -1]
        here = [np.array(part) for part in values(q, parameters)]
        for _ in range(steps):
            curved = self._curved(q[rows], y[rows], _of(parameters, rows), [part[rows] for part in here])
            met = _reported(curved, here[0][rows, 0], result, rows, self._tolerance)
            rows, curved = rows[~met], curved.at(~met)
            before, taken = q[rows], np.zeros(len(rows), dtype=bool)
            while not np.all(taken | (radius[rows] < SMALLEST_RADIUS)):
                some = np.flatnonzero(~taken & (radius[rows] >= SMALLEST_RADIUS))
                at, of = rows[some], _of(parameters, rows[some])
                trial, length, following = self._trial(q[at], curved.at(some), radius[at], _of(request, at))
                there = values(trial, of)
                better = _no_worse([part[at] for part in here], there, following, result[at, 1])
                radius[at[~better]] = SMALLER * np.minimum(radius[at], length)[~better]
                yes, taken[some[better]] = at[better], True
                q[yes], y[yes] = trial[better], following[better]
                for part, new in zip(here, there, strict=True):
                    part[yes] = new[better]
            radius[rows[taken]] = np.minimum(LARGER * radius[rows[taken]], LONGEST_STEP)
            moved = np.max(np.abs(q[rows] - before), axis=1) > STANDSTILL_STEP
            still[rows] = np.where(moved, 0, still[rows] + 1)
            rows = rows[taken & (still[rows] < MAX_IDLE_STEPS)]
            if not len(rows):
                return

    def _curved(self, q: Array, y: Array, parameters: Array, here: list[Array]) -> Curved:
        """The models at the postures q (N, n), with the values ``here`` of objective, rows and ends."""
        _, slopes, hessian, _ = self._batches
        lower, upper = self._nlp.variable_bounds
        ends = np.maximum(lower, -INFINITE_BOUND), np.minimum(upper, INFINITE_BOUND)
        low, high = (np.hstack([part, np.broadcast_to(end, q.shape)]) for part, end in zip(here[2:], ends, strict=True))
        slope, A = slopes(q, parameters)
        model = QuadraticModel(np.hstack([here[1], q]), low, high, y, slope, A.reshape(len(q), -1, q.shape[1]))
        weights = np.clip(model.estimate[:, : model.m], -MAX_MULTIPLIER, MAX_MULTIPLIER)
        return Curved(model, hessian(q, parameters, weights).reshape(len(q), q.shape[1], q.shape[1]))

    def _trial(self, q: Array, curved: Curved, radius: Array, request: Array) -> tuple[Array, Array, Array]:
        """Where steps within a radius (N,) lead to (N, n), how long they are (N,) and the next multipliers."""
        lower, upper = self._nlp.variable_bounds
        step, following = curved.advanced(radius)
        trial, _ = self._batches[3](np.clip(q + step, lower, upper), request)
        return trial, np.max(np.abs(step), axis=1), following


def _reported(curved: Curved, objective: Array, result: Array, rows: Codes, tolerance: float) -> Mask:
    """Which points are optimal; what is known of all of them is written to the rows of ``result``."""
    model = curved.model
    beyond = np.maximum(model.low - model.value, model.value - model.high)[:, : model.m]
    violation, stationarity = np.max(beyond, axis=1, initial=0.0), model.stationarity
    result[rows, :4] = np.column_stack([objective, violation, stationarity, curved.gain()])
    result[rows, 4] += 1
    return np.asarray((stationarity <= tolerance) & (violation <= MET))


def _no_worse(here: list[Array], there: Sequence[Array], y: Array, violation: Array) -> Mask:
    """Which steps, to values ``there``, leave the merit with the next multipliers as it is or less."""
    m = here[1].shape[1]
    before, after = (merit(f[:, 0], g, low, high, y[:, :m]) for f, g, low, high in (here, there))
    price, most = VIOLATION_ALLOWANCE
    return np.asarray(after <= before + MERIT_TOLERANCE * np.fmax(1, np.abs(before)) + np.fmin(price * violation, most))


def _of(array: Array, rows: Codes) -> Array:
    """The rows of an array that has one for each, or one for all."""
    return array[rows] if len(array) > 1 else array
