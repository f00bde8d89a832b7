"""The rivals of a model's effects: the columns that discriminate an effect from what could replace it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.discrimination.discrimination_design import DiscriminationDesign, OrderedPair
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.scores.score_tests import orthonormal_basis
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.experiments.expected_errors import PriorInformation
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Codes
from posture_opt.selection.problem_data import ProblemData

Rivals = Mapping[int, Sequence[Candidate]]

_UNPLANNED_INPUTS = frozenset({"time", "temperature"})  # inputs that no choice of postures varies


@dataclass(frozen=True, eq=False)
class RivalExplanation:
    """A rival of one effect of the model.

    Args:
        place: of the effect in the model.
        rival: the candidate that could replace it.
        theta: (p,) size of the rival in the place of the effect [SI].
        angle: least principal angle between both, given geometry and the other effects [rad].
    """

    place: int
    rival: Candidate
    theta: Array
    angle: float

    @property
    def effect(self) -> Effect:
        """The rival as an effect."""
        assert isinstance(self.rival.what, Effect)
        return self.rival.what


@dataclass(frozen=True, eq=False)
class ModelDiscrimination:
    """A fitted model with the rivals of its effects, and all their columns: geometry, effects and rivals.

    The members are the effects of the model, then all rivals; the columns are those of all parameters of the arm, then
    of each member.

    Args:
        all: the rivals, effect by effect.
    """

    linearised: LinearisedData
    model: Fit
    all: tuple[RivalExplanation, ...]

    @classmethod
    def of(cls, linearised: LinearisedData, model: Fit, rivals: Rivals) -> ModelDiscrimination:
        """The rivals that a choice of postures could discriminate."""
        explanations = []
        for place, others in list(rivals.items())[: levels.MAX_DISCRIMINATED_EFFECTS]:
            if by_posture(model.effects[place]):
                able = [s for s in others if by_posture(s.what)][: levels.MAX_DISCRIMINATED_RIVALS]
                explanations += [_rival_explanation(linearised, model, place, s) for s in able]
        return cls(linearised, model, tuple(explanations))

    @cached_property
    def members(self) -> list[tuple[Effect, Array]]:
        """The effects of the model, then the rivals, each with its size."""
        own = [(e, self.model.x[part]) for e, part in zip(self.model.effects, self.model.slices, strict=True)]
        return [*own, *((d.effect, d.theta) for d in self.all)]

    @cached_property
    def joints(self) -> tuple[int, ...]:
        """The joints of the effects and their rivals."""
        names = self.linearised.sensitivities.residuals.robot.joint_names
        candidates = [s for d in self.all for s in (self.model.effects[d.place], d.effect)]
        parts = {part for s in candidates for part in s.target.split("->")}
        own = parts | {part.rpartition(".")[0] for part in parts if part not in names}  # of a parameter, its joint
        return tuple(j for j, name in enumerate(names) if name in own)

    @cached_property
    def sided(self) -> tuple[int, ...]:
        """The joints whose side of approach matters, where the data state it."""
        names = self.linearised.sensitivities.residuals.robot.joint_names
        asked = {e.target for e, _ in self.members if "approach" in e.needs}
        known = "approach" in self.linearised.excitation.inputs
        return tuple(j for j, name in enumerate(names) if known and name in asked)

    def columns(self, sensitivities: EffectSensitivities) -> tuple[Array, list[Codes]]:
        """(m, K) whitened columns of all parameters at some rows, and the indices of those of each member.

        Columns of a member are the derivatives at its fitted size, its shape among them: a rival may fit its shape
        anew.
        """
        parts, places = [sensitivities.residuals.residuals_and_jacobian(sensitivities.x)[1][: sensitivities.rows]], []
        at = parts[0].shape[1]
        for effect, theta in self.members:
            parts.append(sensitivities.fitted_columns(effect, theta))
            places.append(np.arange(at, at + parts[-1].shape[1]))
            at += len(places[-1])
        return np.concatenate(parts, axis=1), places

    @cached_property
    def pairs(self) -> list[tuple[int, int, int]]:
        """(place of an effect, member, member): any two of an effect and its rivals, as each of them could be true."""
        n = len(self.model.effects)
        sides = {d.place: [d.place] for d in self.all}
        for k, d in enumerate(self.all):
            sides[d.place].append(n + k)
        return [(place, *two) for place, members in sides.items() for two in combinations(members, 2)]

    def design(self, problem: ProblemData, rows: Measurements) -> tuple[DiscriminationDesign, Array]:
        """The design problem of all pairs, either of the two taken for true, and their λ (2 pairs,) in the data.

        Args:
            problem: for the prior of the geometry; rows: the candidate measurements.

        Returns:
            The design, and λ of each ordered pair in the data so far; what of it exceeds `levels.RIVAL_CRITERION` was
            predicted and not seen: it is spent.
        """
        sensitivities = self.linearised.sensitivities
        residuals, noise = sensitivities.residuals, np.sqrt(self.model.variance)
        D, places = self.columns(sensitivities)
        there = EffectSensitivities(residuals.of_data(rows), sensitivities.x)
        A = self.columns(there)[0].reshape(len(rows), residuals.block, -1) / noise
        prior = PriorInformation.of(problem, residuals.parameters).full
        k = len(residuals.parameters)
        M = D.T @ D / noise**2
        M[:k, :k] += prior.T @ prior
        pairs = [self._pair(pair[0], *two, k, places) for pair in self.pairs for two in (pair[1:], pair[:0:-1])]
        before = DiscriminationDesign.of(pairs, M, A)
        now = before.noncentralities(before.information)
        spent = np.maximum(now - levels.RIVAL_CRITERION, 0.0)
        pairs = [replace(pair, spent=float(s)) for pair, s in zip(pairs, spent, strict=True)]
        return DiscriminationDesign.of(pairs, M, A), now

    def _pair(self, place: int, true: int, false: int, k: int, places: list[Codes]) -> OrderedPair:
        """One member taken for true, another fitted in its place with k parameters and the other effects."""
        others = [places[i] for i in range(len(self.model.effects)) if i != place]
        theta = self.members[true][1]
        signature = np.zeros(k + sum(map(len, places)))
        signature[places[true][: len(theta)]] = theta
        return OrderedPair(signature, np.concatenate([np.arange(k), *others, places[false]]))


def by_posture(effect: Effect | UnnamedComponent) -> bool:
    """Whether postures, payloads and sides of approach vary what the effect depends on."""
    return isinstance(effect, Effect) and not effect.asks & _UNPLANNED_INPUTS


def _rival_explanation(linearised: LinearisedData, model: Fit, place: int, rival: Candidate) -> RivalExplanation:
    """A rival with its likeliest size in the place of an effect, and the angle between both given all else."""
    members = [Candidate(e, linearised.sensitivities.columns(e)) for e in model.effects]
    others = [s for i, s in enumerate(members) if i != place]
    baseline = linearised.baseline(others, flips=0)
    one, other = (orthonormal_basis(baseline.project(s.Z)) for s in (members[place], rival))
    cosine = float(np.linalg.norm(one.T @ other, 2))
    theta = np.asarray(np.linalg.lstsq(baseline.project(rival.Z), -baseline.e, rcond=1e-9)[0], dtype=float)
    return RivalExplanation(place, rival, theta, float(np.arccos(min(cosine, 1.0))))
