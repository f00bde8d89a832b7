"""Measurements that would discriminate named effects from their rivals, by the T-criterion (Atkinson, Fedorov 1975).

Of two models take one for true: its signature ``A s`` in all rows, in standard deviations, is fitted by the other with
its columns ``A_F``, geometry and all else among them. The lack of fit that remains is the noncentrality

``λ = min_β |A s − A_F β|² = sᵀ M s − sᵀ M_F M_FF⁻¹ M_Fᵀ s``  with the information  ``M = AᵀA``.

It grows by ``dᵀ (I + A_F M_FF⁻¹ A_Fᵀ)⁻¹ d`` with a new row whose discrepancy is ``d = A s − A_F β``. Plans are made for
the pair of models that is hardest to distinguish.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate, LinearisedData
from posture_opt.diagnosis.scores.score_tests import orthonormal_basis
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.encoding import Encoded, encode
from posture_opt.errors import InputError
from posture_opt.experiments.candidate_postures import candidate_rows
from posture_opt.experiments.information import PriorInformation
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import Cause, Effect
from posture_opt.numerics import Array, Codes, Json, Mask
from posture_opt.selection.problem_data import ProblemData

Steps = Sequence[tuple[int, Array]]
_LEAST_POSTURES = 5  # of a plan, so that no single reading decides; a choice of taste
_MOST_MEASUREMENTS = 300  # what takes more is no matter of postures; a choice of taste


def detection_probability(value: float) -> float:
    """Probability ``Φ(√λ − 3.5)`` that a difference of noncentrality λ is detected.

    Example:
        >>> round(detection_probability(3.5**2), 3), round(detection_probability(22.9), 2)
        (0.5, 0.9)
    """
    from scipy.special import ndtr

    return float(ndtr(np.sqrt(max(value, 0.0)) - 3.5))


@dataclass(frozen=True, eq=False)
class OrderedPair:
    """One model taken for true, and another that is fitted in its place.

    Args:
        signature: (K,) coefficients of the true one.
        fitted: (r,) indices of the columns of the other one, with all that is fitted together with it.
        spent: λ that the data predicted and did not show: it is taken off.
    """

    signature: Array
    fitted: Codes
    spent: float = 0.0

    def noncentrality(self, M: Array) -> tuple[float, Array, Array]:
        """λ, the coefficients (r,) that reach for the signature, and a root ``L`` (r, r), ``L Lᵀ = M_FF⁻¹``.

        Of columns that are alike to rounding, as of parameters that are not identifiable, the information is held to
        its rounding error, so that its inverse stays positive.
        """
        F, s = self.fitted, self.signature
        values, vectors = np.linalg.eigh(M[np.ix_(F, F)])
        L = vectors / np.sqrt(np.maximum(values, 1e-12 * values[-1]))
        reached = L.T @ (M[F] @ s)
        return max(float(s @ M @ s - reached @ reached), 0.0) - self.spent, np.asarray(L @ reached), np.asarray(L)

    def with_each(self, M: Array, A: Array) -> Array:
        """λ (N,) once each of the candidates A (N, b, K) is measured too.

        ``λ + dᵀ (I + V M_FF⁻¹ Vᵀ)⁻¹ d`` with the discrepancy d of the candidate and its columns V of what is fitted.
        """
        value, beta, L = self.noncentrality(M)
        V = A[:, :, self.fitted]
        d = A @ self.signature - V @ beta
        W = V @ L
        S = W @ np.swapaxes(W, 1, 2)
        S[:, range(S.shape[1]), range(S.shape[1])] += 1.0
        return np.asarray(value + np.einsum("nb,nb->n", d, np.linalg.solve(S, d[..., None])[..., 0]))


@dataclass(frozen=True, eq=False)
class DiscriminationDesign:
    """Pairs of models, the information so far, and the candidate measurements.

    Args:
        information: (K, K) of the data and the prior.
        A: (N, b, K) columns at the candidates, in standard deviations of a measurement.
    """

    pairs: tuple[OrderedPair, ...]
    information: Array
    A: Array

    @classmethod
    def of(cls, pairs: Sequence[OrderedPair], information: Array, A: Array) -> DiscriminationDesign:
        """With columns scaled to unit information of the data and an average design, whatever their units."""
        average = np.einsum("nbk,nbk->k", A, A) / max(len(A), 1)
        scale = np.sqrt(np.maximum(np.diag(information) + average, 1e-300))
        M = information / np.outer(scale, scale) + 1e-10 * np.eye(len(scale))  # undetermined columns stay invertible
        return cls(tuple(replace(p, signature=p.signature * scale) for p in pairs), M, A / scale)

    def after(self, chosen: Sequence[int], rounds: float = 1.0) -> Array:
        """(K, K) information once the chosen candidates are measured so many times."""
        flat = self.A[list(chosen)].reshape(-1, self.A.shape[-1])
        return np.asarray(self.information + rounds * flat.T @ flat)

    def noncentralities(self, information: Array) -> Array:
        """(P,) λ of every ordered pair."""
        return np.array([pair.noncentrality(information)[0] for pair in self.pairs])

    def of_pairs(self, chosen: Sequence[int], rounds: float = 1.0) -> Array:
        """(P / 2,) the lesser λ of the two directions of each pair, once the chosen candidates are measured."""
        both = self.noncentralities(self.after(chosen, rounds)).reshape(-1, 2)
        return np.asarray(np.maximum(both.min(axis=1), 0.0))

    def chosen(self, least: int, most: int) -> list[int]:
        """At most ``most`` candidates that raise the least λ, most informative first; fewer where they are enough.

        One by one, then exchanged as long as that helps, two sweeps at the most (Fedorov 1972).
        """
        found: list[int] = []
        while len(found) < min(most, len(self.A)):
            if len(found) >= least and self.noncentralities(self.after(found)).min() >= levels.DISCRIMINATED_LAMBDA:
                break
            found.append(self._best_candidate(found))
        for _ in range(2):
            former = list(found)
            for place in range(len(found)):
                found[place] = self._best_candidate(found[:place] + found[place + 1 :])
            if found == former:
                break
        order: list[int] = []
        while len(order) < len(found):
            rest = [i for i in found if i not in order]
            some = replace(self, information=self.after(order), A=self.A[rest])
            order.append(rest[some._best_candidate([])])
        return order

    def _best_candidate(self, taken: Sequence[int]) -> int:
        """The candidate that raises the least λ most beside others; the mean over all pairs decides between equals."""
        information = self.after(taken)
        reached = np.stack([pair.with_each(information, self.A) for pair in self.pairs])
        worth = reached.min(axis=0) + 0.01 * np.minimum(reached, 2 * levels.DISCRIMINATED_LAMBDA).mean(axis=0)
        worth[list(taken)] = -np.inf
        return int(np.argmax(worth))


@dataclass(frozen=True, eq=False)
class RivalExplanation:
    """A rival of one effect of the model.

    Args:
        place: of the effect in the model.
        theta: (p,) size of the rival in the place of the effect [SI].
        angle: least principal angle between both, given geometry and the other effects [rad].
    """

    place: int
    rival: Effect
    theta: Array
    angle: float

    @classmethod
    def of(cls, linearised: LinearisedData, model: Fit, place: int, rival: Candidate) -> RivalExplanation:
        members = [Candidate(e, linearised.sensitivities.columns(e)) for e in model.effects]
        baseline = linearised.baseline([s for i, s in enumerate(members) if i != place], flips=0)
        one, other = (orthonormal_basis(baseline.project(s.Z)) for s in (members[place], rival))
        cosine = float(np.linalg.norm(one.T @ other, 2))
        theta = np.asarray(np.linalg.lstsq(baseline.project(rival.Z), -baseline.e, rcond=1e-9)[0], dtype=float)
        assert isinstance(rival.what, Effect)
        return cls(place, rival.what, theta, float(np.arccos(min(cosine, 1.0))))


@dataclass(frozen=True, eq=False)
class ModelDiscrimination:
    """A fitted model with the rivals of its effects; its members are the effects, then all rivals."""

    linearised: LinearisedData
    model: Fit
    all: tuple[RivalExplanation, ...]

    @classmethod
    def of(
        cls, linearised: LinearisedData, model: Fit, rivals: Mapping[int, Sequence[Candidate]]
    ) -> ModelDiscrimination:
        """Four rivals of each of six effects that a choice of postures could discriminate; chosen for time."""
        explanations = []
        for place, others in list(rivals.items())[:6]:
            if by_posture(model.effects[place]):
                able = [s for s in others if by_posture(s.what)][:4]
                explanations += [RivalExplanation.of(linearised, model, place, s) for s in able]
        return cls(linearised, model, tuple(explanations))

    @cached_property
    def members(self) -> list[tuple[Effect, Array]]:
        """The effects of the model, then the rivals, each with its size."""
        own = [(e, self.model.x[part]) for e, part in zip(self.model.effects, self.model.slices, strict=True)]
        return [*own, *((d.rival, d.theta) for d in self.all)]

    @cached_property
    def joints(self) -> tuple[int, ...]:
        names = self.linearised.sensitivities.residuals.robot.joint_names
        effects = [s for d in self.all for s in (self.model.effects[d.place], d.rival)]
        parts = {part for s in effects for part in s.target.split("->")}
        own = parts | {part.rpartition(".")[0] for part in parts if part not in names}  # of a parameter, its joint
        return tuple(j for j, name in enumerate(names) if name in own)

    @cached_property
    def sided(self) -> tuple[int, ...]:
        names = self.linearised.sensitivities.residuals.robot.joint_names
        asked = {e.target for e, _ in self.members if "approach" in e.needs}
        known = "approach" in self.linearised.excitation.inputs
        return tuple(j for j, name in enumerate(names) if known and name in asked)

    def columns(self, sensitivities: EffectSensitivities) -> tuple[Array, list[Codes]]:
        """(m, K) whitened columns of all parameters, then of each member with its shape, and the indices of these."""
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
        """Design of all pairs, either of the two taken for true, and their λ (2 pairs,) in the data so far.

        What of it exceeds `levels.RIVAL_CRITERION` was predicted and not seen: it is spent.
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
        pairs = []
        for place, one, two in self.pairs:
            others = [places[i] for i in range(len(self.model.effects)) if i != place]
            for true, false in ((one, two), (two, one)):
                theta, signature = self.members[true][1], np.zeros(M.shape[0])
                signature[places[true][: len(theta)]] = theta
                pairs.append(OrderedPair(signature, np.concatenate([np.arange(k), *others, places[false]])))
        before = DiscriminationDesign.of(pairs, M, A)
        now = before.noncentralities(before.information)
        spent = np.maximum(now - levels.RIVAL_CRITERION, 0.0).tolist()
        return replace(
            before, pairs=tuple(replace(pair, spent=s) for pair, s in zip(before.pairs, spent, strict=True))
        ), now


def by_posture(effect: Effect | UnnamedComponent) -> bool:
    """Whether postures, payloads and sides of approach vary what the effect depends on."""
    return isinstance(effect, Effect) and not effect.asks & {"time", "temperature"}


@dataclass(frozen=True, eq=False)
class DiscriminatedPair(
    Encoded, json="kind=rival.kind target=rival.target angle lambda_now=now lambda=then chance count"
):
    """How well an effect is discriminated from one of its rivals.

    Args:
        angle: least principal angle between their columns, given the geometry and the other effects [rad].
        now: noncentrality λ of the data, the lesser of the two directions of taking one for true.
        then: λ with the planned measurements; what the data predicted and did not show is taken off.
        count: measurements of the plan for a detection probability of 90 %; None where no postures discriminate them.
    """

    rival: Cause
    angle: float
    now: float
    then: float
    count: int | None

    @property
    def chance(self) -> float:
        return detection_probability(self.then)


@dataclass(frozen=True, eq=False)
class DiscriminationPlan:
    """Measurements that discriminate effects from their rivals.

    Args:
        pairs: by the place of the effect in the model, each of its rivals.
        counts: by that place, measurements of the plan after which all but one of effect and rivals are refuted with
            90 %; without those that no postures discriminate, and None where they discriminate none.
        rows: what to measure, the most informative first; ``rounds`` how often all of them.
        sided: the joints whose side of approach matters.
    """

    pairs: Mapping[int, tuple[DiscriminatedPair, ...]]
    counts: Mapping[int, int | None]
    rows: Measurements
    rounds: int
    sided: tuple[int, ...]

    def postures(self, count: int | None = None) -> list[dict[str, Json]]:
        """The first ``count`` postures, all by default, with side and payload where they matter [rad, m, kg]."""
        rows, found = self.rows, []
        for i in range(len(rows) if count is None else min(count, len(rows))):
            one: dict[str, Json] = {"posture": dict(zip(rows.joint_names, map(float, rows.q[i]), strict=True))}
            if self.sided:
                one["approach"] = {rows.joint_names[j]: int(rows.approach[i, j]) for j in self.sided}
            if rows.payload is not None:
                one["payload"] = float(rows.payload[i])
            found.append(one)
        return found

    def to_json(self, place: int) -> dict[str, Json]:
        pairs = self.pairs[place]
        return {
            "angle": min(s.angle for s in pairs),
            "lambda_now": min(s.now for s in pairs),
            "lambda": min((s.then for s in pairs if s.count is not None), default=None),
            "count": self.counts[place],
            "postures": self.postures(self.counts[place] or 0),
            "rivals": encode(pairs),
        }


def plan_discrimination(
    problem: ProblemData,
    linearised: LinearisedData,
    model: Fit,
    rivals: Mapping[int, Sequence[Candidate]],
    seed: int = 0,
) -> DiscriminationPlan | None:
    """Postures that discriminate the effects of a model from their rivals, one list for all pairs; None without rivals.

    Geometry is fitted anew; its prior of 10 mm and 1 deg keeps postures far from the data from promising too much.
    """
    models = ModelDiscrimination.of(linearised, model, rivals)
    residuals = linearised.sensitivities.residuals
    if not models.all or residuals.data.position is None:
        return None
    try:
        rows = candidate_rows(residuals, models.joints, bool(models.sided), seed)
    except InputError:  # a slide without limits has no room to plan in
        return None
    design, now = models.design(problem, rows)
    all_of_them = design.of_pairs(range(len(rows)), _MOST_MEASUREMENTS / max(len(rows), 1))
    possible = all_of_them >= levels.DISCRIMINATED_LAMBDA
    chosen = _choose_postures(design, now, possible)
    steps = list(_growing_plan(design, chosen, possible)) if chosen else []
    pairs: dict[int, tuple[DiscriminatedPair, ...]] = {}
    for k, rival in enumerate(models.all):
        b = models.pairs.index((rival.place, rival.place, len(model.effects) + k))
        then = float(steps[-1][1][b]) if steps else 0.0
        count = _needed_count(steps, (np.arange(len(possible)) == b) & possible)
        least = float(now[2 * b : 2 * b + 2].min())
        one = DiscriminatedPair(rival.rival, rival.angle, least, then, count)
        pairs[rival.place] = (*pairs.get(rival.place, ()), one)
    places = np.array([place for place, _, _ in models.pairs])
    return DiscriminationPlan(
        pairs=pairs,
        counts={place: _needed_count(steps, (places == place) & possible) for place in pairs},
        rows=rows.take(np.array(chosen, dtype=np.intp)),
        rounds=max(steps[-1][0] // len(chosen), 1) if steps else 1,
        sided=models.sided,
    )


def _choose_postures(design: DiscriminationDesign, now: Array, possible: Mask) -> list[int]:
    """Candidates for the twelve pairs of least λ now; if that leaves others below the target, for these with them."""
    sides = np.flatnonzero(np.repeat(possible, 2))
    asked = [int(k) for k in sides[np.argsort(now[sides])][:12]]
    chosen: list[int] = []
    for _ in range(3 if asked else 0):
        some = replace(design, pairs=tuple(design.pairs[k] for k in asked))
        chosen = some.chosen(_LEAST_POSTURES, 10)  # more measurements are rounds of them
        reached = design.noncentralities(design.after(chosen))[sides]
        weak = [int(k) for k in sides[np.argsort(reached)][:6] if k not in asked]
        if not weak or reached.min() >= levels.DISCRIMINATED_LAMBDA:
            break
        asked += weak
    return chosen


def _growing_plan(design: DiscriminationDesign, chosen: list[int], possible: Mask) -> Iterator[tuple[int, Array]]:
    """(number of measurements, λ (pairs,)) as the plan grows, posture by posture and then round by round."""
    for n in range(min(_LEAST_POSTURES, len(chosen)), len(chosen) + 1):
        reached = design.of_pairs(chosen[:n])
        yield n, reached
    for rounds in range(2, _MOST_MEASUREMENTS // len(chosen) + 1):
        if reached[possible].min() >= levels.DISCRIMINATED_LAMBDA:
            return
        reached = design.of_pairs(chosen, rounds)
        yield rounds * len(chosen), reached


def _needed_count(steps: Steps, asked: Mask) -> int | None:
    """Measurements that discriminate all pairs that are asked for; None where there is none, or too many are needed."""
    enough = [count for count, reached in steps if asked.any() and reached[asked].min() >= levels.DISCRIMINATED_LAMBDA]
    return min(enough, default=None)
