"""``Fit``: parameters of an arm from measurements, with priors or without, robust against gross outliers or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.estimation.agreeing_rows import agreeing_rows
from posture_opt.calibration.estimation.clustered_covariance import clustered_covariance
from posture_opt.calibration.estimation.least_squares import (
    Minimum,
    find_outliers,
    least_squares,
    reduced_jacobian,
    triangular_factor,
)
from posture_opt.calibration.estimation.prior import Prior, known_rows
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.numerics import Array, Codes, Mask

if TYPE_CHECKING:
    from posture_opt.model.effects import Effect

MAX_OUTLIER_ROUNDS = 8  # of leaving out and taking back outliers; on real data two or three settle it
PRIOR_WEIGHT_TOLERANCE = 0.01  # of the weight of a prior: it settles faster than its own uncertainty matters
_RANK_TOLERANCE = 1e-7  # of the longest: columns of the geometry that say nothing new
ROUNDING_SHARE = 1e-10  # of the longest column of all effects: a parameter whose column is shorter does nothing
_OFFSET_TOLERANCE = 1e-3  # of a standard error: how near to the minimum is near enough


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters of an arm estimated from measurements: geometry, frames, touched points and effects alike.

    Args:
        residuals: the arm with its effects against the rows; of all rows, the left out ones too.
        x: (k,) deviations of ``residuals.parameters`` from nominal [SI].
        directions: (k, r) the steps that were fitted; ``C`` (r, r) their covariance.
        kept: (N,) the rows that were fitted; ``studentised`` (N,) the length of each row's residuals in units of
            their standard deviation; zero where outliers were not looked for.
        variance: residual variance in units of the instrument's.
        minimum: of the sum of squares in the steps.
        prior, weight: what was known beforehand, and the standard deviation that weighs it, in units of the
            instrument's.
        design: design effect (Kish 1965): so many rows say as much as one alone would.
        settled: whether leaving out outliers came to an end.
        effects: those that were fitted, with estimates and shapes; parameters of the group ``effect`` in this order.
        factor: (r, r) triangular, of the information that errors are counted with; None where it is the minimum's.
    """

    residuals: Residuals
    x: Array
    directions: Array
    C: Array
    kept: Mask
    studentised: Array
    variance: float
    minimum: Minimum
    prior: Prior | None = None
    weight: float = 0.0
    design: float = 1.0
    settled: bool = True
    effects: tuple[Effect, ...] = ()
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
        """(m, r) orthonormal basis of what steps of the geometry do to the arm without its effects.

        What can pass for these: beside an effect they also change its levers, and a frame that slides along its own
        axis does nothing else.
        """
        from scipy.linalg import qr

        bare = self.x.copy()
        bare[self.sizes] = 0.0
        J = self.residuals.residuals_and_jacobian(bare)[1][: self.residuals.measured]
        G = J @ self.directions[:, self.geometry]
        norms = np.linalg.norm(G, axis=0)
        # With pivots: numpy's SVD may not converge where directions are all rounding, and prints so.
        Q, R, _ = qr(G / np.where(norms > 0, norms, 1.0), mode="economic", pivoting=True)
        length = np.abs(np.diag(R))
        return np.asarray(Q[:, : len(length)][:, length > _RANK_TOLERANCE * length.max(initial=0.0)])

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
        """The same estimate without the other effects, nothing fitted again: as certain as all was together."""
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
        changing = (
            f"which rows are outliers still changed after {MAX_OUTLIER_ROUNDS} rounds: look at those that are listed"
        )
        listed = not self.settled and not self.kept.all()  # where none is left out, there is nothing to look at
        return (stopped,) * (not self.minimum.converged) + (changing,) * listed


def estimate_parameters(
    residuals: Residuals, x0: Array, directions: Array, prior: Prior | None = None, *, robust: bool = True,
    near: Array | None = None, weight: float = 0.0, design: float = 1.0, tolerance: float = _OFFSET_TOLERANCE,
) -> Fit:  # fmt: skip
    """The least squares estimate ``x0 + directions z``; rows that turn out gross outliers are left out.

    ``min |r(x0 + D z)|² + |w W (x0 + D z)|²`` over z; the covariance of z is ``design · s² (RᵀR)⁻¹`` with the residual
    variance s² and the triangular factor R of both blocks of rows.

    In each round all rows are judged anew, so that a row wrongly left out comes back. The residual variance, not
    the instrument's, weighs the data against the prior: what the model cannot explain makes data worth less.
    ``near`` is a first guess of ``z``, ``weight`` one of the standard deviation that weighs the prior; the minimum
    does not depend on them. ``design`` is the number of rows that say as much as one alone would: neighbours that err
    alike.

    Args:
        x0: (k,) [rad, m]; directions: D (k, r), the steps that are fitted.
        robust: whether gross outliers are left out, `find_outliers`, unless targets or repeats of a posture agree.
        tolerance: relative offset at which a fit ends.
    """
    n = len(residuals.data)
    kept, z = np.ones(n, dtype=bool), np.zeros(directions.shape[1]) if near is None else near
    studentised, settled = np.zeros(n), False
    for _ in range(MAX_OUTLIER_ROUNDS):
        used, fitted_with = residuals.take(np.flatnonzero(kept)) if not kept.all() else residuals, weight
        found = least_squares(
            _prior_function(used, x0, directions, prior, weight), z, tolerance=tolerance, max_steps=100
        )
        z = found.x
        x = x0 + directions @ z
        variance = found.variance
        if not robust and prior is None:
            settled = True
            break
        r, J = residuals.residuals_and_jacobian(x)
        rows = n * residuals.block
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
    return Fit(
        residuals, x, directions, C, kept, studentised, variance, found, prior, weight, design, settled,
        factor=factor,
    )  # fmt: skip


def position_parts(r: Array, residuals: Residuals) -> Array:
    """The errors (N, axes) of measured coordinates among whitened residuals (m,)."""
    return np.asarray(r.reshape(-1, residuals.block)[:, : len(residuals.axes)])


def minimum_of(residuals: Residuals, x0: Array, directions: Array, known: Array) -> tuple[Array, Minimum]:
    """Where ``|r(x)|² + |known x|²`` is least (k,), on ``x0 + directions z``, and the minimum in z.

    Nothing is left out and nothing weighed anew; ``known`` (p, k) are the rows of a prior.

    Args:
        directions: D (k, r).
    """
    function = _with_known(residuals, x0, directions, known)
    found = least_squares(function, np.zeros(directions.shape[1]), tolerance=_OFFSET_TOLERANCE, max_steps=30)
    return x0 + directions @ found.x, found


def with_clustered_errors(fit: Fit) -> Fit:
    """The same estimate with the covariance that its residuals ask for where they are correlated within blocks.

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
    """(k,) variances of unknowns that rows with the Jacobian J (m, k) leave along ``directions``, for a noise of one.

    Infinite where a direction that the rows do not see is part of an unknown.
    """
    from scipy.linalg import svd

    A = J @ directions
    norms = np.linalg.norm(A, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    _, s, Vt = svd(triangular_factor(A / scale), lapack_driver="gesvd")  # numpy's may not converge, and prints so
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
    by_prior = _prior_share(found.R, known)
    return float(measured @ measured) / max(len(measured) - len(found.x) + by_prior, 1.0)


def _prior_share(R: Array, known: Array) -> float:
    """How many unknowns the rows ``known`` (p, r) of a prior determine: ``tr(K (RᵀR)⁻¹ Kᵀ)``."""
    return float(np.sum((known @ np.linalg.pinv(R, rcond=1e-14)) ** 2))


def _prior_function(residuals: Residuals, x0: Array, directions: Array, prior: Prior | None, weight: float):  # type: ignore[no-untyped-def]
    """Residuals and Jacobian by z (r,), with the rows of a prior."""
    known = weight * prior.matrix(len(x0)) if prior is not None else np.zeros((0, len(x0)))
    return _with_known(residuals, x0, directions, known)


def _with_known(residuals: Residuals, x0: Array, directions: Array, known: Array):  # type: ignore[no-untyped-def]
    """Residuals (m + p,) and Jacobian (m + p, r) as a function of z (r,), rows ``known`` (p, k) last."""

    def function(z: Array) -> tuple[Array, Array]:
        x = x0 + directions @ z
        r, J = residuals.residuals_and_jacobian(x)
        return np.concatenate([r, known @ x]), reduced_jacobian(np.concatenate([J, known]), directions)

    return function
