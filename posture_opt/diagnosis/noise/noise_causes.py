"""The kinds of noise that a diagnosis names, once every other cause is taken away, and the noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from posture_opt.calibration.assumptions.instrument import further_ratio, position_sigma, relative_sigma
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.calibration.instruments import variance_components
from posture_opt.diagnosis.noise.noise_candidates import (
    NoiseCandidate,
    gross_errors,
    score_stated_sigma,
    score_uneven_noise,
    standardised_residuals,
)
from posture_opt.diagnosis.noise.uneven_noise import NoiseCause, NoiseSample, UnevenErrors, find_uneven_noise
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline
from posture_opt.measurements.kinds.mixed import Mixed
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import Contrasts, apart, repeat_of_row
from posture_opt.model.effects import JointNoise, Outliers, Rows, StatedSigma
from posture_opt.numerics import Array, Codes, Mask, rms, rms_length
from posture_opt.selection.problem_data import ProblemData
from posture_opt.validation.prediction import joint_errors, prismatic_joints, scatter_of_effects
from posture_opt.validation.scatter_model import whitened_repeats

_TRUE_RATIO = 1.2  # a stated σ is true enough within this factor: less is not worth a word
_NO_SCATTER = 1e-9  # of the stated σ: rows that are met exactly, and repeats that are copies, show no noise


def noise_causes(
    problem: ProblemData, calibration: Calibration, model: Fit, baseline: ProjectedBaseline, adequacy: float, seed: int
) -> tuple[list[NoiseCause], list[UnevenErrors]]:
    """Noisy joints or noise that grows with the range; gross outliers; a stated σ that is wrong.

    The second list holds errors that only look like a noisy joint. A stated σ is wrong where readings, or repeats,
    scatter otherwise: in residuals, structure and a noisy joint swell them too. Without enough of either, an arm that
    leaves much more than is stated is left unexplained.
    """
    if rms(model.whitened) < _NO_SCATTER:
        return [], []
    samples = noise_samples(problem, model.residuals, baseline, _joint_columns(model), sided_joints(model))
    level = levels.FURTHER_NOISE_LEVEL if model.effects else levels.NOISE_LEVEL
    found, uneven = find_uneven_noise(samples.everything, samples.repeats, seed, level, samples.readings)
    if calibration.outliers and not (found or uneven) and adequacy >= levels.LACK_OF_FIT_LEVEL:
        found += _outlier_causes(calibration, model)
    if not position_sigma(problem, model.residuals.data) or found:
        return found, uneven
    quantities, repeated = _quantities(problem, model.residuals), samples.repeated
    joint = None if repeated is None else _scattering_joint(repeated, quantities, seed)
    if joint is not None:
        return [*found, joint], uneven
    for quantity in quantities:
        e = np.zeros((0, 1)) if repeated is None else quantity.of(repeated.e)
        wrong = quantity.wrong_sigma(e, e.size) if e.size else None
        found += [] if wrong is None else [NoiseCause(wrong.named(), wrong.estimate, wrong.p_value)]
    if not uneven and adequacy >= levels.LACK_OF_FIT_LEVEL and samples.repeats.e.size < levels.MIN_REPEAT_FREEDOM:
        mixed = model.residuals.data.part is not None
        uneven += _wrong_instruments(problem, model) if mixed else _excess_errors(problem, model, quantities, repeated)
    return found, uneven


def _scattering_joint(repeated: NoiseSample, quantities: Sequence[_Quantity], seed: int) -> NoiseCause | None:
    """The joint along which repeats scatter, and as stated across it, where structure hides that in all rows."""
    found = score_uneven_noise(repeated.e, repeated.rows, seed)
    if not found or not found[0].of_arm or found[0].p_value > levels.FURTHER_NOISE_LEVEL:
        return None
    rest = repeated.beside(found[0]).e
    if any(quantity.wrong_sigma(quantity.of(rest), quantity.of(rest).size) for quantity in quantities):
        return None
    return NoiseCause(found[0].named(), found[0].estimate, found[0].p_value)


def _excess_errors(
    problem: ProblemData, model: Fit, quantities: Sequence[_Quantity], read: NoiseSample | None
) -> list[UnevenErrors]:
    """Errors larger than instrument and joints as stated allow, or than readings show where these scatter by more."""
    left = model.whitened.reshape(-1, model.residuals.block)
    left = in_stated_units(problem, model.residuals, left, _joint_columns(model), assumed=True)[0]
    found = list[UnevenErrors]()
    for quantity in quantities:
        e, seen = quantity.of(left), np.zeros(0) if read is None else quantity.of(read.e)
        free = max(e.size - len(model.minimum.x) * e.shape[1] // left.shape[1], 1)
        shown = float(np.mean(seen**2)) if seen.size else 0.0
        yardstick = quantity if shown <= 1 else replace(quantity, estimated=seen.size)
        wrong = yardstick.wrong_sigma(e / np.sqrt(max(shown, 1.0)), free)
        if wrong is not None and wrong.size > 1:
            found.append(UnevenErrors(wrong.named(), wrong.p_value, False, np.zeros(0)))
    return found


def _wrong_instruments(problem: ProblemData, model: Fit) -> list[UnevenErrors]:
    """Instruments of a mixed file that scatter more than stated while another does not: what lacks shows in all."""
    data, kind = model.residuals.data, model.residuals.data.kind
    assert isinstance(kind, Mixed), "a file of several instruments"
    assert data.part is not None, "a file of several instruments"
    group, r = kind.quantity_of(data.part), model.whitened
    level, found, agree = levels.NOISE_LEVEL / len(kind.quantities), list[UnevenErrors](), False
    for k, (variance, freedom) in enumerate(variance_components(model, np.arange(len(data)), group)):
        (_, quantity), own = kind.quantities[k], r[group == k]
        if not getattr(problem.measurement, quantity.key, None) or freedom < levels.MIN_REPEAT_FREEDOM:
            continue
        kurtosis = max(float(np.mean(own**4) / np.mean(own**2) ** 2 - 3), 0.0)
        score = score_stated_sigma(variance, int(freedom), kurtosis)
        if score.p_value < level and score.size > _TRUE_RATIO:
            effect = StatedSigma(quantity=kind.quantity_names[k], factor=score.size)
            found.append(UnevenErrors(effect, score.p_value, False, np.zeros(0)))
        agree = agree or score.p_value >= level
    return found if agree else []


def sided_joints(model: Fit) -> Codes:
    """Indices of the joints whose side of approach matters: those with an effect that depends on it."""
    names = model.residuals.robot.joint_names
    sided = {effect.moved_joint for effect in model.effects if "approach" in effect.needs}
    return np.array([i for i, name in enumerate(names) if name in sided], dtype=np.intp)


def known_sides(model: Fit, data: Measurements) -> Mask:
    """Rows (N,) of the data to which every joint that errs by its side of approach came from a known one."""
    return np.asarray(np.all(data.approach[:, sided_joints(model)] != 0, axis=1))


@dataclass(frozen=True)
class _Quantity:
    """What has a stated σ of its own: positions, or orientations."""

    name: Literal["position", "orientation"] | None
    part: slice
    used: float
    level: float
    estimated: int | None

    def of(self, e: Array) -> Array:
        """Its part (N, d) of whitened residuals (N, block), in units of what is stated."""
        return e[:, self.part] * self.used

    def wrong_sigma(self, e: Array, freedom: int) -> NoiseCandidate | None:
        """The factor by which residuals (N, d), of so many degrees of freedom, scatter otherwise than stated."""
        if rms(e) < _NO_SCATTER:
            return None
        squares = e**2
        # Of few residuals the kurtosis is often far below zero by chance: only long tails count.
        kurtosis = max(float(np.mean(squares**2) / np.mean(squares) ** 2 - 3), 0.0)
        found = score_stated_sigma(float(squares.sum()) / freedom, freedom, kurtosis, self.estimated)
        wrong = found.p_value < self.level and abs(np.log(found.size)) > np.log(_TRUE_RATIO)
        effect = StatedSigma(quantity=self.name, factor=found.size)
        return replace(found, target=effect.target, named=lambda: effect) if wrong else None


def _quantities(problem: ProblemData, residuals: Residuals) -> tuple[_Quantity, ...]:
    estimated = None if problem.measurement is None else problem.measurement.degrees_of_freedom
    if not residuals.data.kind.further:
        return (_Quantity(None, slice(None), 1.0, levels.NOISE_LEVEL, estimated),)
    axes, used = len(residuals.axes), further_ratio(problem, residuals.further)
    return (
        _Quantity("position", slice(axes), 1.0, levels.FURTHER_NOISE_LEVEL, estimated),
        _Quantity("orientation", slice(axes, None), used, levels.FURTHER_NOISE_LEVEL, estimated),
    )


@dataclass(frozen=True, eq=False)
class NoiseSamples:
    """What is known of the noise, in units of what the file states of it."""

    everything: NoiseSample
    repeats: NoiseSample
    readings: NoiseSample
    still: NoiseSample

    @property
    def repeated(self) -> NoiseSample | None:
        """What shows the instrument's noise: readings, else repeats; None where both are too few."""
        enough = [s for s in (self.still, self.readings) if s.e.size >= levels.MIN_REPEAT_FREEDOM]
        if not enough and self.repeats.e.size >= levels.MIN_REPEAT_FREEDOM:
            enough = [self.repeats]
        return min(enough, key=lambda s: abs(np.log(np.mean(s.e**2))), default=None)


def noise_samples(
    problem: ProblemData, residuals: Residuals, baseline: ProjectedBaseline, columns: Array, sided: Codes | None = None
) -> NoiseSamples:
    """The residuals of all rows, and the contrasts of repeats, in units of what the file states of their scatter.

    Args:
        columns: (n, N, block) whitened residual per unit of each joint.
    """
    m, block, data = residuals.measured, residuals.block, residuals.data
    Q = baseline.Q[:m].reshape(-1, block, baseline.Q.shape[1])
    raw = baseline.e[:m].reshape(-1, block)
    e, levers = in_stated_units(problem, residuals, standardised_residuals(raw, Q @ np.swapaxes(Q, 1, 2)), columns)
    ranges = _instrument_ranges(residuals)
    turned = block - len(residuals.axes)
    rows = Rows(residuals.robot, levers, ranges, residuals.sigma, repeat_of_row(data), turned)
    plain = NoiseSample(in_stated_units(problem, residuals, raw, columns)[0], rows)
    repeats = plain.between(Contrasts.of(data, prismatic_joints(residuals), sided))
    still = plain.between(Contrasts.of_readings(data))
    if problem.data.repeats == "readings":
        return NoiseSamples(NoiseSample(e, rows), repeats, still.none, still)
    # Had the arm left its posture in between, each row would have a draw of the stated scatter to itself.
    left = apart(data)
    e_left, levers_left = in_stated_units(problem, residuals.of_data(left, residuals.distances), raw, columns)
    alone = NoiseSample(e_left, replace(rows, levers=levers_left, visits=repeat_of_row(left)))
    return NoiseSamples(NoiseSample(e, rows), repeats, alone.between(Contrasts.of_readings(data)), still)


def noise_shape(model: Fit, causes: Sequence[NoiseCause]) -> Array | None:
    """Covariance (N, axes, axes) of positions that named noise gives the rows, up to a factor."""
    residuals = model.residuals
    columns = _joint_columns(model)[:, :, : len(residuals.axes)]
    rows = Rows(residuals.robot, columns, _instrument_ranges(residuals), residuals.sigma)
    shapes = [shape for cause in causes if (shape := cause.effect.shape(rows)) is not None]
    one = np.eye(columns.shape[2])
    return np.asarray(one + sum(shape - one for shape in shapes)) if shapes else None


def joint_scatter(model: Fit, causes: Sequence[NoiseCause]) -> Array | None:
    """(N, block, k) whitened shift of the rows per standard deviation of each joint that scatters; None without one."""
    names, columns = model.residuals.robot.joint_names, _joint_columns(model)
    every = [
        cause.effect.value * columns[names.index(cause.effect.target)]
        for cause in causes
        if isinstance(cause.effect, JointNoise)
    ]
    return np.stack(every, axis=2) if every else None


def _joint_columns(model: Fit) -> Array:
    """Whitened residuals (n, N, block) per unit of each joint value."""
    return np.moveaxis(model.residuals.sensitivities(model.residuals.robot.driven, model.x), -1, 0)


def _instrument_ranges(residuals: Residuals) -> Array | None:
    """Distances (N,) of the measured points from the instrument at the world's origin [m]; None of touched points."""
    position = residuals.data.position
    return None if position is None else np.asarray(np.linalg.norm(position, axis=1))


def in_stated_units(
    problem: ProblemData, residuals: Residuals, e: Array, columns: Array, *, assumed: bool = False
) -> tuple[Array, Array]:  # fmt: skip
    """Residuals (N, d) and joint columns (n, N, d) in units of what instrument and joints should scatter by.

    ``L⁻¹ e`` with ``L Lᵀ = D + J diag(σ²) Jᵀ`` of all rows of a repeat, D the instrument's variances: the null
    distribution then knows the scatter that is stated.
    """
    sources, own = problem.sources, relative_sigma(problem, residuals.data)
    scatter = dict(zip(sources.names, np.sqrt(np.diag(sources.scatter)).tolist(), strict=True))
    if sources.assumed and not assumed:
        scatter = scatter_of_effects(problem.robot, problem.effects)
    sigma = np.array([scatter.get(name, 0.0) for name in joint_errors(problem.robot)])
    if not sigma.any() and np.all(own == 1.0):
        return e, columns
    S = np.moveaxis(columns, 0, 2) * sigma
    instrument = np.ones(e.shape)
    instrument[:, : len(residuals.axes)] = own[:, None] ** 2
    return whitened_repeats(e, columns, S, repeat_of_row(residuals.data), instrument)


def _outlier_causes(calibration: Calibration, model: Fit) -> list[NoiseCause]:
    """Gross errors among all rows of known sides, where a few explain the tails better than a long-tailed law."""
    residuals = calibration.residuals
    everyone = model.residuals.of_data(residuals.data, residuals.distances)
    e = everyone.whitened(model.x)[: everyone.measured].reshape(-1, residuals.block)
    found = gross_errors(e[known_sides(model, residuals.data)])
    if found is None or (p := float(np.exp(-max(found[1], 0.0) / 2))) > levels.NOISE_LEVEL:
        return []
    count, rows = float(found[0].sum()), len(found[0])
    return [NoiseCause(Outliers(share=count / rows), {"count": (count, float("nan"), "1")}, p)]


@dataclass(frozen=True)
class NoiseFloor:
    """RMS length of an error that no model can explain.

    Args:
        rms: [m] of the length of the position error, all measured axes together; 0 where it is not known.
        stated: the floor by what is stated [m], beside that of repeats; 0 where it is not known.
    """

    rms: float
    repeated: bool
    source: Literal["instrument", "touch"] = "instrument"
    stated: float = 0.0

    @property
    def label(self) -> str:
        return "measurement noise" if self.repeated else f"{self.source} as stated"

    @classmethod
    def of(cls, problem: ProblemData, model: Fit, contrasts: Contrasts) -> NoiseFloor:
        """The noise floor of measurements.

        ``sqrt(mean |d|²)`` of the contrasts d between repeats of one posture and target, each scaled to the variance of
        one reading; where there are too few, σ √k for k measured axes.
        """
        residuals = model.residuals
        e = model.whitened.reshape(-1, residuals.block)[:, : len(residuals.axes)] * residuals.sigma
        source: Literal["instrument", "touch"] = "touch" if residuals.data.touches else "instrument"
        stated = position_sigma(problem, residuals.data) * float(np.sqrt(e.shape[1]))
        if len(contrasts) * e.shape[1] < levels.MIN_REPEAT_FREEDOM:
            return cls(stated, False, source, stated)
        differences = contrasts.differences(e) / np.sqrt(contrasts.reading)[:, None]
        return cls(rms_length(differences), True, source, stated)

    def held_out(self, model: Fit, rounds: int) -> float:
        """The floor [m] with what it costs to fit many parameters to few numbers.

        Rows left out are predicted with the errors of a fit to the others: ``noise · sqrt(1 + k / m)`` for k parameters
        fitted to m numbers.
        """
        numbers = len(model.residuals.data) * len(model.residuals.axes)
        return self.rms * float(np.sqrt(1 + model.count / (numbers * (1 - 1 / max(rounds, 2)))))
