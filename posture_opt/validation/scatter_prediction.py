"""Joint scatter estimated at some postures predicts the scatter at others: is that better than one round ellipse?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.errors import InsufficientDataError
from posture_opt.numerics import Array, Codes, Json, Mask
from posture_opt.validation.joint_variances import JointVariances, fit_joint_variances
from posture_opt.validation.prediction import joint_columns, joint_errors
from posture_opt.validation.repeat_scatter import COPY_TOLERANCE_M, RepeatScatter, prismatic_joints
from posture_opt.validation.residual_scatter import unseen_errors
from posture_opt.validation.scatter_model import Scatter, joint_covariances

_SCATTER_FOLDS = 5
_MIN_LEVER_SHARE = 0.01  # of the longest lever
_COORDINATES_PER_SIGMA = 4  # coordinates of scatter for each σ: with fewer, one for all joints is asked for


@dataclass(frozen=True)
class ScatterPrediction:
    """How likely one model makes what was left out, against the round one: per measured row, natural logarithm.

    Args:
        model: ``joints`` (one σ for each), ``one_sigma`` (the same for all joints), ``round`` (one σ for all
            directions at all postures), ``stated`` (what the problem file says; nothing estimated).
        log_likelihood: mean per row.
        gain: mean difference to ``round``, with its standard error over postures.
    """

    model: str
    log_likelihood: float
    gain: float
    gain_std: float

    @property
    def better(self) -> bool | None:
        """Whether it predicts better than the round model; ``None`` within two standard errors."""
        return None if abs(self.gain) <= 2 * self.gain_std else self.gain > 0

    def to_json(self) -> dict[str, Json]:
        """Plain numbers."""
        return dict(vars(self))


def predict_scatter(
    scatter: Scatter, names: tuple[str, ...], groups: Codes, stated: Array | None, instrument: float
) -> tuple[ScatterPrediction, ...]:
    """Models of the scatter fitted at four fifths of the postures, and how they predict the last fifth.

    The log-likelihood of data that a model was not fitted to needs no penalty for the number of its parameters.

    The empty tuple where the postures are too few.

    Args:
        groups: (G,) cases of one code are left out together.
        stated: (G, d, d) covariances that the problem file states [m²], if it does.
        instrument: where the search for the instrument's σ starts [m].
    """
    parts = _fold_parts(groups)
    if len(parts) < 2:
        return ()
    found: dict[str, Array] = {}
    for left_out in parts:
        train = scatter.take(np.setdiff1d(np.arange(len(groups)), left_out))
        test = scatter.take(left_out)
        models = _scatter_models(train, test, names, instrument)
        if stated is not None:
            models["stated"] = stated[left_out]
        for name, covariance in models.items():
            found.setdefault(name, np.full(len(groups), np.nan))[left_out] = test.log_likelihoods(covariance)
    return tuple(
        _held_out(name, values, found["round"], scatter.freedom, groups)
        for name, values in found.items()
        if not np.isnan(values).any()
    )


def _fold_parts(groups: Codes) -> list[Codes]:
    """The cases of each of `_SCATTER_FOLDS` folds, codes of one group together; empty with fewer than two groups."""
    names = np.random.default_rng(0).permutation(np.unique(groups))
    if len(names) < 2:
        return []
    return [np.flatnonzero(np.isin(groups, part)) for part in np.array_split(names, min(_SCATTER_FOLDS, len(names)))]


def _scatter_models(train: Scatter, test: Scatter, names: tuple[str, ...], instrument: float) -> dict[str, Array]:
    """Covariances (G, d, d) [m²] of the cases in ``test`` by each model that ``train`` can teach."""
    d = test.squares.shape[1]
    variance = float(np.trace(train.squares, axis1=-2, axis2=-1).sum()) / float(train.freedom.sum() * d)
    models = {"round": np.broadcast_to(variance * np.eye(d), test.squares.shape)}
    for name, equal in (("joints", False), ("one_sigma", True)):
        noise = _fitted_variances(train, names, instrument, equal)
        if noise is not None:
            models[name] = noise.covariance(test.columns) + test.known
    return models


def _fitted_variances(train: Scatter, names: tuple[str, ...], instrument: float, equal: bool) -> JointVariances | None:
    """Variance components of the training cases; None where they are too few."""
    try:
        return fit_joint_variances(train, names, instrument, True, equal, intervals=False)
    except InsufficientDataError:
        return None


def _held_out(name: str, values: Array, rival: Array, freedom: Array, groups: Codes) -> ScatterPrediction:
    """The mean log-likelihood per row of one model, and its difference to that of the rival with its standard error.

    Args:
        values, rival: (G,) log-likelihoods of the cases left out; freedom: (G,) rows less one of each.
        groups: (G,) codes, over which the standard error is taken.
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
    """σ of joints and instrument from repeats where there are any, else from what the calibration leaves.

    There the uncertainty of its parameters is a known part of every error, which is no instrument's.

    Returns:
        The variances, None where they cannot be estimated; and models of the scatter, compared on postures left out.
    """
    names = joint_errors(used.robot)
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
    equal = coordinates < _COORDINATES_PER_SIGMA * (len(names) + 1)
    try:
        noise = fit_joint_variances(scatter, names, used.sigma, True, equal)
    except InsufficientDataError:
        return None, ()
    return noise, predict_scatter(scatter, names, codes, stated, used.sigma)


def worth_showing(residuals: Residuals, x: Array, noise: JointVariances | None) -> Mask:
    """(n,) whether the data could show a joint's scatter: it moves the point, and its σ is determined."""
    lever = np.sqrt(np.mean(np.sum(joint_columns(residuals, x) ** 2, axis=1), axis=0))
    moving = lever > _MIN_LEVER_SHARE * np.where(prismatic_joints(residuals), 0.0, lever.max())
    return np.asarray(moving & (noise.determined if noise is not None else True))
