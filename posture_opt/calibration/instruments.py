"""What each instrument of a calibration measured: its rows, its errors in its own unit, what it left unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma, stated_sigma_of
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.kinds.mixed import SLOTS, Mixed
from posture_opt.numerics import Array, Codes, Json, rms, rms_length
from posture_opt.selection.problem_data import ProblemData


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
        return document


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
    return {kind.kind: Instrument(kind.kind, kind.noun, len(kept), left, sigma, kind.unit, places, blind)}


def _of_mixed(
    problem: ProblemData, residuals: Residuals, fit: Fit, errors: Array, kept: Codes
) -> dict[str, Instrument]:
    """Each instrument of a file that mixes some; arguments are those of `instruments_of`."""
    data, values = residuals.data, residuals.places(fit.x)
    assert isinstance(data.kind, Mixed), "a file of several instruments"
    assert data.part is not None, "a file of several instruments"
    left = errors[:, 0] if data.lever is None else errors[:, 0] / data.lever
    described = {name: data.kind.described(name, values[k]) for k, name in enumerate(data.place_names)}
    weighed = data.kind.sigmas(problem.measurement)
    variances = variance_components(fit, kept, data.part // SLOTS)
    found = {}
    for k, member in enumerate(data.kind.members):
        own, kind = kept[data.part[kept] // SLOTS == k], member.kind
        count = len(np.unique(data.line[own]))
        places = {key: described[key] for key in (*member.keys, *member.more) if described[key]}
        sigma = float(getattr(problem.measurement, kind.sigma_key, None) or 0.0)
        held_out = float(np.sqrt(np.sum(left[own] ** 2) / max(count, 1)))
        blind = f"{kind.blind_spot}; {kind.remedy}" if kind.blind_spot else ""
        variance, freedom = variances[k]
        scatter = rms(np.array([weighed[data.point_names[code]] for code in data.point[own]])) * variance**0.5
        p = _chance(variance, freedom) if sigma else nan
        found[member.name] = Instrument(
            kind.kind, kind.noun, count, held_out, sigma, kind.unit, places, blind, scatter, p
        )
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
    """Probability of a residual variance as far from 1, in either direction, where the stated σ is right."""
    from scipy.special import gammainc

    below = float(gammainc(freedom / 2, variance * freedom / 2))
    return 2 * min(below, 1 - below)
