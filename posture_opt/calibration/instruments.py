"""Instruments of a calibration: rows, errors and scatter of each, and whether they can better the arm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import nan, sqrt
from statistics import NormalDist

import numpy as np

from posture_opt.calibration.assumptions.instrument import further_sigmas, position_sigma, stated_sigma_of
from posture_opt.calibration.cross_validation import residual_indices
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.least_squares import reduced_jacobian
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.encoding import Encoded
from posture_opt.measurements.kinds import Kind, Mixed
from posture_opt.measurements.repeats import Contrasts
from posture_opt.numerics import Array, Codes, Json, finite_or_none, rms, rms_length, stacked_rows
from posture_opt.selection.problem_data import ProblemData


@dataclass(frozen=True)
class FurtherReading:
    """What an instrument reads beside the numbers in which errors count: of poses the orientation."""

    sigma: float  # as stated [unit]; scatter: by what the fit leaves; p_value: of one as far from the other by chance
    unit: str
    scatter: float
    p_value: float

    def to_json(self) -> dict[str, Json]:
        p_value = finite_or_none(self.p_value)
        return {"sigma": self.sigma or None, "unit": self.unit, "scatter": self.scatter, "p_value": p_value}


@dataclass(frozen=True)
class Instrument:
    """One kind of measurement in a calibration."""

    kind: str  # its name; ``noun`` what its rows are
    noun: str
    rows: int  # how many count
    rms: float  # of the held-out errors of the calibrated arm [unit]; ``sigma`` as stated, 0 where nothing is
    sigma: float
    unit: str  # SI unit of both
    places: Mapping[str, Mapping[str, Json]]  # plane, anchor or point -> what was found of it, world [m, rad]
    blind_spot: str = ""  # what such data cannot show, and what to add; empty where they show all
    # σ of a reading by what the fit leaves, beside other instruments [unit]; 0 where it was not estimated
    scatter: float = 0.0
    p_value: float = nan  # of a scatter as far from the stated σ by chance; NaN without either
    further: Mapping[str, FurtherReading] = field(default_factory=dict)  # what else it reads, by its key

    def to_json(self) -> dict[str, Json]:
        document: dict[str, Json] = {name: getattr(self, name) for name in ("kind", "rows", "rms", "unit")}
        document |= {
            "sigma": self.sigma or None,
            "unknowns": {name: dict(found) for name, found in self.places.items()},
        }
        if self.scatter:
            document |= {"scatter": self.scatter, "p_value": finite_or_none(self.p_value)}
        return document | {key: one.to_json() for key, one in self.further.items()}


def instruments_of(
    problem: ProblemData, residuals: Residuals, fit: Fit, errors: Array, kept: Codes
) -> dict[str, Instrument]:
    """The instruments of a calibration by name.

    residuals: of all rows; fit: to those that count; errors: (N, 3) held-out errors [m]; kept: rows that count.
    """
    data, kind = residuals.data, residuals.data.kind
    if data.part is not None:
        return _of_mixed(problem, residuals, fit, errors, kept)
    own = errors if data.lever is None else errors / data.lever[:, None]
    values, left = residuals.places(fit.x), rms_length(own[kept])
    places = {name or kind.kind: kind.described(name, values[k]) for k, name in enumerate(data.place_names)}
    sigma = position_sigma(problem, data) if data.lever is None else stated_sigma_of(problem, data)
    further = _further_readings(problem, residuals, fit, kept) if kind.further else {}
    read = (kind.kind, kind.noun, len(kept), left, sigma, kind.unit)
    return {kind.kind: Instrument(*read, places, _blind_spot(kind), further=further)}


def _blind_spot(kind: Kind) -> str:
    return f"{kind.blind_spot}; {kind.remedy}" if kind.blind_spot else ""


def _further_readings(problem: ProblemData, residuals: Residuals, fit: Fit, kept: Codes) -> dict[str, FurtherReading]:
    further, block = residuals.data.kind.further, residuals.block
    group = np.array([1 + k for k, one in enumerate(further) for _ in one.slots])
    every = np.tile(np.r_[np.zeros(len(residuals.axes), dtype=np.intp), group], len(residuals.data))
    variances = variance_components(fit, residual_indices(kept, block), every)
    stated, found = further_sigmas(problem), {}
    for one, (variance, freedom) in zip(further, variances[1:], strict=True):
        used, sigma = residuals.further[one.key], stated[one.key]
        p = _chance(variance * (used / sigma) ** 2, freedom)
        found[one.key] = FurtherReading(sigma, one.unit, used * variance**0.5, p)
    return found


def _of_mixed(
    problem: ProblemData, residuals: Residuals, fit: Fit, errors: Array, kept: Codes
) -> dict[str, Instrument]:
    data, values = residuals.data, residuals.places(fit.x)
    assert isinstance(data.kind, Mixed), "a file of several instruments"
    assert data.part is not None, "a file of several instruments"
    left = errors[:, 0] if data.lever is None else errors[:, 0] / data.lever
    described = {name: data.kind.described(name, values[k]) for k, name in enumerate(data.place_names)}
    group, (names, place) = data.kind.quantity_of(data.part), data.weighed
    weighed, found = data.kind.sigmas(problem.measurement), dict[str, Instrument]()
    every = np.array([weighed[name] for name in names])[place]
    variances = variance_components(fit, kept, group)
    for k, ((member, quantity), (variance, freedom)) in enumerate(zip(data.kind.quantities, variances, strict=True)):
        own, kind = kept[group[kept] == k], member.kind
        sigma = float(getattr(problem.measurement, quantity.key, None) or 0.0)
        scatter, p = rms(every[own]) * variance**0.5, _chance(variance, freedom) if sigma else nan
        if quantity in kind.further:
            more = {quantity.key: FurtherReading(sigma, quantity.unit, scatter, p)}
            found[member.name] = replace(found[member.name], further={**found[member.name].further, **more})
            continue
        places = {key: described[key] for key in (*member.keys, *member.more) if described[key]}
        count = len(np.unique(data.line[own]))
        held_out = float(np.sqrt(np.sum(left[own] ** 2) / max(count, 1)))
        read = (kind.kind, kind.noun, count, held_out, sigma, kind.unit)
        found[member.name] = Instrument(*read, places, _blind_spot(kind), scatter, p)
    return found


def variance_components(fit: Fit, kept: Codes, group: Codes) -> list[tuple[float, float]]:
    """Residual variance of each group of rows in units of their σ's, and its degrees of freedom (Förstner 1979).

    ``|r_k|² / f_k`` with ``f_k = n_k − tr H_kk``, H the hat matrix of the fit, its prior included.
    """
    inverse = np.linalg.pinv(fit.minimum.R, rcond=1e-14)
    Q = fit.jacobian[kept] @ fit.directions @ inverse
    r, leverage, own = fit.whitened[kept], np.sum(Q**2, axis=1), group[kept]
    found = []
    for k in range(int(group.max()) + 1):
        freedom = max(float(np.sum(own == k) - leverage[own == k].sum()), 1e-9)
        found.append((float(np.sum(r[own == k] ** 2)) / freedom, freedom))
    return found


def _chance(variance: float, freedom: float) -> float:
    from scipy.special import gammainc

    below = float(gammainc(freedom / 2, variance * freedom / 2))
    return 2 * min(below, 1 - below)


def orientation_ratio(fit: Fit) -> float:
    """How many times as far orientations scatter as positions, each in units of the σ that weighs it; 1 where as far.

    ``√((Σ e_r² / ν_r) / (Σ e_p² / ν_p))`` over contrasts of repeats, which no error of the model is in, or else over
    what the fit leaves, with the degrees of freedom that it leaves to each (Förstner 1979). It is 1 where an F test
    does not find them different, where they differ by less than half, and where no orientation counts.
    """
    residuals = fit.residuals
    if not residuals.data.kind.further:
        return 1.0
    kept = np.flatnonzero(fit.kept)
    data = residuals.data.take(kept)
    e = fit.whitened.reshape(-1, residuals.block)[kept]
    slides = np.array([joint.type == "prismatic" for joint in residuals.robot.joints])
    for contrasts in (Contrasts.of(data, slides), Contrasts.of_readings(data)):
        # 12 degrees of freedom from which on repeats decide alone: a σ is then known to a fifth.
        if 3 * len(contrasts) >= 12:
            pure = contrasts.differences(e) / np.sqrt(contrasts.reading)[:, None]
            return _ratio(pure, np.ones(pure.shape), len(residuals.axes))
    J = reduced_jacobian(fit.jacobian, fit.directions).reshape(len(fit.kept), residuals.block, -1)[kept]
    Q, _ = np.linalg.qr(J.reshape(e.size, -1))
    return _ratio(e, 1 - np.sum(Q**2, axis=1).reshape(e.shape), len(residuals.axes))


def _ratio(e: Array, left: Array, axes: int) -> float:
    """The ratio of the scatter of the last coordinates of residuals e (N, d) to that of the first ``axes`` of them."""
    from scipy.special import fdtr, fdtrc

    square, freedom = (np.array([np.sum(v[:, :axes]), np.sum(v[:, axes:])]) for v in (e**2, left))
    if np.min(freedom) < 1 or np.min(square) <= 0:
        return 1.0
    F = float(np.divide(*(square / freedom)[::-1]))
    p = 2 * float(min(fdtr(*freedom[::-1], F), fdtrc(*freedom[::-1], F)))
    ratio = float(np.sqrt(F))
    # 1.5 ratio from which on orientations are weighed anew: with less, a fit loses at the most a seventh of its
    # information, ``4 k / (1 + k)²`` for a variance that is wrong by k.
    # 0.002 level at which both scatter alike.
    return ratio if p < 0.002 and max(ratio, 1 / ratio) > 1.5 else 1.0


@dataclass(frozen=True)
class InstrumentScatter(Encoded, json="scatter arm unit exceeds_arm=exceeds"):
    """One reading: what is left of it after calibration, against what errors of the arm make of it."""

    scatter: float  # standard deviation of a reading about the calibrated arm [unit]
    arm: float  # RMS change of a reading by errors of the nominal arm, with free frames and places fitted [unit]
    unit: str  # SI unit of both; ``noun`` what is read, in plural
    noun: str

    @property
    def exceeds(self) -> bool:
        return self.scatter > self.arm


def instrument_scatter(fit: Fit, x_nominal: np.ndarray) -> InstrumentScatter | None:
    """The scatter of the instrument beside the errors of the arm; None of positions, which show the arm as it is.

    Of variances s² after calibration and s₀² before, each per degree of freedom, the arm's part is ``√(s₀² − s²)``.

    x_nominal (k,) deviations with only free frames and places fitted [rad, m].
    """
    used = fit.residuals.take(np.flatnonzero(fit.kept))
    kind = used.data.kind
    if not kind.leaves_geometry_open:
        return None
    r = used.whitened(x_nominal)[: used.measured]
    before = float(r @ r) / max(len(r) - len(used.free), 1)
    sigma = rms(np.broadcast_to(used.row_sigma, len(used.data)))
    arm = sqrt(max(before - fit.variance, 0.0))
    unit = kind.unit if used.data.lever is None else "m"  # what a pixel is at the marker
    return InstrumentScatter(sigma * sqrt(fit.variance), sigma * arm, unit, kind.noun)


LEAST_PROBABILITY = 0.9
"""With which a calibrated arm must be better than the nominal one to be delivered. Where an instrument scatters twice
as much as an arm errs, one in ten fits is worse than nominal even with the true tolerances and the true σ.
"""


def probability_of_gain(fit: Fit, x_nominal: Array) -> float:
    """``Φ(|u|² / 2s)``: that positions at the fitted rows are nearer to the true ones with ``x`` than with ``x₀``.

    They change by ``u = P J (x − x₀)``, where P takes out what a motion of the base does, and those of ``x`` err by ``P
    J e`` with e of covariance C; those of ``x₀`` by ``P J e + u``, which is longer where ``2 uᵀJe > −|u|²``; ``s² = uᵀ
    J C Jᵀ u``.

    x_nominal: x₀ (k,), only free frames and places fitted [rad, m].
    """
    used = fit.residuals.take(np.flatnonzero(fit.kept))
    n, reached = len(used.data), used.walk(fit.x)
    own = [i for i, p in enumerate(used.parameters) if p.source]
    twists = used.arm.twists([used.parameters[i].source for i in own], used.q, reached, used.deviations(fit.x))
    J = np.zeros((n, 3, len(fit.x)))
    for i, (shift, _) in zip(own, twists, strict=True):
        rows = used.parameters[i].code < 0 or used.data.target == used.parameters[i].code
        J[:, :, i] = np.where(np.reshape(rows, (-1, 1)), stacked_rows(shift, n), 0.0)
    # P takes off the six columns of a motion of the base.
    p = stacked_rows(reached.position, n)
    turns = np.stack([np.cross(axis, p - p.mean(axis=0)) for axis in np.eye(3)], axis=2)
    columns = np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), turns], axis=2)
    base, flat = np.linalg.qr(columns.reshape(3 * n, 6))[0], J.reshape(3 * n, -1)
    PJ = flat - base @ (base.T @ flat)
    u = PJ @ (fit.x - x_nominal)
    slope = PJ.T @ u
    s = float(np.sqrt(np.maximum(slope @ fit.covariance @ slope, 0.0)))
    return NormalDist().cdf(float(u @ u) / (2 * s)) if s > 0 else 0.5
