"""One step of sequential quadratic programming, written out as an expression, so that a batch takes it in C.

For ``min f(x)`` under rows ``l ≤ g(x) ≤ u`` and bounds of the variables the step p solves

``H p + ∇f + Aᵀλ + z = 0``,  ``A p = b − g`` for the rows of the working set,  ``p_j = b_j − x_j`` for its bounds,

H being the Hessian of the Lagrangian, less the curvature of convex rows where they bend it downwards: by the least step
that meets the rows, and Newton's step with H projected onto the directions that keep them (Nocedal and Wright 2006,
section 18.1). The working set changes as in a primal active set method (section 16.5), but once in a step instead of in
a loop inside it: what a step meets first joins, what has a multiplier of the wrong sign leaves. So a step costs one
linear system.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from posture_opt.model.ldl import Factors, ldl, solved
from posture_opt.selection.program.nlp import Nlp

LONGEST_STEP = 0.5
"""Of a joint [rad or m]: the quadratic model of a rotation means nothing beyond."""
PENALTY = 1e3  # of a squared row in the merit, in units of the objective (about 1)
WORKING_SET_TOLERANCE = 1e-8  # rad or m: a row or bound that is violated by more belongs to the working set
JOINED_MULTIPLIER = 1e-12  # the multiplier of what has just joined, until the next step says how large it is
LEAST_CHANGE = 1e-12  # a change below it meets nothing
DEPENDENT_ROW_TOLERANCE = 1e-10  # of a row's own square: rows that repeat others, or more rows than joints
MAX_MULTIPLIER = (
    1e3  # of a multiplier in the Hessian: where the rows nearly depend on each other, estimates are anything
)
FLAT_CURVATURE = 1e-8  # of the largest row: the curvature of a direction that changes nothing, above its rounding
INFINITE_BOUND = 1e6  # instead of infinity, which makes NaN of zero


def newton_step(nlp: Nlp) -> ca.Function:
    """``(x, y, p) -> (step, y⁺, before, after, objective, violation, stationarity, gain)`` at one point.

    ``x`` (n,), ``p`` the parameters; ``y`` (m + n,) multipliers of the rows and of the bounds, positive at upper ends,
    zero outside of the working set, and all of them zero at first. ``step`` (n,) meets no bound or row that is not in
    the working set, to first order, and is no longer than `LONGEST_STEP` in a joint. ``before`` and ``after`` are the
    augmented Lagrangian at ``x`` with ``y`` and with ``y⁺``, ``violation`` is the largest one of a row, and
    ``stationarity`` the largest component of ``∇f + Aᵀλ + z`` with least-squares multipliers, those of the wrong sign
    left out, or their complementarity; and ``gain`` is what the quadratic model promises of the whole of Newton's step.
    """
    y = ca.SX.sym("y", len(nlp.rows) + len(nlp.variables))
    at = _Point(nlp, y)
    step, multipliers, indefinite = at.direct()
    gain = ca.if_else(indefinite, INFINITE_BOUND, at.gain(step))
    y_next, step = at.advanced(step, multipliers, indefinite)
    outputs = [step, y_next, at.merit(y), at.merit(y_next), nlp.objective, at.violation, at.stationarity, gain]
    return ca.Function("newton_step", [nlp.x, y, nlp.p], ca.cse([ca.densify(ca.SX(output)) for output in outputs]))


@dataclass(frozen=True)
class _Point:
    """All constraints side by side, the m rows first and then the n bounds, at ``nlp.x`` with multipliers ``y``."""

    nlp: Nlp
    y: ca.SX

    @cached_property
    def m(self) -> int:
        """Rows; those of a vector are ``[:m, 0]``: of a single number, ``[:0]`` is a row to CasADi, not a column."""
        return len(self.nlp.rows)

    @cached_property
    def value(self) -> ca.SX:
        """(m + n,) the rows and the variables."""
        return ca.vertcat(self.nlp.g, self.nlp.x)

    @cached_property
    def ends(self) -> tuple[ca.SX, ca.SX]:
        """(m + n,) lower and upper ends, finite."""
        lower, upper = self.nlp.variable_bounds
        low = ca.vertcat(*(row.lower for row in self.nlp.rows), ca.DM(lower))
        high = ca.vertcat(*(row.upper for row in self.nlp.rows), ca.DM(upper))
        return ca.fmax(low, -INFINITE_BOUND), ca.fmin(high, INFINITE_BOUND)

    @cached_property
    def equal(self) -> ca.DM:
        """1 where both ends are the same expression."""
        rows = [float(ca.is_equal(row.lower, row.upper, 2)) for row in self.nlp.rows]
        return ca.DM([*rows, *(float(v.lower == v.upper) for v in self.nlp.variables)])

    @cached_property
    def above(self) -> ca.SX:
        """1 where the upper end is in the working set; an equality counts as one."""
        return ca.fmax(ca.fmax(self.y > 0, self.value > self.ends[1] + WORKING_SET_TOLERANCE), self.equal)

    @cached_property
    def below(self) -> ca.SX:
        """1 where the lower end of an inequality is in the working set."""
        return (1 - self.equal) * ca.fmax(self.y < 0, self.value < self.ends[0] - WORKING_SET_TOLERANCE)

    @cached_property
    def working(self) -> ca.SX:
        """1 where either end is in the working set."""
        return ca.fmin(self.above + self.below, 1)

    @cached_property
    def gap(self) -> ca.SX:
        """(m + n,) how far the ends in the working set are away."""
        low, high = self.ends
        return self.working * (ca.if_else(self.above, high, low) - self.value)

    @cached_property
    def slope(self) -> ca.SX:
        """(n,) gradient of the objective."""
        return ca.densify(ca.gradient(self.nlp.objective, self.nlp.x))

    @cached_property
    def row_slopes(self) -> ca.SX:
        """(m, n) Jacobian of the rows."""
        return ca.densify(ca.jacobian(self.nlp.g, self.nlp.x))

    @cached_property
    def free_slopes(self) -> ca.SX:
        """(m, n) slopes of the rows of the working set along the variables that are not held; zero elsewhere."""
        rows, free = self.working[: self.m, 0], 1 - self.working[self.m :]
        return ca.repmat(rows, 1, free.shape[0]) * self.row_slopes * ca.repmat(free.T, self.m, 1)

    @cached_property
    def _gram(self) -> Factors:
        """Factors of ``A Aᵀ`` (m, m); the multiplier of a row that depends on others is zero."""
        A, rows = self.free_slopes, self.working[: self.m, 0]
        return ldl(A @ A.T + ca.diag(1 - rows), DEPENDENT_ROW_TOLERANCE)

    def _multipliers(self, slope: ca.SX) -> ca.SX:
        """(m + n,) multipliers that leave the least residual with a slope (n,), zero outside of the working set."""
        rows, held = self.working[: self.m, 0], self.working[self.m :]
        weights = -rows * solved(self._gram, self.free_slopes @ slope) if self.m else ca.SX(0, 1)
        return ca.vertcat(weights, -held * (slope + self.row_slopes.T @ weights))

    @cached_property
    def estimate(self) -> ca.SX:
        """(m + n,) the multipliers here, by least squares."""
        return self._multipliers(self.slope)

    @cached_property
    def curvature(self) -> ca.SX:
        """Hessian of the Lagrangian with the multipliers estimated here: they keep up with the steps.

        Without the curvature of convex rows where the Lagrangian bends downwards with it along what the rows leave
        free: far from an optimum it means nothing, and a step that is turned uphill by it has to be found by halving.
        """
        convex = [row.convex for row in self.nlp.rows]
        others = self._hessian(self.nlp.objective, [not yes for yes in convex])
        if not any(convex):
            return others
        whole = others + self._hessian(ca.SX(0), convex)
        return ca.if_else(_shifted(whole, self.projector)[1] < 0, others, whole)

    def _hessian(self, objective: ca.SX, chosen: Sequence[bool]) -> ca.SX:
        """(n, n) Hessian of an objective and of the ``chosen`` rows times their multipliers, these bounded."""
        weights = ca.SX.sym("weights", self.m)
        lagrangian = objective + ca.dot(ca.DM([float(yes) for yes in chosen]) * weights, self.nlp.g)
        hessian = ca.densify(ca.hessian(lagrangian, self.nlp.x)[0])
        bounded = ca.fmin(ca.fmax(self.estimate[: self.m, 0], -MAX_MULTIPLIER), MAX_MULTIPLIER)
        return ca.substitute(hessian, weights, bounded)

    @cached_property
    def projector(self) -> ca.SX:
        """(n, n) onto the directions that keep the rows of the working set and what is held."""
        m, n, A = self.m, len(self.nlp.variables), self.free_slopes
        project = ca.diag(1 - self.working[m:])
        return project - A.T @ ca.horzcat(*(solved(self._gram, A[:, k]) for k in range(n))) if m else project

    def direct(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Newton's step (n,), its multipliers (m + n,), and whether the Hessian had to be made convex.

        The least step ``Aᵀ(A Aᵀ)⁻¹ gap`` meets the rows; ``−P (P H P)⁻¹ P (∇f + H p)`` then improves along what they
        leave.
        """
        m, A, project = self.m, self.free_slopes, self.projector
        short, p = self.gap[:m, 0] - self.working[:m, 0] * (self.row_slopes @ self.gap[m:]), self.gap[m:]
        if m:
            p = p + A.T @ solved(self._gram, short)  # the least step that meets the rows
        factors, indefinite = _convexified(self.curvature, project)
        p = p - project @ solved(factors, project @ (self.slope + self.curvature @ p))
        return p, self._multipliers(self.slope + self.curvature @ p), indefinite

    def gain(self, p: ca.SX) -> ca.SX:
        """The decrease of the Lagrangian's quadratic model by a step p (n,): ``−(∇f + Aᵀλ)·p − pᵀHp/2``."""
        weights = self.estimate[: self.m, 0]
        return -ca.dot(self.slope + self.row_slopes.T @ weights, p) - ca.dot(p, self.curvature @ p) / 2

    def advanced(self, p: ca.SX, multipliers: ca.SX, indefinite: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The multipliers (m + n,) of the next working set, and the step (n,) up to what it meets first.

        No joint moves by more than `LONGEST_STEP`. What is met joins with a multiplier that is next to zero.
        """
        low, high = self.ends
        change = ca.vertcat(self.row_slopes @ p, p)
        room = ca.if_else(change > 0, high, low) - self.value
        meets = (1 - self.working) * (ca.fabs(change) > LEAST_CHANGE)
        ratio = ca.if_else(meets, ca.fmax(room / change, 0), INFINITE_BOUND)
        first = ca.mmin(ratio)
        longest = ca.mmax(ca.fabs(p))
        # Where the objective bends downwards, Newton's length means nothing: as far as it may go.
        whole = LONGEST_STEP / ca.fmax(longest, ca.if_else(indefinite, 1e-6, LONGEST_STEP))
        right = self.signed(multipliers)
        joined = (ratio <= first) * (first <= whole) * ca.sign(change) * JOINED_MULTIPLIER
        return self.working * right + (1 - self.working) * joined, ca.fmin(whole, first) * p

    def merit(self, y: ca.SX) -> ca.SX:
        """The augmented Lagrangian of the rows (Rockafellar 1973); steps keep the bounds."""
        total = self.nlp.objective
        for g, weight, low, high, row in zip(
            ca.vertsplit(self.nlp.g),
            ca.vertsplit(y[: self.m, 0]),
            *map(ca.vertsplit, self.ends),
            self.nlp.rows,
            strict=False,
        ):
            if ca.is_equal(row.lower, row.upper, 2):
                total = total + weight * (g - high) + PENALTY / 2 * (g - high) ** 2
                continue
            for beyond, part in ((g - high, ca.fmax(weight, 0)), (low - g, ca.fmax(-weight, 0))):
                counted = ca.fmax(beyond, -part / PENALTY)
                total = total + part * counted + PENALTY / 2 * counted**2
        return total

    def signed(self, multipliers: ca.SX) -> ca.SX:
        """Multipliers (m + n,), zero where an inequality has one of the wrong sign."""
        right = ca.if_else(self.above, ca.fmax(multipliers, 0), ca.fmin(multipliers, 0))
        return self.working * ca.if_else(self.equal, multipliers, right)

    @property
    def violation(self) -> ca.SX:
        """The largest violation of a row [m, rad or 1]."""
        low, high = (end[: self.m, 0] for end in self.ends)
        return ca.mmax(ca.fmax(ca.fmax(low - self.nlp.g, self.nlp.g - high), 0)) if self.m else ca.SX(0)

    @property
    def stationarity(self) -> ca.SX:
        """The largest residual of stationarity, or of complementarity: a multiplier times what its end is away."""
        y = self.signed(self.estimate)
        residual = self.slope + self.row_slopes.T @ y[: self.m, 0] + y[self.m :]
        return ca.mmax(ca.fabs(ca.vertcat(residual, (1 - self.equal) * y * self.gap)))


def _convexified(H: ca.SX, project: ca.SX) -> tuple[Factors, ca.SX]:
    """L D Lᵀ of the projected Hessian, and whether it had to be shifted to be convex.

    Directions that the projector takes away get the size of H, those that change nothing a little of it, and where it
    bends downwards the identity is added, times a bound of its largest eigenvalue (Gershgorin 1931).
    """
    K, least = _shifted(H, project)
    indefinite = least < 0
    return ldl(K + indefinite * _size(H) * ca.SX.eye(H.shape[0])), indefinite


def _shifted(H: ca.SX, project: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The projected Hessian (n, n), filled up along the directions that are taken away, and its least pivot."""
    one = ca.SX.eye(H.shape[0])
    K = project @ H @ project + _size(H) * (one - project + FLAT_CURVATURE * one)
    return K, ca.mmin(ca.vertcat(*ldl(K)[1]))


def _size(H: ca.SX) -> ca.SX:
    """A bound of the largest eigenvalue of a symmetric matrix (n, n): the largest row sum of magnitudes."""
    return ca.mmax(ca.sum2(ca.fabs(H))) + LEAST_CHANGE
