"""``Scene``: an arm with its shape and what is around it; how near they come to each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from posture_opt.collision.cell import CellSpec
from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.pairs import (
    Pair,
    exposed,
    obstacle_distances,
    own_distances,
    own_pairs,
    random_postures,
)
from posture_opt.collision.placed_capsules import Placed, PlacedCapsules
from posture_opt.collision.smooth_bounds import segment_bound, soft_minimum
from posture_opt.numerics import Array, Json
from posture_opt.robot.link_capsules import stand_in, tool_line
from posture_opt.robot.robot import Robot

SELF_CLEARANCE_ROW = "clearance of the arm to itself"
"""Name of the row that keeps links apart."""
SEPARATION_M = 0.1
"""Distance beyond the margin [m]: pairs that keep so far apart need no row."""
_POSTURE_COUNT = 4000
"""Random postures by which pairs are found to keep apart."""
_ROW_TOLERANCE_M = 2e-6
"""Taken off each row [m]: more than a solver may leave of a row that counts as met."""


def row_name(obstacle: str) -> str:
    """Name of the row that keeps the arm away from an obstacle."""
    return f"clearance to {obstacle}"


class Clearance(NamedTuple):
    """The least distance and where it is.

    Args:
        distance: [m]; zero or less where bodies overlap, but not how deep.
        between: two joints, or a joint and an obstacle.
    """

    distance: float
    between: tuple[str, str]

    def to_json(self) -> dict[str, Json]:
        """The key ``clearance`` of a document."""
        return {"distance": self.distance, "between": list(self.between)}


class ClearanceRow(NamedTuple):
    """A smooth lower bound of the least distance of one group of pairs.

    Args:
        name: what it keeps apart.
        bound: scalar expression of the joint values [m].
    """

    name: str
    bound: ca.SX


@dataclass(frozen=True)
class Scene:
    """What is checked for collisions.

    Args:
        placed: the capsules of the arm.
        obstacles: in the world.
        margin: least distance to keep [m].
        own: pairs of capsules that are checked against each other.
        against: for each obstacle the capsules that are checked against it.
        assumed: whether the shape is not known, and capsules along the links are taken in its place.
        mounted: (joint, obstacle) with a part always near, as the shoulder above its table, which is not checked.
        switched_off: whether the problem file asks for no checks (``cell: none``).
    """

    placed: PlacedCapsules
    obstacles: tuple[Obstacle, ...]
    margin: float
    own: tuple[Pair, ...]
    against: tuple[tuple[int, ...], ...]
    assumed: bool = False
    mounted: tuple[tuple[str, str], ...] = ()
    switched_off: bool = False

    @classmethod
    def of(cls, robot: Robot, cell: CellSpec | None, *, guessed: bool = False) -> Scene:
        """An arm of known shape is checked against itself and all obstacles; one of unknown shape against obstacles.

        Nothing is checked where the cell says so.

        Args:
            robot: with its shape, if it is known.
            cell: obstacles and clearance; None for neither.
            guessed: whether an arm of unknown shape is checked against itself too, with capsules along its links, and
                every arm with its tool, the line from the flange to the tool point: for postures that no one sees
                before the arm goes there.
        """
        asked = CellSpec() if cell is None else cell
        obstacles = asked.obstacles if asked.checked else ()
        assumed = (bool(obstacles) or guessed) and not robot.shape
        capsules = stand_in(robot) if assumed else robot.shape
        capsules += tool_line(robot) if guessed else ()
        placed = PlacedCapsules(robot, capsules if asked.checked else ())
        shown = [exposed(placed, obstacle, asked.clearance) for obstacle in obstacles]
        always = [
            (placed.capsules[k].joint, o.name) for o, (_, near) in zip(obstacles, shown, strict=True) for k in near
        ]
        own = () if assumed and not guessed else own_pairs(placed, asked.clearance)
        against = tuple(checked for checked, _ in shown)
        return cls(
            placed, obstacles, asked.clearance, own, against, assumed, tuple(dict.fromkeys(always)), not asked.checked
        )

    @property
    def robot(self) -> Robot:
        """The arm whose capsules are placed."""
        return self.placed.robot

    @property
    def explicit(self) -> bool:
        """Whether there are obstacles: then the search keeps clear of them from the beginning."""
        return any(self.against)

    @property
    def active(self) -> bool:
        """Whether anything is checked."""
        return bool(self.own) or any(self.against)

    @cached_property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """(k,) the two names of everything that `distances` holds, column by column."""
        joints = [capsule.joint for capsule in self.placed.capsules]
        own = [(joints[i], joints[j]) for i, j in self.own]
        others = zip(self.obstacles, self.against, strict=True)
        return (*own, *((joints[k], obstacle.name) for obstacle, chosen in others for k in chosen))

    def distances(self, Q: Array) -> Array:
        """(N, k) exact distance of every pair at the postures Q (N, n) [m].

        Zero or less where they overlap, but not how deep.
        """
        start, end = self.placed.segments(np.atleast_2d(Q))
        parts = [own_distances(self.placed, start, end, self.own)] if self.own else []
        parts += [
            obstacle_distances(self.placed, obstacle, start, end, chosen)
            for obstacle, chosen in zip(self.obstacles, self.against, strict=True)
            if chosen
        ]
        return np.hstack([np.zeros((len(start), 0)), *parts])

    def least(self, Q: Array) -> Array:
        """(N,) least distance at each of the postures Q (N, n) [m]; infinite where nothing is checked."""
        return np.asarray(np.min(self.distances(Q), axis=1, initial=np.inf)) if self.active else np.full(len(Q), np.inf)

    def clearance(self, Q: Array) -> Clearance | None:
        """The least distance over the postures Q (N, n) or (n,), and between which; None where nothing is checked."""
        if not self.active:
            return None
        least = self.distances(Q).min(axis=0)
        k = int(np.argmin(least))
        return Clearance(float(least[k]), self.pairs[k])

    def rows(self, q: ca.SX, obstacles: Sequence[Obstacle] | None = None) -> list[ClearanceRow]:
        """A lower bound of the least distance [m] to each obstacle, and of the arm to itself, at joint values ``q``
        (n,).

        Each is to be at least ``margin``. Where it is below that it is at most `smooth_bounds.BOUND_SLACK_M` below the
        true distance, and half of `smooth_bounds.SOFT_MINIMUM_WIDTH_M` for each doubling of pairs that are equally
        near. Pairs that thousands of random postures leave farther apart than the margin and `SEPARATION_M` have no
        part in it, and it never exceeds that.

        Args:
            q: (n,) joint values.
            obstacles: in place of those of the scene: the same ones, smaller or moved by symbols.
        """
        placed, near = self.placed.symbols(q), self._near_pairs
        found = []
        for obstacle, chosen in zip(obstacles or self.obstacles, self.against, strict=True):
            close = [k for k in chosen if near[k, obstacle.name]]
            bounds = [bound for k in close for bound in self._obstacle_bounds(placed[k], obstacle, k)]
            if bounds:
                found.append(self._clearance_row(f"clearance to {obstacle.name}", bounds))
        own = [pair for pair in self.own if near[pair]]
        if own:
            found.append(self._clearance_row(SELF_CLEARANCE_ROW, self._own_bounds(q, own)))
        return found

    def _obstacle_bounds(self, placed: Placed, obstacle: Obstacle, k: int) -> list[ca.SX]:
        """Lower bounds [m] of the distance of capsule k to an obstacle."""
        capsule = self.placed.capsules[k]
        return obstacle.bounds(*placed, capsule.length, capsule.radius)

    def _clearance_row(self, name: str, bounds: list[ca.SX]) -> ClearanceRow:
        """The soft minimum of bounds [m], bounded above by the margin and `SEPARATION_M`."""
        return ClearanceRow(name, soft_minimum([*bounds, ca.SX(self.margin + SEPARATION_M)]) - _ROW_TOLERANCE_M)

    @cached_property
    def _near_pairs(self) -> dict[tuple[int, int | str], bool]:
        """Which pairs of capsules, or of a capsule and an obstacle, random postures bring nearer than
        `SEPARATION_M`.
        """
        others = zip(self.obstacles, self.against, strict=True)
        keys: list[tuple[int, int | str]] = [*self.own]
        keys += [(k, obstacle.name) for obstacle, chosen in others for k in chosen]
        least = self.distances(random_postures(self.placed, _POSTURE_COUNT)).min(axis=0)
        return dict(zip(keys, (least < self.margin + SEPARATION_M).tolist(), strict=True))

    def _own_bounds(self, q: ca.SX, pairs: Sequence[Pair]) -> list[ca.SX]:
        """For every pair, seen from the frame of the first one: only joints between them take part."""
        frames, capsules = self.placed.frames, self.placed.capsules
        seen = {frame: self.placed.symbols(q, frame) for frame in {frames[i] for i, _ in pairs}}
        bounds = []
        for i, j in pairs:
            first, other, placed = capsules[i], capsules[j], seen[frames[i]]
            radius = first.radius + other.radius
            bounds.append(segment_bound(*placed[i], first.length, *placed[j], other.length, radius))
        return bounds
