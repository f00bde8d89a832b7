"""``check_spread``: whether the spread that a model predicts is the one that was measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np

from posture_opt.calibration.calibration import Calibration, calibrated_parts
from posture_opt.calibration.estimation.error_statistics import folds_of, groups_of
from posture_opt.interrupts import interruptible
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Json, Mask, finite_or_none, rms
from posture_opt.result import Result
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Quantity, Statement, state
from posture_opt.units import plus_minus
from posture_opt.validation.coverage import Coverage
from posture_opt.validation.joint_variances import JointVariances
from posture_opt.validation.prediction import (
    ErrorSources,
    JointScatter,
    Prediction,
    joint_errors,
    nominal_prediction,
    parameter_columns,
    scatter_covariances,
    symmetric_root,
)
from posture_opt.validation.repeat_scatter import (
    RepeatScatter,
    ScatterPrediction,
    ScatterTest,
    observed_variances,
    worth_showing,
)
from posture_opt.validation.residual_scatter import covariance_under, residual_scatter

_WHEN = {"nominal": "before", "calibrated": "after"}
_SOURCES = {"visit": "the scatter in the file", "joints": "the σ's of joint values in the file"}
_JOINT_MODELS = {"joints": "one σ for each joint", "one_sigma": "one σ for all joints"}


@dataclass(frozen=True, eq=False, repr=False)
class SpreadCheck(Result):
    """Predicted spread against measured errors.

    Args:
        calibration: whose measurements these are.
        coverage: of the 95 % regions over all rows, each predicted by an arm that has not seen it: ``nominal`` by
            what the problem states, around the nominal arm with its free frames fitted; ``calibrated`` by what is
            still uncertain of the parameters and the scatter that the calibration leaves.
        stated: whether the problem states any uncertainty of the arm; else its region is the instrument's alone.
        repeats: scatter between repeats against what the problem says of them; ``None`` without repeats or
            where it says nothing.
        repeats_by: ``visit`` where the problem states scatter from repeat to repeat, ``joints`` where its σ's of joint
            values are taken for it.
        repeat_sigma: standard deviation of a coordinate between repeats [m]; 0 without repeats.
        residual_rms: root mean square of a coordinate that the calibration leaves [m].
        noise: σ of each joint and of the instrument, estimated from repeats, or from what the calibration leaves.
        from_repeats: which of the two.
        shown: (n,) whether the scatter of each joint shows: it moves the tool point by a hundredth of what the
            others do, or more.
        stated_sigma: (n,) what the problem states of the joints' scatter [rad, m].
        scatter_predictions: models of the scatter fitted at some postures and judged at others.
        outlying: lines of postures whose repeats differ far more than those of the others; they are left out.
        instrument: the σ of a coordinate [m].
        correlated: pairs of parameters that the problem states to vary together, from robot to robot.
    """

    calibration: Calibration
    coverage: dict[str, Coverage]
    stated: bool
    repeats: ScatterTest | None
    repeats_by: str
    repeat_sigma: float
    residual_rms: float
    noise: JointVariances | None
    from_repeats: bool
    shown: Mask
    stated_sigma: Array
    scatter_predictions: tuple[ScatterPrediction, ...]
    outlying: tuple[int, ...]
    instrument: float
    correlated: tuple[str, ...] = ()

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """Coverage of the stated spread, else of the calibrated one; then what limits it, repeats and joints."""
        return (*_coverage_statements(self), *_repeat_statements(self), *_joint_statements(self))

    @property
    def notes(self) -> tuple[str, ...]:
        """What these data cannot show."""
        return tuple(one.text for one in _unknowable(self))

    @property
    def systematic_share(self) -> float:
        """Share ``1 − (σ_repeat / rms)²`` of the residual variance that is the same in every repeat."""
        return 1 - (self.repeat_sigma / self.residual_rms) ** 2

    @property
    def coverage95(self) -> dict[str, float]:
        """The share of the rows inside the 95 % region that each model predicts."""
        return {name: found.share for name, found in self.coverage.items()}

    def fields_json(self) -> dict[str, object]:
        """The entry ``spread_check`` of ``calibration.json``: SI units and radians."""
        return {
            "uncertainty_stated": self.stated,
            "coverage": self.coverage,
            "repeats": None if self.repeats is None else {**self.repeats.to_json(), "prediction": self.repeats_by},
            "sigma_between_repeats": self.repeat_sigma or None,
            "sigma_left": self.residual_rms,
            "joint_noise": _noise_json(self),
            "odd_lines": self.outlying,
            "held_out": self.scatter_predictions,
            "notes": self.notes,
        }


@overload
def check_spread(calibration: Calibration, /, *, folds: int | None = None) -> SpreadCheck: ...
@overload
def check_spread(
    problem: ProblemData, data: Measurements, calibration: Calibration, *, folds: int | None = None
) -> SpreadCheck: ...
@interruptible()
def check_spread(
    problem: ProblemData | Calibration, data: Measurements | None = None, calibration: Calibration | None = None, *,
    folds: int | None = None,
) -> SpreadCheck:  # fmt: skip
    """Whether the predicted spread is true: between repeats, and over all postures.

    Of errors e_i with predicted covariances C_i, of rows that the model has not seen, 95 % should have
    ``e_iᵀ C_i⁻¹ e_i ≤ χ²_d(0.95)``; ``coverage`` has the share by model and the factor by which C_i is off. Repeats
    have the same test about their own means, `scatter_test`.

    Between repeats only what is drawn anew at every repeat shows: the problem's ``scatter`` or ``repeatability``, and
    the instrument; a wrong link length is the same at every repeat. Over postures everything shows. Outliers of the
    calibration are left out.

    Source of the joints' part: J.-F. Brethé, E. Vasselin, D. Lefebvre, B. Dakyo, Modelling of repeatability phenomena
    using the stochastic ellipsoid approach, Robotica 24 (2006) 477.

    Args:
        problem: the calibration, which has its problem and its measurements; or the problem.
        data: in that case the measurements.
        calibration: in that case the calibration of these measurements.
        folds: of the cross-validation; default: those of the calibration.

    Returns:
        ``SpreadCheck``: measured over predicted scatter, between repeats and over all postures, each with an
        interval; lengths in m.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_measured")
        >>> data = po.read_measurements("problems/planar_2r_measured.csv", problem)
        >>> check = po.check_spread(po.calibrate(problem, data))
        >>> check.coverage["calibrated"].share, check.coverage["calibrated"].verdict
        (0.95, 'right')
    """
    problem, data, calibration = calibrated_parts(problem, data, calibration)
    folds = calibration.request.folds if folds is None else folds
    residuals, rows = calibration.residuals, calibration.kept_rows
    used, groups = residuals.take(rows), groups_of(data, calibration.by, folds)
    errors = ErrorSources.of(residuals, problem.sources)
    scatter = residual_scatter(problem, calibration)
    predictions = held_out_predictions(problem, calibration, folds, scatter)
    between = RepeatScatter.of(used, calibration, errors)
    noise, predicted = observed_variances(between, used, calibration, groups[rows])
    names = problem.sources.names
    pairs = np.argwhere(np.triu(problem.sources.constant, 1) != 0)
    return SpreadCheck(
        calibration=calibration,
        coverage={name: Coverage.of(*parts) for name, parts in predictions.items()},
        stated=bool(errors.names),
        repeats=between.test,
        repeats_by=between.by,
        repeat_sigma=between.sigma,
        residual_rms=rms(calibration.errors[np.ix_(rows, residuals.axes)]),
        noise=noise,
        from_repeats=bool(len(between.scatter.freedom)),
        shown=worth_showing(used, calibration.x, noise),
        stated_sigma=between.stated_sigma,
        scatter_predictions=predicted,
        outlying=between.outlying,
        instrument=residuals.sigma,
        correlated=tuple(f"{names[i]} with {names[j]}" for i, j in pairs),
    )


def _coverage_statements(found: SpreadCheck) -> Iterator[Statement]:
    name = "nominal" if found.stated else "calibrated"
    c = found.coverage[name]
    low, high, factor = (Quantity(v, "number") for v in (*c.factor_interval, c.factor))
    id, share = f"validation.coverage-{c.verdict}", Quantity(c.share, "share")
    yield state(id, name, model=_WHEN[name], share=share, low=low, high=high, factor=factor)
    if not found.stated:
        yield state("validation.uncertainty-unstated")
    for model, one in found.coverage.items():
        if one.concentration:
            more, held = ("more" if one.concentration > 0 else "less"), Quantity(one.held(0.5), "share")
            yield state(f"validation.{more}-concentrated", model, model=_WHEN[model], share=held)
    least, most = found.coverage["nominal"].expected
    # 0.1 of the rows: as far as one draw of the errors that stay moves the share
    if found.stated and most - least > 0.1:
        yield state("validation.one-draw", low=Quantity(least, "share"), high=Quantity(most, "share"))
    yield from _unknowable(found)


def _unknowable(found: SpreadCheck) -> Iterator[Statement]:
    if found.correlated:
        yield state("validation.correlation-of-type", pairs=found.correlated[:3])


def _repeat_statements(found: SpreadCheck) -> Iterator[Statement]:
    test = found.repeats
    if not found.repeat_sigma:
        yield state("validation.scatter-inseparable")
        return
    repeat, residual = Quantity(found.repeat_sigma), Quantity(found.residual_rms)
    # 2.0 times the scatter between repeats: larger residuals than that are no scatter
    if found.residual_rms < 2.0 * found.repeat_sigma:
        yield state("validation.mostly-scatter", repeat=repeat, residual=residual)
    else:
        share = Quantity(found.systematic_share, "share")
        yield state("validation.mostly-systematic", share=share, repeat=repeat, residual=residual)
    if found.outlying:
        yield state("validation.repeats-left-out", lines=[*map(str, found.outlying)])
    if test is None:
        yield state("validation.scatter-unstated")
        return
    low, high, factor = (Quantity(v, "number") for v in (*test.interval, test.factor))
    id, p = f"validation.scatter-{test.verdict}", Quantity(test.p_size, "p")
    yield state(id, source=_SOURCES[found.repeats_by], factor=factor, low=low, high=high, p=p)
    off = sum(not pose.true for pose in test.poses)
    yield state("validation.postures-scatter-otherwise", off=off, postures=test.groups)


def _joint_statements(found: SpreadCheck) -> Iterator[Statement]:
    if found.noise is None:
        return
    yield state("validation.joints-from-repeats" if found.from_repeats else "validation.joints-from-residuals")
    if found.calibration.request.problem.sources.assumed:
        yield state("validation.joints-of-data-sheet")
    by = {model.model: model for model in found.scatter_predictions}
    best = max((by[name] for name in _JOINT_MODELS if name in by), key=lambda model: model.gain, default=None)
    if best is None:
        return
    verdict = {None: "alike", True: "better", False: "worse"}[best.better]
    gain = plus_minus(best.gain, best.gain_std)
    yield state(f"validation.joints-predict-{verdict}", model=_JOINT_MODELS[best.model], gain=gain)


def held_out_predictions(
    problem: ProblemData, calibration: Calibration, folds: int = 5, scatter: JointScatter | None = None
) -> dict[str, tuple[Array, Prediction, Codes]]:
    """Held-out errors (N, d) [m] by model, what is predicted of them, and the groups (N,) that are correlated."""
    residuals, rows, x = calibration.residuals, calibration.kept_rows, calibration.x
    scatter = scatter or residual_scatter(problem, calibration)
    groups = groups_of(residuals.data, calibration.by, folds)
    parts, kept = folds_of(groups, folds, calibration.by), calibration.fit.kept
    sources = ErrorSources.of(residuals, problem.sources)
    nominal = nominal_prediction(residuals, calibration.x_nominal, sources, residuals.sigma, parts, kept)
    # The calibrated arm that predicts a row has not seen its fold.
    J = parameter_columns(residuals, x)
    taught = 1 - 1 / max(len(parts), 2) if calibration.design > 1 else 1.0
    common = np.zeros_like(J)
    for part in (part[kept[part]] for part in parts):
        common[part] = J[part] @ symmetric_root(covariance_under(calibration, scatter, part) / taught)
    sigma = np.array([scatter.sigma.get(name, 0.0) for name in joint_errors(residuals.robot)])
    instrument = scatter.instrument if scatter.measured else residuals.sigma
    calibrated = Prediction(common, scatter_covariances(residuals, x, sigma, instrument))
    measured = np.ix_(rows, residuals.axes)
    return {
        "nominal": (calibration.errors_nominal[measured], nominal.take(rows), groups[rows]),
        "calibrated": (calibration.errors[measured], calibrated.take(rows), groups[rows]),
    }


def _noise_json(found: SpreadCheck) -> dict[str, Json] | None:
    noise = found.noise
    if noise is None:
        return None
    values = zip(noise.names, *(v.tolist() for v in (noise.sigma, noise.std, noise.interval)), strict=True)
    shown = zip(values, found.stated_sigma.tolist(), found.shown.tolist(), strict=True)
    joints: list[Json] = [
        {
            "name": name, "sigma": sigma, "std": finite_or_none(std), "interval95": [low, finite_or_none(high)],
            "stated": given or None, "determined": determined,
        }
        for (name, sigma, std, (low, high)), given, determined in shown
    ]  # fmt: skip
    instrument: dict[str, Json] = {
        "sigma": noise.instrument,
        "std": finite_or_none(noise.instrument_std),
        "interval95": [finite_or_none(end) for end in noise.instrument_interval],
    }
    source = "repeats" if found.from_repeats else "calibration"
    return {"from": source, "joints": joints, "instrument": instrument, "log_likelihood": noise.log_likelihood}
