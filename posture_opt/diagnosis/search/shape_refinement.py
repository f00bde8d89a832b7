"""The best shape of a candidate near the grid point where it was found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.diagnosis.scores.candidates import Candidate, LinearisedData
from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline, projected_basis, unit_columns
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent, finer_phases
from posture_opt.model.effects import CyclicError, Effect
from posture_opt.numerics import Array, Mask

_MOMENTS_TRIED = 24  # of a step, before those next to the best; chosen for time


def refine_shape(sensitivities: EffectSensitivities, baseline: ProjectedBaseline, candidate: Candidate) -> Candidate:
    """The candidate at the shape, between its neighbours on the grid, that explains most of the residuals."""
    effect = candidate.what
    if isinstance(effect, UnnamedComponent):
        return max(finer_shapes(sensitivities, candidate), key=lambda s: _explained_square(baseline, s.Z))
    steps = effect.shape_steps(sensitivities.state)
    if len(steps):
        return _best_step(sensitivities, baseline, candidate, effect, steps)
    return _best_smooth(sensitivities, baseline, candidate, effect) if effect.smooth_shape else candidate


def has_shape(sensitivities: EffectSensitivities, candidate: Candidate) -> bool:
    effect = candidate.what
    if isinstance(effect, UnnamedComponent):
        return any(True for _ in finer_phases(sensitivities, effect))
    return bool(effect.smooth_shape) or len(effect.shape_steps(sensitivities.state)) > 0


def finer_shapes(sensitivities: EffectSensitivities, candidate: Candidate) -> Iterator[Candidate]:
    """The candidate at some shapes between its neighbours on the grid, its own among them."""
    effect = candidate.what
    yield candidate
    if isinstance(effect, UnnamedComponent):
        yield from (Candidate(u, Z, candidate.searched) for u, Z in finer_phases(sensitivities, effect))
        return
    shapes = effect.shape_steps(sensitivities.state)
    if len(shapes) > 2 * _MOMENTS_TRIED:  # of thousands of rows: between two of these the model hardly changes
        shapes = shapes[np.linspace(0, len(shapes) - 1, 2 * _MOMENTS_TRIED).astype(int)]
    if not len(shapes) and effect.smooth_shape:
        shapes = np.linspace(*effect.bracket(_joint_span(sensitivities, effect)), 7)
    for shaped in (effect.with_shape(float(shape)) for shape in shapes):
        yield Candidate(shaped, sensitivities.columns(shaped), candidate.searched)


def separate_lines(linearised: LinearisedData, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The candidates without lines that are nearer than `Lines.least_distance` to one before them of the same joint."""
    least = {lines.form.joint: lines.least_distance for lines in linearised.lines}
    found: list[Candidate] = []
    taken: dict[str, list[float]] = {}
    for candidate in candidates:
        if isinstance(candidate.what, CyclicError):
            others = taken.setdefault(candidate.target, [])
            if any(abs(candidate.what.cycles - cycles) <= least[candidate.target] for cycles in others):
                continue
            others.append(candidate.what.cycles)
        found.append(candidate)
    return found


def sharpen_lines(linearised: LinearisedData, members: Sequence[Candidate], learn: Mask) -> list[Candidate]:
    """The members with the cycles of all lines fitted together, to the rows ``learn`` (m,): a Gauss-Newton step.

    A line that was found before others is a little off, towards them, and what it leaves looks like another line next
    to it (Mamandipoor, Ramasamy, Madhow 2016). A step is at most half of what keeps two lines apart.
    """
    found = list(members)
    lines = [i for i, s in enumerate(found) if isinstance(s.what, CyclicError)]
    if not lines:
        return found
    A, places = linearised.columns(found)
    theta = _least_squares_solution(A, linearised.r, learn)
    # Derivatives (m, 1) of the residuals by the cycles of each line.
    sensitivities, data = linearised.sensitivities, linearised.sensitivities.residuals.data
    slopes = [A]
    for i in lines:
        error, (sine, cosine) = found[i].what, theta[places[i]]
        assert isinstance(error, CyclicError)
        joint = data.joint_names.index(error.joint)
        u = data.q[:, joint] - error.centre
        wave = u * (sine * np.cos(error.cycles * u) - cosine * np.sin(error.cycles * u))
        slopes.append(sensitivities.of_joint(joint, wave[:, None]))
    steps = _least_squares_solution(np.concatenate(slopes, axis=1), linearised.r, learn)[A.shape[1] :]
    for i, step in zip(lines, steps.tolist(), strict=True):
        error = found[i].what
        assert isinstance(error, CyclicError)
        most = next(own.least_distance for own in linearised.lines if own.form.joint == error.joint) / 2
        moved = error.with_shape(max(error.cycles + float(np.clip(step, -most, most)), most))
        found[i] = Candidate(moved, sensitivities.columns(moved), found[i].searched)
    return found


def _least_squares_solution(A: Array, r: Array, learn: Mask) -> Array:
    """Least squares solution (k,) for columns A (m, k) of any scales in some rows, by a small ridge."""
    A, scale = unit_columns(A, learn)
    return np.asarray(scale * np.linalg.solve(A.T @ A + 1e-10 * np.eye(A.shape[1]), A.T @ r))


def _best_smooth(
    sensitivities: EffectSensitivities, baseline: ProjectedBaseline, candidate: Candidate, effect: Effect
) -> Candidate:
    from scipy.optimize import minimize_scalar

    def loss(trial: float) -> float:
        return -_explained_square(baseline, sensitivities.columns(effect.with_shape(trial)))

    bounds = effect.bracket(_joint_span(sensitivities, effect))
    found = minimize_scalar(loss, bounds=bounds, method="bounded", options={"maxiter": 16})
    if found.fun >= loss(float(getattr(effect, effect.smooth_shape))):
        return candidate
    better = effect.with_shape(float(found.x))
    return Candidate(better, sensitivities.columns(better), candidate.searched)


def _best_step(
    sensitivities: EffectSensitivities, baseline: ProjectedBaseline, candidate: Candidate, effect: Effect, steps: Array
) -> Candidate:
    """The effect at that of the shapes ``steps`` (k,) which explains most."""

    def gain(k: int) -> float:
        return _explained_square(baseline, sensitivities.columns(effect.with_shape(float(steps[k]))))

    stride = max(len(steps) // _MOMENTS_TRIED, 1)
    some = max(range(stride // 2, len(steps), stride), key=gain)
    best = max(range(max(some - stride + 1, 0), min(some + stride, len(steps))), key=gain)
    if gain(best) < _explained_square(baseline, candidate.Z):
        return candidate
    better = effect.with_shape(float(steps[best]))
    return Candidate(better, sensitivities.columns(better), candidate.searched)


def _explained_square(baseline: ProjectedBaseline, Z: Array) -> float:
    """The sum of squares that columns Z (m, k) explain of what the baseline leaves."""
    return float(np.sum((projected_basis(baseline, Z)[0].T @ baseline.e) ** 2))


def _joint_span(sensitivities: EffectSensitivities, effect: Effect) -> float:
    """Range of the joint of an effect in the data [rad or m]; 0 of an effect of no joint."""
    residuals = sensitivities.residuals
    if not effect.moved_joint:
        return 0.0
    return float(np.ptp(residuals.data.q[:, residuals.robot.joint_names.index(effect.moved_joint)]))
