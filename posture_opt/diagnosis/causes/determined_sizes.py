"""Whether data determine the size of a cause, and what adds to its standard error: the choice, and masses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from posture_opt.calibration.cross_validation import LinearModel, refit_of_fold, residual_indices
from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.search.nested_selection import NestedSelection
from posture_opt.model.effects import Effect
from posture_opt.model.effects.base.joint_effect import GravityLoaded
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot


def is_determined(values: Array, covariance: Array, columns: Array | None = None) -> bool:
    """Whether a size is larger than its error is at 95 %, all directions of its parameters together.

    The size of parameters θ (k,) is how far they move the tool points, ``|B θ|``, and its error that of a random ``B
    e``: ``|B θ|² > t χ²_{ν, 0.95} / ν`` with ``t = tr M``, ``ν = t² / tr M²`` and ``M = B C Bᵀ``. A size whose error is
    large in a single direction, however well all others are known, is none: it is at least 1.96 times its error in the
    worst one. What has no standard error is no estimate.

    Source: Satterthwaite (1946), the distribution of sums of squares of unequal variances.

    Args:
        values: θ [SI]; covariance: C (k, k) of them.
        columns: B (m, k), the tool points moved by one unit each; one for all, where they are not given.

    Example:
        >>> import numpy as np
        >>> is_determined(np.array([1.0]), np.array([[1.0]])), is_determined(np.array([3.0]), np.array([[1.0]]))
        (False, True)
        >>> is_determined(np.array([20.0, 24.0]), np.diag([1.0, 710.0**2]))  # 20 standard errors from zero
        False
    """
    from scipy.special import chdtri

    own = np.flatnonzero(np.diag(covariance) > 0)
    B = (np.eye(len(values)) if columns is None else columns)[:, own]
    scale = np.sqrt(np.diag(covariance)[own])
    z, gram = values[own] / scale, scale[:, None] * (B.T @ B) * scale
    M = covariance[np.ix_(own, own)] / np.outer(scale, scale) @ gram  # it has the eigenvalues of B C Bᵀ
    trace = float(np.trace(M))
    if not trace > 0:
        return True
    freedom = max(trace**2 / float(np.sum(M * M.T)), 1.0)
    return float(z @ gram @ z) > trace / freedom * float(chdtri(freedom, 0.05))


def determined_parts(model: Fit, place: int) -> tuple[int, ...]:
    """Which parts of an effect have a size that the data of a fit determine, given geometry and all other parts."""
    own, B = model.slices[place], model.effect_columns(place)
    x, C = model.x[own], model.covariance[own, own]
    parts = model.effects[place].size_parts
    sure = tuple(i for i, p in enumerate(parts) if is_determined(x[p], C[p, p], B[:, p]))
    return tuple(range(len(parts))) if not sure and determines_all(model, place) else sure


def determines_all(model: Fit, place: int) -> bool:
    """Whether the data of a fit determine the size of an effect as a whole, all its parts together."""
    part = model.slices[place]
    return is_determined(model.x[part], model.covariance[part, part], model.effect_columns(place))


def stated_parts(model: Fit, place: int) -> tuple[int, ...]:
    """The parts of an effect whose sizes are determined as stated: of unknown loads, the turn about its mean."""
    parts, effect = determined_parts(model, place), model.effects[place]
    if not parts or not (isinstance(effect, GravityLoaded) and effect.unstated_loads):
        return parts
    size, std = turn_about_mean(model, place, parts)
    return parts if is_determined(np.array([size]), np.array([[std**2]])) else ()


def turn_about_mean(model: Fit, place: int, parts: Sequence[int]) -> tuple[float, float]:
    """Root mean square of the turn that parts of an effect make about its mean, and its standard error [rad].

    ``√(θᵀMθ)``, M (k, k) the covariance of the turns by one unit of each parameter, summed over axes where they have
    some; the error to first order. A mean turn is an offset of the joint.
    """
    own = places_of_parts(model, place, parts)
    turns = turns_of(model, place)[:, :, [k - model.slices[place].start for k in own]]
    values, C = model.x[own], model.covariance[np.ix_(own, own)]
    centred = (turns - turns.mean(axis=1, keepdims=True)).reshape(-1, turns.shape[-1])
    M = centred.T @ centred / turns.shape[1]
    size = float(np.sqrt(values @ M @ values))
    return size, float(np.sqrt(values @ M @ C @ M @ values)) / size if size else 0.0


def turns_of(model: Fit, place: int) -> Array:
    """(axes, N, k) turn of its joint by one unit of each parameter of an effect [rad]."""
    state = EffectSensitivities(model.residuals, model.x).state
    ones, rows = model.effects[place].sensitivities(state), np.zeros(len(model.residuals.data))
    joints = np.stack([rows + sum(one.joints.values()) for one in ones], axis=-1)
    if np.any(joints):
        return joints[None]
    return np.stack([np.stack([rows + one.twist[1][axis] for one in ones], axis=-1) for axis in range(3)])


def places_of_parts(model: Fit, place: int, parts: Sequence[int]) -> list[int]:
    """Where in the parameters (k,) of a fit those of some parts of an effect are."""
    first, every = model.slices[place].start, model.effects[place].size_parts
    return [first + k for i in parts for k in range(every[i].start, every[i].stop)]


def undetermined(model: Fit) -> list[int]:
    return [place for place in range(len(model.effects)) if not determined_parts(model, place)]


def choice_deviations(model: Fit, calibrated: Fit, nested: NestedSelection, size: int) -> Array:
    """Parameters (S, K, k) beside what each of K folds chose of S sizes, minus those of this model [SI].

    A standard error holds for the model that was chosen. Other rows choose other neighbours, and what these leave out
    goes into the rest. To the rows of every fold two models are fitted: this one, and the geometry with what the fold
    chose and those effects of the model that it lacks. Where more effects predict rows left out better, but not
    clearly, sets of that size are as good a choice, and compared alike.
    """
    sizes = np.setdiff1d(np.arange(model.directions.shape[1]), model.geometry)
    own = LinearModel.with_columns(model, model.residuals_and_jacobian[1] @ model.directions[:, sizes])
    steps = model.directions[:, np.concatenate([model.geometry, sizes])]
    counts = (size, nested.best) if nested.best > size else (size,)
    found = np.zeros((len(counts), len(nested.folds), len(model.x)))
    for i, count in enumerate(counts):
        for k, fold in enumerate(nested.fitted_sets(calibrated, count, model.effects)):
            here = model.x + steps @ _refitted(own, fold[0], model)
            found[i, k] = _fold_estimate(model, calibrated, *fold) - here
    return found


def with_choice_errors(fit: Fit, deviations: Array) -> Fit:
    """Add the spread between the folds' choices to a covariance: ``C + (t / 1.96)² Σ δ_k δ_kᵀ / (K − 1)``.

    Sources: Buckland, Burnham, Augustin (1997), equation 4, the choices of the folds for the models; JCGM 100:2008,
    annex G.3, for t.

    Args:
        deviations: δ (S, K, k) of the parameters, from `choice_deviations`.
    """
    from scipy.special import stdtrit

    sizes, folds, _ = deviations.shape
    if folds < 2 or not np.any(deviations):
        return fit
    freedom = folds - 1
    steps = deviations.reshape(sizes * folds, -1) @ np.linalg.pinv(fit.directions).T
    few = float(stdtrit(freedom, 0.975)) / 1.96
    return replace(fit, C=fit.C + few**2 * steps.T @ steps / (sizes * freedom))


def _refitted(linear: LinearModel, left_out: Codes, fit: Fit) -> Array:
    """The step (c,) of a linear model without the rows of a fold."""
    theirs = residual_indices(left_out, fit.residuals.block)
    return refit_of_fold(linear, linear.r, np.arange(linear.K.shape[1]), theirs)[0]


def _fold_estimate(
    model: Fit, calibrated: Fit, left_out: Codes, linear: LinearModel, effects: Sequence[Effect],
    columns: Sequence[Array],
) -> Array:  # fmt: skip
    """The parameters (k,) of the model as one fold has them; further arguments from `NestedSelection.fitted_sets`."""
    step = _refitted(linear, left_out, calibrated)
    x = model.x.copy()
    x[: len(calibrated.x)] = calibrated.x + linear.basis @ step
    moved: dict[tuple[str, str], Array] = {}
    first = len(step) - sum(B.shape[1] for B in columns)
    for effect, B in zip(effects, columns, strict=True):
        norms = np.linalg.norm(B, axis=0)
        one = B @ (step[first : first + B.shape[1]] / np.where(norms > 0, norms, 1.0))
        moved[effect.kind, effect.target] = moved.get((effect.kind, effect.target), 0.0) + one
        first += B.shape[1]
    for i, effect in enumerate(model.effects):
        _set_parameters(model, i, moved[effect.kind, effect.target], x)
    return x


def _set_parameters(model: Fit, place: int, moved: Array, x: Array) -> None:
    """Writes into x (k,) the size and shape of an effect that moves the residuals most like ``moved`` (m,)."""
    part, shape = model.slices[place], model.shapes.get(place)
    own = [*range(part.start, part.stop), *([] if shape is None else [shape])]
    J = model.jacobian[:, own]
    norms = np.linalg.norm(J, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    # A shape that does what sine and cosine do is not told from them.
    found = np.linalg.lstsq(J / scale, moved[: len(J)], rcond=1e-10)[0] / scale
    sizes = part.stop - part.start
    x[part] = found[:sizes]
    if shape is not None:
        x[shape] = model.x[shape] + found[sizes]


# Relative standard deviation of the mass of a link: cables, covers and grease are in no table of the maker
_MASS_SIGMA = 0.05
_CENTRE_SIGMA = 0.1  # m, of a payload's centre along each axis of the tool: no file states it
# Standard deviation of the mass at the tool where rows state no payload, as a share of the mass of the links: grippers
# of 1 to 3 kg on arms of 20 to 30 kg, whose rated payloads are 10 to 45 % of their mass by the data sheets
_TOOL_SHARE = 0.07


def with_mass_errors(fit: Fit, of_payload: bool = True) -> Fit:
    """Add the errors of masses and of the payload's centre to the covariance of an estimate: ``C + Σ_k s_k s_kᵀ``.

    ``s_k = −σ A⁺ ∂(Z θ)/∂m_k`` with A all columns of the fit and Z those of the effects that rest on masses, of size
    θ: parameters that are not estimated, but considered. Where payloads differ, these determine the sizes, and s_k of
    the links is small. An arm that carries the same payload again needs no error of its centre.

    Source: Tapley, Schutz, Born (2004), Statistical Orbit Determination, section 6.2.
    """
    loaded = [i for i, effect in enumerate(fit.effects) if "masses" in effect.asks]
    if not loaded:
        return fit
    A, inverse = fit.jacobian @ fit.directions, np.linalg.pinv(fit.minimum.R, rcond=1e-14)
    robot, now = fit.residuals.robot, _shift(fit, fit, loaded)
    steps = []
    for other, sigmas in _other_loads(robot, of_payload, fit.residuals.data.payload is not None):
        loads, inputs = fit.residuals.of_robot(other, fit.residuals.parameters), fit.residuals.arm.inputs
        carried = replace(inputs, payload=np.asarray(inputs.payload) + other.payload - robot.payload)
        loads = replace(loads, arm=loads.arm.under(carried))
        change = (_shift(fit, replace(fit, residuals=loads), loaded) - now) * sigmas
        steps.append(-inverse @ (inverse.T @ (A.T @ change)))
    S = np.array(steps).reshape(len(steps), A.shape[1])
    return replace(fit, C=fit.C + S.T @ S)


def _other_loads(robot: Robot, of_payload: bool, stated: bool) -> Iterator[tuple[Robot, float]]:
    """The arm with one load changed by a step, and the standard deviation of that load in such steps.

    Columns are linear in a load but for the lost motion of one: a step of 10 %, of 0.1 m or of 1 kg serves. ``stated``
    is whether the rows have a payload.
    """
    for k, joint in enumerate(robot.joints):
        if joint.mass > 0:
            joints = (*robot.joints[:k], replace(joint, mass=1.1 * joint.mass), *robot.joints[k + 1 :])
            yield replace(robot, joints=joints), _MASS_SIGMA / 0.1
    for x, y, z in np.eye(3).tolist() if of_payload else ():
        yield replace(robot, payload_centre=(0.1 * x, 0.1 * y, 0.1 * z)), _CENTRE_SIGMA / 0.1
    if of_payload and not stated and not robot.payload:
        yield replace(robot, payload=1.0), _TOOL_SHARE * sum(joint.mass for joint in robot.joints if joint.mass > 0)


def _shift(fit: Fit, loads: Fit, effects: list[int]) -> Array:
    """(m,) what effects of a fit do to its residuals under the masses of another."""
    sensitivities = EffectSensitivities(loads.residuals, loads.x)
    moved = [sensitivities.columns(fit.effects[i]) @ fit.x[fit.slices[i]] for i in effects]
    return np.asarray(np.sum(moved, axis=0)[: fit.residuals.measured])
