"""The best postures of many targets at once: random starts for all of them in batches, then what neighbours know.

Targets that lie side by side mostly have the same best branch of the inverse kinematics. So the posture of a neighbour
is a start for each target: a better posture spreads over the map, a missing one is found beside a known one, and of
equally good ones all targets take the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.numerics import Array, Codes, Progress
from posture_opt.selection.engine import CandidatePosture, Engine, Recipe
from posture_opt.selection.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.map_points import MapCandidate
from posture_opt.selection.multistart import distinct, rank
from posture_opt.selection.task_target import TaskTarget

Pairs = Sequence[tuple[Codes, Codes]]
"""Targets, and as many others whose postures are tried there."""

_CHUNK = 32  # targets that are sought together
_ROUNDS = 4  # of learning from neighbours
_STARTS = (48, 144)  # of a target, the second number where the first met no requirement
_POLISHED = 4  # of a target where no start meets the further requirements
_AROUND = 24  # starts about each neighbour's posture, for a target without one
_STRAY = 0.2  # rad, or of a slide's stroke: how far from it
_BETTER = 1e-4  # of the objective: what a neighbour's posture must promise, and what is no difference
_NEAR = 0.05  # of the objective: how far a neighbour's posture may lie above the optimum that it leads to


def best_candidates(
    engines: Sequence[Engine],
    targets: Sequence[TaskTarget],
    neighbours: Pairs,
    *,
    seed: int,
    workers: int = 1,
    progress: Progress | None = None,
) -> list[MapCandidate]:
    """The best candidate of every target (N of them, points), each with the engine that solves it.

    Args:
        neighbours: pairs of index arrays: the postures of the second are tried at the first.
        seed: of the random starts; the answer does not depend on ``workers``.
    """
    chunks = [
        mine[i : i + _CHUNK]
        for _, mine in _by_engine(engines, range(len(engines)))
        for i in range(0, len(mine), _CHUNK)
    ]
    found: dict[int, MapCandidate] = {}
    for indices, candidates in _explored(chunks, engines, targets, seed, workers):
        found |= dict(zip(indices, candidates, strict=True))
        if progress is not None:
            progress(len(found), len(targets))
    exchange = _NeighbourExchange(engines, targets, neighbours, [found[k] for k in range(len(targets))])
    rng = np.random.default_rng(seed)
    for _ in range(_ROUNDS):
        learnt = exchange.learn()
        # Both, whatever the first one says.
        if not exchange.try_around(rng) and not learnt:
            break
    exchange.agree()
    return exchange.candidates


def _by_engine(engines: Sequence[Engine], indices: Iterable[int]) -> list[tuple[Engine, list[int]]]:
    """Each engine with those of some targets that it serves."""
    shares: dict[int, list[int]] = {}
    for k in indices:
        shares.setdefault(id(engines[k]), []).append(k)
    return [(engines[mine[0]], mine) for mine in shares.values()]


def _explored(
    chunks: Sequence[list[int]], engines: Sequence[Engine], targets: Sequence[TaskTarget], seed: int, workers: int
) -> Iterable[tuple[list[int], list[MapCandidate]]]:
    if workers == 1 or len(chunks) == 1:
        for chunk in chunks:
            yield chunk, _explore(engines[chunk[0]], [targets[k] for k in chunk], chunk, seed)
        return
    with ProcessPoolExecutor(workers) as pool:
        recipes = [engines[chunk[0]].recipe for chunk in chunks]
        shares = [[targets[k] for k in chunk] for chunk in chunks]
        yield from zip(chunks, pool.map(_explore_there, recipes, shares, chunks, [seed] * len(chunks)), strict=True)


def _explore_there(
    recipe: Recipe, targets: Sequence[TaskTarget], indices: Sequence[int], seed: int
) -> list[MapCandidate]:
    return _explore(Engine.build(recipe), targets, indices, seed)


def _explore(engine: Engine, targets: Sequence[TaskTarget], indices: Sequence[int], seed: int) -> list[MapCandidate]:
    """The candidates of some targets by random starts; ``indices`` seed them, each target by its own."""
    candidates = [MapCandidate("not reached", None, math.nan)] * len(targets)
    for round_, starts in enumerate(_STARTS):
        open_ = [k for k, candidate in enumerate(candidates) if candidate.best is None]
        open_ = [k for k in open_ if not _out_of_plane(engine, targets[k])]
        if not open_:
            break
        rngs = [np.random.default_rng([seed, round_, indices[k]]) for k in open_]
        Q = [engine.ik.random_postures(starts, rng) for rng in rngs]
        requests = [engine.request(targets[k], starts, rng) for k, rng in zip(open_, rngs, strict=True)]
        for k, reached in zip(open_, engine.ik.reached(Q, requests), strict=True):
            if len(reached):
                candidates[k] = _best_among(engine, targets[k], reached)
    return candidates


def _out_of_plane(engine: Engine, target: TaskTarget) -> bool:
    return engine.optimisation_problem.reach.misses(target.lower, target.upper)


def _best_among(engine: Engine, target: TaskTarget, Q: Array) -> MapCandidate:
    """The best candidate among postures (M, n) that reach the target."""
    _, violation, own, _ = (column[:, 0] for column in engine.screen(Q, target.parameters()))
    scale = engine.scale_of(own)
    target = replace(target, scale=scale)
    postures = engine.candidates(Q, target)
    if np.any(violation <= ROW_TOLERANCE):
        chosen = [min((c for c in postures if c.feasible), key=rank)]
    else:
        chosen = [postures[k] for k in np.argsort(violation, kind="stable")[:_POLISHED]]
    best = min((engine.polished(posture, target) for posture in chosen), key=rank)
    return MapCandidate("feasible", best, scale) if best.feasible else MapCandidate("requirement not met", None, scale)


@dataclass(frozen=True)
class _NeighbourExchange:
    """Targets that take over postures from each other; ``candidates`` are the best ones known, replaced in place."""

    engines: Sequence[Engine]
    targets: Sequence[TaskTarget]
    neighbours: Pairs
    candidates: list[MapCandidate]

    def learn(self) -> bool:
        """Try the postures of neighbours; whether any candidate became better."""
        better: dict[int, CandidatePosture] = {}
        for here, there in self.neighbours:
            known = ((k, self.candidates[j].best) for k, j in self._pairs(here, there))
            for k, posture in self._carried_over({k: best.q for k, best in known if best is not None}):
                own = self.candidates[k].best
                promising = own is None or _gain(posture, own) > _BETTER
                if promising and (k not in better or rank(posture) < rank(better[k])):
                    better[k] = posture
        improved = [self._improve(k, posture) for k, posture in better.items()]
        return any(improved)

    def try_around(self, rng: np.random.Generator) -> bool:
        """Look for postures of targets without one about those of their neighbours; whether there are any."""
        starts: dict[int, list[Array]] = {}
        for here, there in self.neighbours:
            for k, j in self._pairs(here, there):
                best = self.candidates[j].best
                if self.candidates[k].best is None and best is not None:
                    starts.setdefault(k, []).append(_about(self.engines[k], best.q, rng))
        found = False
        for engine, indices in _by_engine(self.engines, starts):
            mine = [k for k in indices if not _out_of_plane(engine, self.targets[k])]
            if not mine:
                continue
            Q = [np.vstack(starts[k]) for k in mine]
            requests = [engine.request(self.targets[k], len(q), rng) for k, q in zip(mine, Q, strict=True)]
            for k, reached in zip(mine, engine.ik.reached(Q, requests), strict=True):
                if len(reached):
                    self.candidates[k] = _best_among(engine, self.targets[k], reached)
                    found |= self.candidates[k].best is not None
        return found

    def agree(self) -> None:
        """Of equally good postures take the one of the neighbour: a map is read more easily, and an arm moves less.

        From the best candidate outwards, each target once.
        """
        beside: dict[int, list[int]] = {}
        for here, there in self.neighbours:
            for k, j in self._pairs(here, there):
                beside.setdefault(j, []).append(k)
        known = {k: candidate.best for k, candidate in enumerate(self.candidates) if candidate.best is not None}
        while known:
            front = [min(known, key=lambda k: known[k].sigma)]
            while front:
                for k in front:
                    known.pop(k, None)
                pairs = {k: j for j in front for k in beside.get(j, []) if k in known}
                self._take_over(pairs)
                front = list(pairs)

    def _pairs(self, here: Codes, there: Codes) -> Iterable[tuple[int, int]]:
        """Those of the pairs whose targets are solved by the same engine."""
        pairs = zip(here.tolist(), there.tolist(), strict=True)
        return ((k, j) for k, j in pairs if self.engines[j] is self.engines[k])

    def _carried_over(self, postures: dict[int, Array]) -> Iterable[tuple[int, CandidatePosture]]:
        """Postures (n,) moved onto target k, where they meet what is required if anything does."""
        for engine, mine in _by_engine(self.engines, postures):
            rng = np.random.default_rng(0)
            requests = [engine.request(self.targets[k], 1, rng) for k in mine]
            reached = dict(zip(mine, engine.ik.reached([postures[k][None] for k in mine], requests), strict=True))
            arrived = [k for k in mine if len(reached[k])]
            if not arrived:
                continue
            parameters = [replace(self.targets[k], scale=self._known_scale(k)).parameters() for k in arrived]
            moved = engine.screened(np.vstack([reached[k] for k in arrived]), np.array(parameters))
            for k, posture in zip(arrived, moved, strict=True):
                if self.candidates[k].best is None or posture.feasible:
                    yield k, posture

    def _known_scale(self, k: int) -> float:
        scale = self.candidates[k].scale
        return 1.0 if math.isnan(scale) else scale

    def _improve(self, k: int, posture: CandidatePosture) -> bool:
        engine, target = self.engines[k], self.targets[k]
        known, scale = self.candidates[k].best, self.candidates[k].scale
        if math.isnan(scale):  # no start had reached this target
            scale = engine.scale_of(np.asarray(engine.screen(posture.q[None], target.parameters())[2][:, 0]))
            posture = engine.candidates(posture.q[None], replace(target, scale=scale))[0]
        end = engine.polished(posture, replace(target, scale=scale))
        if not end.feasible or (known is not None and end.objective >= known.objective):
            return False
        self.candidates[k] = MapCandidate("feasible", end, scale)
        return True

    def _take_over(self, pairs: dict[int, int]) -> None:
        """At each first target the posture of the second one, where it is another one and as good."""
        known = ((k, self.candidates[j].best) for k, j in pairs.items())
        postures = {k: best.q for k, best in known if best is not None}
        for k, posture in self._carried_over(postures):
            engine, own = self.engines[k], self.candidates[k].best
            assert own is not None
            alike = len(distinct(np.array([own.q, posture.q]), engine.robot)) == 1
            if alike or _gain(posture, own) < -_NEAR:
                continue
            end = engine.polished(posture, replace(self.targets[k], scale=self.candidates[k].scale))
            if end.feasible and (end.optimal or not own.optimal) and _gain(end, own) > -_BETTER:
                self.candidates[k] = MapCandidate("feasible", end, self.candidates[k].scale)


def _about(engine: Engine, q: Array, rng: np.random.Generator) -> Array:
    """(M, n) postures within the limits about one (n,)."""
    robot = engine.robot
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    stray = _STRAY * np.where(slides, upper - lower, 1.0)
    return np.asarray(np.clip(q + stray * rng.normal(size=(_AROUND, len(q))), lower, upper))


def _gain(posture: CandidatePosture, known: CandidatePosture) -> float:
    """By what share of the objective a posture is better."""
    return (known.objective - posture.objective) / max(abs(known.objective), 1e-9)
