"""Which capsules of an arm are checked against each other and against an obstacle, and how near they come."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.collision.segment_distances import to_segment
from posture_opt.numerics import Array, Json, Mask
from posture_opt.robot.posture import drawn_between


class Nearest(NamedTuple):
    """The least distance of some pairs."""

    distance: float  # [m]; zero or less where bodies overlap, but not how deep
    between: tuple[str, str]  # two joints, or a joint and an obstacle

    def to_json(self) -> dict[str, Json]:
        return {"distance": self.distance, "between": list(self.between)}


class Clearance(NamedTuple):
    """The least distances and where they are."""

    cell: Nearest | None  # of the arm to obstacles and mounting plane; None where it is checked against neither
    own: Nearest | None  # of the arm to itself; None where that is not checked

    @property
    def nearest(self) -> Nearest:
        return min((part for part in self if part is not None), key=lambda part: part.distance)

    @property
    def distance(self) -> float:
        return self.nearest.distance

    @property
    def between(self) -> tuple[str, str]:
        return self.nearest.between

    def to_json(self) -> dict[str, Json]:
        parts = {"cell": self.cell, "self": self.own}
        return {**self.nearest.to_json(), **{key: part and part.to_json() for key, part in parts.items()}}


Pair = tuple[int, int]
"""Indices of two capsules."""


class Checked(NamedTuple):
    """What is checked of some pairs."""

    chosen: tuple[int, ...]  # (k,) indices of the pairs that are checked
    required: tuple[float, ...]  # (k,) least distance [m] that each is to keep
    left_out: tuple[int, ...]  # indices of the pairs that overlap whatever the posture


def checked_pairs(distances: Array, clearance: float, still: Mask, joined: bool = True) -> Checked:
    """Pairs that are ever apart, from distances (N, k) [m]; ``still`` ones keep at most the median, in whole mm."""
    overlapping = still & joined & (distances < 0).all(axis=0)
    # A solver's bounds are up to 1 mm below the true distance.
    usual = np.floor((np.median(distances, axis=0) - 1e-3) * 1e3) / 1e3
    required = np.where(still, np.clip(usual, 0.0, clearance), clearance)
    chosen, left_out = np.flatnonzero(~overlapping), np.flatnonzero(overlapping)
    return Checked(tuple(chosen.tolist()), tuple(required[chosen].tolist()), tuple(left_out.tolist()))


def apart_pairs(placed: PlacedCapsules) -> tuple[Pair, ...]:
    """Pairs of capsules with a body between them, base first, that the robot's SRDF does not allow to touch."""
    bodies = placed.bodies
    allowed, owners = placed.robot.allowed_collisions, [capsule.joint for capsule in placed.capsules]
    count = range(len(bodies))
    return tuple(
        (i, j) if bodies[i] < bodies[j] else (j, i)
        for i in count
        for j in count[:i]
        if abs(bodies[i] - bodies[j]) > 1 and frozenset((owners[i], owners[j])) not in allowed
    )


def checked_own(placed: PlacedCapsules, pairs: Sequence[Pair], clearance: float, radii: Array) -> Checked:
    """Checked pairs of one arm, of capsules of ``radii`` (c,) [m]."""
    if not pairs:
        return Checked((), (), ())
    # A median of 1000 is known to 1.6 % of them.
    found = own_distances(radii, *placed.segments(random_postures(placed, 1000)), pairs)
    return checked_pairs(found, clearance, np.ones(len(pairs), dtype=bool))


def own_distances(radii: Array, start: Array, end: Array, pairs: Sequence[Pair]) -> Array:
    """(N, k) distance of pairs of segments (N, c, 3), (N, c, 3) less radii (c,) [m]; negative where they overlap."""
    first, second = (np.array(side, dtype=int) for side in zip(*pairs, strict=True))
    step = max(8000 // len(pairs), 1)  # of more, the arrays of vectors leave the cache
    blocks = [slice(k, k + step) for k in range(0, len(start), step)]
    between = [to_segment(start[b][:, first], end[b][:, first], start[b][:, second], end[b][:, second]) for b in blocks]
    every = np.concatenate([*between, np.zeros((0, len(pairs)))])
    return np.asarray(every - radii[first] - radii[second])


def checked_against(
    placed: PlacedCapsules, obstacle: Obstacle, moving: Sequence[int], clearance: float, carries: bool
) -> Checked:
    """Checked capsules against an obstacle; the first link, and what hardly moves, may keep less than the clearance."""
    if not moving:
        return Checked((), (), ())
    start, end = placed.segments(random_postures(placed, 1000))
    away = obstacle_distances(placed, obstacle, start, end, moving)
    # The first link turns on what the arm is mounted on; what varies by less than 50 mm belongs to the mount.
    still = (np.array([placed.bodies[k] for k in moving]) == 1) | (np.ptp(away, axis=0) <= 0.05)
    return checked_pairs(away, clearance, still, carries)


def moving_capsules(placed: PlacedCapsules, behind: int = 0) -> tuple[int, ...]:
    """Indices of capsules of bodies behind that number; 0 is the base, 1 the first link."""
    return tuple(k for k, body in enumerate(placed.bodies) if body > behind)


def obstacle_distances(
    placed: PlacedCapsules, obstacle: Obstacle, start: Array, end: Array, chosen: Sequence[int]
) -> Array:
    """(N, k) distance of chosen segments (N, c, 3), (N, c, 3) [m] to an obstacle less radii, world."""
    columns = list(chosen)
    return obstacle.distance(start[:, columns], end[:, columns]) - placed.radii[columns]


def random_postures(placed: PlacedCapsules, count: int) -> Array:
    """(count, n) postures [rad or m] within the limits, always the same ones."""
    rng = np.random.default_rng(0)
    return rng.uniform(*drawn_between(placed.robot), (count, placed.robot.n))
