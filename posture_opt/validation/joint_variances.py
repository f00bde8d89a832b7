"""The scatter of the joints from the scatter of the tool point: variance components by (restricted) likelihood.

Joint errors that change from repeat to repeat spread the tool point by ``J diag(σ²) Jᵀ``, differently at every
posture, and the instrument adds ``s² I`` everywhere: postures with different ``J`` separate the joints from each other
and from the instrument (Brethé, Vasselin, Lefebvre, Dakyo 2005: stochastic ellipsoids).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.errors import InsufficientDataError
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.validation.scatter_model import Scatter, joint_covariances
from posture_opt.validation.variance_components import Components


@dataclass(frozen=True, eq=False)
class JointVariances:
    """Standard deviations of the joints and of the instrument.

    Args:
        names: (n,) the joints' errors, ``JOINT.theta`` or ``JOINT.d``.
        sigma: (n,) standard deviations [rad, m], 0 or more.
        std: (n,) standard errors of ``sigma``; of a σ of 0, by how much it may be more; infinite where the data do not
            determine it.
        interval: (n, 2) 95 % intervals of ``sigma`` by the profile likelihood.
        instrument, instrument_std: the instrument's standard deviation of a coordinate [m], error 0 where it was
            given; ``instrument_interval`` as above.
        log_likelihood: at the maximum; of the contrasts within groups where there are groups.
    """

    names: tuple[str, ...]
    sigma: Array
    std: Array
    interval: Array
    instrument: float
    instrument_std: float
    instrument_interval: tuple[float, float]
    log_likelihood: float

    def covariance(self, columns: Array) -> Array:
        """``s² I + J diag(σ²) Jᵀ`` (N, d, d) [m²] at the postures of ``columns`` (N, d, n) [m/rad, m/m]."""
        return joint_covariances(columns, self.sigma, self.instrument)

    @property
    def determined(self) -> Mask:
        """(n,) whether the data determine each σ."""
        return np.isfinite(self.std)


def estimate_joint_variances(
    errors: Array,
    columns: Array,
    *,
    groups: Codes | None = None,
    instrument: float,
    fit_instrument: bool = False,
    equal: bool = False,
    names: Sequence[str] = (),
    known: Array | None = None,
) -> JointVariances:
    """Standard deviations of the joints that make measured errors likeliest.

    ``error ~ N(μ_group or 0, s² I + J diag(σ²) Jᵀ)`` with ``σ ≥ 0``. The restricted likelihood (Patterson,
    Thompson 1971) of the contrasts within groups does not know the group means. Fisher scoring on the variances,
    each step a non-negative least squares problem: the covariance is linear in them, so that the step to
    ``θ = I(θ)⁻¹ u(θ)`` is the Newton step with the expected information (Searle, Casella, McCulloch 1992, 6.6).

    Args:
        errors: (N, d) [m], d = 1, 2 or 3.
        columns: (N, d, n) shift of the tool point by a unit of each joint's error [m/rad, m/m].
        groups: (N,) rows of one code repeat one posture; ``None`` takes the errors to be about zero.
        instrument: standard deviation s of a measured coordinate [m]; a start where ``fit_instrument``.
        equal: one standard deviation for all joints whose name does not end in ``.d``.
        names: (n,) the joints' errors.
        known: (N, d, d) covariance of the errors besides [m²], as that of a prediction; not with ``groups``.

    Raises:
        InsufficientDataError: no group has two rows, or fewer coordinates than unknowns.
    """
    named = tuple(names) or tuple(f"joint{i + 1}.theta" for i in range(columns.shape[2]))
    scatter = Scatter.of(np.asarray(errors, dtype=float), np.asarray(columns, dtype=float), groups, known)
    if not len(scatter.freedom):
        raise InsufficientDataError("no posture was measured twice: repeat some postures to see their scatter")
    return fit_joint_variances(scatter, named, instrument, fit_instrument, equal)


def fit_joint_variances(
    scatter: Scatter,
    names: tuple[str, ...],
    instrument: float,
    fit_instrument: bool = False,
    equal: bool = False,
    intervals: bool = True,
) -> JointVariances:
    """As :func:`estimate_joint_variances`, from sums of squares; ``intervals`` are left open where not asked for.

    Args:
        scatter: sums of squares (G, d, d) [m²] with their degrees of freedom and joint columns.
        intervals: off, intervals are (0, ∞): each end costs some maximisations.

    Raises:
        InsufficientDataError: fewer coordinates of scatter than unknown standard deviations.
    """
    model = Components.of(scatter, names, instrument, fit_instrument, equal)
    freedom = int(scatter.freedom.sum()) * scatter.squares.shape[1]
    if freedom < model.size:
        need = int(np.ceil(model.size / scatter.squares.shape[1]))
        raise InsufficientDataError(
            f"{freedom} coordinates of scatter cannot determine {model.size} standard deviations: measure at least "
            f"{need} more repeats, at different postures"
        )
    theta, best = model.maximise(model.start())
    if not np.isfinite(best):
        raise InsufficientDataError("errors of such different sizes do not determine the scatter of the joints")
    error = model.errors(theta)
    search = range(model.size) if intervals else ()
    ends = np.array([model.interval(theta, best, k, error[k]) for k in search] or [(0.0, np.inf)] * model.size)
    joints = model.member.argmax(axis=1)
    sigma, std = np.sqrt(theta), _std_of_root(theta, error)
    last = model.size - 1
    fitted = (
        (float(np.sqrt(theta[last] + model.fixed)), float(std[last])) if fit_instrument else (model.fixed**0.5, 0.0)
    )
    low, high = np.sqrt(ends[last] + model.fixed) if fit_instrument else (fitted[0], fitted[0])
    return JointVariances(
        names=names,
        sigma=sigma[joints],
        std=std[joints],
        interval=np.sqrt(ends)[joints],
        instrument=fitted[0],
        instrument_std=fitted[1],
        instrument_interval=(float(low), float(high)),
        log_likelihood=best,
    )


def _std_of_root(theta: Array, error: Array) -> Array:
    """Standard errors of the roots of variances; near zero, where a tangent says nothing, the root of the error.

    ``std(√θ) = std(θ) / (2 √θ)``, with √θ no less than half the root of the error.

    Args:
        theta: (c,) variances; error: (c,) their standard errors, infinite where the data do not determine them.
    """
    finite = np.where(np.isfinite(error), error, 0.0)
    steep = 2 * np.maximum(np.sqrt(theta), np.sqrt(finite) / 2)
    found = np.divide(finite, steep, out=np.zeros_like(finite), where=steep > 0)
    return np.where(np.isfinite(error), found, np.inf)
