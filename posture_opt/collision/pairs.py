"""Which capsules of an arm are checked against each other, and against an obstacle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.collision.segment_distances import to_segment
from posture_opt.numerics import Array, Mask
from posture_opt.robot.joint_ranges import drawn_between

_POSTURE_COUNT = 1000
"""Random postures: a median is then known to 1.6 % of them (one standard deviation)."""
_MOST_AT_ONCE = 8000
"""Distances that are computed together: of more, the arrays of vectors leave the cache."""
_HELD_BELOW_M = 1e-3
"""What is taken off a distance [m] that is held in place of the clearance, before it is rounded down: the bounds that
a solver keeps are up to so much below the true distance."""
_FIRST_BODY = 1
"""The body behind the first joint, which turns on what the arm is mounted on."""
_MOUNTED_RANGE_M = 0.05
"""A body whose distance to an obstacle varies by less than this [m] belongs to the mount."""

Pair = tuple[int, int]
"""Indices of two capsules."""


class Checked(NamedTuple):
    """What is checked of some pairs.

    Args:
        chosen: (k,) indices of the pairs that are checked.
        required: (k,) least distance [m] that each is to keep.
        left_out: indices of the pairs that overlap whatever the posture.
    """

    chosen: tuple[int, ...]
    required: tuple[float, ...]
    left_out: tuple[int, ...]


def checked_pairs(distances: Array, clearance: float, still: Mask, joined: bool = True) -> Checked:
    """Which pairs are checked, and the distance that each is to keep.

    A pair that is ever apart is checked. Of links that are near each other by design not all postures have the
    clearance; such a pair is asked for no more than half of all postures have, in whole millimetres.

    Args:
        distances: (N, k) of the pairs at random postures [m]; negative where they overlap.
        clearance: least distance to keep [m].
        still: (k,) whether a pair may be left out, or kept nearer than the clearance, at all.
        joined: whether bodies may overlap in every posture, as links of one arm, and an arm with what carries it.
    """
    overlapping = still & joined & (distances < 0).all(axis=0)
    usual = np.floor((np.median(distances, axis=0) - _HELD_BELOW_M) * 1e3) / 1e3
    required = np.where(still, np.clip(usual, 0.0, clearance), clearance)
    chosen = np.flatnonzero(~overlapping)
    return Checked(
        tuple(chosen.tolist()), tuple(required[chosen].tolist()), tuple(np.flatnonzero(overlapping).tolist())
    )


def apart_pairs(placed: PlacedCapsules) -> tuple[Pair, ...]:
    """Pairs of capsules of bodies with another body between them, nearer to the base first.

    Without those that the robot's SRDF does not check; the tool moves with the last joint and is always checked.
    """
    bodies = placed.bodies
    allowed, owners = placed.robot.allowed_collisions, [capsule.joint for capsule in placed.capsules]
    count = range(len(bodies))
    return tuple(
        (i, j) if bodies[i] < bodies[j] else (j, i)
        for i in count
        for j in count[:i]
        if _not_adjacent(bodies, i, j) and frozenset((owners[i], owners[j])) not in allowed
    )


def checked_own(placed: PlacedCapsules, pairs: Sequence[Pair], clearance: float, assumed: Array) -> Checked:
    """What is checked of pairs of capsules of an arm.

    Args:
        placed: the capsules of the arm; ``pairs`` (k,) of them.
        clearance: least distance to keep [m].
        assumed: (c,) what of each radius is assumed [m]: by that two bodies may overlap.
    """
    if not pairs:
        return Checked((), (), ())
    found = own_distances(placed, *placed.segments(random_postures(placed, _POSTURE_COUNT)), pairs)
    more = assumed[np.array(pairs)].sum(axis=1)
    checked = checked_pairs(found + more, clearance, np.ones(len(pairs), dtype=bool))
    return checked._replace(required=tuple((np.array(checked.required) - more[list(checked.chosen)]).tolist()))


def own_distances(placed: PlacedCapsules, start: Array, end: Array, pairs: Sequence[Pair]) -> Array:
    """(N, k) distance of the pairs [m]; negative where they overlap.

    Args:
        placed: the capsules, for their radii.
        start, end: (N, c, 3) their segments at N postures [m], world.
        pairs: (k,) which of them.
    """
    first, second = (np.array(side, dtype=int) for side in zip(*pairs, strict=True))
    step = max(_MOST_AT_ONCE // len(pairs), 1)
    blocks = [slice(k, k + step) for k in range(0, len(start), step)]
    between = [to_segment(start[b][:, first], end[b][:, first], start[b][:, second], end[b][:, second]) for b in blocks]
    return np.asarray(
        np.concatenate([*between, np.zeros((0, len(pairs)))]) - placed.radii[first] - placed.radii[second]
    )


def checked_against(
    placed: PlacedCapsules, obstacle: Obstacle, moving: Sequence[int], clearance: float, carries: bool
) -> Checked:
    """What is checked of capsules of an arm against an obstacle.

    What belongs to the first link, or keeps its distance within 50 mm, may be nearer to it than the clearance, and
    always touch what carries the arm: the shoulder above its table.

    Args:
        placed: the capsules of the arm; ``moving`` (k,) indices of those that may be checked.
        obstacle: in the world.
        clearance: least distance to keep [m].
        carries: whether the arm stands on it.
    """
    if not moving:
        return Checked((), (), ())
    start, end = placed.segments(random_postures(placed, _POSTURE_COUNT))
    away = obstacle_distances(placed, obstacle, start, end, moving)
    still = (np.array([placed.bodies[k] for k in moving]) == _FIRST_BODY) | (np.ptp(away, axis=0) <= _MOUNTED_RANGE_M)
    return checked_pairs(away, clearance, still, carries)


def moving_capsules(placed: PlacedCapsules, behind: int = 0) -> tuple[int, ...]:
    """Indices of the capsules of bodies behind the one of this number; 0 is the base, 1 the first link."""
    return tuple(k for k, body in enumerate(placed.bodies) if body > behind)


def obstacle_distances(
    placed: PlacedCapsules, obstacle: Obstacle, start: Array, end: Array, chosen: Sequence[int]
) -> Array:
    """(N, k) distance of some capsules to an obstacle [m]; zero or less where they overlap.

    Args:
        placed: the capsules, for their radii.
        obstacle: in the world.
        start, end: (N, c, 3) all their segments at N postures [m], world.
        chosen: (k,) indices of the capsules.
    """
    columns = list(chosen)
    return obstacle.distance(start[:, columns], end[:, columns]) - placed.radii[columns]


def _not_adjacent(bodies: Sequence[int], i: int, j: int) -> bool:
    """Whether two capsules are of bodies with another body between them."""
    return abs(bodies[i] - bodies[j]) > 1


def random_postures(placed: PlacedCapsules, count: int) -> Array:
    """(count, n) postures [rad or m] within the limits, always the same ones."""
    rng = np.random.default_rng(0)
    return rng.uniform(*drawn_between(placed.robot), (count, placed.robot.n))
