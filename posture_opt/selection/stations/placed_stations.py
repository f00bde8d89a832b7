"""``PlacedStations``: the features of a workpiece, and the best posture of each at many placements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.numerics import TURN, Array, Codes, DerivedAgain, Mask
from posture_opt.selection.answer.placement import PlacementRange, combined_numbers
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import STEPS, Engine
from posture_opt.selection.search.inverse_kinematics import PARTS, ROW_TOLERANCE, TOLERANCE, PoseRequest
from posture_opt.selection.search.inverse_kinematics import STEPS as IK_STEPS
from posture_opt.selection.stations.stations_problem import SharedSuccess, Station, StationErrors, StationsProblem
from posture_opt.selection.tasks.workpiece import Combine
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.success_of_all import ErrorParts, SharedDraws


@dataclass(frozen=True)
class StationCandidates:
    """R postures of one station at M placements."""

    of: Codes  # (R,) placement of each
    Q: Array  # (R, n) postures
    main: Array  # (R,) first term of the objective
    extra: Array  # (R,) further terms
    sigma: Array  # (R,) largest standard deviation of the part that counts [m]
    excess: Array  # (R,) violation of the rows, zero where they are met
    gap: Array  # (M,) least error of the inverse kinematics, and how far the target is off the plane of the arm

    def at(self, m: int) -> Codes:
        """Feasible ones at placement m."""
        return np.flatnonzero((self.of == m) & (self.excess == 0))

    def best(self) -> tuple[Array, Array, Array, Array, Array]:
        """Best at each placement: posture (M, n); first term, further terms, σ, gap (M,) each."""
        M, n = len(self.gap), self.Q.shape[1]
        main, extra, sigma, best = np.full(M, np.inf), np.zeros(M), np.full(M, np.inf), np.full((M, n), np.nan)
        gap = self.gap.copy()
        for r in np.lexsort((self.main + self.extra, self.excess))[::-1]:  # the best one is written last
            m, met = self.of[r], self.excess[r] == 0
            gap[m], best[m] = (0.0 if met else self.excess[r]), self.Q[r]
            main[m], extra[m] = (self.main[r], self.extra[r]) if met else (np.inf, 0.0)
            sigma[m] = self.sigma[r]
        return best, main, extra, sigma, gap


def station_candidates(
    engine: Engine, targets: Sequence[TaskTarget], starts: int, known: Array, rng: np.random.Generator,
    branches: int = 0,
) -> StationCandidates:  # fmt: skip
    """Postures at M targets, random starts and ``known`` (J, n); ``branches`` distinct ones of each, 0: best."""
    count, M = starts + len(known), len(targets)
    drawn = engine.ik.random_postures(starts * M, rng).reshape(M, starts, engine.robot.n)
    begun = np.concatenate([drawn, np.broadcast_to(known, (M, *known.shape))], axis=1)
    Q, error = engine.ik.solve(begun.reshape(M * count, -1), _requests(engine, targets, count, rng), steps=IK_STEPS)
    of = np.repeat(np.arange(M), count)
    off = _off_plane(engine, targets)
    gap = np.maximum(error.reshape(M, count).min(axis=1), off)
    arrived = (error < TOLERANCE) & (off[of] == 0)
    several = _distinct(engine, Q, of, arrived) if branches else arrived
    rows = _promising(engine, targets, Q, of, several, branches or max(2, count // 8))
    ends, placements = np.zeros((0, engine.robot.n)), of[rows]
    if len(rows):
        steps = STEPS if M == 1 else 20  # more are taken by searches that end nowhere
        ends = engine.descended_each(Q[rows], targets, placements, steps).q
    if branches and len(known):
        # What the errors that stay make of a posture is not in its own optimum.
        kept = np.flatnonzero(arrived & np.tile(np.arange(count) >= starts, M))
        ends, placements = np.vstack([ends, Q[kept]]), np.concatenate([placements, of[kept]])
    return given_candidates(engine, targets, ends, placements, gap)


def given_candidates(
    engine: Engine, targets: Sequence[TaskTarget], Q: Array, of: Codes, gap: Array
) -> StationCandidates:
    """Postures Q (R, n) as they are, each at its target ``of`` (R,)."""
    objective, main, violation, sigma = _values(engine, targets, Q, of).T
    excess = np.where(violation <= ROW_TOLERANCE, 0.0, violation)
    return StationCandidates(of, Q, main, objective - main, sigma, excess, gap)


def _requests(engine: Engine, targets: Sequence[TaskTarget], count: int, rng: np.random.Generator) -> PoseRequest:
    rows = np.vstack([np.broadcast_to(engine.request(t, count, rng).rows, (count, PARTS[-1])) for t in targets])
    weights = engine.request(targets[0], 1, rng).weights
    position, axis, spin, _, slack, cone = np.split(rows, PARTS[1:-1], axis=1)
    return PoseRequest(position, axis, spin, weights, slack, cone)


def _off_plane(engine: Engine, targets: Sequence[TaskTarget]) -> Array:
    """(M,) distance [m] of targets from the plane, or line, that the tool point cannot leave; mostly zero."""
    reach = engine.optimisation_problem.reach
    if not reach.normals.shape[1]:
        return np.zeros(len(targets))
    shifts = [reach.outside(t.lower, t.upper) if reach.misses(t.lower, t.upper) else np.zeros(3) for t in targets]
    return np.asarray(np.linalg.norm(shifts, axis=1))


def _distinct(engine: Engine, Q: Array, of: Codes, arrived: Array) -> Array:
    """(N,) the arrived postures that differ from each other at their placement."""
    kept = np.zeros(len(Q), dtype=bool)
    rows = np.flatnonzero(arrived)
    for own in np.split(rows, np.flatnonzero(np.diff(of[rows])) + 1) if len(rows) else ():
        kept[own[engine.clusters(Q[own])[0]]] = True
    return kept


def _promising(engine: Engine, targets: Sequence[TaskTarget], Q: Array, of: Codes, arrived: Array, most: int) -> Codes:
    rows = np.flatnonzero(arrived)
    if not len(rows):
        return rows
    objective, violation = _values(engine, targets, Q[rows], of[rows])[:, [0, 2]].T
    excess = np.where(violation <= ROW_TOLERANCE, 0.0, violation)
    order = np.lexsort((objective, excess, of[rows]))
    sorted_of = of[rows][order]
    rank = np.arange(len(order)) - np.searchsorted(sorted_of, sorted_of)
    return np.asarray(rows[order[rank < most]])


def _values(engine: Engine, targets: Sequence[TaskTarget], Q: Array, of: Codes) -> Array:
    """(N, 4) objective, first term, worst violation of a row, and σ [m], of each posture at its target."""
    if not len(Q):
        return np.zeros((0, 4))
    parameters = np.array([target.parameters for target in targets])[of]
    objective, violation, main, variance = (column[:, 0] for column in engine.screen(Q, parameters))
    return np.column_stack([objective, main, violation, np.sqrt(np.maximum(variance, 0.0))])


@dataclass(frozen=True)
class Branches:
    """Postures of one feature at one placement."""

    Q: Array  # (B, n) postures
    success: Array  # (B, N) probability given each draw of the errors that stay
    log_miss: Array  # (B,) of the posture alone
    extra: Array  # (B,) further terms of the objective


def combination_losses(p_all: Array, log_miss: Array, extra: Array) -> Array:
    """(S,) ``log(−log P) + Σ e_k/K``, P kept within ``max_k m_k ≤ 1 − P ≤ Σ m_k`` (draws fail near P = 1)."""
    miss = np.exp(np.minimum(log_miss, -1e-9))
    least, most = miss.max(axis=1), miss.sum(axis=1)
    slight = 1e-9 * np.prod(1 - miss, axis=1)  # where no draw succeeds, products are compared
    loss = np.clip(1 - p_all, least, np.maximum(np.minimum(most, 1 - slight), least))
    return np.asarray(np.log(-np.log1p(-np.minimum(loss, 1 - 1e-300))) + extra.mean(axis=1))


def best_combination(features: Sequence[Branches], revolute: Mask) -> tuple[Codes, float]:
    """(K,) the posture of each feature, and the loss; ``revolute`` (n,) joints count but for whole turns."""
    alone = [int(np.argmin(f.log_miss + f.extra)) for f in features]
    starts = np.unique(np.vstack([alone, _families(features, revolute), _greedy(features)]), axis=0)
    losses = _losses(features, starts)
    chosen = np.argsort(losses, kind="stable")[:2]
    ends = [_exchanged(features, starts[s], float(losses[s])) for s in chosen]
    return min(ends, key=lambda end: end[1])


def _losses(features: Sequence[Branches], chosen: Codes) -> Array:
    """(S,) losses of the combinations ``chosen`` (S, K)."""
    product = np.ones((len(chosen), features[0].success.shape[1]))
    for feature, picks in zip(features, chosen.T, strict=True):
        product = product * feature.success[picks]
    log_miss, extra = (
        np.column_stack([getattr(f, name)[picks] for f, picks in zip(features, chosen.T, strict=True)])
        for name in ("log_miss", "extra")
    )
    return combination_losses(product.mean(axis=1), log_miss, extra)


def _families(features: Sequence[Branches], revolute: Mask) -> Codes:
    """(S, K) the nearest postures of all features to each posture of each: one branch for all."""
    rows = []
    for seed in features:
        columns = []
        for other in features:
            away = seed.Q[:, None] - other.Q
            away = np.where(revolute, away - TURN * np.rint(away / TURN), away)
            columns.append(np.argmin(np.sum(away**2, axis=2), axis=1))
        rows.append(np.column_stack(columns))
    return np.vstack(rows)


def _greedy(features: Sequence[Branches]) -> Codes:
    """(S, K) from each posture of the hardest feature on, what goes best with those before, hardest first."""
    order = np.argsort([-float(f.log_miss.min()) for f in features], kind="stable")
    chosen = np.zeros((len(features[order[0]].Q), len(features)), dtype=int)
    chosen[:, order[0]] = np.arange(len(chosen))
    product = features[order[0]].success
    for k in order[1:]:
        chosen[:, k] = np.argmax(product @ features[k].success.T, axis=1)
        product = product * features[k].success[chosen[:, k]]
    return chosen


def _exchanged(features: Sequence[Branches], chosen: Codes, loss: float) -> tuple[Codes, float]:
    success, log_miss, extra = (
        np.array([getattr(f, name)[b] for f, b in zip(features, chosen, strict=True)])
        for name in ("success", "log_miss", "extra")
    )
    for _ in range(8):
        before = loss
        for k, feature in enumerate(features):
            others = np.prod(np.delete(success, k, axis=0), axis=0)
            misses, extras = (np.tile(row, (len(feature.Q), 1)) for row in (log_miss, extra))
            misses[:, k], extras[:, k] = feature.log_miss, feature.extra
            losses = combination_losses(feature.success @ others / len(others), misses, extras)
            b = int(np.argmin(losses))
            if losses[b] < loss:
                loss, chosen = float(losses[b]), np.where(np.arange(len(chosen)) == k, b, chosen)
                success[k], log_miss[k], extra[k] = feature.success[b], feature.log_miss[b], feature.extra[b]
        if loss >= before:
            break
    return chosen, loss


_COLUMNS = ("W", "Q", "main", "extra", "sigma", "gap", "loss")
_OF_STATION = ("main", "extra", "sigma", "gap")


@dataclass(frozen=True)
class Postures:
    """Best posture found of each of K stations at each of M placements."""

    W: Array  # (M, 4) placements
    Q: Array  # (M, K, n) postures, NaN where nothing was found
    main: Array  # (M, K) first term of the objective, infinite where no posture is feasible
    extra: Array  # (M, K) further terms
    sigma: Array  # (M, K) largest standard deviation of the part that counts [m]
    gap: Array  # (M, K) zero where a posture is feasible; else the least error of the inverse kinematics or of a row
    loss: Array  # (M,) objective of all stations together, infinite where one cannot be done
    tried: int = 0  # random postures that were led to targets

    def rows(self, chosen: Codes) -> Postures:
        return replace(self, **{name: getattr(self, name)[chosen] for name in _COLUMNS})

    def joined(self, other: Postures) -> Postures:
        both = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS}
        return replace(self, **both, tried=self.tried + other.tried)

    def replaced(self, rows: Codes, better: Postures) -> Postures:
        """The placements, those of some rows as in ``better``."""
        columns: dict[str, Any] = {name: np.array(getattr(self, name)) for name in _COLUMNS}
        for name, column in columns.items():
            column[rows] = getattr(better, name)
        return replace(self, **columns, tried=self.tried + better.tried)


@dataclass(frozen=True)
class PlacedStations(DerivedAgain):
    """K stations on one workpiece."""

    engines: tuple[Engine, ...] = field(repr=False)  # of each station; those of one kind share one
    targets: tuple[TaskTarget, ...]  # in the frame of the workpiece, with one scale
    placement: PlacementRange  # where the workpiece may stand
    combine: Combine
    shared: Sources | None = None  # whose constant part moves all stations, where what counts is that all succeed
    draws: int = 256  # of these errors, by which combinations are compared

    def __reduce__(self) -> tuple[Any, ...]:
        return PlacedStations, (self.engines, self.targets, self.placement, self.combine, self.shared, self.draws)

    @cached_property
    def joint(self) -> StationsProblem:
        """All stations and the placement as one nonlinear program."""
        pairs, box = zip(self.engines, self.targets, strict=True), self.placement.without_seam
        stations = tuple(Station(engine.optimisation_problem, target) for engine, target in pairs)
        errors = None if self.shared is None else SharedSuccess(self.shared, self._draws.delta[::4])
        return StationsProblem(stations, box.lower, box.upper, self.combine, shared=errors)

    def scaled(self, scale: float) -> PlacedStations:
        """Stations with the objectives divided by another variance [m²]."""
        return replace(self, targets=tuple(replace(target, scale=scale) for target in self.targets))

    def scale_of(self, found: Postures) -> float:
        """Median variance over all feasible postures [m²], which objectives are divided by; one without any."""
        own = found.main[np.isfinite(found.main)]
        return self.engines[0].scale_of(own * self.targets[0].scale) if len(own) else 1.0

    def at(self, w: Array) -> list[TaskTarget]:
        """Targets of all stations at a placement w (4,) [m, rad], world."""
        return [target.moved(w) for target in self.targets]

    def in_plane(self, W: Array) -> Array:
        """Placements W (M, 4), of a planar arm shifted within the box so that the first target is in its plane."""
        reach = self.engines[0].optimisation_problem.reach
        if not reach.normals.shape[1]:
            return W
        points = [self.targets[0].moved(w).lower for w in W]
        shifts = np.array([np.append(reach.outside(point, point), 0.0) for point in points])
        return np.asarray(np.clip(W + shifts, self.placement.lower, self.placement.upper))

    def best(self, W: Array, starts: int, rng: np.random.Generator, known: Array | None = None) -> Postures:
        """Best postures at placements W (M, 4), from random starts and from ``known`` postures (J, K, n)."""
        candidates = []
        for k, (engine, target) in enumerate(zip(self.engines, self.targets, strict=True)):
            own = np.zeros((0, engine.robot.n)) if known is None else known[:, k]
            own, targets = own[np.isfinite(own).all(axis=1)], [target.moved(w) for w in W]
            branches = 0 if self.shared is None else 6
            candidates.append(station_candidates(engine, targets, starts, own, rng, branches))
        return self._chosen(W, candidates, starts * len(W) * len(self.targets))

    def among(self, w: Array, given: Sequence[Array]) -> Postures:
        """Best of given postures (B, n) of each station at a placement w (4,), as they are."""
        none = np.zeros(1)
        each = zip(self.engines, self.at(w), given, strict=True)
        found = [given_candidates(e, [target], Q, np.zeros(len(Q), dtype=int), none) for e, target, Q in each]
        return self._chosen(w[None], found, 0)

    def _chosen(self, W: Array, candidates: Sequence[StationCandidates], tried: int) -> Postures:
        parts = zip(*(of_station.best() for of_station in candidates), strict=True)
        Q, main, extra, sigma, gap = (np.stack(part, axis=1) for part in parts)
        alone = Postures(W, Q, main, extra, sigma, gap, combined_numbers(self.combine, main, extra), tried)
        return alone if self.shared is None else self._together(alone, candidates)

    def better(self, found: Postures, other: Postures) -> Postures:
        """Better postures of two searches at the same placements: of each station, or of all that share errors."""
        mine, theirs = found.main + found.extra, other.main + other.extra
        take = (other.gap < found.gap) | ((other.gap == found.gap) & (theirs < mine))
        if self.shared is not None:
            both = np.isfinite(found.loss) & np.isfinite(other.loss)
            take = np.where(both[:, None], (other.loss < found.loss)[:, None], take)
        best = {name: np.where(take, getattr(other, name), getattr(found, name)) for name in _OF_STATION}
        Q = np.where(take[..., None], other.Q, found.Q)
        loss = self.losses(found.W, Q, best["main"], best["extra"])
        return replace(found, Q=Q, loss=loss, **best, tried=found.tried + other.tried)

    def losses(self, W: Array, Q: Array, main: Array, extra: Array) -> Array:
        """(M,) objective of all stations at W (M, 4), Q (M, K, n); infinite where ``main`` (M, K) is."""
        loss = combined_numbers(self.combine, main, extra)
        rows = np.flatnonzero(np.isfinite(main).all(axis=1))
        if self.shared is None or not len(rows):
            return loss
        product = np.ones(1)
        for k in range(len(self.targets)):
            product = product * self._draws.success(self._errors_at(k, W, rows, Q[rows, k]))
        loss[rows] = combination_losses(product.mean(axis=1), main[rows], extra[rows])
        return loss

    def _errors_at(self, k: int, W: Array, of: Codes, Q: Array) -> ErrorParts:
        """Errors of station k with postures Q (N, n), each at its placement ``of`` (N,) among W (M, 4)."""
        parameters = np.array([self.targets[k].moved(w).parameters for w in W])
        return self._errors[k].at(Q, parameters[of])

    @cached_property
    def _errors(self) -> list[StationErrors]:
        assert self.shared is not None, "independent stations have no errors in common"
        of = {id(e): StationErrors(e.optimisation_problem, self.shared) for e in self.engines}
        return [of[id(engine)] for engine in self.engines]

    @cached_property
    def _draws(self) -> SharedDraws:
        rng, W = np.random.default_rng(0), self.placement.drawn(32, np.random.default_rng(0))
        every = np.arange(32)
        probed = [self._errors_at(k, W, every, e.ik.random_postures(32, rng)) for k, e in enumerate(self.engines)]
        return SharedDraws.of([errors.shared for errors in probed], self.draws)

    def _together(self, alone: Postures, candidates: Sequence[StationCandidates]) -> Postures:
        revolute = np.array([joint.type == "revolute" for joint in self.engines[0].robot.joints])
        names = ("main", "extra", "sigma")
        found: dict[str, Any] = {name: np.array(getattr(alone, name)) for name in ("Q", "loss", *names)}
        success = [self._draws.success(self._errors_at(k, alone.W, c.of, c.Q)) for k, c in enumerate(candidates)]
        for m in np.flatnonzero((alone.gap == 0).all(axis=1)).tolist():
            rows = [c.at(m) for c in candidates]
            branches = [
                Branches(c.Q[r], s[r], c.main[r], c.extra[r]) for c, s, r in zip(candidates, success, rows, strict=True)
            ]
            chosen, found["loss"][m] = best_combination(branches, revolute)
            for k, (c, r) in enumerate(zip(candidates, rows, strict=True)):
                found["Q"][m, k] = c.Q[r[chosen[k]]]
                for name in names:
                    found[name][m, k] = getattr(c, name)[r[chosen[k]]]
        return replace(alone, **found)
