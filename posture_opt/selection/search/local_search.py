"""``LocalSearch``: sequential quadratic programming from many feasible starts at once, in one call of generated C.

Each step of a :mod:`posture_opt.selection.search.quadratic_model` is followed by one of the inverse kinematics, which
brings the posture back onto target and tool axis: the objective of two postures can then be compared. A step that makes
the merit worse is tried again within a smaller radius.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache, cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from posture_opt.collision.contacts import C_TEXT, MOST_NEAR, POINTS, Contacts
from posture_opt.model.c_source import c_file
from posture_opt.model.compiled import BatchFunction, RowLoop
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.selection.program.nlp import Nlp
from posture_opt.selection.search import quadratic_model
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.search.quadratic_model import (
    INFINITE_BOUND,
    LARGER,
    LEAST_CHANGE,
    LONGEST_STEP,
    MAX_IDLE_STEPS,
    MAX_MULTIPLIER,
    MERIT_TOLERANCE,
    MOST_VIOLATION,
    SMALLER,
    SMALLEST_RADIUS,
    VIOLATION_PRICE,
    Curved,
    QuadraticModel,
    merit,
)

MET = 1e-9  # m, rad or 1: violation of a row at an optimum, as IPOPT is asked for

# What the loop receives of contacts where there are none.
_NOTHING_APART: tuple[int | float | Array, ...] = (0, 0, *[np.zeros(1)] * 5, 0.0)


@dataclass(frozen=True)
class LocalOptima:
    """Where N local searches ended, or were stopped."""

    q: Array  # (N, n) [rad or m]
    state: Array  # (N, m + n + 1) multipliers and radius, to go on from
    objective: Array  # (N,)
    violation: Array  # (N,) the largest of a row
    stationarity: Array  # (N,) residual of the first-order conditions
    gain: Array  # (N,) promised by the next step, large where the model says nothing
    optimal: Mask  # (N,)

    @property
    def excess(self) -> Array:
        """(N,) violation of the rows, zero where they count as met."""
        return np.where(self.violation <= ROW_TOLERANCE, 0.0, self.violation)

    def rows(self, chosen: Codes | slice) -> LocalOptima:
        """The ``chosen`` ones, in this order."""
        return LocalOptima(*(getattr(self, field.name)[chosen] for field in fields(self)))


_SHARED = {k: v for k, v in vars(quadratic_model).items() if k.isupper() and isinstance(v, int | float)}
_SHARED |= {"MOST_NEAR": MOST_NEAR, "POINTS": POINTS}


@cache
def _loop_text() -> str:
    return C_TEXT + c_file("posture_opt.selection.search", "local_search.c", _SHARED)


class LocalSearch:
    """The local search of one program: Newton's step, a step ``restore`` back onto the target, and the merit."""

    def __init__(
        self, nlp: Nlp, restore: ca.Function, tolerance: float, compiled: bool | None, contacts: Contacts | None = None
    ) -> None:
        self._nlp, self._restore, self._tolerance = nlp, restore, tolerance
        self._functions = Derivatives.of(nlp)
        named = dict(zip(("values", "slopes", "hessian"), self._functions, strict=True))
        self._contacts = contacts
        frames = (
            ca.Function("frames", [ca.SX.sym("q", len(nlp.variables))], []) if contacts is None else contacts.frames
        )
        self._loop = RowLoop({**named, "restore": restore, "frames": frames}, _loop_text(), compiled)

    def descend(
        self, Q: Array, parameters: Array, request: Array, steps: int, state: Array | None = None
    ) -> LocalOptima:
        """At most ``steps`` steps from each posture of Q (N, n); ``state`` (N, m + n + 1) of an earlier call goes on.

        A step is taken where the augmented Lagrangian does not grow, else tried within a radius smaller by `SMALLER`.
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
        return tuple(BatchFunction(function, compiled=False) for function in (*self._functions, self._restore))

    def _run_interpreted(
        self, q: Array, state: Array, parameters: Array, request: Array, steps: int, result: Array
    ) -> None:
        """The loop in NumPy; q (N, n), state (N, m + n + 1) and result (N, 5) are overwritten."""
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
            moved = np.max(np.abs(q[rows] - before), axis=1) > LEAST_CHANGE
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
        """Ends (N, n) of steps within a radius (N,), their lengths (N,) and the next multipliers."""
        lower, upper = self._nlp.variable_bounds
        step, following = curved.advanced(radius)
        trial, _ = self._batches[3](np.clip(q + step, lower, upper), request)
        return trial, np.max(np.abs(step), axis=1), following


def _reported(curved: Curved, objective: Array, result: Array, rows: Codes, tolerance: float) -> Mask:
    """Mask of optimal points; results of all are written to the rows of ``result``."""
    model = curved.model
    beyond = np.maximum(model.low - model.value, model.value - model.high)[:, : model.m]
    violation, stationarity = np.max(beyond, axis=1, initial=0.0), model.stationarity
    result[rows, :4] = np.column_stack([objective, violation, stationarity, curved.gain()])
    result[rows, 4] += 1
    return np.asarray((stationarity <= tolerance) & (violation <= MET))


def _no_worse(here: list[Array], there: Sequence[Array], y: Array, violation: Array) -> Mask:
    """Steps to values ``there`` after which the merit with the next multipliers has not grown."""
    m = here[1].shape[1]
    before, after = (merit(f[:, 0], g, low, high, y[:, :m]) for f, g, low, high in (here, there))
    return np.asarray(
        after
        <= before + MERIT_TOLERANCE * np.fmax(1, np.abs(before)) + np.fmin(VIOLATION_PRICE * violation, MOST_VIOLATION)
    )


def _of(array: Array, rows: Codes) -> Array:
    return array[rows] if len(array) > 1 else array


class Derivatives(NamedTuple):
    """Functions of variables x (n,) and parameters p of a program with m rows; values are a tenth of the work."""

    values: ca.Function  # (x, p) -> objective, rows (m,), their lower and upper ends (m,), finite
    slopes: ca.Function  # (x, p) -> gradient (n,), Jacobian (m, n)
    curvature: ca.Function  # (x, p, λ (m,)) -> Hessian (n, n) of the objective and λ times the rows

    @classmethod
    def of(cls, nlp: Nlp) -> Derivatives:
        x, p, m = nlp.x, nlp.p, len(nlp.rows)
        # Before differentiation: what is alike in a program is alike in its derivatives, which are ten times as long.
        f, g = ca.cse([nlp.objective, nlp.g])
        low, high = nlp.row_ends
        ends = ca.fmax(low, -INFINITE_BOUND), ca.fmin(high, INFINITE_BOUND)
        weights = ca.SX.sym("weights", m)
        slopes = ca.gradient(f, x), ca.jacobian(g, x)
        hessian = ca.hessian(f + ca.dot(weights, g), x)[0]
        return cls(
            ca.Function("values", [x, p], _dense(f, g, *ends)),
            ca.Function("slopes", [x, p], _dense(*slopes)),
            ca.Function("curvature", [x, p, weights], _dense(hessian)),
        )


def _dense(*outputs: ca.SX) -> list[ca.SX]:
    """Expressions as outputs of a function, structural zeros included."""
    return [ca.densify(ca.SX(output)) for output in outputs]
