"""What each instrument of a calibration measured: its rows, its errors in its own unit, what it left unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from posture_opt.calibration.assumptions.instrument import position_sigma, stated_sigma_of
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.numerics import Array, Codes, Json, rms_length
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
    """

    kind: str
    noun: str
    rows: int
    rms: float
    sigma: float
    unit: str
    places: Mapping[str, Mapping[str, Json]]
    blind_spot: str = ""

    def to_json(self) -> dict[str, Json]:
        """The entry under ``instruments`` of ``calibration.json``."""
        return {
            "kind": self.kind,
            "rows": self.rows,
            "rms": self.rms,
            "sigma": self.sigma or None,
            "unit": self.unit,
            "unknowns": {name: dict(found) for name, found in self.places.items()},
        }


def instruments_of(
    problem: ProblemData, residuals: Residuals, x: Array, errors: Array, kept: Codes
) -> dict[str, Instrument]:
    """The instruments of a calibration by name.

    Args:
        residuals: of all rows; x: (k,) estimates [rad, m]; errors: (N, 3) held-out errors [m]; kept: rows that count.
    """
    data, kind = residuals.data, residuals.data.kind
    own = errors if data.lever is None else errors / data.lever[:, None]
    values, left = residuals.places(x), rms_length(own[kept])
    named = enumerate(data.place_names)
    places = {name or kind.kind: kind.described(name, values[k]) for k, name in named}
    sigma = position_sigma(problem, data) if data.lever is None else stated_sigma_of(problem, data)
    blind = f"{kind.blind_spot}; {kind.remedy}" if kind.blind_spot else ""
    return {kind.kind: Instrument(kind.kind, kind.noun, len(kept), left, sigma, kind.unit, places, blind)}
