"""Fit: parameters of an arm from measurements, with priors or without, alone or with effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.estimation.error_statistics import clustered_covariance, design_effect
from posture_opt.calibration.estimation.least_squares import (
    Function,
    Minimum,
    column_lengths,
    find_outliers,
    least_squares,
    reduced_jacobian,
    triangular_factor,
)
from posture_opt.calibration.estimation.parameters import Prior, known_rows
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Mask

if TYPE_CHECKING:
    from posture_opt.model.effects import Effect


def agreeing_rows(data: Measurements, errors: Array, gross: Mask) -> Mask:
    """(N,) which gross rows are off by nearly as much as another target or repeat of the same posture.

    ``0 < |e_i − e_j| ≤ max(|e_i|, |e_j|) / 2`` for a gross row i and another gross row j of the same pose, as most of
    the targets of that posture, or of its rows where there is one target: a reading that failed does not recur, what
    the arm does is in all of them. Copies of a row do not confirm it.

    errors (N, k) of the measured coordinates, in one unit; gross (N,) rows that look like outliers.
    """
    agree = np.zeros(len(data), dtype=bool)
    unit = data.target if len(data.target_names) > 1 else np.arange(len(data))
    poses, count = np.unique(data.pose[gross], return_counts=True)
    for pose in poses[count > 1]:
        rows = np.flatnonzero(data.pose == pose)
        off = rows[gross[rows]]
        near = [i for i in off if _errs_alike(unit, errors, i, off)]
        if 2 * len(set(unit[near])) > len(set(unit[rows])):
            agree[near] = True
    return agree


def _errs_alike(unit: Codes, errors: Array, i: int, others: Codes) -> bool:
    rest = others[unit[others] != unit[i]]
    lengths = np.linalg.norm(errors, axis=1)
    apart = np.linalg.norm(errors[rest] - errors[i], axis=1)
    # 0.5 share of the larger of two errors by which they may differ: two gross errors of readings, in any direction and
    # of sizes alike, agree so by chance in one pair of fifteen at the most (the share of a sphere within 30 deg).
    return bool(np.any((apart > 0) & (apart <= 0.5 * np.maximum(lengths[rest], lengths[i]))))


MAX_OUTLIER_ROUNDS = 8  # of leaving out and taking back outliers; on real data two or three settle it
PRIOR_WEIGHT_TOLERANCE = 0.01  # of the weight of a prior: it settles faster than its own uncertainty matters
ROUNDING_SHARE = 1e-10  # of the longest column of all effects: a parameter whose column is shorter does nothing
_OFFSET_TOLERANCE = 1e-3  # of a standard error: how near to the minimum is near enough


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters of an arm estimated from measurements: geometry, frames, touched points and effects alike."""

    residuals: Residuals  # the arm with its effects against the rows; of all rows, the left out ones too
    x: Array  # (k,) deviations of ``residuals.parameters`` from nominal [SI]
    directions: Array  # (k, r) the steps that were fitted; ``C`` (r, r) their covariance
    C: Array
    # (N,) the rows that were fitted; ``studentised`` (N,) the length of each row's residuals in units of their standard
    # deviation; zero where outliers were not looked for
    kept: Mask
    studentised: Array
    variance: float  # residual variance in units of the instrument's
    minimum: Minimum  # of the sum of squares in the steps
    # prior, weight: what was known beforehand, and the standard deviation that weighs it, in units of the instrument's
    prior: Prior | None = None
    weight: float = 0.0
    design: float = 1.0  # design effect (Kish 1965): so many rows say as much as one alone would
    settled: bool = True  # whether leaving out outliers came to an end
    # those that were fitted, with estimates and shapes; parameters of the group ``effect`` in this order
    effects: tuple[Effect, ...] = ()
    # (r, r) triangular, of the information that errors are counted with; None where it is the minimum's
    factor: Array | None = None

    @property
    def covariance(self) -> Array:
        """(k, k) of ``x``; what was not fitted has no variance in it."""
        return np.asarray(self.directions @ self.C @ self.directions.T)

    @property
    def std(self) -> Array:
        """(k,) standard errors; zero for what was not fitted."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @cached_property
    def held_by_prior(self) -> Array:
        """(k,) how many times as large standard errors would be by the rows alone; infinite where these say nothing."""
        J = self.residuals_and_jacobian[1]
        rows = len(J) - (0 if self.prior is None else len(self.prior.rows))
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.sqrt(_variances(J[:rows], self.directions) / _variances(J, self.directions))
        return np.asarray(np.where(np.isnan(ratio), 1.0, ratio))

    @property
    def spent(self) -> float:
        """How many unknowns the rows determine: the steps, less what the prior contributes to each."""
        known = known_rows(self.prior, self.weight, self.directions)
        return float(self.directions.shape[1]) - _prior_share(self.minimum.R, known)

    @property
    def geometry(self) -> Codes:
        """(g,) the steps that are none of effects."""
        own = [i for i, p in enumerate(self.residuals.parameters) if p.group != "effect"]
        return np.flatnonzero(np.any(self.directions[own], axis=0))

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Where in ``x`` the linear parameters of each effect are; its shape follows."""
        first = sum(p.group != "effect" for p in self.residuals.parameters)
        found = []
        for effect in self.effects:
            found.append(slice(first, first + len(effect.dimensions)))
            first += len(effect.dimensions) + bool(effect.smooth_shape)
        return tuple(found)

    @property
    def shapes(self) -> dict[int, int]:
        """Effect -> index in ``x`` of its smooth shape."""
        return {i: part.stop for i, part in enumerate(self.slices) if self.effects[i].smooth_shape}

    @property
    def sizes(self) -> Codes:
        """Where in ``x`` the linear parameters of all effects are."""
        return np.array([k for part in self.slices for k in range(part.start, part.stop)], dtype=np.intp)

    @property
    def count(self) -> int:
        """How many parameters were fitted, shapes left out."""
        return len(self.geometry) + len(self.sizes)

    @cached_property
    def jacobian(self) -> Array:
        """(m, k) of the whitened residuals of all rows by the parameters."""
        return self.residuals.residuals_and_jacobian(self.x)[1][: self.residuals.measured]

    @cached_property
    def imitating(self) -> Array:
        """(m, r) orthonormal basis of what steps of the geometry do to the arm without its effects."""
        from scipy.linalg import qr

        bare = self.x.copy()
        bare[self.sizes] = 0.0
        J = self.residuals.residuals_and_jacobian(bare)[1][: self.residuals.measured]
        G = J @ self.directions[:, self.geometry]
        # With pivots: numpy's SVD may not converge where directions are all rounding, and prints so.
        Q, R, _ = qr(G / column_lengths(G), mode="economic", pivoting=True)
        length = np.abs(np.diag(R))
        # 1e-7 of the longest: columns of the geometry that say nothing new
        return np.asarray(Q[:, : len(length)][:, length > 1e-7 * length.max(initial=0.0)])

    @cached_property
    def residuals_and_jacobian(self) -> tuple[Array, Array]:
        """Whitened residuals (m + d + p,) and their Jacobian: of rows, known distances, and the prior."""
        r, J = self.residuals.residuals_and_jacobian(self.x)
        if self.prior is None:
            return r, J
        known = self.weight * self.prior.matrix(len(self.x))
        return np.concatenate([r, known @ self.x]), np.concatenate([J, known])

    def effect_columns(self, i: int) -> Array:
        """(m, parameters) whitened residual per unit of each linear parameter of an effect."""
        return np.asarray(self.jacobian[:, self.slices[i]])

    @cached_property
    def whitened(self) -> Array:
        """(m,) residuals of all rows in units of the instrument's σ."""
        return self.residuals.whitened(self.x)[: self.residuals.measured]

    def places_of(self, effects: Sequence[int]) -> list[int]:
        """Where in ``x`` the parameters of the geometry and of some effects are, shapes included."""
        places = [k for k, p in enumerate(self.residuals.parameters) if p.group != "effect"]
        for i in effects:
            part = self.slices[i]
            places += range(part.start, part.stop + (i in self.shapes))
        return places

    def keeping(self, effects: Sequence[int]) -> Fit:
        """Drop all other effects from the estimate, nothing fitted again."""
        rows = self.places_of(effects)
        steps = np.flatnonzero(np.any(self.directions[rows], axis=0)).tolist()
        return replace(
            self,
            residuals=self.residuals.with_parameters([self.residuals.parameters[k] for k in rows]),
            x=self.x[rows],
            directions=self.directions[np.ix_(rows, steps)],
            C=self.C[np.ix_(steps, steps)],
            prior=None,
            effects=tuple(self.effects[i] for i in effects),
        )

    @property
    def at_rest(self) -> bool:
        """Whether the fit found its minimum, and leaving out outliers came to an end."""
        return self.minimum.converged and self.settled

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what did not converge."""
        stopped = f"the fit had not converged after {self.minimum.steps} steps: estimates and errors are provisional"
        changing = f"the outliers still changed after {MAX_OUTLIER_ROUNDS} rounds: look at the listed rows"
        listed = not self.settled and not self.kept.all()  # where none is left out, there is nothing to look at
        return (stopped,) * (not self.minimum.converged) + (changing,) * listed


def estimate_parameters(
    residuals: Residuals, x0: Array, directions: Array, prior: Prior | None = None, *, robust: bool = True,
    near: Array | None = None, weight: float = 0.0, design: float = 1.0, tolerance: float = _OFFSET_TOLERANCE,
) -> Fit:  # fmt: skip
    """The least squares estimate ``x0 + directions z``; rows that turn out gross outliers are left out.

    ``min |r(x0 + D z)|² + |w W (x0 + D z)|²`` over z; the covariance of z is ``design · s² (RᵀR)⁻¹`` with the residual
    variance s² and the triangular factor R of both blocks of rows.

    x0 (k,) [rad, m]; directions: D (k, r), the steps that are fitted.
    """
    n = len(residuals.data)
    kept, z = np.ones(n, dtype=bool), np.zeros(directions.shape[1]) if near is None else near
    studentised, settled = np.zeros(n), False
    for _ in range(MAX_OUTLIER_ROUNDS):
        used, fitted_with = residuals.take(np.flatnonzero(kept)) if not kept.all() else residuals, weight
        held = np.zeros((0, len(x0))) if prior is None else weight * prior.matrix(len(x0))
        found = least_squares(_with_known(used, x0, directions, held), z, tolerance=tolerance, max_steps=100)
        z, x, variance = found.x, x0 + directions @ found.x, found.variance
        if not robust and prior is None:
            settled = True
            break
        r, J = residuals.residuals_and_jacobian(x)
        rows = residuals.measured
        known = known_rows(prior, weight, directions)
        gross, studentised = find_outliers(r[:rows], reduced_jacobian(J[:rows], directions), residuals.block, known)
        gross &= ~agreeing_rows(residuals.data, position_parts(r[:rows], residuals), gross)
        gross = gross if robust else np.zeros(n, dtype=bool)
        variance = variance_of(found, known)
        # A prior that was weighed with the variance of a fit to outliers would have many times too much weight.
        fair = np.sqrt(design * variance) if prior is not None else 0.0
        settled = np.array_equal(~gross, kept) and abs(weight - fair) <= PRIOR_WEIGHT_TOLERANCE * fair
        kept, weight = ~gross, fair
        if settled:
            break
    factor = _factor_of_errors(found.R, prior, fitted_with, directions)
    inverse = np.linalg.pinv(factor, rcond=1e-14)
    C = np.asarray(design * variance * inverse @ inverse.T)
    judged = (kept, studentised, variance, found, prior, weight, design, settled)
    return Fit(residuals, x, directions, C, *judged, factor=factor)


def position_parts(r: Array, residuals: Residuals) -> Array:
    """The errors (N, axes) of measured coordinates among whitened residuals (m,)."""
    return np.asarray(r.reshape(-1, residuals.block)[:, : len(residuals.axes)])


def minimum_of(residuals: Residuals, x0: Array, directions: Array, known: Array) -> tuple[Array, Minimum]:
    """Where ``|r(x)|² + |known x|²`` is least (k,), on ``x0 + directions z``, and the minimum in z.

    directions: D (k, r).
    """
    function = _with_known(residuals, x0, directions, known)
    found = least_squares(function, np.zeros(directions.shape[1]), tolerance=_OFFSET_TOLERANCE, max_steps=30)
    return x0 + directions @ found.x, found


def with_clustered_errors(fit: Fit) -> Fit:
    """Replace the covariance by one for residuals correlated within blocks.

    Source: Liang, Zeger (1986), see `clustered_covariance`.
    """
    used = fit.residuals.take(np.flatnonzero(fit.kept))
    r, J = used.residuals_and_jacobian(fit.x)
    known = known_rows(fit.prior and fit.prior.of_errors, fit.weight, fit.directions)
    A = reduced_jacobian(J[: used.measured], fit.directions)
    R = fit.minimum.R if fit.factor is None else fit.factor
    C = clustered_covariance(used, r[: used.measured], A, R, fit.variance, known, fit.weight)
    return replace(fit, C=C)


def _variances(J: Array, directions: Array) -> Array:
    """(k,) variances of unknowns left by rows with Jacobian J (m, k) along ``directions``, for a noise of one."""
    from scipy.linalg import svd

    scale = column_lengths(J @ directions)
    _, s, Vt = svd(triangular_factor(J @ directions / scale), lapack_driver="gesvd")  # numpy's may not converge
    steps = (directions / scale) @ Vt.T
    seen = s > ROUNDING_SHARE * s.max(initial=0.0)
    found = np.sum((steps[:, seen] / s[seen]) ** 2, axis=1)
    hidden = np.any(np.abs(steps[:, ~seen]) > ROUNDING_SHARE * np.abs(steps).max(axis=1, keepdims=True), axis=1)
    return np.asarray(np.where(hidden, np.inf, found))


def _factor_of_errors(R: Array, prior: Prior | None, weight: float, directions: Array) -> Array:
    """(r, r) triangular factor of the information that errors are counted with, ``RᵀR − KᵀK + LᵀL``.

    K are the rows of the prior as it weighs, L as it is known: ``S R`` with ``SᵀS = I − (KR⁻¹)ᵀKR⁻¹ + (LR⁻¹)ᵀLR⁻¹``.
    """
    if prior is None or prior.errors is None:
        return R
    inverse = np.linalg.pinv(R, rcond=1e-14)
    K, L = (known_rows(one, weight, directions) @ inverse for one in (prior, prior.of_errors))
    return np.asarray(np.linalg.cholesky(np.eye(len(R)) - K.T @ K + L.T @ L).T @ R)


def variance_of(found: Minimum, known: Array) -> float:
    """Residual variance of the measurements: what a wrong prior costs is no noise of theirs."""
    measured = found.residuals[: len(found.residuals) - len(known)]
    freedom = len(measured) - len(found.x) + _prior_share(found.R, known)
    return float(measured @ measured) / max(freedom, 1.0)


def _prior_share(R: Array, known: Array) -> float:
    """How many unknowns the rows ``known`` (p, r) of a prior determine: ``tr(K (RᵀR)⁻¹ Kᵀ)``."""
    return float(np.sum((known @ np.linalg.pinv(R, rcond=1e-14)) ** 2))


def _with_known(residuals: Residuals, x0: Array, directions: Array, known: Array) -> Function:
    """Residuals (m + p,) and Jacobian (m + p, r) as a function of z (r,), rows ``known`` (p, k) last."""

    def function(z: Array) -> tuple[Array, Array]:
        x = x0 + directions @ z
        r, J = residuals.residuals_and_jacobian(x)
        return np.concatenate([r, known @ x]), reduced_jacobian(np.concatenate([J, known]), directions)

    return function


def fit_with_effects(
    residuals: Residuals, x0: Array, directions: Array, effects: Sequence[Effect], prior: Prior | None = None,
    weight: float = 1.0, *, shapes: bool = True,
) -> Fit:  # fmt: skip
    """Geometry in some ``directions`` (k, r) about ``x0`` (k,), effects and their smooth shapes, all together."""
    wide = residuals.with_effects(effects, x0)
    more = len(wide.parameters) - len(x0)
    steps = np.zeros((len(wide.parameters), directions.shape[1] + more))
    steps[: len(x0), : directions.shape[1]] = directions
    start = np.r_[x0, wide.start_of(effects)]
    steps[len(x0) :, directions.shape[1] :] = np.diag(_unit_steps(wide, start, len(x0)))
    if not shapes:
        held = [i for i, p in enumerate(wide.parameters) if p.name in wide.arm.shape_parameters]
        steps = steps[:, ~np.any(steps[held], axis=0)]
    design, near = 1.0, None
    for _ in range(MAX_OUTLIER_ROUNDS):
        # 1e-6 of a standard error: lines of one joint that lean on each other would not fit any more
        found = estimate_parameters(
            wide, start, steps, prior, robust=False, near=near, weight=weight, design=design, tolerance=1e-6
        )
        A = found.jacobian @ found.directions
        again = design_effect(found.residuals, found.whitened, A / column_lengths(A)) if A.shape[1] else 1.0
        if prior is None or abs(again - design) <= PRIOR_WEIGHT_TOLERANCE * design:
            break
        design, weight, near = again, found.weight, found.minimum.x
    found = replace(found, design=again, C=found.C / design, effects=wide.fitted_effects(effects, found.x))
    return with_clustered_errors(found) if again > 1 else found


def _unit_steps(wide: Residuals, start: Array, first: int) -> Array:
    """Steps (e,) of the effects' parameters whose columns have length one: scaled so, no unit dominates."""
    norms = np.linalg.norm(wide.residuals_and_jacobian(start)[1][:, first:], axis=0)
    steps = np.where(norms > 0, 1 / np.where(norms > 0, norms, 1.0), 1.0)
    return np.asarray(np.where((norms > 0) & (norms < ROUNDING_SHARE * norms.max(initial=0.0)), 0.0, steps))
