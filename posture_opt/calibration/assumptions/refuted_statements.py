"""What a problem file states as known, tested against the data before anything else: frames and standard deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from posture_opt.calibration.assumptions.frame_coordinates import Chart
from posture_opt.calibration.assumptions.frames import arm_and_data, fit_frames
from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.calibration.assumptions.kinematic_coupling import fitted_ratio, full_coupling
from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities, case_of
from posture_opt.calibration.estimation.fit import Fit, minimum_of
from posture_opt.calibration.estimation.fit_setup import full_prior, prior_tolerances
from posture_opt.calibration.estimation.parameters import prior_covariance, tool_unknown
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.affine_fit import reach
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import EFFECTS, Cause, Effect, JointCoupling
from posture_opt.numerics import Array, Json, rms_length
from posture_opt.selection.fitted_arm import NEGLIGIBLE
from posture_opt.selection.problem_data import ProblemData

FRAMES = ("base", "tool")
_EVIDENCE_PER_RESIDUAL = 0.1  # evidence per residual: errors a tenth larger than without what is stated
_MIN_EVIDENCE = 20.0  # evidence in all: probability of e²⁰
_STATEMENT_PENALTY = 5.0  # of each statement that is set aside: the logarithm of how many there are (Chen, Chen 2008)
_STUDENT_FREEDOM = 4.0  # of Student's t, by which a few gross errors decide nothing (Lange, Little, Taylor 1989)
_LINEAR_ERROR_SHARE = 0.01  # of the reach: what a tangent leaves beyond that, only a fit of its own can judge
_SUSPICIOUS_DEVIATION = {
    "m": 1e-3,
    "rad": 5e-3,
}  # farther off its drawing, a parameter of the first or last link is due to a frame
_MIN_DEVIATING_PARAMETERS = 2  # so many of them: one alone is more likely wrong itself
_CLEAR_STD_ERRORS = 5.0  # standard errors that each of them is off
_DETERMINED_STRENGTH = 2.0  # σ of the data that a tolerance moves: more than a prior does
_LEAST_OF_UNSTATED = 0.01  # of the σ taken where none is stated: 1 µm, as of the best trackers
_CONTRADICTING_SIGMAS = 2.0  # of its stated σ that a parameter is off at the least
_SPARE_RESIDUALS = 6  # residuals beyond the unknowns: with fewer, anything would fit
_MAX_EFFECT_ROWS = 400  # that decide whether an effect explains as much

_P = TypeVar("_P", bound=ProblemData)


@dataclass(frozen=True, eq=False)
class Contradiction:
    """Something that the file states as known and the data refute; it was set aside and fitted.

    Args:
        cause: what differs from the file.
        estimate: parameter -> (deviation from the file, standard error, SI unit).
        sigma: the stated standard deviation of a parameter [SI]; 0 of a frame, which is stated as exact.
        p_value: of the likelihood ratio.
        rms_stated: RMS position error [m] of the arm calibrated as stated; ``rms`` with all contradictions set aside.
        gain: relative drop of the RMS on rows left out by setting this one aside, everything else fitted again.
    """

    cause: Cause
    estimate: Mapping[str, tuple[float, float, str]]
    sigma: float
    p_value: float
    rms_stated: float
    rms: float
    gain: float

    def to_json(self) -> dict[str, Json]:
        """The entry of ``contradictions`` in ``calibration.json``."""
        return {
            "kind": self.cause.kind,
            "target": self.cause.target,
            "estimate": {name: {"value": v, "std": s, "unit": u} for name, (v, s, u) in self.estimate.items()},
            "sigma": self.sigma,
            "p_value": self.p_value,
            "rms": {"as_stated": self.rms_stated, "set_aside": self.rms},
        }


@dataclass(frozen=True, eq=False)
class Refuted:
    """Statements that the data refute: frames, and names of parameters whose σ is wrong.

    The p-value of all of them together is that of Wilks (1938): ``P(χ²_f > 2 · evidence)`` with f = ``freedom``.

    Args:
        sigma: parameter -> its stated σ [SI]; none of frames.
        evidence: logarithm of the likelihood ratio of all of them.
        freedom: how many parameters they hold.
        rms_stated, rms: RMS position error [m] of the arm calibrated with and without them.
        coupling: of two joints, which the file does not state and without which the data make no sense.
        gains: what each of them brings beside the others, by name; of the coupling by its kind.
    """

    names: tuple[str, ...] = ()
    sigma: Mapping[str, float] | None = None
    evidence: float = 0.0
    freedom: int = 1
    rms_stated: float = 0.0
    rms: float = 0.0
    coupling: JointCoupling | None = None
    gains: Mapping[str, float] = field(default_factory=dict)

    def contradictions(self, fit: Fit) -> tuple[Contradiction, ...]:
        """The contradictions with the sizes that the fit without them found, ``fit`` of all rows."""
        from scipy.special import gammaincc

        p = float(gammaincc(self.freedom / 2, max(self.evidence, 0.0)))
        found = []
        if self.coupling is not None:
            ratio = {"ratio": (*fitted_ratio(self.coupling, fit), "1")}
            gain = self.gains[self.coupling.kind]
            found.append(Contradiction(self.coupling, ratio, 0.0, p, self.rms_stated, self.rms, gain))
        for name in self.names:
            mine = [
                (i, q)
                for i, q in enumerate(fit.residuals.parameters)
                if (q.group == name if name in FRAMES else q.name == name)
            ]
            if not mine:
                continue
            moves = [(i, q) for i, q in mine if fit.std[i] > NEGLIGIBLE[q.unit]] or mine
            sizes = {q.name.rpartition(".")[2]: (float(fit.x[i]), float(fit.std[i]), q.unit) for i, q in moves}
            cause = GeometricDeviation.of(mine[0][1])
            sigma = 0.0 if name in FRAMES else (self.sigma or {}).get(name, 0.0)
            found.append(Contradiction(cause, sizes, sigma, p, self.rms_stated, self.rms, self.gains[name]))
        return tuple(found)


def consistent_problem(
    problem: _P, data: Measurements, priors: bool = True, effects: Sequence[Effect] = ()
) -> tuple[_P, Refuted]:  # fmt: skip
    """The problem without the statements that the data refute, and which those are.

    A statement is set aside where minus the log-likelihood falls by `_MIN_EVIDENCE` and by `_EVIDENCE_PER_RESIDUAL` for
    each residual, parameters and statements charged. Each combination that is tried costs one fit.

    Frames that are stated, and σ's of parameters, are set aside as long as that makes the errors of the calibrated arm
    much smaller, and smaller than any single effect of the catalogue would. Where no base and no tool make sense of
    the data, a joint may be logged relative to another, see `full_coupling`. Geometry is fitted within its tolerance in
    every comparison: what a joint's zero explains as well is no error of a frame.

    Args:
        effects: that are known to act, fitted in every comparison: what they do no statement need explain.

    Returns:
        The problem, with the refuted frames free and the refuted σ's gone, and what was refuted.

    Source: likelihood ratios of Student's t (Lange, Little, Taylor 1989) at the scale of the widest model.
    """
    before = _Statements(problem, data, priors, effects)
    coupling = None if effects else full_coupling(problem.arm, data)
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
    return _released_problem(stated.problem, found.released), Refuted(
        found.released, stated.sigma, evidence, max(more, 1), first.rms, found.rms, coupling, gains
    )


def _released_problem(problem: _P, names: Sequence[str]) -> _P:
    """The problem without some statements."""
    return (
        problem.released([n for n in names if n in FRAMES], [n for n in names if n not in FRAMES]) if names else problem
    )


@dataclass(frozen=True, eq=False)
class _Trial:
    """The arm calibrated with some statements ``released``, at the estimate x (k,).

    The trials of all combinations of statements share one scale, so that their likelihoods can be compared.

    Args:
        e: (N, block) residuals; ``known`` (p, k) rows of the prior, as the data weigh it.
        count: how many combinations of parameters the data determine.
        least: that the instrument's σ can be, over the one that residuals are counted in.
    """

    released: tuple[str, ...]
    residuals: Residuals
    x: Array
    e: Array
    known: Array
    count: int
    least: float

    @cached_property
    def scale(self) -> float:
        """The residuals' standard deviation in units of the instrument's, at least ``least``, of most rows."""
        return _scale_of(self.e, self.count, self.least)

    @property
    def rms(self) -> float:
        """RMS position error [m]."""
        e = self.residuals.metres(self.e[:, : len(self.residuals.axes)])
        return rms_length(e)

    @property
    def predicted_rms(self) -> float:
        """RMS position error [m] of rows left out, ``n / (n − p)`` times that of n residuals and p parameters.

        Source: generalized cross-validation (Golub, Heath, Wahba 1979).
        """
        return self.rms * self.e.size / max(self.e.size - self.count, 1)


def _scale_of(e: Array, count: int, least: float) -> float:
    """The standard deviation of residuals e (N, block) from their median length, no less than ``least``.

    ``count`` parameters were fitted.
    """
    from scipy.special import gammaincinv

    N, block = e.shape
    squared = float(np.median(np.sum(e**2, axis=1))) / (2 * float(gammaincinv(block / 2, 0.5)))
    return max(float(np.sqrt(squared * N * block / max(N * block - count, 1))), least)


def _negative_log_likelihood(e: Array, known: Array, scale: float) -> float:
    """Minus the logarithm of the likelihood of residuals (N, block) under Student's t of a ``scale``.

    And of ``known`` (p,), how far what the prior holds is from it in units of the same scale, under a Gaussian.

    ``(ν + d)/2 Σ log(1 + |e_i|² / (ν s²)) + |known|² / (2 s²)``, up to a constant; ν = `_STUDENT_FREEDOM`, d = block.
    """
    squared = np.sum(e**2, axis=1) / scale**2
    data = float(np.sum(np.log1p(squared / _STUDENT_FREEDOM)) * (_STUDENT_FREEDOM + e.shape[1]) / 2)
    return data + float(known @ known) / (2 * scale**2)


class _Statements(Generic[_P]):
    """The statements of one problem against one file, each combination of them fitted once.

    Attributes:
        statements: names of frames that are stated as exact, then of parameters with a stated σ.
        sigma: of the latter [rad or m].
    """

    def __init__(self, problem: _P, data: Measurements, priors: bool, effects: Sequence[Effect] = ()) -> None:
        self.problem, self.data, self.priors, self.effects = problem, data, priors, effects
        self._trials: dict[tuple[str, ...], _Trial] = {}
        robot = problem.robot
        free = {"base": robot.base_free or data.position is None, "tool": tool_unknown(robot, data)}
        frames = tuple(name for name in FRAMES if not free[name])
        residuals = arm_and_data(problem, data)[0]
        rows, covariance = prior_covariance(problem, residuals.parameters) if priors else ([], np.zeros((0, 0)))
        names = [residuals.parameters[i] for i in rows]
        self.sigma = {p.name: float(np.sqrt(covariance[k, k])) for k, p in enumerate(names) if p.group == "geometry"}
        self.statements = (*frames, *self.sigma)
        self._frames = frames

    def trial(self, released: Sequence[str]) -> _Trial:
        """The arm calibrated without some of the statements."""
        key = tuple(name for name in self.statements if name in released)
        if key not in self._trials:
            self._trials[key] = self._fitted_trial(key, self._weight)
        return self._trials[key]

    @cached_property
    def _weight(self) -> float:
        """The standard deviation, in units of the instrument's, of what nothing explains: by it the prior is weighed.

        To first order about the arm as stated, unless that is too far off for tangents.
        """
        residuals, x = self._start(arm_and_data(self.problem, self.data)[0])
        e, _, count = self._without_all(residuals, x, 1.0)
        if self._far_off(e, residuals):
            return self._fitted_trial(self.statements, 1.0).scale
        return _scale_of(e, count, self._least)

    @cached_property
    def _least(self) -> float:
        """The least σ of the instrument, over the one taken: where none is stated, it may be much better than that."""
        return 1.0 if position_sigma(self.problem, self.data) else _LEAST_OF_UNSTATED

    def _far_off(self, e: Array, residuals: Residuals) -> bool:
        """Whether residuals (N, block) are so far off that a tangent says little of them."""
        axes = len(residuals.axes)
        left = rms_length(residuals.metres(e[:, :axes]))
        return left > _LINEAR_ERROR_SHARE * reach(self.problem.robot)

    def _fitted_trial(self, released: tuple[str, ...], weight: float) -> _Trial:
        """The arm fitted without the ``released`` statements, in the chart that suits its frames."""
        problem = _released_problem(self.problem, released)
        residuals, x = self._start(Chart.of(arm_and_data(problem, self.data)[0]).fitted)
        return self._calibrated_trial(problem, residuals, x, released, weight)

    def _calibrated_trial(
        self, problem: _P, residuals: Residuals, x0: Array, released: tuple[str, ...], weight: float
    ) -> _Trial:
        """The arm fitted without the ``released`` statements, from ``x0`` (k,); ``weight`` is that of the prior."""
        parameters = residuals.parameters
        stated = prior_covariance(problem, parameters)[0] if self.priors else []
        known = weight * _prior_rows(problem, residuals, stated)
        x, found = minimum_of(residuals, x0, np.diag(prior_tolerances(parameters, [])), known)
        count = int(np.sum(np.linalg.svd(found.R, compute_uv=False) > _DETERMINED_STRENGTH * weight))
        e = found.residuals[: residuals.measured].reshape(len(residuals.data), -1)
        return _Trial(released, residuals, x, e, known, count, self._least)

    def _start(self, residuals: Residuals) -> tuple[Residuals, Array]:
        """The unknowns with those of the effects, and where a fit of them starts (k,): free frames fitted."""
        x = fit_frames(residuals)
        if not self.effects:
            return residuals, x
        wide = residuals.with_effects(self.effects, x)
        return wide, np.r_[x, wide.start_of(self.effects)]

    def _without_all(self, residuals: Residuals, x: Array, weight: float) -> tuple[Array, Array, int]:
        """Residuals (N, block), those of the prior (p,) and the rank, without any statement; to first order.

        Args:
            residuals: as stated, with deviations x (k,); weight: of the prior, in units of the instrument's σ.
        """
        wide = arm_and_data(_released_problem(self.problem, self.statements), self.data)[0]
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
    def worthwhile(self) -> bool:
        """Whether setting everything aside could bring much, to first order; or the arm is far off."""
        stated = self.trial(())
        e, known, count = self._without_all(stated.residuals, stated.x, self._weight)
        if stated.scale <= self._least or e.size < count + _SPARE_RESIDUALS:
            return False
        scale = _scale_of(e, count, self._least)
        gain = _negative_log_likelihood(stated.e, stated.known @ stated.x, scale) - _negative_log_likelihood(
            e, known, scale
        )
        return (
            self._far_off(e, stated.residuals)
            or gain > _required_evidence(e)
            or any(self._is_imitated(stated, frame) for frame in self._frames)
        )

    @cached_property
    def _scale(self) -> float:
        """The scale of the likelihood: that of the widest model, or of the stated one where it is smaller."""
        return min(self.trial(self.statements).scale, self.trial(()).scale)

    def cost(self, trial: _Trial) -> float:
        """Minus the log-likelihood of a trial at the scale of the widest."""
        return _negative_log_likelihood(trial.e, trial.known @ trial.x, self._scale)

    def explains(self, other: _Statements[Any]) -> bool:
        """Whether this problem's arm, calibrated, explains what the other's does not."""
        return self._clearly_better(other.trial(()), self.trial(()))

    def _clearly_better(self, one: _Trial, other: _Trial) -> bool:
        """Whether the other trial explains so much more that chance is no explanation (`_required_evidence`)."""
        gain = self.cost(one) - self.cost(other) - (other.count - one.count)
        return gain > _required_evidence(one.e)

    @cached_property
    def found(self) -> _Trial:
        """The arm without the statements that are refuted: one after the other, and none that is not needed.

        Greedy: the release of largest gain next, then any of them taken back that is not needed. An effect of the
        catalogue that explains as much ends it, unless those are known already that act.
        """
        now = self.trial(())
        while True:
            options = [self.trial((*now.released, *more)) for more in self._next_releases(now)]
            priced = {self.cost(o) + o.count + _STATEMENT_PENALTY * len(o.released): o for o in options}
            if not priced:
                return now
            best = priced[min(priced)]
            imitated = tuple(frame for frame in self._frames if self._is_imitated(now, frame))
            if imitated and not self._clearly_better(now, best):
                return self.trial((*now.released, *imitated))
            if not self._clearly_better(now, best) or self._effect_explains(now, best):
                return now
            widest = best  # what is taken back one by one must not add up to a loss
            for name in widest.released:
                less = self.trial([n for n in best.released if n != name])
                needed = self._contradicted(widest, name) and self._clearly_better(less, widest)
                best = best if needed else less
            if len(best.released) <= len(now.released):
                return now
            now = best

    def _is_imitated(self, now: _Trial, frame: str) -> bool:
        """Whether parameters of the link next to a frame, which move the tool as it does, are off in its place.

        What lies before the first joint moves all as the base does, and what lies behind the last as the tool: the fit
        cannot choose, and one wrong frame is likelier than several errors of one link.
        """
        robot, parameters = now.residuals.robot, now.residuals.parameters
        place = {factor.parameter: i for i, factor in enumerate(robot.factors)}
        first, last = robot.driven[0], robot.driven[-1]
        adjacent = [
            i
            for i, p in enumerate(parameters)
            if p.group == "geometry"
            and p.name not in self.sigma
            and (place[p.source] < first if frame == "base" else place[p.source] > last)
            and abs(now.x[i]) > _SUSPICIOUS_DEVIATION[p.unit]
        ]
        if frame in now.released or len(adjacent) < _MIN_DEVIATING_PARAMETERS:
            return False
        J = np.concatenate([now.residuals.residuals_and_jacobian(now.x)[1], now.known])
        std = now.scale * np.sqrt(np.diag(np.linalg.pinv(J.T @ J, rcond=1e-15, hermitian=True)))
        return int(np.sum(np.abs(now.x[adjacent]) > _CLEAR_STD_ERRORS * std[adjacent])) >= _MIN_DEVIATING_PARAMETERS

    def _next_releases(self, now: _Trial) -> list[tuple[str, ...]]:
        """Statements to set aside next: each frame, both, the σ that is farthest off, all of a kind, and all σ's."""
        frames = [name for name in self._frames if name not in now.released]
        found: list[tuple[str, ...]] = [(name,) for name in frames]
        found += [tuple(frames)] if len(frames) > 1 else []
        kinds: dict[str, list[str]] = {}
        for name in self.sigma:
            if name not in now.released:
                kinds.setdefault(name.rpartition(".")[2], []).append(name)
        every = [name for names in kinds.values() for name in names]
        if every:
            at = {p.name: i for i, p in enumerate(now.residuals.parameters)}
            found.append((max(every, key=lambda name: self._sigmas_off(now, at[name])),))
        # Where all are wrong, the others make up for one that is set aside: it explains little by itself.
        together = [tuple(names) for names in (*kinds.values(), every) if len(names) > 1]
        return [*found, *dict.fromkeys(together)]

    def _contradicted(self, now: _Trial, name: str) -> bool:
        """Whether an estimate lies outside what is stated of it: a frame, or a σ that it exceeds."""
        at = {p.name: i for i, p in enumerate(now.residuals.parameters)}
        return name in self._frames or self._sigmas_off(now, at[name]) > _CONTRADICTING_SIGMAS

    def _sigmas_off(self, now: _Trial, i: int) -> float:
        """How many of its stated σ's a parameter is off where the others share what it cannot take."""
        return abs(float(now.x[i])) / self.sigma[now.residuals.parameters[i].name]

    def _effect_explains(self, now: _Trial, best: _Trial) -> bool:
        """Whether one effect of the catalogue, at what is stated, explains as much as setting it aside.

        On `_MAX_EFFECT_ROWS` rows at most, to first order: every candidate of the catalogue, its size by least squares.
        """
        if self.effects:
            return False
        rows = np.unique(
            np.linspace(0, len(self.data) - 1, min(len(self.data), _MAX_EFFECT_ROWS)).round().astype(np.intp)
        )
        some = now.residuals.take(rows)
        r, J = some.residuals_and_jacobian(now.x)
        columns = np.concatenate([J, now.known])
        Q = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))[0]
        r = np.concatenate([r, now.known @ now.x])
        r = r - Q @ (Q.T @ r)
        sensitivities, share = EffectSensitivities(some, now.x), np.sqrt(len(rows) / len(self.data))
        wanted = _negative_log_likelihood(best.e[rows], share * (best.known @ best.x), self._scale) + best.count
        below = np.zeros((len(now.known), 1))
        for effect in (e for kind in EFFECTS for e in kind.candidates(case_of(some.data, some.robot))):
            Z = sensitivities.columns(effect)
            Z = np.concatenate([Z, np.repeat(below, Z.shape[1], axis=1)])
            Z = Z - Q @ (Q.T @ Z)
            e = r - Z @ np.linalg.lstsq(Z, r, rcond=1e-9)[0]
            rest, e = share * e[len(J) :], e[: some.measured].reshape(len(rows), -1)
            if _negative_log_likelihood(e, rest, self._scale) + now.count + Z.shape[1] <= wanted:
                return True
        return False


def _required_evidence(e: Array) -> float:
    """The evidence at which residuals (N, block) are much smaller, with certainty."""
    return max(_MIN_EVIDENCE, _EVIDENCE_PER_RESIDUAL * e.size)


def _prior_rows(problem: ProblemData, residuals: Residuals, stated: list[int]) -> Array:
    """Stated σ's and tolerances as further rows (p, k) of the Jacobian."""
    parameters = residuals.parameters
    covariance = prior_covariance(problem, parameters)[1] if stated else np.zeros((0, 0))
    prior = full_prior(parameters, problem.robot, prior_tolerances(parameters, stated), stated, covariance)
    return prior.matrix(len(parameters))
