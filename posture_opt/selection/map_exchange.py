"""``NeighbourExchange``: targets of a map that take over postures from each other until none becomes better.

The best posture jumps from one branch to another somewhere between two neighbours. So wherever a neighbour's posture,
led here by inverse kinematics, is another one than that of the target, the solver decides between both: a branch that
random starts missed spreads over all targets where it is the best one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, islice

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.engine import CandidatePosture, Engine
from posture_opt.selection.map_neighbours import Neighbourhood, Pairs
from posture_opt.selection.map_points import MapCandidate
from posture_opt.selection.map_starts import best_among, better_of, by_engine, freedom, is_near, out_of_plane
from posture_opt.selection.multistart import distinct, rank
from posture_opt.selection.pose_request import PoseRequest
from posture_opt.selection.task_target import TaskTarget

BETTER = 1e-4
"""Of the objective: what is no difference."""

_CHUNK = 256  # targets whose postures are led at once
_AROUND = 24  # starts about each neighbour's posture, for a target without one
_STRAY = 0.2  # rad, or of a slide's stroke: how far from it
_WORTH = 0.25  # of the objective: a neighbour's posture that lies so far above the best one known is not polished
_BEND = 40.0  # of the objective, over (distance / reach)²: what a posture led so far falls short of its optimum,
_SEEN = 60  # until so many were polished; then at most twice the largest that was seen
_NEAR = 0.05  # of the objective: the same, where it can be no more than equally good
_TURNED = 1e-4  # (distance / reach)²: below it a posture was turned rather than led
_OTHERS = 1  # polished of a target in all that do not promise to be better as they are
_SAME = 0.1  # rad or m: a start so near to an optimum leads to it
_MOST = 4  # polished of a target at once


@dataclass(frozen=True)
class LedPosture:
    """A neighbour's posture led here, and the square of how far, as a part of the reach."""

    posture: CandidatePosture
    square: float


@dataclass(frozen=True)
class NeighbourExchange:
    """Targets with the engines that solve them; ``candidates`` are the best ones known, replaced in place.

    ``tried`` holds the postures of neighbours that the solver began with at each target, ``lost`` those of them that
    ended at a worse optimum.
    """

    engines: Sequence[Engine]
    targets: Sequence[TaskTarget]
    neighbourhood: Neighbourhood
    candidates: list[MapCandidate]
    tried: dict[int, list[Array]] = field(default_factory=dict)
    lost: dict[int, list[Array]] = field(default_factory=dict)
    bends: list[float] = field(default_factory=list)
    requests: dict[int, PoseRequest] = field(default_factory=dict)

    def spread(self, fresh: set[int], rng: np.random.Generator) -> None:
        """Exchange postures, those of ``fresh`` targets first, until no target becomes better."""
        while fresh:
            learnt = [self._learn(fresh, pairs) for pairs in (self.neighbourhood.on_grid, self.neighbourhood.turned)]
            fresh = set().union(*learnt) | self._try_around(fresh, rng)

    def excess(self) -> Array:
        """(N,) by what share the objective of each target lies above what its neighbours let expect; −inf for none."""
        best = [(c.best.objective * c.scale) if c.best is not None else math.nan for c in self.candidates]
        return self.neighbourhood.excess(np.array(best))

    def keep_better(self, k: int, candidate: MapCandidate) -> bool:
        """Take over what another search found for target k; whether it is better than what was known."""
        before = self.candidates[k]
        self.candidates[k] = better_of(self.engines[k], self.targets[k], before, candidate)
        after = self.candidates[k].best
        return after is not None and (before.best is None or _gain(after, before.best) > BETTER)

    def _learn(self, fresh: set[int], pairs: Sequence[Pairs]) -> set[int]:
        """Try the postures of ``fresh`` neighbours; the targets that became better."""
        led: dict[int, list[LedPosture]] = {}
        for pair in pairs:
            starts = {k: (j, q) for k, j, q in self._known(fresh, pair) if not self._same(k, q)}
            for k, posture in self._carried_over({k: q for k, (_, q) in starts.items()}):
                led.setdefault(k, []).append(LedPosture(posture, self._square(starts[k][0], k)))
        # In a random order, so that what falls short is soon seen all over the map.
        order = np.random.default_rng(0).permutation(list(led)).tolist()
        return {k for k in order if self._try_all(k, led[k])}

    def _try_all(self, k: int, postures: Sequence[LedPosture]) -> bool:
        """Polish those postures that may become the best one of target k, best first; whether it became better."""
        better = False
        for led in islice(self._worth_trying(k, sorted(postures, key=lambda led: rank(led.posture))), _MOST):
            own = self.candidates[k].best
            gain = self._try(k, led.posture)
            if own is not None and math.isfinite(gain):
                self.bends.append((gain - _gain(led.posture, own)) / max(led.square, _TURNED))
            better |= gain > BETTER
        return better

    def _worth_trying(self, k: int, postures: Sequence[LedPosture]) -> Iterable[LedPosture]:
        """They are decided one by one, as better ones are found."""
        for led in postures:
            own, posture = self.candidates[k].best, led.posture
            if own is None:
                yield led
                continue
            gain = _gain(posture, own)
            short = min(self._bend(k) * led.square, _WORTH)
            tried = self.tried.get(k, [])
            other = gain + short > BETTER and len(tried) < _OTHERS
            other = other and not is_near(self.engines[k], posture.q, [own.q, *tried])
            if posture.feasible and (gain > BETTER or other):
                yield led

    def _bend(self, k: int) -> float:
        if freedom(self.engines[k], self.targets[k]) <= 0:
            return 0.0
        return min(_BEND, 2 * max(self.bends)) if len(self.bends) >= _SEEN else _BEND

    def _square(self, there: int, here: int) -> float:
        """Of the distance that a posture is led over, as a part of the reach."""
        reach = self.engines[here].optimisation_problem.reach.radius
        return (self.neighbourhood.distance(there, here) / reach) ** 2

    def _try(self, k: int, posture: CandidatePosture) -> float:
        """Polish a posture at target k and keep it where it is better; what that gains, as a share."""
        engine, target = self.engines[k], self.targets[k]
        known, scale = self.candidates[k].best, self.candidates[k].scale
        if math.isnan(scale):  # no start had reached this target
            scale = engine.scale_of(np.asarray(engine.screen(posture.q[None], target.parameters)[2][:, 0]))
            posture = engine.candidates(posture.q[None], replace(target, scale=scale))[0]
        self.tried.setdefault(k, []).append(posture.q)
        end = engine.polished(posture, replace(target, scale=scale))
        gain = -math.inf if not end.feasible else math.inf if known is None else _gain(end, known)
        if gain < -BETTER:
            self.lost.setdefault(k, []).append(posture.q)
        if gain > 0:
            self.candidates[k] = MapCandidate("feasible", end, scale)
        return gain

    def _try_around(self, fresh: set[int], rng: np.random.Generator) -> set[int]:
        """Look for postures of targets without one about those of ``fresh`` neighbours; those that have one now."""
        starts: dict[int, list[Array]] = {}
        for k, _, q in chain.from_iterable(self._known(fresh, pair) for pair in self.neighbourhood.pairs):
            if self.candidates[k].best is None:
                starts.setdefault(k, []).append(_about(self.engines[k], q, rng))
        found = set()
        for engine, indices in by_engine(self.engines, starts):
            mine = [k for k in indices if not out_of_plane(engine, self.targets[k])]
            if not mine:
                continue
            Q = [np.vstack(starts[k]) for k in mine]
            requests = [engine.request(self.targets[k], len(q), rng) for k, q in zip(mine, Q, strict=True)]
            for k, reached in zip(mine, engine.ik.reached(Q, requests), strict=True):
                if len(reached):
                    self.candidates[k] = best_among(engine, self.targets[k], reached)
                    found |= {k} if self.candidates[k].best is not None else set()
        return found

    def agree(self) -> None:
        """Of equally good postures take the one of the neighbour: a map is read more easily, and an arm moves less.

        From the best candidate outwards, each target once.
        """
        known = {k: candidate.best for k, candidate in enumerate(self.candidates) if candidate.best is not None}
        beside: dict[int, list[int]] = {}
        for k, j, _ in chain.from_iterable(self._known(set(known), pair) for pair in self.neighbourhood.on_grid):
            beside.setdefault(j, []).append(k)
        while known:
            front = [min(known, key=lambda k: known[k].sigma)]
            while front:
                for k in front:
                    known.pop(k, None)
                pairs = {k: j for j in front for k in beside.get(j, []) if k in known}
                self._take_over(pairs)
                front = list(pairs)

    def _take_over(self, pairs: dict[int, int]) -> None:
        """At each first target the posture of the second one, where it is another one and as good."""
        pair = np.array(list(pairs)), np.array(list(pairs.values()))
        postures = {k: q for k, _, q in self._known(set(pairs.values()), pair)} if pairs else {}
        for k, posture in self._carried_over(postures):
            engine, own = self.engines[k], self.candidates[k].best
            assert own is not None
            alike = len(distinct(np.array([own.q, posture.q]), engine.robot)) == 1
            if alike or _gain(posture, own) < -_NEAR or is_near(engine, posture.q, self.lost.get(k, [])):
                continue
            end = engine.polished(posture, replace(self.targets[k], scale=self.candidates[k].scale))
            if end.feasible and (end.optimal or not own.optimal) and _gain(end, own) > -BETTER:
                self.candidates[k] = MapCandidate("feasible", end, self.candidates[k].scale)

    def _known(self, fresh: set[int], pair: Pairs) -> Iterable[tuple[int, int, Array]]:
        """Target, neighbour, and the neighbour's posture with joint 1 moved: those that one engine solves."""
        both = zip(pair[0].tolist(), pair[1].tolist(), strict=True)
        chosen = [(k, j) for k, j in both if j in fresh and self.engines[j] is self.engines[k]]
        known = [(k, j, best.q) for k, j in chosen if (best := self.candidates[j].best) is not None]
        if known:
            here, there = (np.array([row[side] for row in known]) for side in (0, 1))
            moved = self.neighbourhood.carried(np.array([q for _, _, q in known]), there, here)
            yield from zip(here.tolist(), there.tolist(), moved, strict=True)

    def _same(self, k: int, q: Array) -> bool:
        """Whether a posture can lead to nothing but the one that target k has."""
        own = self.candidates[k].best
        return own is not None and float(np.max(np.abs(own.q - q))) < _SAME

    def _carried_over(self, starts: dict[int, Array]) -> Iterable[tuple[int, CandidatePosture]]:
        """Postures (n,) moved onto target k, where they arrive: where a tilt is allowed, with and without their own."""
        for engine, indices in by_engine(self.engines, starts):
            for i in range(0, len(indices), _CHUNK):
                mine = indices[i : i + _CHUNK]
                requests = [self._request(k) for k in mine]
                Q = [np.tile(starts[k], (1 + (self.targets[k].tilt > 0), 1)) for k in mine]
                arrived = zip(mine, engine.ik.reached(Q, requests), strict=True)
                rows = [(k, q) for k, led in arrived for q in led]
                if rows:
                    parameters = [replace(self.targets[k], scale=self._known_scale(k)).parameters for k, _ in rows]
                    moved = engine.screened(np.array([q for _, q in rows]), np.array(parameters))
                    yield from zip([k for k, _ in rows], moved, strict=True)

    def _request(self, k: int) -> PoseRequest:
        if k not in self.requests:
            count = 1 + (self.targets[k].tilt > 0)
            self.requests[k] = self.engines[k].request(self.targets[k], count, np.random.default_rng(0))
        return self.requests[k]

    def _known_scale(self, k: int) -> float:
        scale = self.candidates[k].scale
        return 1.0 if math.isnan(scale) else scale


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
