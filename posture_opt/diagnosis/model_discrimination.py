"""``Duels``: effects of a fitted model against what could stand for them, and the columns that part them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from posture_opt.calibration.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.parameters import CalibrationProblem
from posture_opt.diagnosis.candidates import Candidate
from posture_opt.diagnosis.extended_fit import Extended, shape_column
from posture_opt.diagnosis.linearised_data import LinearisedData
from posture_opt.diagnosis.noncentrality import Pair, Parting
from posture_opt.diagnosis.score_tests import orthonormal
from posture_opt.diagnosis.search import RIVALS
from posture_opt.experiments.knowledge_stages import Beforehand
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Codes

Rivals = Mapping[int, Sequence[Candidate]]

_EFFECTS, _RIVALS = 6, 4  # that are looked at, the weightiest
_ELSEWHERE = frozenset({"time", "temperature"})  # inputs that no choice of postures varies


@dataclass(frozen=True, eq=False)
class Duel:
    """An effect of the model and one that could stand for it, with the size that it would have."""

    place: int
    rival: Candidate
    theta: Array
    angle: float


@dataclass(frozen=True, eq=False)
class Duels:
    """All columns that matter: geometry, the effects of the model, and their rivals, each with its shape."""

    scene: LinearisedData
    model: Extended
    all: tuple[Duel, ...]

    @classmethod
    def of(cls, scene: LinearisedData, model: Extended, rivals: Rivals) -> Duels:
        """The rivals that a choice of postures could part."""
        duels = []
        for place, others in list(rivals.items())[:_EFFECTS]:
            if by_posture(model.suspects[place]):
                able = [s for s in others if by_posture(s)][:_RIVALS]
                duels += [_duel_of(scene, model, place, s) for s in able]
        return cls(scene, model, tuple(duels))

    @cached_property
    def members(self) -> list[tuple[Candidate, Array]]:
        """The effects of the model, then the rivals, each with its size."""
        own = [(s, self.model.theta[part]) for s, part in zip(self.model.suspects, self.model.slices, strict=True)]
        return [*own, *((d.rival, d.theta) for d in self.all)]

    @cached_property
    def joints(self) -> tuple[int, ...]:
        """The joints of the effects that are to be parted."""
        names = self.scene.tangents.residuals.robot.joint_names
        suspects = [s for d in self.all for s in (self.model.suspects[d.place], d.rival)]
        parts = {part.split(".")[0] for s in suspects for part in s.target.split("->")}
        return tuple(j for j, name in enumerate(names) if name in parts)

    @cached_property
    def sided(self) -> tuple[int, ...]:
        """The joints whose side of arrival matters, where the data know it."""
        names = self.scene.tangents.residuals.robot.joint_names
        asked = {s.target for s, _ in self.members if isinstance(s.what, Effect) and "approach" in s.what.needs}
        known = "approach" in self.scene.case.inputs
        return tuple(j for j, name in enumerate(names) if known and name in asked)

    def columns(self, tangents: EffectSensitivities) -> tuple[Array, list[Codes]]:
        """(m, K) at some rows, and where each member stands."""
        parts, places = [tangents.residuals.both(tangents.x)[1][: tangents.rows]], []
        at = parts[0].shape[1]
        for suspect, theta in self.members:
            assert isinstance(suspect.what, Effect)
            Z = tangents.columns(suspect.what)
            parts += [Z, shape_column(tangents, suspect, theta)]
            places.append(np.arange(at, at + Z.shape[1] + parts[-1].shape[1]))
            at += len(places[-1])
        return np.concatenate(parts, axis=1), places

    @cached_property
    def bouts(self) -> list[tuple[int, int, int]]:
        """Place of an effect, and any two of it and its rivals, as members: each of them could be the true one."""
        n = len(self.model.suspects)
        sides = {d.place: [d.place] for d in self.all}
        for k, d in enumerate(self.all):
            sides[d.place].append(n + k)
        return [(place, *two) for place, members in sides.items() for two in combinations(members, 2)]

    def parting(self, problem: CalibrationProblem, rows: Measurements) -> tuple[Parting, Array]:
        """What is to be parted, each bout from both sides, and λ (2 bouts,) in the data."""
        tangents = self.scene.tangents
        residuals, noise = tangents.residuals, np.sqrt(self.model.variance)
        D, places = self.columns(tangents)
        there = EffectSensitivities(replace(residuals, data=rows, distances=()), tangents.x)
        A = self.columns(there)[0].reshape(len(rows), residuals.block, -1) / noise
        prior = Beforehand.of(problem, residuals.parameters).prior
        k = len(residuals.parameters)
        M = D.T @ D / noise**2
        M[:k, :k] += prior.T @ prior
        pairs = [self._pair(bout[0], *two, k, places) for bout in self.bouts for two in (bout[1:], bout[:0:-1])]
        now = Parting.of(pairs, M, A).strengths(Parting.of(pairs, M, A).information)
        spent = np.maximum(now - RIVALS, 0.0)
        pairs = [replace(pair, spent=float(s)) for pair, s in zip(pairs, spent, strict=True)]
        return Parting.of(pairs, M, A), now

    def _pair(self, place: int, true: int, false: int, k: int, places: list[Codes]) -> Pair:
        """One member taken for true and another fitted in its place, beside k parameters and the other effects."""
        others = [places[i] for i in range(len(self.model.suspects)) if i != place]
        theta = self.members[true][1]
        signature = np.zeros(k + sum(map(len, places)))
        signature[places[true][: len(theta)]] = theta
        return Pair(signature, np.concatenate([np.arange(k), *others, places[false]]))


def by_posture(suspect: Candidate) -> bool:
    return isinstance(suspect.what, Effect) and not suspect.what.asks & _ELSEWHERE


def _duel_of(scene: LinearisedData, model: Extended, place: int, rival: Candidate) -> Duel:
    others = [s for i, s in enumerate(model.suspects) if i != place]
    ground = scene.ground(others, flips=0)
    one, other = (orthonormal(ground.project(s.Z)) for s in (model.suspects[place], rival))
    cosine = float(np.linalg.norm(one.T @ other, 2))
    theta = np.asarray(np.linalg.lstsq(ground.project(rival.Z), -ground.e, rcond=1e-9)[0], dtype=float)
    return Duel(place, rival, theta, float(np.arccos(min(cosine, 1.0))))
