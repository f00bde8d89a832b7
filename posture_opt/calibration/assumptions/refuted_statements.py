"""What a problem file states as known, tested against the data before anything else: frames and standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from posture_opt.calibration.assumptions.contradictions import Refuted
from posture_opt.calibration.assumptions.kinematic_coupling import full_coupling
from posture_opt.calibration.assumptions.statement_trials import (
    StatementTrial,
    StatementTrials,
    negative_log_likelihood,
    released_problem,
    scale_of,
)
from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities, case_of
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import EFFECTS, Effect
from posture_opt.numerics import Array
from posture_opt.selection.problem_data import ProblemData

_EVIDENCE_PER_RESIDUAL = 0.1  # evidence per residual: errors a tenth larger than without what is stated
_MIN_EVIDENCE = 20.0  # evidence in all: probability of e²⁰
_STATEMENT_PENALTY = 5.0  # of each statement that is set aside: the logarithm of how many there are (Chen, Chen 2008)
_SUSPICIOUS_DEVIATION = {
    "m": 1e-3,
    "rad": 5e-3,
}  # farther off its drawing, a parameter of the first or last link is due to a frame
_MIN_DEVIATING_PARAMETERS = 2  # so many of them: one alone is more likely wrong itself
_CLEAR_STD_ERRORS = 5.0  # standard errors that each of them is off
_CONTRADICTING_SIGMAS = 2.0  # of its stated σ that a parameter is off at the least
_SPARE_RESIDUALS = 6  # residuals beyond the unknowns: with fewer, anything would fit
_MAX_EFFECT_ROWS = 400  # that decide whether an effect explains as much

_P = TypeVar("_P", bound=ProblemData)


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


class _Statements(StatementTrials[_P]):
    """The statements of one problem against one file, and which of them the data refute."""

    @cached_property
    def worthwhile(self) -> bool:
        """Whether setting everything aside could bring much, to first order; or the arm is far off."""
        stated = self.trial(())
        e, known, count = self.without_all(stated.residuals, stated.x, self.weight)
        if stated.scale <= self.least or e.size < count + _SPARE_RESIDUALS:
            return False
        scale = scale_of(e, count, self.least)
        gain = negative_log_likelihood(stated.e, stated.known @ stated.x, scale) - negative_log_likelihood(
            e, known, scale
        )
        return (
            self.far_off(e, stated.residuals)
            or gain > _required_evidence(e)
            or any(self._is_imitated(stated, frame) for frame in self.frames)
        )

    def explains(self, other: _Statements[Any]) -> bool:
        """Whether this problem's arm, calibrated, explains what the other's does not."""
        return self._clearly_better(other.trial(()), self.trial(()))

    def _clearly_better(self, one: StatementTrial, other: StatementTrial) -> bool:
        """Whether the other trial explains so much more that chance is no explanation (`_required_evidence`)."""
        gain = self.cost(one) - self.cost(other) - (other.count - one.count)
        return gain > _required_evidence(one.e)

    @cached_property
    def found(self) -> StatementTrial:
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
            imitated = tuple(frame for frame in self.frames if self._is_imitated(now, frame))
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

    def _is_imitated(self, now: StatementTrial, frame: str) -> bool:
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

    def _next_releases(self, now: StatementTrial) -> list[tuple[str, ...]]:
        """Statements to set aside next: each frame, both, the σ that is farthest off, all of a kind, and all σ's."""
        frames = [name for name in self.frames if name not in now.released]
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

    def _contradicted(self, now: StatementTrial, name: str) -> bool:
        """Whether an estimate lies outside what is stated of it: a frame, or a σ that it exceeds."""
        at = {p.name: i for i, p in enumerate(now.residuals.parameters)}
        return name in self.frames or self._sigmas_off(now, at[name]) > _CONTRADICTING_SIGMAS

    def _sigmas_off(self, now: StatementTrial, i: int) -> float:
        """How many of its stated σ's a parameter is off where the others share what it cannot take."""
        return abs(float(now.x[i])) / self.sigma[now.residuals.parameters[i].name]

    def _effect_explains(self, now: StatementTrial, best: StatementTrial) -> bool:
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


def _required_evidence(e: Array) -> float:
    """The evidence at which residuals (N, block) are much smaller, with certainty."""
    return max(_MIN_EVIDENCE, _EVIDENCE_PER_RESIDUAL * e.size)
