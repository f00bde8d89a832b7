"""The kinds of noise that a diagnosis names, once every other cause is taken away."""

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
    GROSS_ERRORS,
    NoiseCandidate,
    fit_tails,
    score_stated_sigma,
    score_uneven_noise,
    standardised_residuals,
)
from posture_opt.diagnosis.noise.uneven_noise import (
    NoiseCause,
    NoiseSample,
    UnevenErrors,
    find_uneven_noise,
    spread_by,
)
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline
from posture_opt.measurements.kinds.mixed import Mixed
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import Contrasts, apart, repeat_of_row
from posture_opt.model.effects import JointNoise, Outliers, Rows, StatedSigma
from posture_opt.numerics import Array, Codes, Mask, rms
from posture_opt.selection.problem_data import ProblemData
from posture_opt.validation.prediction import joint_errors, scatter_of_effects
from posture_opt.validation.repeat_scatter import prismatic_joints
from posture_opt.validation.scatter_model import whitened_repeats

_NO_SCATTER = 1e-9  # of the stated σ: rows that are met exactly, and repeats that are copies, show no noise


def noise_causes(
    problem: ProblemData,
    calibration: Calibration,
    model: Fit,
    baseline: ProjectedBaseline,
    adequacy: float,
    seed: int,
) -> tuple[list[NoiseCause], list[UnevenErrors]]:
    """Noisy joints or noise that grows with the range; gross outliers; a stated σ that is wrong.

    The second list holds errors that look like a noisy joint, and that repeats do not show to be one.

    A stated σ is wrong where readings, or repeats, scatter otherwise: in residuals, structure and a noisy joint swell
    them too. Without enough of either, an arm that leaves much more than is stated is left unexplained. Gross errors
    are sought among all rows, those too that the calibration left out.

    Args:
        adequacy: p-value of the tests for anything left unexplained, 0 where an unnamed component is.
        problem: for what it states of instrument and joints.
        model: the arm with its effects; ``baseline`` everything that was fitted, unnamed components too.
        seed: of the null distributions.
    """
    if rms(model.whitened) < _NO_SCATTER:
        return [], []
    samples = noise_samples(problem, model.residuals, baseline, _joint_columns(model), sided_joints(model))
    level = levels.FURTHER_NOISE_LEVEL if model.effects else levels.NOISE_LEVEL
    found, uneven = find_uneven_noise(samples.everything, samples.repeats, seed, level, samples.readings)
    other = bool(found or uneven)
    found += [] if adequacy < levels.LACK_OF_FIT_LEVEL else _outlier_causes(calibration, model, other)
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
    """The joint along which repeats scatter, where structure hides that in all rows; None where none is clear.

    What scatters along a joint, and as stated across it, is that joint's, and no wrong σ of the instrument.
    """
    found = score_uneven_noise(repeated.e, repeated.rows, seed)
    if not found or not found[0].of_arm or found[0].p_value > levels.FURTHER_NOISE_LEVEL:
        return None
    rest = repeated.without(spread_by(found[0], repeated)).e
    if any(quantity.wrong_sigma(quantity.of(rest), quantity.of(rest).size) for quantity in quantities):
        return None
    return NoiseCause(found[0].named(), found[0].estimate, found[0].p_value)


def _excess_errors(
    problem: ProblemData, model: Fit, quantities: Sequence[_Quantity], read: NoiseSample | None
) -> list[UnevenErrors]:
    """Errors larger than instrument and joints as stated allow, or than readings show where these scatter by more.

    Where no posture was left and met again, nothing else says what an arm that is right would leave. A data sheet's
    repeatability, which may be of another arm, is allowed too.
    """
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
    """Instruments of a mixed file that scatter more than stated while another one is as stated; so with orientations.

    What the model cannot explain shows in all of them; the σ of one is wrong where it alone scatters.
    """
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
        if score.p_value < level and score.size > levels.STATED_SIGMA_RATIO:
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
    """Rows (N,) of the data to which every joint that errs by its side of approach came from a known one.

    To the others, as to the first of a file, a joint with play errs by half of it, whatever else is right.
    """
    return np.asarray(np.all(data.approach[:, sided_joints(model)] != 0, axis=1))


@dataclass(frozen=True)
class _Quantity:
    """What has a stated σ of its own: positions, or orientations.

    Args:
        name: as in `StatedSigma`; None where only one is measured.
        part: its coordinates in a row.
        used: its σ, by which residuals are whitened, over the stated one.
        level: of its test.
        estimated: degrees of freedom of the stated σ where it is itself an estimate.
    """

    name: Literal["position", "orientation"] | None
    part: slice
    used: float
    level: float
    estimated: int | None

    def of(self, e: Array) -> Array:
        """Its part (N, d) of whitened residuals (N, block), in units of what is stated."""
        return e[:, self.part] * self.used

    def wrong_sigma(self, e: Array, freedom: int) -> NoiseCandidate | None:
        """The factor by which residuals (N, d), of so many degrees of freedom, scatter otherwise than stated.

        None: as stated, or copies of one reading, which say nothing of it.
        """
        if rms(e) < _NO_SCATTER:
            return None
        squares = e**2
        # Of few residuals the kurtosis is often far below zero by chance: only long tails count.
        kurtosis = max(float(np.mean(squares**2) / np.mean(squares) ** 2 - 3), 0.0)
        found = score_stated_sigma(float(squares.sum()) / freedom, freedom, kurtosis, self.estimated)
        wrong = found.p_value < self.level and abs(np.log(found.size)) > np.log(levels.STATED_SIGMA_RATIO)
        effect = StatedSigma(quantity=self.name, factor=found.size)
        return replace(found, target=effect.target, named=lambda: effect) if wrong else None


def _quantities(problem: ProblemData, residuals: Residuals) -> tuple[_Quantity, ...]:
    """What is measured and has a stated σ: position, and orientation; where it is both, they share the level."""
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
    """What is known of the noise, in units of what the file states of it.

    Args:
        everything: the residuals of all rows.
        repeats: contrasts of repeats between which the arm left the posture.
        readings: contrasts of rows of one posture that follow each other, as if it left it in between too; none where
            the file says that it did not.
        still: the same, as if it did not.
    """

    everything: NoiseSample
    repeats: NoiseSample
    readings: NoiseSample
    still: NoiseSample

    @property
    def repeated(self) -> NoiseSample | None:
        """What shows the instrument's noise: readings, else repeats; None where both are too few.

        Of the two ways to take readings, the one that agrees with what the file states.
        """
        enough = [s for s in (self.still, self.readings) if s.e.size >= levels.MIN_REPEAT_FREEDOM]
        if not enough and self.repeats.e.size >= levels.MIN_REPEAT_FREEDOM:
            enough = [self.repeats]
        return min(enough, key=lambda s: abs(np.log(np.mean(s.e**2))), default=None)


def noise_samples(
    problem: ProblemData, residuals: Residuals, baseline: ProjectedBaseline, columns: Array, sided: Codes | None = None
) -> NoiseSamples:
    """The residuals of all rows, and the contrasts of repeats, in units of what the file states of their scatter.

    Contrasts have lost no freedom to the fit, which errs alike at every repeat: no leverage is given back to them.

    Args:
        columns: (n, N, block) whitened residual per unit of each joint.
        sided: indices of the joints whose side of approach matters, see `Contrasts.of`.
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
    """Covariance (N, axes, axes) of positions that named noise gives the rows, up to a factor.

    None where it is the same.
    """
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

    Where the file states no scatter of the joints from repeat to repeat, and an instrument that is the same everywhere,
    all stays as it is, in units of the instrument's σ.

    ``L⁻¹ e`` with ``L Lᵀ = D + J diag(σ²) Jᵀ`` of all rows of a repeat, D the instrument's variances: the null
    distribution then knows the scatter that is stated.

    Args:
        assumed: take the repeatability of the data sheet where the file states none; else it counts as unknown.
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


def _outlier_causes(calibration: Calibration, model: Fit, other: bool) -> list[NoiseCause]:
    """Gross errors among all rows of known sides, where a few explain the tails better than a long-tailed law."""
    if not calibration.outliers or other:
        return []
    residuals = calibration.residuals
    everyone = model.residuals.of_data(residuals.data, residuals.distances)
    e = everyone.whitened(model.x)[: everyone.measured].reshape(-1, residuals.block)
    law = fit_tails(e[known_sides(model, residuals.data)])
    if law.shape != GROSS_ERRORS:
        return []
    count = int(law.rows.sum())
    p = float(np.exp(-max(law.evidence, 0.0) / 2))
    if p > levels.NOISE_LEVEL:
        return []
    share = Outliers(share=count / len(law.rows))
    return [NoiseCause(share, {"count": (float(count), float("nan"), "1")}, p)]
