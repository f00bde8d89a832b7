"""Targets of a map take over postures from neighbours in rounds, until none becomes better."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.numerics import Array, Codes
from posture_opt.selection.maps.map_points import MapCandidate
from posture_opt.selection.maps.map_trials import BEND, NeighbourStarts, Trial, take_over, try_all, try_around
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.workers import Part, Workers

Pairs = tuple[Codes, Codes]
"""Targets, and as many others whose postures are tried there."""


@dataclass(frozen=True, eq=False)
class Line:
    """Targets in a line with two others, which predict a value of theirs."""

    at: Codes  # (N,) targets; first and second (N,) two others each in one line with them
    first: Codes
    second: Codes
    share: float  # of the first in what both let expect: one half interpolates, two extrapolates


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """Motion of the whole arm by joint 1: about, or along, a line that is fixed in the world."""

    axis: Array  # (3,) unit vector, world. frame: (3, 2) two unit vectors across it. point: (3,) on it [m]
    frame: Array
    point: Array
    slides: bool  # whether joint 1 is prismatic
    lower: float  # lower, upper: its limits [rad or m]
    upper: float

    @classmethod
    def of(cls, arm: Arm) -> BaseMotion:
        """Read off the Jacobian of joint 1, in which nothing before it moves."""
        joint = arm.robot.joints[0]
        q = (np.array(arm.robot.lower) + np.array(arm.robot.upper)) / 2
        position, (v, w) = np.asarray(arm.position(q), dtype=float), np.split(np.asarray(arm.jacobian(q))[:, 0], 2)
        slides = joint.type == "prismatic"
        axis = v / np.linalg.norm(v) if slides else w / np.linalg.norm(w)
        across = np.eye(3)[np.argmin(np.abs(axis))]
        e1 = across - axis * (axis @ across)
        e1 = e1 / np.linalg.norm(e1)
        # v = ω x (p - c), so that c = p + ω x v lies on the axis.
        point = position if slides else position + np.cross(w, v) / (w @ w)
        frame = np.column_stack([e1, np.cross(axis, e1)])
        return cls(axis, frame, point, slides, float(joint.lower), float(joint.upper))

    def keeps(self, direction: Array) -> bool:
        """Whether a direction (3,) stays."""
        return self.slides or float(np.linalg.norm(np.cross(self.axis, direction))) < 1e-6  # rad

    def split(self, points: Array) -> tuple[Array, Array]:
        """(N, 2) radius and height of points (N, 3), or both offsets [m], and (N,) the amount of motion [rad or m]."""
        r = points - self.point
        along, across = r @ self.axis, r @ self.frame
        if self.slides:
            return across, along
        return np.column_stack([np.linalg.norm(across, axis=1), along]), np.arctan2(across[:, 1], across[:, 0])

    def moved(self, Q: Array, shift: Array) -> Array:
        """Postures (N, n), joint 1 moved by ``shift`` (N,) [rad or m], whole turns aside, at most to its limit."""
        turn = 0.0 if self.slides else 2 * np.pi
        values = (Q[:, 0] + shift)[:, None] + turn * np.array([0.0, -1.0, 1.0])
        within = np.clip(values, self.lower, self.upper)
        nearest = np.argmin(np.abs(values - within), axis=1)
        return np.column_stack([within[np.arange(len(Q)), nearest], Q[:, 1:]])


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """Which targets try each other's postures."""

    motion: BaseMotion  # of joint 1
    kept: Array  # (N, 2 or 3) the coordinates of each target that this motion does not change [m]
    amount: Array  # (N,) of the motion to each target [rad or m]; zeros where the task differs along it
    on_grid: tuple[Pairs, ...]  # pairs of neighbours on the grid
    turned: tuple[Pairs, ...]  # pairs of targets that joint 1 moves onto each other, or near to
    lines: tuple[Line, ...]  # targets in a row, for outliers

    @classmethod
    def of(cls, arm: Arm, direction: Array, points: Array, on_grid: Sequence[Pairs]) -> Neighbourhood:
        """Neighbourhood of points (N, 3) [m], direction (3,) in the world; ``on_grid`` pairs both ways in turn."""
        lines = tuple(line for here, there in on_grid[::2] for line in _lines(len(points), here, there))
        motion = BaseMotion.of(arm)
        kept, amount = motion.split(points)
        if not motion.keeps(direction):
            return cls(motion, points, np.zeros(len(points)), tuple(on_grid), (), lines)
        turned = [pair for here, there in _nearest(kept) for pair in ((here, there), (there, here))]
        return cls(motion, kept, amount, tuple(on_grid), tuple(turned), lines)

    @property
    def pairs(self) -> tuple[Pairs, ...]:
        return *self.on_grid, *self.turned

    def distance(self, there: int, here: int) -> float:
        """Distance that inverse kinematics leads a posture from one target to another [m]."""
        return float(np.linalg.norm(self.kept[here] - self.kept[there]))

    def carried(self, Q: Array, there: Codes, here: Codes) -> Array:
        """Postures (N, n) of targets ``there``, joint 1 moved so that the arm faces the targets ``here``."""
        return self.motion.moved(Q, self.amount[here] - self.amount[there])

    def excess(self, values: Array) -> Array:
        """(N,) largest share of each value above what lines of targets predict; −inf without a line."""
        worst = np.full(len(values), -np.inf)
        for line in self.lines:
            expected = line.share * values[line.first] + (1 - line.share) * values[line.second]
            above = (values[line.at] - expected) / np.maximum(np.abs(expected), np.finfo(float).tiny)
            worst[line.at] = np.fmax(worst[line.at], above)
        return worst


def _lines(count: int, here: Codes, there: Codes) -> list[Line]:
    ahead, behind = np.full(count, -1), np.full(count, -1)
    ahead[here], behind[there] = there, here
    at = np.flatnonzero((ahead >= 0) & (behind >= 0))
    lines = [Line(at, ahead[at], behind[at], 0.5)]
    for step in (ahead, behind):
        at = np.flatnonzero(step >= 0)
        at = at[step[step[at]] >= 0]
        lines.append(Line(at, step[at], step[step[at]], 2.0))
    return lines


def _nearest(kept: Array) -> list[Pairs]:
    """Targets that follow each other at one height by radius, in ``kept`` (N, 2)."""
    slack = 1e-9 + 1e-6 * float(np.max(np.abs(kept)))
    height = np.round(kept[:, 1] / slack)
    order = np.lexsort((np.round(kept[:, 0] / slack), height))
    pairs = []
    for step in (1, 2):  # places away in the order by radius
        here, there = order[:-step], order[step:]
        level = height[here] == height[there]
        pairs.append((here[level], there[level]))
    return pairs


CHUNK = 32
"""Targets of a part, about a tenth of a second; part of the answer, so that this does not depend on who works."""
T = TypeVar("T")
R = TypeVar("R")
Starts = dict[int, list[tuple[int, Array]]]
"""Target -> neighbours with their postures, joint 1 moved."""


@dataclass(frozen=True)
class Items(Sequence[Sequence[T]], Generic[T]):
    """Items of chunks of targets, made when they are sent: a map never holds all of them at once."""

    chunks: Sequence[Sequence[int]]
    item: Callable[[int], T]

    def __len__(self) -> int:
        return len(self.chunks)

    def __getitem__(self, k: Any) -> Any:
        return [self.item(target) for target in self.chunks[k]]


def worked_on(
    workers: Workers, part: Part[Engine, Sequence[T], Sequence[R]], engines: Sequence[Engine],
    indices: Iterable[int], item: Callable[[int], T],
) -> Iterator[tuple[int, R]]:  # fmt: skip
    """Targets with their rows of ``part(engine, [item, …])``, chunk by chunk of one engine, as they are done."""
    shares: dict[int, list[int]] = {}
    for k in indices:
        shares.setdefault(id(engines[k]), []).append(k)
    for mine in shares.values():
        chunks = [mine[i : i + CHUNK] for i in range(0, len(mine), CHUNK)]
        for k, rows in workers.run(part, engines[mine[0]], Items(chunks, item)):
            yield from zip(chunks[k], rows, strict=True)


@dataclass(frozen=True)
class NeighbourExchange:
    """Targets with the engines that solve them; ``candidates`` are replaced in place."""

    engines: Sequence[Engine]  # N, one for each of targets; many share one
    targets: Sequence[TaskTarget]
    neighbourhood: Neighbourhood
    workers: Workers  # who works on the chunks; the answer does not depend on it
    seed: int  # of perturbed starts, together with round and target
    candidates: list[MapCandidate]  # N, the best known
    tried: dict[int, list[Array]] = field(default_factory=dict)  # neighbours' postures that the solver began with
    lost: dict[int, list[Array]] = field(default_factory=dict)  # those of them that ended at a worse optimum
    bends: list[float] = field(default_factory=list)  # what carried postures fell short, over the squared distance

    def spread(self, fresh: set[int]) -> None:
        """Exchange postures, ``fresh`` ones first, until no target becomes better."""
        rounds = 0
        while fresh:
            learnt = [self._learn(fresh, pairs) for pairs in (self.neighbourhood.on_grid, self.neighbourhood.turned)]
            fresh = set().union(*learnt) | self._try_around(fresh, rounds)
            rounds += 1

    def excess(self) -> Array:
        """(N,) share of each objective above the neighbours' prediction; −inf without one."""
        best = [(c.best.objective * c.scale) if c.best is not None else math.nan for c in self.candidates]
        return self.neighbourhood.excess(np.array(best))

    def _learn(self, fresh: set[int], pairs: Sequence[Pairs]) -> set[int]:
        """Targets that became better by the postures of ``fresh`` neighbours."""
        starts = self._starts(fresh, pairs, others=True)
        # In a random order, so that what falls short is soon seen all over the map.
        order, first = np.random.default_rng(0).permutation(list(starts)).tolist(), 8 * CHUNK
        return self._try_all(order[:first], starts) | self._try_all(order[first:], starts)

    def _try_all(self, indices: Sequence[int], starts: Starts) -> set[int]:
        # Twice the largest of 60 bounds what a posture falls short.
        bend = min(BEND, 2 * max(self.bends)) if len(self.bends) >= 60 else BEND

        def item(k: int) -> NeighbourStarts:
            return self._beside(k, starts[k], tried=self.tried.get(k, ()), bend=bend)

        better = set()
        for k, row in worked_on(self.workers, try_all, self.engines, indices, item):
            trial = Trial.unpacked(row)
            self.candidates[k] = trial.candidate
            if trial.tried:
                self.tried[k] = trial.tried
            if trial.lost:
                self.lost.setdefault(k, []).extend(trial.lost)
            self.bends.extend(trial.bends)
            better |= {k} if trial.better else set()
        return better

    def _try_around(self, fresh: set[int], rounds: int) -> set[int]:
        """Targets without a posture that have one now, sought about those of ``fresh`` neighbours."""
        starts = self._starts(fresh, self.neighbourhood.pairs, empty=True)

        def item(k: int) -> NeighbourStarts:
            return self._beside(k, starts[k], seed=(self.seed, rounds, k))

        found = set()
        for k, row in worked_on(self.workers, try_around, self.engines, list(starts), item):
            self.candidates[k] = MapCandidate.unpacked(row)
            found |= {k} if self.candidates[k].best is not None else set()
        return found

    def agree(self) -> None:
        """Take neighbours' postures that are as good, from the best target outwards, breadth first."""
        known = {k: candidate.best for k, candidate in enumerate(self.candidates) if candidate.best is not None}
        followers: dict[int, list[int]] = {}
        for here, there in self.neighbourhood.on_grid:
            for k, j in zip(here.tolist(), there.tolist(), strict=True):
                if k in known and j in known and self.engines[j] is self.engines[k]:
                    followers.setdefault(j, []).append(k)
        while known:
            front = [min(known, key=lambda k: known[k].sigma)]
            while front:
                for k in front:
                    known.pop(k, None)
                pairs = {k: j for j in front for k in followers.get(j, []) if k in known}
                self._take_over(pairs)
                front = list(pairs)

    def _take_over(self, pairs: dict[int, int]) -> None:
        starts: Starts = {}
        if pairs:
            self._add_moved(
                starts, self._postures(), np.array(list(pairs)), np.array(list(pairs.values())), others=True
            )

        def item(k: int) -> NeighbourStarts:
            return self._beside(k, starts[k], tried=self.lost.get(k, ()))

        for k, row in worked_on(self.workers, take_over, self.engines, list(starts), item):
            self.candidates[k] = MapCandidate.unpacked(row)

    def _postures(self) -> Array:
        """(N, n) best known [rad or m]; NaN without one."""
        nothing = np.full(self.engines[0].robot.n, np.nan)
        return np.array([nothing if one.best is None else one.best.q for one in self.candidates])

    def _starts(self, fresh: set[int], pairs: Sequence[Pairs], *, others: bool = False, empty: bool = False) -> Starts:
        """Neighbours among ``fresh`` and their postures; ``others`` that differ, ``empty`` targets alone."""
        new = np.array([k in fresh and one.best is not None for k, one in enumerate(self.candidates)])
        Q, engine = self._postures(), np.array([id(one) for one in self.engines])
        starts: Starts = {}
        for here, there in pairs:
            chosen = new[there] & (engine[here] == engine[there])
            if empty:
                chosen &= np.isnan(Q[here, 0])
            if chosen.any():
                self._add_moved(starts, Q, here[chosen], there[chosen], others=others)
        return starts

    def _add_moved(self, starts: Starts, Q: Array, here: Codes, there: Codes, *, others: bool) -> None:
        """Add postures Q[there], joint 1 moved; ``others``: only those 0.1 rad or m away, that may end elsewhere."""
        moved = self.neighbourhood.carried(Q[there], there, here)
        near = np.max(np.abs(Q[here] - moved), axis=1, initial=0.0) < 0.1 if others else np.zeros(len(here), dtype=bool)
        for k, j, q in zip(here[~near].tolist(), there[~near].tolist(), moved[~near], strict=True):
            starts.setdefault(k, []).append((j, q))

    def _beside(self, k: int, starts: Sequence[tuple[int, Array]], **more: Any) -> NeighbourStarts:
        reach = self.engines[k].optimisation_problem.reach.radius
        squares = [(self.neighbourhood.distance(j, k) / reach) ** 2 for j, _ in starts]
        return NeighbourStarts(self.targets[k], self.candidates[k], np.array([q for _, q in starts]), squares, **more)
