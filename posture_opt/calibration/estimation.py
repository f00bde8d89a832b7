"""The estimate of an arm's parameters: the determined directions, robust against gross outliers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from posture_opt.calibration.least_squares import Fit, least_squares, outlying, reduced
from posture_opt.calibration.residuals import Residuals
from posture_opt.numerics import Array, Mask

ROUNDS = 8  # of leaving out and taking back outliers; on real data two or three settle it
FAIR = 0.01  # of the weight of a prior: it settles faster than its own uncertainty matters
_HELD = 1e-8  # of a variance, in correlations: a ten-thousandth of a standard deviation is as good as nothing
_SURE = 1e-10  # rad, m: nothing is known better
_OFFSET = 1e-3  # of a standard error: how near to the minimum is near enough


@dataclass(frozen=True, eq=False)
class Prior:
    """Independent knowledge of some deviations: ``W x[rows]`` is a standard normal vector."""

    rows: tuple[int, ...] = ()
    W: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def of(cls, rows: list[int], covariance: Array) -> Prior:
        """From the covariance of the deviations ``rows``; what has no variance in it, as after a calibration, is held.

        ``W = Λ^(−½) Vᵀ D⁻¹`` with the correlations ``V Λ Vᵀ`` and the standard deviations D.
        """
        if not rows:
            return cls()
        # A variance that is rounding would weigh so much that all else drowned in it.
        covariance = covariance + np.diag(np.maximum(_SURE**2 - np.diag(covariance), 0.0))
        sigma = np.sqrt(np.diag(covariance))
        values, vectors = np.linalg.eigh(covariance / np.outer(sigma, sigma))
        return cls(tuple(rows), (vectors / np.sqrt(np.maximum(values, _HELD))).T / sigma)

    def matrix(self, k: int) -> Array:
        """``W`` in the columns of all k unknowns."""
        wide = np.zeros((len(self.rows), k))
        wide[:, list(self.rows)] = self.W
        return wide


@dataclass(frozen=True, eq=False)
class Beforehand:
    """What a fit goes by besides the data: the steps (k, r) of the geometry that it fits, and a prior with its weight.

    ``weight`` is the standard deviation that weighs the prior, in units of the instrument's; a first guess of it.
    """

    directions: Array
    prior: Prior
    weight: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """Deviations ``x`` (k,) with their covariance, and the rows (N,) that were kept."""

    x: Array
    covariance: Array
    kept: Mask
    studentised: Array
    variance: float
    fit: Fit
    settled: bool = True
    weight: float = 0.0

    @property
    def at_rest(self) -> bool:
        """Whether the fit found its minimum, and leaving out outliers came to an end."""
        return self.fit.converged and self.settled

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what did not come to rest."""
        stopped = f"the fit had not come to rest after {self.fit.steps} steps: its estimates and errors are provisional"
        changing = f"which rows are outliers still changed after {ROUNDS} rounds: look at those that are listed"
        listed = not self.settled and not self.kept.all()  # where none is left out, there is nothing to look at
        return (stopped,) * (not self.fit.converged) + (changing,) * listed


def estimate(
    residuals: Residuals, x0: Array, directions: Array, prior: Prior | None = None, *, robust: bool = True,
    near: Array | None = None, weight: float = 0.0, design: float = 1.0,
) -> Estimate:  # fmt: skip
    """The least squares estimate ``x0 + directions z``; rows that turn out gross outliers are left out.

    In each round all rows are judged anew, so that a row wrongly left out comes back. The residual variance, not
    the instrument's, weighs the data against the prior: what the model cannot explain makes data worth less.
    ``near`` is a first guess of ``z``, ``weight`` one of the standard deviation that weighs the prior; the minimum
    does not depend on them. ``design`` is the number of rows that tell as much as one alone would: neighbours that err
    alike.
    """
    n = len(residuals.data)
    kept, z = np.ones(n, dtype=bool), np.zeros(directions.shape[1]) if near is None else near
    studentised, settled = np.zeros(n), False
    for _ in range(ROUNDS):
        used = residuals.take(np.flatnonzero(kept)) if not kept.all() else residuals
        found = least_squares(_function(used, x0, directions, prior, weight), z, tolerance=_OFFSET, max_steps=100)
        z = found.x
        x = x0 + directions @ z
        variance = found.variance
        if not robust and prior is None:
            settled = True
            break
        r, J = residuals.both(x)
        rows = n * residuals.block
        known = known_rows(prior, weight, directions)
        gross, studentised = outlying(r[:rows], reduced(J[:rows], directions), residuals.block, known)
        gross = gross if robust else np.zeros(n, dtype=bool)
        variance = variance_of(found, known)
        # A prior that was weighed with the variance of a fit to outliers would be many times too sure of itself.
        fair = np.sqrt(design * variance) if prior is not None else 0.0
        settled = np.array_equal(~gross, kept) and abs(weight - fair) <= FAIR * fair
        kept, weight = ~gross, fair
        if settled:
            break
    inverse = directions @ np.linalg.pinv(found.R, rcond=1e-14)
    covariance = design * variance * inverse @ inverse.T
    return Estimate(x, covariance, kept, studentised, variance, found, settled, weight)


def known_rows(prior: Prior | None, weight: float, directions: Array) -> Array:
    """The prior as further rows of the Jacobian."""
    rows = np.zeros((0, directions.shape[1]))
    return rows if prior is None else np.asarray(weight * prior.matrix(len(directions)) @ directions)


def variance_of(found: Fit, known: Array) -> float:
    """Residual variance of the measurements: what a wrong prior costs is no noise of theirs."""
    measured = found.residuals[: len(found.residuals) - len(known)]
    by_prior = float(np.sum((known @ np.linalg.pinv(found.R, rcond=1e-14)) ** 2))
    return float(measured @ measured) / max(len(measured) - len(found.x) + by_prior, 1.0)


def _function(residuals: Residuals, x0: Array, directions: Array, prior: Prior | None, weight: float):  # type: ignore[no-untyped-def]
    known = weight * prior.matrix(len(x0)) if prior is not None else np.zeros((0, len(x0)))

    def function(z: Array) -> tuple[Array, Array]:
        x = x0 + directions @ z
        r, J = residuals.both(x)
        return np.concatenate([r, known @ x]), reduced(np.concatenate([J, known]), directions)

    return function
