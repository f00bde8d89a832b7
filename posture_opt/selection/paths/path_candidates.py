"""Candidate postures for every point of a path: random ones led onto it, followed along it, and local optima."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.numerics import Array, Progress
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.program.task_path import stacked
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, TOLERANCE
from posture_opt.selection.search.multistart import feasible_starts
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.workers import Serial, Workers

_STARTS = 12
"""Random postures at points that are no anchors: what cannot be followed from one is found here."""


@dataclass(frozen=True)
class PathCandidates:
    """Candidates of each point: K arrays of postures (N_k, n) and of objectives (N_k,), all of them feasible."""

    targets: tuple[TaskTarget, ...]  # of the points, with one scale
    postures: tuple[Array, ...]
    costs: tuple[Array, ...]
    arrived: tuple[int, ...]  # (K,) postures that meet target and tool axis, whatever else is required

    def closed(self) -> PathCandidates:
        """Candidates with those of both ends at the first and at the last point."""
        both, costs = np.vstack([self.postures[0], self.postures[-1]]), np.append(self.costs[0], self.costs[-1])
        postures, values = (both, *self.postures[1:-1], both), (costs, *self.costs[1:-1], costs)
        return replace(self, postures=postures, costs=values)

    def turned(self, steps: JointSteps) -> PathCandidates:
        """Candidates with postures whole turns away where ``steps`` distinguish these."""
        pairs = [steps.turned(Q, cost) for Q, cost in zip(self.postures, self.costs, strict=True)]
        return replace(self, postures=tuple(Q for Q, _ in pairs), costs=tuple(cost for _, cost in pairs))


def find_candidates(
    engine: Engine, targets: Sequence[TaskTarget], steps: JointSteps, scene: Scene, rng: np.random.Generator,
    pool: Workers | None = None, progress: Progress | None = None,
) -> PathCandidates:  # fmt: skip
    """Random postures of some anchors, and their local optima, followed along the path by inverse kinematics."""
    search, found = _Following(engine, tuple(targets), steps).all(rng, Serial() if pool is None else pool, progress)
    postures, costs = [], []
    for Q, target in zip(found, search.targets, strict=True):
        objective, violation = (column[:, 0] for column in engine.screen(Q, target.parameters)[:2])
        met = violation <= ROW_TOLERANCE
        met[met] = is_clear(scene, Q[met])
        # Postures that are followed from several anchors meet in one branch, to 1e-6 rad or m.
        met[met] = np.isin(np.arange(met.sum()), np.unique(np.rint(Q[met] / 1e-6), axis=0, return_index=True)[1])
        postures.append(Q[met])
        costs.append(objective[met])
    return PathCandidates(search.targets, tuple(postures), tuple(costs), tuple(map(len, found)))


@dataclass(frozen=True)
class _Following:
    """The search for candidates: anchors, and what is followed from them along the path."""

    engine: Engine
    targets: tuple[TaskTarget, ...]
    steps: JointSteps

    def all(self, rng: np.random.Generator, pool: Workers, progress: Progress | None) -> tuple[_Following, list[Array]]:
        """The search with the scale of its first postures, and the postures of each point."""
        engine, count = self.engine, len(self.targets)
        anchors = sorted({round(k) for k in np.linspace(0, count - 1, min(6, count))})
        starts = min(48 * max(engine.optimisation_problem.freedom, 1), 120)
        starts = min(starts, max(_STARTS, 12_000 // (len(anchors) * count)))
        sizes = [starts if k in anchors else _STARTS for k in range(count)]
        own = [feasible_starts(engine, target, size, rng)[0] for target, size in zip(self.targets, sizes, strict=True)]
        search = self._scaled(own)
        own = [search._restored(Q, target) for Q, target in zip(own, search.targets, strict=True)]
        found = [[self.steps.wrapped(Q)] for Q in own]
        done: dict[int, list[tuple[int, Array]]] = {}
        for part, followed in pool.run(_followed_from, search, [(k, own[k]) for k in anchors]):
            done[part] = followed
            if progress is not None:
                progress(len(done), len(anchors))
        for part in sorted(done):
            for j, Q in done[part]:
                found[j].append(Q)
        return search, [self.steps.rested(np.vstack(Q)) for Q in found]

    def from_anchor(self, k: int, Q: Array) -> Iterator[tuple[int, Array]]:
        """Points and postures (N, n) there that postures (N, n) of anchor ``k`` lead to."""
        engine = self.engine
        Q = Q[engine.clusters(Q)[0]] if len(Q) else Q
        yield from self._follow(k, Q, 0)
        if len(Q) and engine.optimisation_problem.freedom:
            optima = engine.descended(Q, self.targets[k], 30)
            order = np.lexsort((optima.objective, optima.excess))
            nearest, _ = engine.clusters(optima.q[order])
            yield from self._follow(k, optima.q[order][nearest][:24], 3)

    def _scaled(self, own: Sequence[Array]) -> _Following:
        """The search with objectives divided by the median variance of some postures (K arrays)."""
        rows = [(Q, target) for Q, target in zip(own, self.targets, strict=True) if len(Q)]
        if not rows:
            return self
        parameters = np.repeat(stacked([target for _, target in rows]), [len(Q) for Q, _ in rows], axis=0)
        variances = self.engine.screen(np.vstack([Q for Q, _ in rows]), parameters)[2][:, 0]
        scale = self.engine.scale_of(variances)
        return replace(self, targets=tuple(replace(target, scale=scale) for target in self.targets))

    def _follow(self, k: int, Q: Array, improved: int) -> Iterator[tuple[int, Array]]:
        """Postures (N, n) of point ``k`` followed to both ends of the path."""
        if not len(Q):
            return
        yield k, self.steps.wrapped(Q)
        for way in (range(k + 1, len(self.targets)), range(k - 1, -1, -1)):
            yield from self._followed(Q, way, improved)

    def _followed(self, Q: Array, way: range, improved: int) -> Iterator[tuple[int, Array]]:
        """Postures (N, n) led from point to point, with ``improved`` steps of the local search at each."""
        for j in way:
            request, target = self.engine.held(self.targets[j]), self.targets[j]
            moved, errors = self.engine.ik.solve(self.steps.wrapped(Q), request)
            Q = moved[errors < TOLERANCE]
            if not len(Q):
                return
            if improved:
                better = self.engine.descended(Q, target, improved)
                Q = np.where((better.excess == 0)[:, None], better.q, Q)
            Q = self._restored(Q, target)
            yield j, self.steps.wrapped(Q)

    def _restored(self, Q: Array, target: TaskTarget) -> Array:
        """Postures (N, n) of a target, those that break a further requirement led to where it is met."""
        problem = self.engine.optimisation_problem
        if not len(Q) or (not problem.task.subject_to and problem.scene is None):
            return Q
        broken = self.engine.screen(Q, target.parameters)[1][:, 0] > ROW_TOLERANCE
        if not np.any(broken):
            return Q
        led = self.engine.descended(Q[broken], target, 4)
        Q = Q.copy()
        Q[broken] = np.where((led.excess == 0)[:, None], led.q, Q[broken])
        return Q


def _followed_from(search: _Following, anchor: tuple[int, Array]) -> list[tuple[int, Array]]:
    return list(search.from_anchor(*anchor))
