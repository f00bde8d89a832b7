"""Calibration: the parameters of the arm from measurements, with honest errors, and what they bring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import erfc, isfinite, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt import evaluation_of
from posture_opt.calibration.assumptions.frames import far_frames
from posture_opt.calibration.calibration_statements import CORRELATION_SHOWN, statements_of
from posture_opt.calibration.cross_validation import HeldOut
from posture_opt.calibration.doubts import OtherPreset, other_preset
from posture_opt.calibration.estimation.error_statistics import By, Statistics
from posture_opt.calibration.estimation.fit import Fit, fit_with_effects
from posture_opt.calibration.estimation.fit_request import FitRequest
from posture_opt.calibration.estimation.identifiability import ANGLE_TOLERANCE_RAD, LENGTH_TOLERANCE_M, Identifiability
from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.calibration.instruments import (
    LEAST_PROBABILITY,
    Instrument,
    InstrumentScatter,
    instrument_scatter,
    instruments_of,
    probability_of_gain,
)
from posture_opt.calibration.second_file import OtherFile
from posture_opt.calibration.start_up import StartUp, start_up
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Json, Mask, finite_or_none
from posture_opt.result import Result
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Statement

if TYPE_CHECKING:
    from posture_opt.calibration.assumptions.contradictions import Contradiction
    from posture_opt.calibration.data_checks import Disagreement
    from posture_opt.calibration.doubts import Doubt
    from posture_opt.calibration.second_file import LargeFile
    from posture_opt.model.effects import Effect


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Result):
    """What measurements say about the parameters of an arm.

    Args:
        request: the arm as stated, the measurements, and what else was asked.
        fit: of everything, in the parameters of the file; directions that are not determined have no variance in it.
        x_nominal: (k,) deviations from nominal with only free frames fitted [rad, m].
        fixed: (k,) whether the data, or a prior, determine the parameter.
        identifiability: rank, observability and the undetermined combinations in words.
        nominal, calibrated: position errors by cross-validation [m], nominal with free frames fitted.
        held: those errors row by row, of all N rows, by model.
        errors_fitted: (N, 3) position errors of the arm fitted to all rows [m].
        by: the groups that the cross-validation left out together.
        test: another file predicted by what this one taught.
        prior: (k,) the σ of each parameter that counts as knowledge [rad, m]; NaN where there is none.
        assumed: (k,) whether that is a tolerance by manufacturing, and not stated.
        unseen: (k,) part of the standard errors that combinations leave which nothing determines [rad, m].
        notes: sentences for the report.
        contradictions: what the problem file states as known and the data refute; ``request`` is without it.
        disagreement: what is left of data that are hardly this arm's; None of others.
        large: what a file of very many rows was thinned to, ``request`` with it; None where all rows were used.
        doubts: what can hardly be as the file says; copies of rows count once.
    """

    request: FitRequest
    fit: Fit
    x_nominal: Array
    fixed: Mask
    identifiability: Identifiability
    nominal: Statistics
    calibrated: Statistics
    held: Mapping[str, HeldOut]
    errors_fitted: Array
    by: By
    test: OtherFile | None
    prior: Array
    assumed: Mask
    unseen: Array
    notes: tuple[str, ...] = ()
    contradictions: tuple[Contradiction, ...] = ()
    disagreement: Disagreement | None = None
    large: LargeFile | None = None
    doubts: tuple[Doubt, ...] = ()

    @property
    def far_frames(self) -> dict[str, float]:
        """Free frames that are where none can be, and how far off [m]."""
        return far_frames(self.residuals, self.x)

    @property
    def implausible(self) -> dict[str, tuple[float, float, str]]:
        """Geometry farther from nominal than parts ever are, with certainty: (deviation, standard error, SI unit)."""
        far = {"m": 5 * LENGTH_TOLERANCE_M, "rad": 5 * ANGLE_TOLERANCE_RAD}  # and five standard errors
        own = np.where(self.assumed, nan, self.prior).tolist()
        rows = zip(self.parameters, self.x.tolist(), self.std.tolist(), own, strict=True)
        return {
            p.name: (x, std, p.unit)
            for p, x, std, stated in rows
            if p.group == "geometry" and not isfinite(stated) and abs(x) > max(far[p.unit], 5 * std)
        }

    @property
    def residuals(self) -> Residuals:
        """The arm against these measurements, as a function of ``x``."""
        return self.fit.residuals

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """(k,) what was unknown."""
        return self.fit.residuals.parameters

    @property
    def x(self) -> Array:
        """(k,) deviations from nominal [rad, m]."""
        return self.fit.x

    @property
    def covariance(self) -> Array:
        """(k, k) of ``x``."""
        return self.fit.covariance

    @property
    def variance(self) -> float:
        """Residual variance in units of the instrument's."""
        return self.fit.variance

    @property
    def design(self) -> float:
        """How many rows say as much as one alone would, as neighbouring postures err alike."""
        return self.fit.design

    @property
    def errors_nominal(self) -> Array:
        """(N, 3) position errors by cross-validation [m], with only free frames fitted."""
        return self.held["nominal"].errors

    @property
    def errors(self) -> Array:
        """(N, 3) position errors by cross-validation [m], calibrated."""
        return self.held["calibrated"].errors

    @property
    def coverage(self) -> dict[str, float]:
        """Share of the rows that count inside the 95 % region that other rows lead one to expect."""
        return {"calibrated": float(self.held["calibrated"].inside[self.fit.kept].mean())}

    @property
    def outliers(self) -> tuple[int, ...]:
        """Rows left out of the fit, counted from 0."""
        return tuple(int(i) for i in np.flatnonzero(~self.fit.kept))

    @property
    def lines(self) -> tuple[int, ...]:
        """Their lines in the file."""
        return tuple(int(line) for line in self.residuals.data.line[~self.fit.kept])

    def fit_effects(self, residuals: Residuals, effects: Sequence[Effect]) -> Fit:
        """Geometry as it was fitted here, together with effects: the prior weighs as much.

        Args:
            residuals: of the rows that count, in the same parameters.
        """
        if not np.isfinite(self.prior).any():
            return fit_with_effects(residuals, self.x, self.identifiability.directions, effects)
        fit = self.fit
        return fit_with_effects(residuals, fit.x, fit.directions, effects, fit.prior, fit.weight)

    @property
    def outliers_at_ends(self) -> int:
        """How many outliers follow each other, in the order of measuring, from the first row on or to the last.

        Gross errors of an instrument do not: what was moved then does.
        """
        kept = self.fit.kept
        inside = np.flatnonzero(kept[self.request.data.order])
        return len(kept) - 1 - int(inside[-1] - inside[0])

    @property
    def kept_rows(self) -> Codes:
        """(M,) rows that are no outliers."""
        return np.flatnonzero(self.fit.kept)

    @property
    def std(self) -> Array:
        """(k,) standard errors [rad, m]; NaN where nothing determines the parameter, nor a tolerance holds it."""
        variance = np.maximum(np.diag(self.covariance), 0.0) + self.unseen**2
        return np.where(self.fixed | self.assumed, np.sqrt(variance), np.nan)

    @property
    def z(self) -> Array:
        """(k,) deviations from nominal over their standard errors; NaN where nothing determines the parameter."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(self.fixed & (self.std > 0), self.x / self.std, np.nan))

    @property
    def p_values(self) -> Array:
        """(k,) probability of a deviation as far from nominal where the parameter has its nominal value; or NaN."""
        return np.array([erfc(abs(z) / 2**0.5) if isfinite(z) else nan for z in self.z.tolist()])

    @property
    def correlation(self) -> Array:
        """(k, k) of the estimates; zero where nothing determines the parameter."""
        variance = np.diag(self.covariance)
        scale = np.where(self.fixed & (variance > 0), 1 / np.sqrt(np.maximum(variance, 1e-300)), 0.0)
        return np.asarray(self.covariance * np.outer(scale, scale))

    @cached_property
    def evaluation(self) -> Any:
        """What the calibration is held against: the ``Evaluation`` of `posture_opt.validation.calibrated_arm`."""
        return evaluation_of(self)

    @cached_property
    def instruments(self) -> dict[str, Instrument]:
        """What each instrument measured, by name."""
        return instruments_of(self.request.problem, self.residuals, self.fit, self.errors, self.kept_rows)

    @cached_property
    def instrument_scatter(self) -> InstrumentScatter | None:
        """Whether the instrument scatters more than the arm errs; None of positions."""
        return instrument_scatter(self.fit, self.x_nominal)

    @cached_property
    def better_than_nominal(self) -> float | None:
        """Probability that positions of the calibrated arm are nearer to true than those of the nominal one.

        At the measured postures, see `probability_of_gain`.

        None where no tolerance of parts is assumed: data that show the whole geometry judge an arm on held-out rows.
        """
        return probability_of_gain(self.fit, self.x_nominal) if self.assumed.any() else None

    @property
    def keeps_nominal(self) -> bool:
        """Whether the nominal arm is delivered: rows left out are predicted no worse by it.

        Or the instrument is worse than the arm, and a gain not sure enough. A fine level does not show that positions
        get better, as it sees no length; what it shows of angles is sure.
        """
        unsure = self.better_than_nominal is not None and self.better_than_nominal < LEAST_PROBABILITY
        worse = self.instrument_scatter is not None and self.instrument_scatter.exceeds
        return not self.predicts_better or (worse and unsure)

    @property
    def predicts_better(self) -> bool:
        """Whether the calibrated arm predicts rows left out better than the nominal one."""
        return self.held["calibrated"].rms < self.held["nominal"].rms

    @property
    def delivered(self) -> Array:
        """(k,) deviations from nominal of the arm that is delivered [rad, m]: found, or with only frames fitted."""
        return self.x_nominal if self.keeps_nominal else self.x

    @cached_property
    def start_up(self) -> StartUp | None:
        """First rows that are farther off than the rest, of those that count and predicted by the calibrated arm."""
        return start_up(self.errors[self.kept_rows], self.request.data.take(self.kept_rows))

    @cached_property
    def other_preset(self) -> OtherPreset | None:
        """The preset whose link lengths the data have in place of the file's; None where there is none."""
        return other_preset(self.residuals.take(self.kept_rows), self.x_nominal)

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """What it has to say, the answer first, and what follows from what it is held against."""
        evaluated: tuple[Statement, ...] = self.evaluation.statements
        return (*statements_of(self), *evaluated)

    def fields_json(self) -> dict[str, Json]:
        """The document ``calibration.json``: SI units and radians; what the calibration is held against included."""
        evaluated: dict[str, Json] = self.evaluation.to_json()
        return self.estimates_json() | evaluated

    def estimates_json(self) -> dict[str, Json]:
        """The part of the document that the calibration itself knows."""
        names, known, C = [p.name for p in self.parameters], self.identifiability, self.correlation
        pairs = np.argwhere(np.triu(np.abs(C) > CORRELATION_SHOWN, 1))
        values = {"std": self.std, "prior": self.prior, "z": self.z, "p_value": self.p_values}
        further = {
            "other_preset": self.other_preset, "instrument_scatter": self.instrument_scatter, "start_up": self.start_up,
            "test": self.test, "thinned": self.large,
        }  # fmt: skip
        document: dict[str, Json] = {
            "residual_rms": {"nominal": self.nominal.rms, "calibrated": self.calibrated.rms},
            "residuals": {"nominal": self.nominal.to_json(), "calibrated": self.calibrated.to_json()},
            "coverage95": dict(self.coverage),
            "cross_validation": self.by,
            "parameters": [
                {
                    "name": p.name, "estimate": float(p.nominal + self.x[i]), "nominal": p.nominal, "unit": p.unit,
                    "determined": bool(self.fixed[i]),
                    **{name: finite_or_none(float(value[i])) for name, value in values.items()},
                }
                for i, p in enumerate(self.parameters)
            ],
            "correlations": [{"parameters": [names[i], names[j]], "correlation": float(C[i, j])} for i, j in pairs],
            "instruments": {name: one.to_json() for name, one in self.instruments.items()},
            "rows_per_independent": self.design,
            "rank": known.rank,
            "condition": known.condition,
            "singular_values": known.singular_values.tolist(),
            "observability": dict(known.observability),
            "undetermined": list(known.words),
            "residual_variance": self.variance,
            "outliers": list(self.outliers),
            "outlier_lines": list(self.lines),
            "notes": list(self.notes),
            "contradictions": [contradiction.to_json() for contradiction in self.contradictions],
            "disagrees": self.disagreement is not None,
            "far_frames": self.far_frames,
            "nominal_kept": self.keeps_nominal,
            "doubts": [doubt.to_json() for doubt in self.doubts],
        }  # fmt: skip
        if self.better_than_nominal is not None:
            document["better_than_nominal"] = self.better_than_nominal
        return document | {name: one.to_json() for name, one in further.items() if one is not None}


def calibrated_parts(
    problem: ProblemData | Calibration, data: Measurements | None, calibration: Calibration | None
) -> tuple[ProblemData, Measurements, Calibration]:
    """What a function of a calibration was given: the calibration alone, or its problem and measurements before it."""
    if isinstance(problem, Calibration) and data is None and calibration is None:
        return problem.request.problem, problem.request.data, problem
    if isinstance(problem, Calibration) or data is None or calibration is None:
        raise TypeError("give the calibration alone, or the problem, its measurements and the calibration")
    return problem, data, calibration
