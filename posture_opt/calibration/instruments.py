"""What each instrument of a calibration measured: its rows, its errors in its own unit, what it left unknown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite, nan

import numpy as np

from posture_opt.calibration.assumptions.instrument import further_sigmas, position_sigma, stated_sigma_of
from posture_opt.calibration.cross_validation import residual_indices
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.kinds.mixed import Mixed
from posture_opt.numerics import Array, Codes, Json, rms, rms_length
from posture_opt.selection.problem_data import ProblemData


@dataclass(frozen=True)
class FurtherReading:
    """What an instrument reads beside the numbers in which errors count: of poses the orientation.

    Args:
        sigma: as stated [unit]; scatter: by what the fit leaves; p_value: of one as far from the other by chance.
    """

    sigma: float
    unit: str
    scatter: float
    p_value: float

    def to_json(self) -> dict[str, Json]:
        """Its entry in that of the instrument."""
        p_value = self.p_value if isfinite(self.p_value) else None
        return {"sigma": self.sigma or None, "unit": self.unit, "scatter": self.scatter, "p_value": p_value}


@dataclass(frozen=True)
class Instrument:
    """One kind of measurement in a calibration.

    Args:
        kind: its name; ``noun`` what its rows are.
        rows: how many count.
        rms: of the held-out errors of the calibrated arm [unit]; ``sigma`` as stated, 0 where nothing is.
        unit: SI unit of both.
        places: plane, anchor or point -> what was found of it, world [m, rad].
        blind_spot: what such data cannot show, and what to add; empty where they show all.
        scatter: σ of a reading by what the fit leaves, beside other instruments [unit]; 0 where it was not estimated.
        p_value: of a scatter as far from the stated σ by chance; NaN without either.
        further: what else it reads, by its key.
    """

    kind: str
    noun: str
    rows: int
    rms: float
    sigma: float
    unit: str
    places: Mapping[str, Mapping[str, Json]]
    blind_spot: str = ""
    scatter: float = 0.0
    p_value: float = nan
    further: Mapping[str, FurtherReading] = field(default_factory=dict)

    def to_json(self) -> dict[str, Json]:
        """The entry under ``instruments`` of ``calibration.json``."""
        document: dict[str, Json] = {
            "kind": self.kind,
            "rows": self.rows,
            "rms": self.rms,
            "sigma": self.sigma or None,
            "unit": self.unit,
            "unknowns": {name: dict(found) for name, found in self.places.items()},
        }
        if self.scatter:
            document |= {"scatter": self.scatter, "p_value": self.p_value if isfinite(self.p_value) else None}
        return document | {key: one.to_json() for key, one in self.further.items()}


def instruments_of(
    problem: ProblemData, residuals: Residuals, fit: Fit, errors: Array, kept: Codes
) -> dict[str, Instrument]:
    """The instruments of a calibration by name.

    Args:
        residuals: of all rows; fit: to those that count; errors: (N, 3) held-out errors [m]; kept: rows that count.
    """
    data, kind, x = residuals.data, residuals.data.kind, fit.x
    if data.part is not None:
        return _of_mixed(problem, residuals, fit, errors, kept)
    own = errors if data.lever is None else errors / data.lever[:, None]
    values, left = residuals.places(x), rms_length(own[kept])
    named = enumerate(data.place_names)
    places = {name or kind.kind: kind.described(name, values[k]) for k, name in named}
    sigma = position_sigma(problem, data) if data.lever is None else stated_sigma_of(problem, data)
    blind = f"{kind.blind_spot}; {kind.remedy}" if kind.blind_spot else ""
    further = _further_readings(problem, residuals, fit, kept) if kind.further else {}
    one = Instrument(kind.kind, kind.noun, len(kept), left, sigma, kind.unit, places, blind, further=further)
    return {kind.kind: one}


def _further_readings(problem: ProblemData, residuals: Residuals, fit: Fit, kept: Codes) -> dict[str, FurtherReading]:
    """What the one instrument of a file reads beside; arguments are those of `instruments_of`."""
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
    """Each instrument of a file that mixes some; arguments are those of `instruments_of`."""
    data, values = residuals.data, residuals.places(fit.x)
    assert isinstance(data.kind, Mixed), "a file of several instruments"
    assert data.part is not None, "a file of several instruments"
    left = errors[:, 0] if data.lever is None else errors[:, 0] / data.lever
    described = {name: data.kind.described(name, values[k]) for k, name in enumerate(data.place_names)}
    found = dict[str, Instrument]()
    scatters = _scatters(problem, residuals, fit, kept)
    for (member, quantity), (own, seen) in zip(data.kind.quantities, scatters, strict=True):
        kind, count = member.kind, len(np.unique(data.line[own]))
        if quantity in kind.further:
            whole = found[member.name]
            found[member.name] = replace(whole, further={**whole.further, quantity.key: seen})
            continue
        places = {key: described[key] for key in (*member.keys, *member.more) if described[key]}
        held_out = float(np.sqrt(np.sum(left[own] ** 2) / max(count, 1)))
        blind = f"{kind.blind_spot}; {kind.remedy}" if kind.blind_spot else ""
        found[member.name] = Instrument(
            kind.kind, kind.noun, count, held_out, seen.sigma, kind.unit, places, blind, seen.scatter, seen.p_value
        )
    return found


def _scatters(
    problem: ProblemData, residuals: Residuals, fit: Fit, kept: Codes
) -> Iterator[tuple[Codes, FurtherReading]]:
    """Of each quantity of a mixed file its rows that count, and how far these scatter."""
    data = residuals.data
    assert isinstance(data.kind, Mixed), "a file of several instruments"
    assert data.part is not None, "a file of several instruments"
    group, (names, place) = data.kind.quantity_of(data.part), data.weighed
    weighed = data.kind.sigmas(problem.measurement)
    every = np.array([weighed[name] for name in names])[place]
    for k, (variance, freedom) in enumerate(variance_components(fit, kept, group)):
        own, (_, one) = kept[group[kept] == k], data.kind.quantities[k]
        sigma = float(getattr(problem.measurement, one.key, None) or 0.0)
        p = _chance(variance, freedom) if sigma else nan
        yield own, FurtherReading(sigma, one.unit, rms(every[own]) * variance**0.5, p)


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
    """Probability of a residual variance as far from 1, in either direction, where the stated σ is right."""
    from scipy.special import gammainc

    below = float(gammainc(freedom / 2, variance * freedom / 2))
    return 2 * min(below, 1 - below)
