"""What a problem file states as known, tested against the data before anything else: frames and standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.calibration.assumptions.contradictions import FRAMES, Refuted, full_coupling
from posture_opt.calibration.assumptions.frames import Chart, arm_and_data, fit_frames
from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities, case_of
from posture_opt.calibration.estimation.fit import minimum_of
from posture_opt.calibration.estimation.fit_setup import full_prior, prior_tolerances
from posture_opt.calibration.estimation.parameters import prior_covariance, tool_unknown
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.measurements import Measurements, reach
from posture_opt.model.effects import EFFECTS, Effect
from posture_opt.numerics import Array, rms_length
from posture_opt.selection.problem_data import ProblemData

_STUDENT_FREEDOM = 4.0  # of Student's t, by which a few gross errors decide nothing (Lange, Little, Taylor 1989)
_DETERMINED_STRENGTH = 2.0  # σ of the data that a tolerance moves: more than a prior does

MIN_EVIDENCE = 20.0  # logarithm of a likelihood ratio with which a statement is set aside: probability of e²⁰
_SUSPICIOUS_DEVIATION = {
    "m": 1e-3,
    "rad": 5e-3,
}  # farther off its drawing, a parameter of the first or last link is due to a frame
_MIN_DEVIATING_PARAMETERS = 2  # so many of them: one alone is more likely wrong itself


def released_problem(problem: ProblemData, names: Sequence[str]) -> ProblemData:
    """The problem without some statements."""
    frames, sigmas = [n for n in names if n in FRAMES], [n for n in names if n not in FRAMES]
    return problem.released(frames, sigmas) if names else problem


@dataclass(frozen=True, eq=False)
class StatementTrial:
    """The arm calibrated with some statements ``released``, at the estimate x (k,)."""

    released: tuple[str, ...]
    residuals: Residuals
    x: Array
    e: Array  # (N, block) residuals; ``known`` (p, k) rows of the prior, as the data weigh it
    known: Array
    count: int  # how many combinations of parameters the data determine
    least: float  # that the instrument's σ can be, over the one that residuals are counted in

    @cached_property
    def scale(self) -> float:
        """Standard deviation of most residuals in units of the instrument's, at least ``least``."""
        return scale_of(self.e, self.count, self.least)

    @property
    def rms(self) -> float:
        """RMS position error [m]."""
        return rms_length(self.residuals.metres(self.e[:, : len(self.residuals.axes)]))

    @property
    def predicted_rms(self) -> float:
        """RMS position error [m] of rows left out, ``n / (n − p)`` times that of n residuals and p parameters.

        Source: generalized cross-validation (Golub, Heath, Wahba 1979).
        """
        return self.rms * self.e.size / max(self.e.size - self.count, 1)


def scale_of(e: Array, count: int, least: float) -> float:
    """The standard deviation of residuals e (N, block) from their median length, no less than ``least``."""
    from scipy.special import gammaincinv

    N, block = e.shape
    squared = float(np.median(np.sum(e**2, axis=1))) / (2 * float(gammaincinv(block / 2, 0.5)))
    return max(float(np.sqrt(squared * N * block / max(N * block - count, 1))), least)


def negative_log_likelihood(e: Array, known: Array, scale: float) -> float:
    """Minus the logarithm of the likelihood of residuals (N, block) under Student's t of a ``scale``.

    ``(ν + d)/2 Σ log(1 + |e_i|² / (ν s²)) + |known|² / (2 s²)``, up to a constant; ν = `_STUDENT_FREEDOM`, d = block.
    """
    squared = np.sum(e**2, axis=1) / scale**2
    data = float(np.sum(np.log1p(squared / _STUDENT_FREEDOM)) * (_STUDENT_FREEDOM + e.shape[1]) / 2)
    return data + float(known @ known) / (2 * scale**2)


class _Statements:
    """The statements of one problem against one file: exact frames, and parameters with a stated σ [rad or m]."""

    def __init__(self, problem: ProblemData, data: Measurements, priors: bool, effects: Sequence[Effect] = ()) -> None:
        self.problem, self.data, self.priors, self.effects = problem, data, priors, effects
        self._trials: dict[tuple[str, ...], StatementTrial] = {}
        robot = problem.robot
        free = {"base": robot.base_free or data.position is None, "tool": tool_unknown(robot, data)}
        self.frames = tuple(name for name in FRAMES if not free[name])
        parameters = arm_and_data(problem, data)[0].parameters
        rows, covariance = prior_covariance(problem, parameters) if priors else ([], np.zeros((0, 0)))
        sigmas = zip((parameters[i] for i in rows), np.sqrt(np.diag(covariance)).tolist(), strict=True)
        self.sigma: dict[str, float] = {p.name: sigma for p, sigma in sigmas if p.group == "geometry"}
        self.statements = (*self.frames, *self.sigma)

    def trial(self, released: Sequence[str]) -> StatementTrial:
        """The arm calibrated without some of the statements."""
        key = tuple(name for name in self.statements if name in released)
        if key not in self._trials:
            self._trials[key] = self._fitted_trial(key, self.weight)
        return self._trials[key]

    @cached_property
    def weight(self) -> float:
        """Standard deviation of the unexplained, in units of the instrument's, that weighs the prior."""
        residuals, x = self._start(arm_and_data(self.problem, self.data)[0])
        e, _, count = self.without_all(residuals, x, 1.0)
        if self.far_off(e, residuals):
            return self._fitted_trial(self.statements, 1.0).scale
        return scale_of(e, count, self.least)

    @cached_property
    def least(self) -> float:
        """Least σ of the instrument over the one taken; unstated ones may be much better."""
        # 0.01 of the σ taken where none is stated: 1 µm, as of the best trackers
        return 1.0 if position_sigma(self.problem, self.data) else 0.01

    def far_off(self, e: Array, residuals: Residuals) -> bool:
        """Whether residuals (N, block) are so far off that a tangent says little of them."""
        # 0.01 of the reach: what a tangent leaves beyond that, only a fit of its own can judge
        return rms_length(residuals.metres(e[:, : len(residuals.axes)])) > 0.01 * reach(self.problem.robot)

    def _fitted_trial(self, released: tuple[str, ...], weight: float) -> StatementTrial:
        """The arm fitted without the ``released`` statements; ``weight`` is that of the prior."""
        problem = released_problem(self.problem, released)
        residuals, x0 = self._start(Chart.of(arm_and_data(problem, self.data)[0]).fitted)
        stated = prior_covariance(problem, residuals.parameters)[0] if self.priors else []
        known = weight * _prior_rows(problem, residuals, stated)
        x, found = minimum_of(residuals, x0, np.diag(prior_tolerances(residuals.parameters, [])), known)
        count = int(np.sum(np.linalg.svd(found.R, compute_uv=False) > _DETERMINED_STRENGTH * weight))
        e = found.residuals[: residuals.measured].reshape(len(residuals.data), -1)
        return StatementTrial(released, residuals, x, e, known, count, self.least)

    def _start(self, residuals: Residuals) -> tuple[Residuals, Array]:
        """The unknowns with those of the effects, and where a fit of them starts (k,): free frames fitted."""
        x = fit_frames(residuals)
        if not self.effects:
            return residuals, x
        wide = residuals.with_effects(self.effects, x)
        return wide, np.r_[x, wide.start_of(self.effects)]

    def without_all(self, residuals: Residuals, x: Array, weight: float) -> tuple[Array, Array, int]:
        """Residuals (N, block), those of the prior (p,) and the rank, without any statement; to first order.

        residuals: as stated, with deviations x (k,); weight: of the prior, in units of the instrument's σ.
        """
        wide = arm_and_data(released_problem(self.problem, self.statements), self.data)[0]
        wide = wide.with_effects(self.effects, fit_frames(wide)) if self.effects else wide
        value = dict(zip((p.name for p in residuals.parameters), x, strict=True))
        at = np.array([value.get(p.name, 0.0) for p in wide.parameters])
        r, J = wide.residuals_and_jacobian(at)
        known = weight * _prior_rows(self.problem, wide, [])
        columns = np.concatenate([J, known])
        step = np.linalg.lstsq(columns, -np.concatenate([r, known @ at]), rcond=1e-12)[0]
        strength = np.linalg.svd(J * prior_tolerances(wide.parameters, []), compute_uv=False)
        e = (r + J @ step)[: wide.measured].reshape(len(self.data), -1)
        return e, known @ (at + step), int(np.sum(strength > _DETERMINED_STRENGTH * weight))

    @cached_property
    def scale(self) -> float:
        """The scale of the likelihood: that of the widest model, or of the stated one where it is smaller."""
        return min(self.trial(self.statements).scale, self.trial(()).scale)

    def cost(self, trial: StatementTrial) -> float:
        """Minus the log-likelihood of a trial at the scale of the widest."""
        return negative_log_likelihood(trial.e, trial.known @ trial.x, self.scale)

    @cached_property
    def worthwhile(self) -> bool:
        """Whether setting everything aside could bring much, to first order; or the arm is far off."""
        stated = self.trial(())
        e, known, count = self.without_all(stated.residuals, stated.x, self.weight)
        # 6 residuals beyond the unknowns: with fewer, anything would fit
        if stated.scale <= self.least or e.size < count + 6:
            return False
        scale = scale_of(e, count, self.least)
        before, after = ((stated.e, stated.known @ stated.x), (e, known))
        gain = negative_log_likelihood(*before, scale) - negative_log_likelihood(*after, scale)
        imitated = (self._is_imitated(stated, frame) for frame in self.frames)
        return self.far_off(e, stated.residuals) or gain > _required_evidence(e) or any(imitated)

    def explains(self, other: _Statements) -> bool:
        """Whether this problem's arm, calibrated, explains what the other's does not."""
        return self._clearly_better(other.trial(()), self.trial(()))

    def _clearly_better(self, one: StatementTrial, other: StatementTrial) -> bool:
        gain = self.cost(one) - self.cost(other) - (other.count - one.count)
        return gain > _required_evidence(one.e)

    @cached_property
    def found(self) -> StatementTrial:
        """The arm without the statements that are refuted: one after the other, and none that is not needed."""
        now = self.trial(())
        while True:
            options = [self.trial((*now.released, *more)) for more in self._next_releases(now)]
            # 5.0 of each statement that is set aside: the logarithm of how many there are (Chen, Chen 2008)
            priced = {self.cost(o) + o.count + 5.0 * len(o.released): o for o in options}
            if not priced:
                return now
            best = priced[min(priced)]
            imitated = tuple(frame for frame in self.frames if self._is_imitated(now, frame))
            if imitated and not self._clearly_better(now, best):
                return self.trial((*now.released, *imitated))
            if not self._clearly_better(now, best) or self._effect_explains(now, best):
                return now
            widest = best  # what is taken back one by one must not add up to a loss
            for name in widest.released:
                less = self.trial([n for n in best.released if n != name])
                # 2 of its stated σ that a parameter is off at the least
                contradicted = name in self.frames or self._sigmas_off(widest, name) > 2.0
                needed = contradicted and self._clearly_better(less, widest)
                best = best if needed else less
            if len(best.released) <= len(now.released):
                return now
            now = best

    def _is_imitated(self, now: StatementTrial, frame: str) -> bool:
        """Whether parameters next to a frame, which move the tool alike, are off: one wrong frame is likelier."""
        robot, parameters = now.residuals.robot, now.residuals.parameters
        place = {factor.parameter: i for i, factor in enumerate(robot.factors)}
        if frame == "base":
            beside = {name for name, i in place.items() if i < robot.driven[0]}
        else:
            beside = {name for name, i in place.items() if i > robot.driven[-1]}
        own = [
            i
            for i, p in enumerate(parameters)
            if p.group == "geometry" and p.name not in self.sigma and p.source in beside
        ]
        off = [i for i in own if abs(now.x[i]) > _SUSPICIOUS_DEVIATION[parameters[i].unit]]
        if frame in now.released or len(off) < _MIN_DEVIATING_PARAMETERS:
            return False
        J = np.concatenate([now.residuals.residuals_and_jacobian(now.x)[1], now.known])
        std = now.scale * np.sqrt(np.diag(np.linalg.pinv(J.T @ J, rcond=1e-15, hermitian=True)))
        # 5 standard errors that each of them is off
        return int(np.sum(np.abs(now.x[off]) > 5.0 * std[off])) >= _MIN_DEVIATING_PARAMETERS

    def _next_releases(self, now: StatementTrial) -> list[tuple[str, ...]]:
        frames = tuple(name for name in self.frames if name not in now.released)
        found: list[tuple[str, ...]] = [(name,) for name in frames]
        found += [frames] if len(frames) > 1 else []
        kinds: dict[str, list[str]] = {}
        for name in self.sigma:
            if name not in now.released:
                kinds.setdefault(name.rpartition(".")[2], []).append(name)
        every = [name for names in kinds.values() for name in names]
        found += [(max(every, key=lambda name: self._sigmas_off(now, name)),)] if every else []
        # Where all are wrong, the others make up for one that is set aside: it explains little by itself.
        together = [tuple(names) for names in (*kinds.values(), every) if len(names) > 1]
        return [*found, *dict.fromkeys(together)]

    def _sigmas_off(self, now: StatementTrial, name: str) -> float:
        at = [p.name for p in now.residuals.parameters].index(name)
        return abs(float(now.x[at])) / self.sigma[name]

    def _effect_explains(self, now: StatementTrial, best: StatementTrial) -> bool:
        if self.effects:
            return False
        # 400 that decide whether an effect explains as much
        rows = np.unique(np.linspace(0, len(self.data) - 1, min(len(self.data), 400)).round().astype(np.intp))
        some = now.residuals.take(rows)
        r, J = some.residuals_and_jacobian(now.x)
        columns = np.concatenate([J, now.known])
        Q = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))[0]
        r = np.concatenate([r, now.known @ now.x])
        r = r - Q @ (Q.T @ r)
        sensitivities, share = EffectSensitivities(some, now.x), np.sqrt(len(rows) / len(self.data))
        wanted = negative_log_likelihood(best.e[rows], share * (best.known @ best.x), self.scale) + best.count
        below = np.zeros((len(now.known), 1))
        for effect in (e for kind in EFFECTS for e in kind.candidates(case_of(some.data, some.robot))):
            Z = sensitivities.columns(effect)
            Z = np.concatenate([Z, np.repeat(below, Z.shape[1], axis=1)])
            Z = Z - Q @ (Q.T @ Z)
            e = r - Z @ np.linalg.lstsq(Z, r, rcond=1e-9)[0]
            rest, e = share * e[len(J) :], e[: some.measured].reshape(len(rows), -1)
            if negative_log_likelihood(e, rest, self.scale) + now.count + Z.shape[1] <= wanted:
                return True
        return False


def consistent_problem(
    problem: ProblemData, data: Measurements, priors: bool = True, effects: Sequence[Effect] = ()
) -> tuple[ProblemData, Refuted]:  # fmt: skip
    """The problem without the statements that the data refute, and which those are.

    Source: likelihood ratios of Student's t (Lange, Little, Taylor 1989) at the scale of the widest model.
    """
    before = _Statements(problem, data, priors, effects)
    coupling = None if effects else full_coupling(problem.arm, data, problem.measurement)
    stated = before if coupling is None else _Statements(problem.released((), (), (coupling,)), data, priors)
    if coupling is not None and not stated.explains(before):
        coupling, stated = None, before
    found = stated.found if stated.statements and stated.worthwhile else None
    if coupling is None and (found is None or not found.released):
        return problem, Refuted()
    found, first = found or stated.trial(()), before.trial(())
    evidence = stated.cost(first) - stated.cost(found)
    more = max(found.count - first.count, 0) + (coupling is not None)
    others = {name: stated.trial([n for n in found.released if n != name]) for name in found.released}
    others |= {} if coupling is None else {coupling.kind: before.trial(found.released)}
    gains = {name: 1 - found.predicted_rms / max(other.predicted_rms, 1e-300) for name, other in others.items()}
    if not any(gain > 0 for gain in gains.values()):  # a likelihood that gross rows alone raise predicts nothing
        return problem, Refuted()
    return released_problem(stated.problem, found.released), Refuted(
        found.released, stated.sigma, evidence, max(more, 1), first.rms, found.rms, coupling, gains
    )


def _prior_rows(problem: ProblemData, residuals: Residuals, stated: list[int]) -> Array:
    """Stated σ's and tolerances as further rows (p, k) of the Jacobian."""
    parameters = residuals.parameters
    covariance = prior_covariance(problem, parameters)[1] if stated else np.zeros((0, 0))
    prior = full_prior(parameters, problem.robot, prior_tolerances(parameters, stated), stated, covariance)
    return prior.matrix(len(parameters))


def _required_evidence(e: Array) -> float:
    """The evidence at which residuals (N, block) are much smaller, with certainty."""
    # 0.1 evidence per residual: errors a tenth larger than without what is stated
    return max(MIN_EVIDENCE, 0.1 * e.size)
