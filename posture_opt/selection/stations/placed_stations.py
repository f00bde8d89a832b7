"""``PlacedStations``: the features of a workpiece; the best posture of each at many placements.

Once the placement is given, no feature depends on the others, unless errors that stay move all of them at once and what
counts is that all succeed. So placements are compared by solving all features at all of them in batches; postures that
err alike are looked for among the branches of each feature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.numerics import Array, Codes, DerivedAgain, Mask
from posture_opt.selection.answer.combine import combined_numbers
from posture_opt.selection.answer.placement import PlacementRange
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.stations.branch_combination import Branches, best_combination, combination_losses
from posture_opt.selection.stations.station_candidates import StationCandidates, given_candidates, station_candidates
from posture_opt.selection.stations.station_errors import StationErrors
from posture_opt.selection.stations.stations_problem import SharedSuccess, Station, StationsProblem
from posture_opt.selection.tasks.workpiece import Combine
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.spread.shared_draws import ErrorParts, SharedDraws

_COLUMNS = ("W", "Q", "main", "extra", "sigma", "gap", "loss")
_OF_STATION = ("main", "extra", "sigma", "gap")
_PROBED = 32  # placements, by which the leading combinations of the errors that stay are found
_BRANCHES = 6  # postures of a feature at a placement that are combined with those of the others, at most
_DRAWS = 256  # of the errors that stay, to compare combinations by
_JOINT_SHARE = 4  # one in so many of them is in the joint program


@dataclass(frozen=True)
class Postures:
    """The best posture found of each of K stations at each of M placements.

    Args:
        W: (M, 4) placements.
        Q: (M, K, n) postures, NaN where nothing was found.
        main: (M, K) first term of the objective, infinite where no posture is feasible; extra: (M, K) further terms.
        sigma: (M, K) largest standard deviation of the part that counts [m].
        gap: (M, K) zero where a posture is feasible; else the least error of the inverse kinematics or of a row.
        loss: (M,) objective of all stations together, infinite where one cannot be done.
        tried: random postures that were led to targets.
    """

    W: Array
    Q: Array
    main: Array
    extra: Array
    sigma: Array
    gap: Array
    loss: Array
    tried: int = 0

    def rows(self, chosen: Codes) -> Postures:
        """The placements of the ``chosen`` rows, in this order."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in _COLUMNS})

    def joined(self, other: Postures) -> Postures:
        """The placements of both, in this order."""
        both = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS}
        return replace(self, **both, tried=self.tried + other.tried)


@dataclass(frozen=True)
class PlacedStations(DerivedAgain):
    """K stations on one workpiece.

    Args:
        engines: of each station; those of one kind share one.
        targets: in the frame of the workpiece, with one scale.
        placement: where the workpiece may stand.
        shared: sources whose constant part moves all stations at once, where what counts is that all succeed; None
            where the stations are independent.
        draws: of these errors, by which combinations are compared.
    """

    engines: tuple[Engine, ...] = field(repr=False)
    targets: tuple[TaskTarget, ...]
    placement: PlacementRange
    combine: Combine
    shared: Sources | None = None
    draws: int = _DRAWS

    def __reduce__(self) -> tuple[Any, ...]:
        return PlacedStations, (self.engines, self.targets, self.placement, self.combine, self.shared, self.draws)

    @cached_property
    def joint(self) -> StationsProblem:
        """All stations and the placement as one nonlinear program."""
        pairs = zip(self.engines, self.targets, strict=True)
        stations = tuple(Station(engine.optimisation_problem, target) for engine, target in pairs)
        box = self.placement.without_seam
        return StationsProblem(stations, box.lower, box.upper, self.combine, shared=self._joint_errors)

    def scaled(self, scale: float) -> PlacedStations:
        """The same stations with the objectives divided by another variance [m²]."""
        return replace(self, targets=tuple(replace(target, scale=scale) for target in self.targets))

    def scale_of(self, found: Postures) -> float:
        """What the objectives are divided by [m²]: the median over all feasible postures; one where there is none."""
        own = found.main[np.isfinite(found.main)]
        return self.engines[0].scale_of(own * self.targets[0].scale) if len(own) else 1.0

    def at(self, w: Array) -> list[TaskTarget]:
        """The targets of all stations at a placement w (4,) [m, rad], world."""
        return [target.moved(w) for target in self.targets]

    def in_plane(self, W: Array) -> Array:
        """Placements W (M, 4), those of a planar arm shifted within the box so that the first target is in reach."""
        reach = self.engines[0].optimisation_problem.reach
        if not reach.normals.shape[1]:
            return W
        points = [self.targets[0].moved(w).lower for w in W]
        shifts = np.array([np.append(reach.outside(point, point), 0.0) for point in points])
        return np.asarray(np.clip(W + shifts, self.placement.lower, self.placement.upper))

    def best(self, W: Array, starts: int, rng: np.random.Generator, known: Array | None = None) -> Postures:
        """The best postures at placements W (M, 4), from random starts and from ``known`` postures (J, K, n)."""
        candidates = []
        for k, (engine, target) in enumerate(zip(self.engines, self.targets, strict=True)):
            own = np.zeros((0, engine.robot.n)) if known is None else known[:, k]
            own, targets = own[np.isfinite(own).all(axis=1)], [target.moved(w) for w in W]
            branches = 0 if self.shared is None else _BRANCHES
            candidates.append(station_candidates(engine, targets, starts, own, rng, branches))
        return self._chosen(W, candidates, starts * len(W) * len(self.targets))

    def among(self, w: Array, given: Sequence[Array]) -> Postures:
        """The best of given postures (B, n) of each station at a placement w (4,), as they are."""
        none = np.zeros(1)
        each = zip(self.engines, self.at(w), given, strict=True)
        found = [given_candidates(e, [target], Q, np.zeros(len(Q), dtype=int), none) for e, target, Q in each]
        return self._chosen(w[None], found, 0)

    def _chosen(self, W: Array, candidates: Sequence[StationCandidates], tried: int) -> Postures:
        """The best of the candidates of each station: each on its own, or all together where they share errors."""
        parts = zip(*(of_station.best() for of_station in candidates), strict=True)
        Q, main, extra, sigma, gap = (np.stack(part, axis=1) for part in parts)
        alone = Postures(W, Q, main, extra, sigma, gap, combined_numbers(self.combine, main, extra), tried)
        return alone if self.shared is None else self._together(alone, candidates)

    def better(self, found: Postures, other: Postures) -> Postures:
        """The better postures of two searches at the same placements: of each station, or of all that share errors."""
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
        """(M,) the objective of all stations together at placements W (M, 4) with postures Q (M, K, n), as the joint
        problem has it; infinite where a first term ``main`` (M, K) is.
        """
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
        """The errors of station k with postures Q (N, n), each at the placement ``of`` (N,) it among W (M, 4)."""
        parameters = np.array([self.targets[k].moved(w).parameters for w in W])
        return self._errors[k].at(Q, parameters[of])

    @cached_property
    def _errors(self) -> list[StationErrors]:
        """Of each station; those of one kind share one."""
        assert self.shared is not None, "independent stations have no errors in common"
        of = {id(e): StationErrors(e.optimisation_problem, self.shared) for e in self.engines}
        return [of[id(engine)] for engine in self.engines]

    @cached_property
    def _draws(self) -> SharedDraws:
        """Draws of the errors that stay, in the combinations of them that move some postures at some placements."""
        rng, W = np.random.default_rng(0), self.placement.drawn(_PROBED, np.random.default_rng(0))
        every = np.arange(_PROBED)
        probed = [self._errors_at(k, W, every, e.ik.random_postures(_PROBED, rng)) for k, e in enumerate(self.engines)]
        return SharedDraws.of([errors.shared for errors in probed], self.draws)

    @cached_property
    def _joint_errors(self) -> SharedSuccess | None:
        """What the joint problem knows of the errors that stay; None where the stations are independent."""
        return None if self.shared is None else SharedSuccess(self.shared, self._draws.delta[::_JOINT_SHARE])

    def _together(self, alone: Postures, candidates: Sequence[StationCandidates]) -> Postures:
        """The same placements, where all stations can be done with the combination of candidates that is best."""
        names = ("main", "extra", "sigma")
        found: dict[str, Any] = {name: np.array(getattr(alone, name)) for name in ("Q", "loss", *names)}
        success = [self._draws.success(self._errors_at(k, alone.W, c.of, c.Q)) for k, c in enumerate(candidates)]
        for m in np.flatnonzero((alone.gap == 0).all(axis=1)).tolist():
            rows = [c.at(m) for c in candidates]
            branches = [
                Branches(c.Q[r], s[r], c.main[r], c.extra[r]) for c, s, r in zip(candidates, success, rows, strict=True)
            ]
            chosen, found["loss"][m] = best_combination(branches, self._revolute)
            for k, (c, r) in enumerate(zip(candidates, rows, strict=True)):
                found["Q"][m, k] = c.Q[r[chosen[k]]]
                for name in names:
                    found[name][m, k] = getattr(c, name)[r[chosen[k]]]
        return replace(alone, **found)

    @property
    def _revolute(self) -> Mask:
        """(n,) which joints turn."""
        return np.array([joint.type == "revolute" for joint in self.engines[0].robot.joints])
