"""Scatter between repeats of one posture, beside its prediction, and whether joint scatter predicts others."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.encoding import Encoded
from posture_opt.errors import InsufficientDataError
from posture_opt.measurements.measurements import outlying_groups, rows_of
from posture_opt.measurements.repeats import repeats_of_one_kind
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.validation.joint_variances import JointVariances, fit_joint_variances
from posture_opt.validation.model_errors import holm_rejections
from posture_opt.validation.prediction import ErrorSources, joint_columns, joint_errors, prismatic_joints
from posture_opt.validation.residual_scatter import unseen_errors
from posture_opt.validation.scatter_model import Scatter, joint_covariances

COPY_TOLERANCE_M = 1e-9  # m: repeats that agree to less are one row written twice


@dataclass(frozen=True, eq=False)
class RepeatScatter:
    """Scatter between repeats, and what the problem predicts of it."""

    scatter: Scatter  # of the postures commanded more than once
    # (G, d, d) predicted there [m²], and their ``test``; ``None`` where the problem says nothing of it
    covariances: Array | None
    test: ScatterTest | None
    by: str  # ``visit`` or ``joints``, see `repeat_errors`
    stated_sigma: Array  # (n,) of each joint from repeat to repeat, as stated [rad, m]
    outlying: tuple[int, ...]  # lines of postures that were left out

    @property
    def sigma(self) -> float:
        """Standard deviation of a coordinate, pooled [m]; 0 without repeats."""
        nu = self.scatter.freedom
        total = float(np.trace(self.scatter.squares, axis1=-2, axis2=-1).sum())
        return float(np.sqrt(total / (nu.sum() * self.scatter.squares.shape[1]))) if len(nu) else 0.0

    @classmethod
    def of(cls, used: Residuals, calibration: Calibration, errors: ErrorSources) -> RepeatScatter:
        """Of the rows that a calibration kept."""
        data = used.data
        between, by = repeat_errors(errors, used)
        driven = joint_errors(used.robot)
        stated = np.zeros(len(driven))
        for k, name in enumerate(driven):
            if name in errors.names:
                stated[k] = np.sqrt(between[errors.names.index(name), errors.names.index(name)])
        codes = np.arange(len(data)) if data.position is None else repeats_of_one_kind(data, prismatic_joints(used))
        scatter = Scatter.of(used.error(calibration.x)[:, used.axes], joint_columns(used, calibration.x), codes)
        firsts = np.array([rows[0] for rows in rows_of(codes) if len(rows) > 1], dtype=np.intp)
        copied = np.trace(scatter.squares, axis1=-2, axis2=-1) <= scatter.freedom * COPY_TOLERANCE_M**2
        scatter, firsts = scatter.take(~copied), firsts[~copied]
        size = np.trace(scatter.squares, axis1=-2, axis2=-1)
        gross = outlying_groups(size, scatter.freedom * scatter.squares.shape[1])
        outlying = tuple(int(line) for line in data.line[firsts[gross]])
        scatter, firsts = scatter.take(~gross), firsts[~gross]
        if not len(firsts):
            return cls(scatter, None, None, by, stated, outlying)
        first = used.take(firsts)
        B = first.metres(first.sensitivities(errors.names, calibration.x)[:, : len(used.axes)])
        C = B @ between @ np.swapaxes(B, -1, -2) + used.sigma**2 * np.eye(len(used.axes))
        if not between.any():
            return cls(scatter, None, None, by, stated, outlying)
        return cls(scatter, C, scatter_test(scatter, C, data.line[firsts]), by, stated, outlying)


def repeat_errors(errors: ErrorSources, residuals: Residuals) -> tuple[Array, str]:
    """The covariance of what changes between repeats; where the problem says nothing of it, σ's of joint values.

    Returns (k, k) covariance [rad², m²], and ``visit`` if the problem states scatter, ``joints`` if σ's of joints
    replace it.
    """
    if errors.scatter.any():
        return errors.scatter, "visit"
    driven = np.isin(errors.names, joint_errors(residuals.robot))
    return np.where(np.outer(driven, driven), errors.constant, 0.0), "joints"


@dataclass(frozen=True)
class PoseScatter:
    """The scatter about the mean at one posture."""

    line: int  # of the first repeat; ``n`` repeats
    n: int
    measured: float  # measured, predicted: standard deviation of a coordinate, root of the mean over the axes [m]
    predicted: float
    factor: float  # measured over predicted, in the metric of the prediction
    # p_size, p_shape: probabilities of scatter so different in size, or in shape too (NaN with too few repeats), were
    # the prediction true; ``true`` whether nothing speaks against it, all postures tested together
    p_size: float
    p_shape: float
    true: bool


@dataclass(frozen=True, eq=False)
class ScatterTest(
    Encoded,
    json="visits=rows postures=groups factor factor_interval95=interval p_size p_shape verdict poses",
):
    """Scatter between repeats against its prediction."""

    rows: int  # rows, groups: rows that repeat a posture, and how many postures
    groups: int
    factor: float  # measured over predicted standard deviation, pooled; ``interval`` holds it with 95 %
    interval: tuple[float, float]
    p_size: float  # p_size, p_shape: as of a posture, over all of them
    p_shape: float
    poses: tuple[PoseScatter, ...]  # those with most repeats first

    @property
    def verdict(self) -> str:
        """``right``, ``understated`` or ``overstated``: whether the interval of the factor holds 1."""
        low, high = self.interval
        return "right" if low <= 1 <= high else "understated" if self.factor > 1 else "overstated"


def scatter_test(scatter: Scatter, covariances: Array, lines: Codes) -> ScatterTest:
    """Sums of squares A_g with ν_g degrees of freedom against predicted covariances C_g (G, d, d) [m²].

    Size: ``tr(C_g⁻¹ A_g) ~ χ²(ν_g d)``, exactly, so that the pooled ``f² = Σ tr(C⁻¹ A) / Σ ν d`` has the interval ``Σ
    tr / χ²``. Size and shape: ``ν (tr(C⁻¹S) − ln |C⁻¹S| − d) ~ χ²(d (d + 1) / 2)`` for ``S = A / ν``, with Bartlett's
    factor ``1 − (2d² + 3d − 1) / (6 ν (d + 1))`` (Anderson 2003, 10.8), where ν is 2 d or more. Postures are judged
    together by Holm's (1979) rule.

    lines (G,) the line of each posture's first repeat; scatter: sums of squares and degrees of freedom of G postures;
    covariances: predicted (G, d, d) [m²].
    """
    from scipy.special import chdtrc, chdtri

    nu, d = scatter.freedom, scatter.squares.shape[1]
    whitened = np.linalg.solve(covariances, scatter.squares)
    size = np.trace(whitened, axis1=-2, axis2=-1)
    used = nu >= 2 * d  # with less freedom the likelihood ratio is not χ² even with Bartlett's factor
    safe = np.where(used[:, None, None], whitened / nu[:, None, None], np.eye(d))
    ratio = nu * (np.trace(safe, axis1=-2, axis2=-1) - np.linalg.slogdet(safe)[1] - d)
    shape = np.maximum(ratio * (1 - (2 * d * d + 3 * d - 1) / (6 * nu * (d + 1))), 0.0)
    p_size, p_shape = _two_sided(size, nu * d), np.where(used, chdtrc(d * (d + 1) / 2, shape), np.nan)
    least = np.where(used, 2 * np.fmin(p_size, p_shape), p_size)  # two tests where there are two
    false = holm_rejections(list(least))
    total, freedom = float(size.sum()), float(nu.sum() * d)
    low, high = np.sqrt(total / np.array([chdtri(freedom, 0.025), chdtri(freedom, 0.975)]))
    many = int(used.sum())
    order = np.argsort(-nu, kind="stable")
    measured = np.sqrt(np.trace(scatter.squares, axis1=-2, axis2=-1) / (nu * d))
    predicted = np.sqrt(np.trace(covariances, axis1=-2, axis2=-1) / d)
    factors = np.sqrt(size / (nu * d))
    poses = tuple(
        PoseScatter(
            int(lines[g]), int(nu[g]) + 1, float(measured[g]), float(predicted[g]), float(factors[g]),
            float(p_size[g]), float(p_shape[g]), not false[g],
        )
        for g in order
    )  # fmt: skip
    return ScatterTest(
        rows=int(nu.sum()) + len(nu),
        groups=len(nu),
        factor=float(np.sqrt(total / freedom)),
        interval=(float(low), float(high)),
        p_size=float(_two_sided(total, freedom)),
        p_shape=float(chdtrc(many * d * (d + 1) / 2, shape[used].sum())) if many else float("nan"),
        poses=poses,
    )


def _two_sided(value: Array | float, freedom: Array | float) -> Array:
    """Twice the smaller tail of χ².

    The p-value of a two-sided test, at most 1; ``value`` is χ² with ``freedom`` degrees under the null.
    """
    from scipy.special import chdtr, chdtrc

    return np.asarray(np.minimum(2 * np.minimum(chdtr(freedom, value), chdtrc(freedom, value)), 1.0))


@dataclass(frozen=True)
class ScatterPrediction:
    """How likely one model makes what was left out, against the round one: per measured row, natural logarithm."""

    # ``joints`` (one σ for each), ``one_sigma`` (the same for all joints), ``round`` (one σ for all directions at all
    # postures), ``stated`` (what the problem file says; nothing estimated)
    model: str
    log_likelihood: float  # mean per row
    gain: float  # mean difference to ``round``, with its standard error over postures
    gain_std: float

    @property
    def better(self) -> bool | None:
        """Whether it predicts better than the round model; ``None`` within two standard errors."""
        return None if abs(self.gain) <= 2 * self.gain_std else self.gain > 0


def predict_scatter(
    scatter: Scatter, names: tuple[str, ...], groups: Codes, stated: Array | None, instrument: float
) -> tuple[ScatterPrediction, ...]:
    """Models of the scatter fitted at four fifths of the postures, and how they predict the last fifth.

    groups (G,) cases of one code are left out together; stated (G, d, d) covariances that the problem file states [m²],
    if it does; instrument: where the search for the instrument's σ starts [m].
    """
    codes = np.random.default_rng(0).permutation(np.unique(groups))
    if len(codes) < 2:
        return ()
    found: dict[str, Array] = {}
    for part in np.array_split(codes, min(5, len(codes))):
        own = np.isin(groups, part)
        train, test = scatter.take(np.flatnonzero(~own)), scatter.take(np.flatnonzero(own))
        models = _scatter_models(train, test, names, instrument)
        if stated is not None:
            models["stated"] = stated[own]
        for name, covariance in models.items():
            found.setdefault(name, np.full(len(groups), np.nan))[own] = test.log_likelihoods(covariance)
    known = {name: values for name, values in found.items() if not np.isnan(values).any()}
    return tuple(_held_out(name, v, found["round"], scatter.freedom, groups) for name, v in known.items())


def _scatter_models(train: Scatter, test: Scatter, names: tuple[str, ...], instrument: float) -> dict[str, Array]:
    """Covariances (G, d, d) [m²] of the cases in ``test`` by each model that ``train`` can teach."""
    d = test.squares.shape[1]
    variance = float(np.trace(train.squares, axis1=-2, axis2=-1).sum()) / float(train.freedom.sum() * d)
    models = {"round": np.broadcast_to(variance * np.eye(d), test.squares.shape)}
    for name, equal in (("joints", False), ("one_sigma", True)):
        with suppress(InsufficientDataError):
            noise = fit_joint_variances(train, names, instrument, True, equal, intervals=False)
            models[name] = noise.covariance(test.columns) + test.known
    return models


def _held_out(name: str, values: Array, rival: Array, freedom: Array, groups: Codes) -> ScatterPrediction:
    """The mean log-likelihood per row of one model, and its difference to that of the rival with its standard error.

    values, rival (G,) log-likelihoods of the cases left out; freedom: (G,) rows less one of each; groups (G,) codes,
    over which the standard error is taken.
    """
    rows = float(freedom.sum())
    codes = np.unique(groups, return_inverse=True)[1]
    gain, many = (values - rival).sum() / rows, int(codes.max()) + 1
    off = np.bincount(codes, values - rival) - gain * np.bincount(codes, freedom)
    std = np.sqrt(np.sum(off**2) * many / max(many - 1, 1)) / rows
    return ScatterPrediction(name, float(values.sum() / rows), float(gain), float(std))


def observed_variances(
    between: RepeatScatter, used: Residuals, calibration: Calibration, groups: Codes
) -> tuple[JointVariances | None, tuple[ScatterPrediction, ...]]:
    """σ of joints and instrument from repeats where there are any, else from what the calibration leaves."""
    names = joint_errors(used.robot)
    if not names:
        return None, ()
    if len(between.scatter.freedom):
        scatter, codes, stated = between.scatter, np.arange(len(between.scatter.freedom)), between.covariances
    else:
        left, known, _ = unseen_errors(calibration)
        scatter, codes = Scatter.of(left, joint_columns(used, calibration.x), known=known), groups
        stated = None
        if between.stated_sigma.any():
            stated = joint_covariances(scatter.columns, between.stated_sigma, used.sigma) + known
    if not scatter.squares.max(initial=0.0) > COPY_TOLERANCE_M**2:
        return None, ()
    coordinates = float(scatter.freedom.sum()) * scatter.squares.shape[1]
    # 4 coordinates of scatter for each σ: with fewer, one for all joints is asked for
    equal = coordinates < 4 * (len(names) + 1)
    try:
        noise = fit_joint_variances(scatter, names, used.sigma, True, equal)
    except InsufficientDataError:
        return None, ()
    return noise, predict_scatter(scatter, names, codes, stated, used.sigma)


def worth_showing(residuals: Residuals, x: Array, noise: JointVariances | None) -> Mask:
    """(n,) whether the data could show a joint's scatter: it moves the point, and its σ is determined."""
    lever = np.sqrt(np.mean(np.sum(joint_columns(residuals, x) ** 2, axis=1), axis=0))
    # 0.01 of the longest lever
    if not lever.size:
        return np.zeros(0, dtype=bool)
    moving = lever > 0.01 * np.where(prismatic_joints(residuals), 0.0, lever.max())
    return np.asarray(moving & (noise.determined if noise is not None else True))
